"""What both kill tests share: processes that really die, and what a cycle must be like that was resumed."""

from __future__ import annotations

import contextlib
import math
import mmap
import os
import select
import signal
import sys
import time
import traceback
from collections.abc import Callable, Iterator, MutableSequence
from pathlib import Path
from typing import Any
from unittest import mock

import pytest

from arl_fixtures.journal.record import SessionRecord, read_journal
from arl_fixtures.plugin.resume import Past
from arl_fixtures.recording.bag_folder import verify
from tests_bench.small_cycle import SETTLE_TOLERANCE_K

PATIENCE_S = 600.0
LARGEST_SIGMA = 8.0
"""How far values of a repeated sweep may lie apart, in their own standard uncertainty: thousands are compared."""


def in_child(work: Callable[[], None], *, kill_after_s: float | None = None) -> int:
    """Run `work` in a process of its own, perhaps killed on the way; returns its exit status, −9 if it was killed."""
    pid = fork(work)
    try:
        return wait_for(pid, PATIENCE_S if kill_after_s is None else kill_after_s)
    except TimeoutError:
        os.kill(pid, signal.SIGKILL)
        _, status = os.waitpid(pid, 0)
        assert kill_after_s is not None, "the cycle hung"
        return os.waitstatus_to_exitcode(status)


def fork(work: Callable[[], None]) -> int:
    """Start `work` in a process of its own; returns its number."""
    pid = os.fork()
    if pid:
        return pid
    status = 70
    try:
        work()
        status = 0
    except SystemExit as end:
        status = int(end.code or 0)
    except BaseException:
        traceback.print_exc()
        sys.stderr.flush()
    finally:
        os._exit(status)


def wait_for(pid: int, patience_s: float = PATIENCE_S) -> int:
    """Exit status of a child.

    Raises:
        TimeoutError: it did not end in time.
    """
    deadline_s = time.monotonic() + patience_s
    while time.monotonic() < deadline_s:
        done, status = os.waitpid(pid, os.WNOHANG)
        if done:
            return os.waitstatus_to_exitcode(status)
        select.select([], [], [], 0.002)
    raise TimeoutError(f"process {pid} did not end")


def die() -> None:
    """As from outside: nothing is cleaned up."""
    os.kill(os.getpid(), signal.SIGKILL)


@contextlib.contextmanager
def storage_calls(at_call: int = -1) -> Iterator[MutableSequence[int]]:
    """Count calls that touch the disk; in the one with number `at_call` the process dies half-way.

    The count is common to all that are forked meanwhile: one of them dies, not each when its turn comes.
    """
    count = memoryview(mmap.mmap(-1, 8)).cast("q")
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


def count_ways(trial: Callable[[int], str], seeds: range) -> None:
    """Run a trial for each seed; the count of each way to die is printed with -s.

    Args:
        trial: returns how its cycle died, or "not at all".
        seeds: of which at least three quarters must really be killed.
    """
    ways: dict[str, int] = {}
    for seed in seeds:
        way = trial(seed)
        ways[way] = ways.get(way, 0) + 1
        sys.stdout.write(".")
        sys.stdout.flush()
    sys.stdout.write(f"\nkilled cycles: {ways}\n")
    assert sum(count for way, count in ways.items() if way != "not at all") >= 0.75 * len(seeds)


# -- what the sessions left


def journals(out: Path) -> list[Path]:
    """Journals of a folder, oldest first."""
    return sorted(out.glob("session-*.jsonl"))


def past_of(out: Path) -> Past:
    """What the sessions before have left; nothing when they died before they could begin."""
    return Past.of(out, resume=any(path.stat().st_size for path in journals(out)))


def whole_lines(out: Path) -> bytes:
    """Every complete line of the newest journal as it stands."""
    paths = journals(out)
    data = paths[-1].read_bytes() if paths else b""
    return data[: data.rfind(b"\n") + 1]


def finished_before(out: Path) -> set[str]:
    """Steps that were finished when the session died."""
    if not whole_lines(out):
        return set()
    return {step.step_id for step in read_journal(journals(out)[-1]).steps.values() if step.finished}


def check_equal(whole: SessionRecord, record: SessionRecord, *, untouched: set[str]) -> None:
    """Steps, bags and values of a resumed cycle are those of the undisturbed one.

    Args:
        whole: the undisturbed cycle.
        record: the resumed one.
        untouched: steps that ran at the same bench times in both, and so must be the same bit for bit.
    """
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
        judged = [{(one.dut, one.metric, one.scope, one.verdict) for one in each.judgements} for each in (done, was)]
        assert judged[0] == judged[1], judged[0] ^ judged[1]
        if step_id in untouched and done.begin.attempt == 1:
            assert done.bag.sha256 == was.bag.sha256
            values = [[(each.value, each.u, each.reason) for each in one.measurements] for one in (done, was)]
            assert values[0] == values[1], step_id
        else:
            apart = _apart(done.measurements, was.measurements)
            assert not apart, f"{step_id}: " + "; ".join(apart)
    bags = {path.name for path in (record.path.parent / "bags").iterdir()}
    kept = {name for name in bags if not name.endswith((".part", ".recovered"))}
    assert len(kept) == len(record.steps), "one whole bag per step"


def _apart(one: list[Any], other: list[Any]) -> list[str]:
    """Values of two sweeps of the same thing that differ by more than their uncertainties explain."""
    found = []
    for a, b in zip(one, other, strict=True):
        allowed = math.inf if a.value is None or not a.u or not b.u else LARGEST_SIGMA * math.hypot(a.u, b.u)
        if a.metric == "operating" and a.value is not None:
            # voltages and temperatures are those of DUTs as warm as settling leaves them: not the same each time
            allowed = max(allowed, 2.0 * SETTLE_TOLERANCE_K if a.unit == "degC" else 0.02 * abs(a.value))
        if (a.value is None) != (b.value is None) or (a.value is not None and abs(a.value - b.value) > allowed):
            found.append(f"{a.dut} {a.metric} {a.scope}: {a.value} ± {a.u} and {b.value} ± {b.u} {b.reason}")
    return found
