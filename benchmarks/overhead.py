"""What a step costs besides the bench: judging, journal, properties, table, for 30 judged values.

Each round journals a step's begin, its outcome and its end as the session does, and makes what pytest shows of it.
Printed beside a plain pytest test as the smallest cost there is. Run: python -m benchmarks.overhead
"""

from __future__ import annotations

import tempfile
import time
from pathlib import Path

from arl_fixtures.bench.clock import VirtualClock
from arl_fixtures.bench.config import load_bench
from arl_fixtures.bench.profile import CycleStep, load_profile
from arl_fixtures.bench.settle import SettleReport
from arl_fixtures.journal.journal import Journal
from arl_fixtures.metrics.conditions import Conditions
from arl_fixtures.metrics.judge import judge, overall
from arl_fixtures.metrics.limits import Limit, LimitSet
from arl_fixtures.metrics.measurement import Measurement
from arl_fixtures.plugin import journaling
from arl_fixtures.plugin.cycle import properties
from arl_fixtures.plugin.options import Options
from arl_fixtures.plugin.outcome import rows_of, verdict_table
from arl_fixtures.plugin.setup import SessionFiles
from arl_fixtures.plugin.step_runner import StepResult
from arl_fixtures.quantity import Contribution, Quantity

VALUES = 30
ROUNDS = 50


def main() -> None:
    limit = Limit(metric="distance_scatter", unit="mm", upper=8.0, reason="benchmark")
    limits = LimitSet(name="overhead", version=1, limits=(limit,))
    bench = load_bench("emulated")
    with tempfile.TemporaryDirectory() as folder:
        options = Options(
            bench="emulated", profile="short", limits=Path(), out=Path(folder), cycles=1, first_cycle=0, resume=False
        )
        hashes = dict.fromkeys(("bench", "profile", "limits"), "0" * 64)
        files = SessionFiles(
            options=options, bench=bench, profile=load_profile("short"), limits=limits, hashes=hashes
        )
        steps = [CycleStep(0, index, 25.0, 1) for index in range(ROUNDS)]
        journal = Journal.create(
            Path(folder) / "session-0001.jsonl", journaling.session_begin(files, steps), VirtualClock()
        )
        start_s, cpu_s = time.perf_counter(), time.process_time()
        for step in steps:
            journal.append(journaling.step_begin(step, 1))
            measurements = [
                Measurement(
                    metric="distance_scatter",
                    dut="ARL-EMU-0001",
                    scope=f"scope_{number}",
                    quantity=Quantity.of(5.0 + 0.01 * number, "mm", Contribution("repeatability", 0.1, dof=9)),
                )
                for number in range(VALUES)
            ]
            judgements = judge(measurements, limits, Conditions(set_temperature_c=25.0))
            verdict, _ = overall(judgements)
            result = StepResult(
                step=step,
                attempt=1,
                settle=SettleReport(settled=True, duration_s=300.0),
                bag=None,
                steps={},
                judgements=judgements,
                verdict=verdict,
                reason="",
            )
            journal.append_many(journaling.outcome(result, Path(folder), limits))
            rows = rows_of(judgements)
            properties(result, rows)
            verdict_table(rows)
        wall_ms = 1e3 * (time.perf_counter() - start_s) / ROUNDS
        cpu_ms = 1e3 * (time.process_time() - cpu_s) / ROUNDS
        journal.close()
    print(f"{VALUES} judged values per step: {wall_ms:.1f} ms wall, {cpu_ms:.1f} ms processor per step")
    print(f"share of the promised 20 ms: {wall_ms / 20:.2f} (with a synced write), {cpu_ms / 20:.2f} (processor)")


if __name__ == "__main__":
    main()
