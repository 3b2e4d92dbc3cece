"""How long the report of a cycle takes, and how much memory.

    python -m benchmarks.report OUT… [--bench FILE]

OUT is the output folder of a cycle, e.g. of `pytest -m cycle tests_bench --profile full --out OUT`.
"""

from __future__ import annotations

import argparse
import resource
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from arl_fixtures.report.cycles import load_cycles
from arl_fixtures.report.document import make_report
from arl_fixtures.report.write import map_maker, report_name, write_report


@contextmanager
def timed(what: str) -> Iterator[None]:
    wall, cpu = time.perf_counter(), time.process_time()
    yield
    print(f"{what:24} {time.process_time() - cpu:6.2f} s CPU {time.perf_counter() - wall:6.2f} s wall")


BUDGET_S = 60.0
BUDGET_STEPS = 39
BUDGET_MIB = 1024.0


def main(folders: Sequence[Path], bench: str = "") -> None:
    start_s = time.perf_counter()
    with timed("all"):
        with timed("read journals"):
            cycles = load_cycles(list(folders))
        with timed("tables, maps, drawings"):
            report = make_report(cycles, map_maker(cycles[-1].record, bench))
        with timed("HTML and PDF"), tempfile.TemporaryDirectory() as folder:
            sizes = [path.stat().st_size for path in write_report(report, Path(folder), report_name(cycles))]
    steps = sum(len(cycle.steps) for cycle in cycles)
    peak_mib = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"{len(cycles)} cycles, {steps} steps; HTML {sizes[0] / 1e6:.1f} MB, PDF {sizes[1] / 1e6:.1f} MB")
    used = (time.perf_counter() - start_s) / (BUDGET_S * steps / BUDGET_STEPS)
    print(f"time {used:.2f} of the budget ({BUDGET_S:.0f} s for {BUDGET_STEPS} steps)")
    print(f"largest memory {peak_mib:.0f} MiB, {peak_mib / BUDGET_MIB:.2f} of the budget")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="time and memory of a report")
    parser.add_argument("cycles", type=Path, nargs="+", metavar="OUT")
    parser.add_argument("--bench", default="")
    options = parser.parse_args()
    main(options.cycles, options.bench)
