"""A healthy session computes for long, too: the guard must hear of it again and again, from the main loop."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest import mock

from arl_fixtures.guard.inside import InsideGuard
from arl_fixtures.metrics import registry
from arl_fixtures.plugin import campaign, references, step_runner
from tests_bench.small_cycle import fast, files_for, run_cycle, write_files

LONGEST_S = 10.0
"""The guard's `heartbeat_timeout_s` by default."""
ONE_S = 6.0
"""As long as each piece of computing takes here: two in a row without a sign of life would be too long."""


def test_a_session_whose_computing_takes_long_never_looks_hung(tmp_path: Path) -> None:
    """Every metric, every reference and every old journal take seconds on a clock of their own."""
    now = SimpleNamespace(s=0.0, heard_s=0.0, longest_s=0.0, pieces=0)

    def slow(work: Any) -> Any:
        def takes_long(*arguments: Any, **options: Any) -> Any:
            now.s += ONE_S
            now.pieces += 1
            return work(*arguments, **options)

        return takes_long

    def heard(_guard: InsideGuard, *_: Any) -> None:
        now.longest_s = max(now.longest_s, now.s - now.heard_s)
        now.heard_s = now.s

    see = InsideGuard._see

    def seen(guard: InsideGuard, reading: Any) -> None:
        heard(guard)
        see(guard, reading)

    files = dataclasses.replace(
        files_for(write_files(tmp_path), tmp_path / "out", {}), stop=campaign.StopRules(verdict="FAIL")
    )
    with (
        fast(),
        mock.patch.object(InsideGuard, "beat", heard),
        mock.patch.object(InsideGuard, "_see", seen),
        mock.patch.object(step_runner, "measure", slow(registry.measure)),
        mock.patch.object(references, "remember", slow(registry.remember)),
        mock.patch.object(campaign, "read_journal", slow(campaign.read_journal)),
    ):
        ended = run_cycle(files)
    assert set(ended.verdicts.values()) == {"PASS"}
    assert now.pieces > 3 * 2 * len(registry.all_metrics())
    assert now.longest_s < LONGEST_S
