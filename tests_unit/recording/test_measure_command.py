"""`arl measure`: recorded steps measured again from their bags, whole or not, as their user meets it."""

from __future__ import annotations

import csv
import hashlib
import io
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from arl_fixtures.bench.config import BUILT_IN, load_bench
from arl_fixtures.bench.keep import keep_bench, keep_file
from arl_fixtures.cli import arl
from arl_fixtures.errors import ConfigError, DataError
from arl_fixtures.metrics.conditions import Conditions
from arl_fixtures.metrics.geometry import GeometryCache
from arl_fixtures.metrics.judge import judge
from arl_fixtures.metrics.limits import load_limits
from arl_fixtures.metrics.reference import Reference
from arl_fixtures.metrics.registry import measure, remember
from arl_fixtures.metrics.simulated import simulated_blocks
from arl_fixtures.metrics.statistics import SweepStatistics
from arl_fixtures.metrics.step import StepData
from arl_fixtures.recording.metadata import StepMetadata
from arl_fixtures.recording.writer import StepBagWriter
from arl_fixtures.twin.frame import Renderer

LIMITS = Path(__file__).parents[2] / "limits" / "default.yaml"
STEP_DEG, ANGLES = 3.6, 34
PROFILE = f"""
name: sparse
load_cycle: {{temperatures_c: [25]}}
angles: {{from_deg: -60, to_deg: {-60 + STEP_DEG * (ANGLES - 1)}, step_deg: {STEP_DEG}, order: ascending}}
"""
START_NS = 1_767_225_600_000_000_000


def sha256(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


@pytest.fixture(scope="module")
def session(tmp_path_factory):
    """The output folder of a session of one step and two DUTs, and what was measured while it was recorded."""
    folder = tmp_path_factory.mktemp("session")
    profile = folder / "sparse.yaml"
    profile.write_text(PROFILE)
    for name in ("top", "middle"):
        shutil.copy(BUILT_IN.parent / "duts" / f"emulated-{name}.yaml", folder)
    text = (BUILT_IN / "emulated.yaml").read_text().replace("../duts/", "").replace(", emulated-bottom.yaml", "")
    (folder / "bench.yaml").write_text(text.replace("[2, 3, 4]", "[2, 3]"))
    bench, limits, out = load_bench(str(folder / "bench.yaml")), load_limits(LIMITS), folder / "out"
    keep_bench(bench, out)
    keep_file(profile, sha256(profile), "profile", out)
    keep_file(LIMITS, sha256(LIMITS), "limits", out)
    metadata = StepMetadata(
        campaign="c", cycle=0, step=0, step_id="c0000-00-up+25C", attempt=1, set_temperature_c=25.0, ramp=1,
        started_utc_ns=START_NS, duts=tuple(dut.serial for dut in bench.dut_settings), software_version="0",
        bench_sha256=bench.sha256, profile_sha256=sha256(profile), limits_sha256=sha256(LIMITS),
    )  # fmt: skip
    conditions = Conditions(set_temperature_c=25.0, temperatures_c={"T2": 25.1})
    live, sweeps = [], {dut.serial: SweepStatistics(dut.serial) for dut in bench.dut_settings}
    angles_deg = [-60.0 + STEP_DEG * k for k in range(ANGLES)]
    with StepBagWriter(out / "bags" / metadata.step_id, metadata) as bag:
        bag.temperatures(START_NS, {"T2": 25.1})
        blocks = (
            simulated_blocks(Renderer(dut, bench.scene), angles_deg, seed=k)
            for k, dut in enumerate(bench.dut_settings)
        )
        for row in zip(*blocks, strict=True):
            for each in row:
                block = replace(each, time_ns=START_NS + each.angle_index * 10**9 + np.arange(10) * 40_000_000)
                if each is row[0]:
                    bag.stage(int(block.time_ns[0]), block.stage_angle_deg)
                bag.block(block)
                sweeps[block.dut].add(block)
        bag.close()
    for dut in bench.dut_settings:
        sweep = sweeps[dut.serial].summary()
        step = StepData(
            dut=dut,
            conditions=conditions,
            sweep=sweep,
            geometry=GeometryCache(dut, bench.scene).at(sweep.stage_angle_deg),
            expected_angles=ANGLES,
            uncertainty=bench.uncertainty,
        )
        step.reference = remember(step)
        (out / "references").mkdir(exist_ok=True)
        step.reference.save(out / "references" / f"{dut.serial}.npz")
        live += measure(step)
    return out, judge(live, limits, conditions, {dut.serial: dut.model for dut in bench.dut_settings})


@pytest.fixture
def out(session, tmp_path):
    """A copy that may be spoilt."""
    shutil.copytree(session[0], tmp_path / "out")
    return tmp_path / "out"


def told(*arguments: object) -> str:
    result = CliRunner().invoke(arl, ["measure", *(str(each) for each in arguments)], catch_exceptions=False)
    assert result.exit_code == 0
    return result.output


def test_values_and_verdicts_are_those_of_the_session(session):
    out, live = session
    rows = list(csv.DictReader(io.StringIO(told(out, "--csv"))))
    found = [
        (row["dut"], row["metric"], row["scope"], row["value"], row["u"], row["verdict"], row["reason"])
        for row in rows
    ]
    expected = []
    for each in live:
        of = each.measurement
        numbers = ("", "") if of.quantity is None else (repr(float(of.quantity.value)), repr(float(of.quantity.u)))
        expected.append((of.dut, of.metric, of.scope, *numbers, each.verdict.value, each.reason))
    assert found == expected
    assert sum(row["value"] != "" for row in rows) > 180
    assert told(out) == "c0000-00-up+25C PASS\nPASS: 1 step\n"


def test_a_cut_bag_is_measured_as_far_as_it_goes(out):
    (file,) = out.glob("bags/*/*.mcap")
    file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])
    lines = told(out).splitlines()
    assert lines[0].startswith("c0000-00-up+25C INVALID: ARL-EMU-0001 ")
    assert "of 34 stage angles recorded" in lines[0]
    assert f"{file.name}: is cut short" in lines[0]
    assert str(out) not in lines[0]
    rows = csv.DictReader(io.StringIO(told(out, "--csv")))
    assert any(row["value"] and row["metric"] == "operating" for row in rows)


def test_the_reference_of_another_dut_costs_the_changes_of_one_dut_alone(out):
    shutil.copy(out / "references" / "ARL-EMU-0002.npz", out / "references" / "ARL-EMU-0001.npz")
    lines = told(out).splitlines()
    reason = "the reference was recorded from DUT ARL-EMU-0002, not ARL-EMU-0001"
    assert lines[0] == f"c0000-00-up+25C INVALID: ARL-EMU-0001 power_centroid_shift[azimuth]: {reason}"
    assert lines[1] == f"  ARL-EMU-0001 INVALID: {reason}"
    assert "power_change" in lines[2]
    assert "power_level" not in lines[2]
    assert lines[3:] == ["INVALID: 1 step"]


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04"])
def test_a_damaged_reference_is_named_and_no_reference_is_another_thing(out, content):
    (out / "references" / "ARL-EMU-0001.npz").write_bytes(content)
    (out / "references" / "ARL-EMU-0002.npz").unlink()
    lines = told(out).splitlines()
    assert lines[1].startswith("  ARL-EMU-0001 INVALID: the reference (unreadable): ARL-EMU-0001.npz: not a ref")
    assert lines[3] == "  ARL-EMU-0002 NOT_RUN: no reference recorded yet"


def test_an_expired_reference_is_refused(out):
    path = out / "references" / "ARL-EMU-0001.npz"
    replace(Reference.load(path), valid_until_utc_ns=START_NS - 86_400_000_000_000).save(path)
    assert "ARL-EMU-0001 INVALID: the reference (cycle 0, step 0, 25 degC) expired 1.0 days before" in told(out)


def test_a_bag_of_an_unknown_dut_or_without_its_index_says_so_and_the_next_one_is_measured(out):
    (bag,) = (out / "bags").iterdir()
    shutil.copytree(bag, out / "bags" / "later")
    bench = (BUILT_IN / "emulated.yaml").read_text().replace("../duts/emulated-middle.yaml, ", "")
    other = out / "other.yaml"
    other.write_text(bench.replace("../duts/", f"{BUILT_IN.parent}/duts/").replace("[2, 3, 4]", "[2, 3]"))
    lines = told(out, "--bench", other).splitlines()
    assert len(lines) == 3
    assert "the bench file describes no DUT ARL-EMU-0002, only ARL-EMU-0001, ARL-EMU-0003" in lines[0]
    assert lines[2] == "INVALID: 2 steps"
    result = CliRunner().invoke(arl, ["measure", str(out), "--bench", str(other), "--csv"], catch_exceptions=False)
    assert len(result.stdout.splitlines()) == 1
    assert result.stderr.count("the bench file describes no DUT ARL-EMU-0002") == 2


def test_what_cannot_be_measured_at_all_is_one_line(out, tmp_path):
    (bag,) = (out / "bags").iterdir()
    cases = {
        tmp_path / "nowhere": "there is no such folder",
        tmp_path: "holds no finished bag",
    }
    for path, why in cases.items():
        with pytest.raises(DataError, match=why):
            told(path)
    (bag / "metadata.yaml").unlink()
    with pytest.raises(DataError, match=r"metadata\.yaml is missing; keep what is whole with `arl recover`"):
        told(bag)


def test_limits_of_nothing_and_limits_that_were_not_kept_are_refused(out, tmp_path):
    path = tmp_path / "limits.yaml"
    path.write_text(
        "name: mine\nversion: 1\nlimits:\n  - {metric: distance_eror, unit: '%', upper: 1, reason: typing error}\n"
    )
    with pytest.raises(ConfigError, match=r"yaml:4:14: .*no metric 'distance_eror'; did you mean 'distance_error'"):
        told(out, "--limits", path)
    for kept in out.glob("inputs/limits-*"):
        kept.unlink()
    assert told(out).startswith("c0000-00-up+25C INVALID: ")
    assert "the limits that the bag names are not kept there (--limits FILE)" in told(out)
