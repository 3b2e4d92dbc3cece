"""SIGKILL at random instants of a whole cycle, then `--resume`: the same steps, bags and values as undisturbed.

Real processes die: at a random bench time, at a random moment of the wall clock, and in the middle of a random call
that writes, syncs or renames, where half of the bytes are written and the rest never.
"""

from __future__ import annotations

import contextlib
import os
import random
import select
import signal
import sys
import time
import traceback
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from unittest import mock

import pytest

from arl_fixtures.bench.bench import Bench
from arl_fixtures.bench.build import Emulated
from arl_fixtures.journal.record import SessionRecord, read_journal
from arl_fixtures.plugin.resume import Past
from arl_fixtures.plugin.setup import SessionFiles
from arl_fixtures.recording.bag_folder import verify
from tests_bench.small_cycle import fast, files_for, run_cycle, write_files

PATIENCE_S = 120.0
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


def in_child(work: Callable[[], None], *, kill_after_s: float | None = None) -> int:
    """Run `work` in a process of its own, perhaps killed on the way; returns its exit status, −9 if it was killed."""
    pid = os.fork()
    if not pid:
        status = 70
        try:
            work()
            status = 0
        except BaseException:
            traceback.print_exc()
            sys.stderr.flush()
        finally:
            os._exit(status)
    deadline_s = time.monotonic() + (PATIENCE_S if kill_after_s is None else kill_after_s)
    while True:
        done, status = os.waitpid(pid, os.WNOHANG)
        if done:
            return os.waitstatus_to_exitcode(status)
        if time.monotonic() >= deadline_s:
            os.kill(pid, signal.SIGKILL)
            _, status = os.waitpid(pid, 0)
            assert kill_after_s is not None, "the cycle hung"
            return os.waitstatus_to_exitcode(status)
        select.select([], [], [], 0.002)


def die() -> None:
    """As from outside: nothing is cleaned up."""
    os.kill(os.getpid(), signal.SIGKILL)


@contextlib.contextmanager
def storage_calls(at_call: int = -1) -> Iterator[list[int]]:
    """Count calls that touch the disk; in the one with number `at_call` the process dies half-way."""
    count = [0]
    write, replace = os.write, os.rename

    def turn() -> bool:
        count[0] += 1
        return count[0] == at_call

    def dying_write(descriptor: int, data: Any) -> int:
        if turn():
            write(descriptor, memoryview(data)[: len(data) // 2])
            die()
        return write(descriptor, data)

    def around(call: Callable[..., Any]) -> Callable[..., Any]:
        def dying(*arguments: Any, **options: Any) -> Any:
            if turn():
                # before or after: both happen
                if count[0] % 2:
                    call(*arguments, **options)
                die()
            return call(*arguments, **options)

        return dying

    with (
        mock.patch.object(os, "write", dying_write),
        mock.patch.object(os, "fdatasync", around(os.fdatasync)),
        mock.patch.object(os, "fsync", around(os.fsync)),
        mock.patch.object(os, "rename", around(replace)),
        mock.patch.object(os, "replace", around(os.replace)),
        mock.patch("arl_fixtures.recording.bag_folder.fsync", around(os.fsync)),
    ):
        yield count


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
        past = past_of(files)

        def look(world: Emulated, _bench: Bench) -> None:
            if mode == "bench time":
                world.clock.at(past.start_s + at_s, die)

        with storage_calls(call):
            run_cycle(files, past=past, look=look)

    return in_child(work, kill_after_s=chance.uniform(0.0, whole.wall_s) if mode == "wall clock" else None)


def past_of(files: SessionFiles) -> Past:
    """What the sessions before have left; nothing when they died before they could begin."""
    begun = any(path.stat().st_size for path in files.options.out.glob("session-*.jsonl"))
    return Past.of(files.options.out, resume=begun)


def finished_before(files: SessionFiles) -> set[str]:
    """Steps that were finished when the session died."""
    paths = sorted(files.options.out.glob("session-*.jsonl"))
    if not paths or not paths[-1].read_bytes().count(b"\n"):
        return set()
    return {step.step_id for step in read_journal(paths[-1]).steps.values() if step.finished}


def resumed(files: SessionFiles) -> SessionRecord:
    """Go on to the end, in a process of its own."""
    assert in_child(lambda: end_it(files)) == 0
    return read_journal(sorted(files.options.out.glob("session-*.jsonl"))[-1])


def end_it(files: SessionFiles) -> None:
    """The rest of the cycle; nothing may be left to be said."""
    ended = run_cycle(files, past=past_of(files))
    assert ended.over == "", ended.over
    assert ended.unsafe == []


def check_equal(stand: Stand, files: SessionFiles, record: SessionRecord, untouched: set[str]) -> None:
    """Steps, bags and values of a resumed cycle are those of the undisturbed one."""
    whole = stand.whole.record
    assert set(record.steps) == set(whole.steps)
    assert record.end is not None
    assert record.end.verdict == "PASS"
    for step_id, step in record.steps.items():
        (done,) = [attempt for attempt in step.attempts if attempt.finished]
        (was,) = [attempt for attempt in whole.steps[step_id].attempts if attempt.finished]
        assert done.bag is not None
        assert was.bag is not None
        verify(record.bag_path(done.bag), done.bag.sha256)
        assert done.bag.message_count == pytest.approx(was.bag.message_count, rel=0.2)
        assert done.verdict == was.verdict
        keys = [[(each.dut, each.metric, each.scope) for each in one.measurements] for one in (done, was)]
        assert keys[0] == keys[1]
        judged = [[(each.dut, each.metric, each.verdict) for each in one.judgements] for one in (done, was)]
        assert judged[0] == judged[1]
        if step_id in untouched and done.begin.attempt == 1:
            assert done.bag.sha256 == was.bag.sha256
            values = [[(each.value, each.u, each.reason) for each in one.measurements] for one in (done, was)]
            assert values[0] == values[1]
    bags = {path.name for path in (files.options.out / "bags").iterdir()}
    kept = {name for name in bags if not name.endswith((".part", ".recovered"))}
    assert len(kept) == len(record.steps), "one whole bag per step"


def trial(stand: Stand, seed: int) -> str:
    """Kill, perhaps kill again, go on, compare; returns how it died."""
    chance = random.Random(seed)
    mode = MODES[seed % len(MODES)]
    files = stand.new_out()
    status = killed(stand, files, chance, mode)
    # how far it came before it died for the first time: only those steps ran at the same bench times
    untouched = finished_before(files)
    if status == 0:
        untouched = set(stand.whole.record.steps)
    elif chance.random() < SECOND_KILL:
        mode += ", twice"
        killed(stand, files, chance, "bench time")
    check_equal(stand, files, resumed(files), untouched)
    return mode if status else "not at all"


@pytest.mark.parametrize("seed", range(20))
def test_a_killed_cycle_resumed_is_an_undisturbed_one(stand: Stand, seed: int) -> None:
    """A sample."""
    trial(stand, seed)


@pytest.mark.slow
def test_two_hundred_killed_cycles(stand: Stand) -> None:
    """All of them; the count of each way to die is printed with -s."""
    ways: dict[str, int] = {}
    for seed in range(1000, 1200):
        way = trial(stand, seed)
        ways[way] = ways.get(way, 0) + 1
        sys.stdout.write(".")
        sys.stdout.flush()
    sys.stdout.write(f"\nkilled cycles: {ways}\n")
    assert sum(count for way, count in ways.items() if way != "not at all") >= 150
