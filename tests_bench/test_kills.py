"""SIGKILL at random instants of a whole cycle, then `--resume`: the same steps, bags and values as undisturbed.

The embedded bench: hardware and guard live in the process that dies. `test_guarded_kills.py` kills with guard and
hardware outside. Real processes die: at a random bench time, at a random moment of the wall clock, and in the middle
of a random call that writes, syncs or renames, where half of the bytes are written and the rest never.
"""

from __future__ import annotations

import random
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from arl_fixtures.bench.bench import Bench
from arl_fixtures.bench.build import Emulated
from arl_fixtures.journal.record import SessionRecord, read_journal
from arl_fixtures.plugin.setup import SessionFiles
from tests_bench.killed_cycles import (
    check_equal,
    count_ways,
    die,
    finished_before,
    in_child,
    journals,
    past_of,
    storage_calls,
    whole_lines,
)
from tests_bench.small_cycle import fast, files_for, run_cycle, write_files

SECOND_KILL = 0.3
MODES = ("bench time", "storage call", "wall clock")


@dataclass
class Undisturbed:
    """The cycle as it is when nobody dies."""

    record: SessionRecord
    bench_s: float
    storage_calls: int
    wall_s: float


@dataclass
class Stand:
    """Where cycles run and die."""

    folder: Path
    whole: Undisturbed
    new_out: Callable[[], SessionFiles]


@pytest.fixture(scope="module")
def stand(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stand]:
    """An undisturbed cycle, and room for others."""
    folder = tmp_path_factory.mktemp("kills")
    options = write_files(folder)
    known: dict[str, SessionFiles] = {}
    numbers = iter(range(1_000_000))
    with fast():
        # what is rendered here the children need not render; the threads of these cycles have ended
        run_cycle(files_for(options, folder / "warm", known))
        start_s = time.monotonic()
        with storage_calls() as count:
            ended = run_cycle(files_for(options, folder / "whole", known))
        wall_s = time.monotonic() - start_s
        assert set(ended.verdicts.values()) == {"PASS"}
        whole = Undisturbed(ended.record, ended.bench_s, count[0], wall_s)
        yield Stand(folder, whole, lambda: files_for(options, folder / f"out-{next(numbers)}", known))


def killed(stand: Stand, files: SessionFiles, chance: random.Random, mode: str) -> int:
    """One session, new or resumed, that is killed somewhere; returns its exit status."""
    whole = stand.whole
    at_s = chance.uniform(0.0, whole.bench_s)
    call = chance.randint(1, whole.storage_calls) if mode == "storage call" else -1

    def work() -> None:
        past = past_of(files.options.out)

        def look(world: Emulated, _bench: Bench) -> None:
            if mode == "bench time":
                world.clock.at(past.start_s + at_s, die)

        with storage_calls(call):
            run_cycle(files, past=past, look=look)

    return in_child(work, kill_after_s=chance.uniform(0.0, whole.wall_s) if mode == "wall clock" else None)


def resumed(files: SessionFiles) -> SessionRecord:
    """Go on to the end, in a process of its own."""
    assert in_child(lambda: end_it(files)) == 0
    return read_journal(journals(files.options.out)[-1])


def end_it(files: SessionFiles) -> None:
    """The rest of the cycle; nothing may be left to be said."""
    ended = run_cycle(files, past=past_of(files.options.out))
    assert ended.over == "", ended.over
    assert ended.unsafe == []


def trial(stand: Stand, seed: int) -> str:
    """Kill, perhaps kill again, go on, compare; returns how it died."""
    chance = random.Random(seed)
    mode = MODES[seed % len(MODES)]
    files = stand.new_out()
    out = files.options.out
    status = killed(stand, files, chance, mode)
    # how far it came before it died for the first time: only those steps ran at the same bench times
    untouched = finished_before(out)
    if status == 0:
        untouched = set(stand.whole.record.steps)
    elif chance.random() < SECOND_KILL:
        mode += ", twice"
        killed(stand, files, chance, "bench time")
    said = whole_lines(out)
    record = resumed(files)
    assert whole_lines(out).startswith(said), "a line of the journal was changed"
    check_equal(stand.whole.record, record, untouched=untouched)
    return mode if status else "not at all"


@pytest.mark.parametrize("seed", range(12))
def test_a_killed_cycle_resumed_is_an_undisturbed_one(stand: Stand, seed: int) -> None:
    """A sample."""
    trial(stand, seed)


@pytest.mark.slow
def test_two_hundred_killed_cycles(stand: Stand) -> None:
    """All of them."""
    count_ways(lambda seed: trial(stand, seed), range(1000, 1200))
