"""What the journal costs the session that writes it: wall time of all its calls over a whole cycle, per entry.

A cycle on the embedded bench, as `pytest -m cycle` runs it; every call of its journal is timed on the wall, with the
flushes of the disk that it waits for. Then entries alone. Run: python -m benchmarks.journal [PROFILE]
"""

from __future__ import annotations

import contextlib
import itertools
import os
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
import pytest

from arl_fixtures.bench.clock import VirtualClock
from arl_fixtures.journal import entries
from arl_fixtures.journal.journal import PART_OF_A_STEP, Journal
from arl_fixtures.journal.record import SessionRecord, read_journal

BUDGET_MS = 0.2
SINGLE = 500


class Timed:
    """Wall time of a journal's calls, seconds; a call within another one is the other one's."""

    def __init__(self) -> None:
        self.of_a_step: list[float] = []
        self.relied_on: list[float] = []
        self._busy = False

    @property
    def total_s(self) -> float:
        return sum(self.of_a_step) + sum(self.relied_on)

    def around(self, call: Callable[..., Any]) -> Callable[..., Any]:
        def timed(*arguments: Any, **options: Any) -> Any:
            if self._busy:
                return call(*arguments, **options)
            self._busy = True
            start_s = time.perf_counter()
            try:
                return call(*arguments, **options)
            finally:
                self._busy = False
                kept = self.of_a_step if _of_a_step(arguments) else self.relied_on
                kept.append(time.perf_counter() - start_s)

        return timed


def _of_a_step(arguments: tuple[Any, ...]) -> bool:
    return len(arguments) > 1 and isinstance(arguments[1], PART_OF_A_STEP)


@contextlib.contextmanager
def timed_journal() -> Iterator[Timed]:
    timed = Timed()
    with contextlib.ExitStack() as stack:
        for name in ("append", "append_many", "append_at", "sync", "close"):
            stack.enter_context(mock.patch.object(Journal, name, timed.around(getattr(Journal, name))))
        yield timed


def cycle(out: Path, profile: str) -> Iterator[str]:
    arguments = ["-q", "-m", "cycle", "tests_bench", "--profile", profile, "--out", str(out)]
    start_s = time.perf_counter()
    with timed_journal() as timed, (out / "pytest.txt").open("w") as said, contextlib.redirect_stdout(said):
        pytest.main([*arguments, "-p", "no:cacheprovider", "-W", "ignore::pytest.PytestAssertRewriteWarning"])
    wall_s = time.perf_counter() - start_s
    record = read_journal(out / "session-0001.jsonl")
    count, per_entry_ms = len(record.lines), timed.total_s / len(record.lines) * 1e3
    steps, verdict = len(record.steps), record.end.verdict if record.end else "none"
    yield f"profile {profile}: {steps} steps with the reference, verdict {verdict}, {wall_s:.1f} s"
    yield f"entries                        {count:8d}"
    share = f"{timed.total_s / wall_s * 100:.2f} % of the session"
    yield f"all calls of the journal       {timed.total_s * 1e3:8.1f} ms, {share}"
    yield f"per entry, flushes included    {per_entry_ms:8.3f} ms ({per_entry_ms / BUDGET_MS:.2f} of the budget)"
    yield f"calls nobody relies on         {len(timed.of_a_step):8d}, {_spread(timed.of_a_step)}"
    yield f"calls that wait for the disk   {len(timed.relied_on):8d}, {_spread(timed.relied_on)}"
    yield from single(out, record)


def single(folder: Path, record: SessionRecord) -> Iterator[str]:
    """The cycle's own measurements, one entry a call, turn by turn with bare lines on the same disk."""
    step = next(each for each in record.attempts if each.measurements)
    bare = os.open(folder / "bare", os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o644)
    alone, flushed, relied_on = [], [], []
    fault = entries.Fault(device="stage", message="stage: silent", action="again")
    with Journal.create(folder / "single.jsonl", record.begin, VirtualClock()) as journal:
        journal.append(step.begin)
        for entry in itertools.islice(itertools.cycle(step.measurements), SINGLE):
            alone.append(_took_s(partial(journal.append, entry)))
        journal.sync()
        for _ in range(SINGLE // 5):
            relied_on.append(_took_s(partial(journal.append, fault)))
            os.write(bare, bytes(400))
            flushed.append(_took_s(partial(os.fdatasync, bare)))
    os.close(bare)
    alone_ms = sum(alone) / len(alone) * 1e3
    yield f"a measurement, alone, mean     {alone_ms:8.3f} ms ({alone_ms / BUDGET_MS:.2f} of the budget)"
    yield f"and how they vary              {_spread(alone)}"
    yield f"a fault, which is relied on    {_spread(relied_on)}"
    yield f"a bare flush of this disk      {_spread(flushed)}"


def _took_s(action: Callable[[], object]) -> float:
    start_s = time.perf_counter()
    action()
    return time.perf_counter() - start_s


def _spread(taken_s: list[float]) -> str:
    if not taken_s:
        return "none"
    median, high = np.quantile(taken_s, [0.5, 0.95]) * 1e3
    return f"median {median:.3f} ms, 95 % below {high:.3f} ms, longest {max(taken_s) * 1e3:.3f} ms"


def main(profile: str = "short") -> None:
    with tempfile.TemporaryDirectory() as folder:
        for line in cycle(Path(folder), profile):
            print(line, flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
