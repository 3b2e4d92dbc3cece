"""A hidden effect is found in a recorded cycle, put into the twin, and then nothing is left to find."""

from pathlib import Path

import pytest
from click.testing import CliRunner
from small_cycle import BENCH, fast, files_for, run_cycle, write_files

from arl_fixtures.cli.observe import observe_command
from arl_fixtures.reconcile.command import reconcile

HIDDEN = """
schema: arl-model/1
effects:
- effect: timing.temperature_offset
  options: {channel: distance_m, temperature: tof_temperature_c, kind: offset, reference: 34.0}
  values: {slope: 0.0003, bend: 0.0}
  channels: [distance_m]
  drivers: [tof_temperature_c]
"""
PROFILE = """
name: small
load_cycle: {temperatures_c: [80, 67, 53, 40, 47, 60]}
angles: {from_deg: -12, to_deg: 12, step_deg: 12}
frames: 8
reference_c: 80
"""


def observe(folder: Path, out: str, *model: str) -> Path:
    """The observation table of the recorded cycle."""
    table = folder / out
    options = ["--bench", str(folder / "bench.yaml"), "--pixels", "4-123/24,3-28/12", "--out", str(table)]
    result = CliRunner().invoke(observe_command, [str(folder / "out"), *options, *model], catch_exceptions=False)
    assert result.exit_code == 0, result.stderr
    return table


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a cycle on an emulated bench with the hidden effect."""
    folder = tmp_path_factory.mktemp("repair")
    (folder / "hidden.yaml").write_text(HIDDEN, encoding="utf-8")
    bench = BENCH.replace("emulation:\n", "emulation:\n  effects: hidden.yaml\n")
    bench = bench.replace("{limit_s:g}", "20000")
    options = write_files(folder, bench=bench)
    (folder / "profile.yaml").write_text(PROFILE, encoding="utf-8")
    with fast():
        ended = run_cycle(files_for(options, folder / "out", {}))
    assert ended.over == "", ended.over
    return folder


def test_the_twin_with_the_found_effect_agrees_with_the_recording(recorded: Path) -> None:
    """Found, named, given back: consistent."""
    first = reconcile(observe(recorded, "first.parquet"), recorded / "first")
    assert [f.effect for f in first.findings] == ["timing.temperature_offset"]
    slope = first.findings[0].parameters[0]
    assert slope.low < 0.0003 < slope.high
    repaired = observe(recorded, "second.parquet", "--model", str(recorded / "first"))
    second = reconcile(repaired, recorded / "second")
    assert (second.verdict, [f.statement for f in second.findings]) == ("consistent", [])
