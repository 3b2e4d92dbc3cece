"""What an installed package needs is in it; what the user writes is found, and complained of with its place."""

import tomllib
from fnmatch import fnmatch
from pathlib import Path

import pytest

from arl_fixtures.bench.config import BUILT_IN, bench_path, load_bench
from arl_fixtures.bench.emulated_file import bench_file_for
from arl_fixtures.errors import ConfigError
from arl_fixtures.metrics.limits import limits_path

ROOT = Path(__file__).parents[2]


def test_every_file_of_the_package_goes_into_the_wheel():
    setup = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    patterns = [*setup["tool"]["setuptools"]["package-data"]["*"], "*.py"]
    there = (path for path in (ROOT / "arl_fixtures").rglob("*") if path.is_file())
    files = [path for path in there if "__pycache__" not in path.parts]
    left_behind = [path.name for path in files if not any(fnmatch(path.name, pattern) for pattern in patterns)]
    assert len(files) > 200
    assert left_behind == []


def test_the_limits_at_the_top_of_the_project_are_the_package_s_own():
    assert (ROOT / "limits" / "default.yaml").samefile(limits_path("default"))


def test_limits_are_a_file_or_a_name():
    assert limits_path("mine/limits.yaml") == Path("mine/limits.yaml")
    with pytest.raises(ConfigError, match=r"no limits 'stict'; known are default, strict"):
        limits_path("stict")


def test_a_bench_that_is_partly_there_keeps_the_addresses_it_has(tmp_path):
    bench = tmp_path / "bench.yaml"
    text = bench_path("emulated").read_text(encoding="utf-8").replace("../duts", str(BUILT_IN.parent / "duts"))
    text = text.replace("clock: virtual", "clock: real").replace(
        "huber_pb, url: emulated", "huber_pb, url: tcp://h:1"
    )
    bench.write_text(text, encoding="utf-8")
    served = {kind: f"tcp://127.0.0.1:{port}" for port, kind in enumerate(("thermometer", "stage", "relays"))}
    run = tmp_path / "run.yaml"
    run.write_text(bench_file_for(str(bench), served), encoding="utf-8")
    urls = {kind: entry.url for kind, entry in load_bench(str(run)).devices().items()}
    assert urls == {"chiller": "tcp://h:1", **served, "duts": "udp://127.0.0.1"}


def test_a_driver_nobody_announced_is_named_with_its_place(tmp_path):
    bench = tmp_path / "bench.yaml"
    text = bench_path("emulated").read_text(encoding="utf-8").replace("huber_pb", "hubr_pb")
    bench.write_text(text, encoding="utf-8")
    line = next(number for number, each in enumerate(text.splitlines(), start=1) if "hubr_pb" in each)
    with pytest.raises(ConfigError, match=rf"bench.yaml:{line}:19: chiller.driver: unknown driver 'hubr_pb'"):
        load_bench(str(bench))
