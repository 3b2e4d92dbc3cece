"""What an installed package needs is in the package, and what the user edits is the same file."""

import tomllib
from fnmatch import fnmatch
from pathlib import Path

import pytest

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
