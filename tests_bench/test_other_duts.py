"""A DUT that was exchanged: nothing is ever recorded under another one's serial number."""

from __future__ import annotations

from pathlib import Path

import pytest

from arl_fixtures.bench.bench import Bench
from arl_fixtures.bench.build import Emulated
from arl_fixtures.emulators.dut import DutEmulator
from arl_fixtures.plugin.setup import SessionFiles
from tests_bench.killed_cycles import past_of
from tests_bench.small_cycle import fast, files_for, run_cycle, write_files

SAID = "DUTs are not those of bench 'small': 'SN-OTHER' instead of 'ARL-EMU-0002'"
FIRST, SECOND = "c0000-00-up+81C", "c0000-01-up+82.5C"


def exchange(world: Emulated) -> None:
    """Another unit at the same place, with the same address."""
    unit = world.duts[1]
    assert isinstance(unit, DutEmulator)
    unit._dut = unit._dut.model_copy(update={"serial": "SN-OTHER"})


@pytest.fixture
def files(tmp_path: Path) -> SessionFiles:
    """Of a small cycle."""
    return files_for(write_files(tmp_path), tmp_path / "out", {})


def test_a_session_does_not_begin_on_another_dut(files: SessionFiles) -> None:
    """It names both; nothing is recorded."""
    with fast():
        ended = run_cycle(files, look=lambda world, _bench: exchange(world))
    assert ended.over == f"did not start: {SAID}"
    assert ended.record.steps == {}
    assert ended.unsafe == []


def test_one_that_was_exchanged_under_way_ends_the_session_and_the_right_one_goes_on(files: SessionFiles) -> None:
    """What it delivered is no step's."""
    with fast():
        whole = run_cycle(files_for(files.options, files.options.out / "whole", {}))
        begins = [line.time_s for line in whole.record.lines if line.entry.type == "step_begin"]

        def look(world: Emulated, _bench: Bench) -> None:
            world.clock.at(begins[2] + 1.0, lambda: exchange(world))

        ended = run_cycle(files, look=look)
        assert SAID in ended.over
        assert ended.verdicts[FIRST] == "PASS"
        assert [each.finished for each in ended.record.steps[SECOND].attempts] == [False]
        assert not ended.record.steps[SECOND].attempts[0].measurements
        resumed = run_cycle(files, past=past_of(files.options.out))
    assert set(resumed.verdicts.values()) == {"PASS"}
    assert [each.finished for each in resumed.record.steps[SECOND].attempts] == [False, True]
