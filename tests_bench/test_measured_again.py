"""What a session measured while it ran is what its bags say afterwards, to the last digit."""

from __future__ import annotations

import csv
import io
from pathlib import Path
from unittest import mock

from click.testing import CliRunner

from arl_fixtures.bench.build import Emulated
from arl_fixtures.cli import arl
from arl_fixtures.journal.record import AttemptRecord
from arl_fixtures.metrics.geometry import Geometry
from tests_bench.small_cycle import fast, files_for, run_cycle, write_files


def judged(attempt: AttemptRecord) -> list[tuple[str, ...]]:
    """As `arl measure --csv` writes it."""
    values = {(each.dut, each.metric, each.scope): each for each in attempt.measurements}
    rows = []
    for each in attempt.judgements:
        value = values.get((each.dut, each.metric, each.scope))
        number = u = ""
        if value is not None and value.value is not None:
            number, u = repr(value.value), repr(value.u)
        place = (attempt.begin.step_id, str(attempt.begin.attempt), each.dut, each.metric, each.scope)
        rows.append((*place, number, u, each.verdict, each.reason))
    return rows


def test_a_cycle_measured_again_is_the_same(tmp_path: Path) -> None:
    """Values, uncertainties, verdicts and reasons."""
    with fast():
        ended = run_cycle(files_for(write_files(tmp_path), tmp_path / "out", {}))
    assert ended.over == ""
    result = CliRunner().invoke(arl, ["measure", str(ended.out), "--csv"], catch_exceptions=False)
    found = [
        (
            *(row[name] for name in ("step", "attempt", "dut", "metric", "scope", "value", "u")),
            row["verdict"],
            row["reason"],
        )
        for row in csv.DictReader(io.StringIO(result.output))
    ]
    planned = ended.record.begin.plan
    live = [row for step in planned for each in ended.record.steps[step].attempts for row in judged(each)]
    assert found == live
    assert sum(row[5] != "" for row in found) > 100


def test_what_the_twins_expect_is_had_while_the_stage_turns_back(tmp_path: Path) -> None:
    """Once a sweep for each DUT, at the angles that were recorded, with the stage on its way."""
    worlds: list[Emulated] = []
    seen: list[tuple[str, tuple[float, ...], bool]] = []

    def expect(geometry: Geometry) -> None:
        clock, plant = worlds[0].clock, worlds[0].plant
        clock.sleep(0.1)
        plant.advance(clock.now_s)
        at_rest = plant.stage_at_rest(clock.now_s - 0.05, clock.now_s)
        seen.append((geometry.dut.serial, tuple(geometry.stage_angle_deg.tolist()), at_rest))

    with fast(), mock.patch("arl_fixtures.plugin.step_runner.expect", expect):
        files = files_for(write_files(tmp_path), tmp_path / "out", {})
        ended = run_cycle(files, look=lambda world, _bench: worlds.append(world))
    serials = [dut.serial for dut in files.bench.dut_settings]
    assert [serial for serial, _, _ in seen] == serials * (1 + len(ended.record.begin.plan))
    assert {angles for _, angles, _ in seen} == {(-9.0, 0.0, 9.0)}
    assert not any(at_rest for _, _, at_rest in seen)
