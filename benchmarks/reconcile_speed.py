"""How long and how much memory `arl reconcile` takes as tables grow, and whether it answers the same twice.

`python -m benchmarks.reconcile_speed --rows 10000 100000 1000000`. The tables have two channels and 40 columns, from
the concealed bench with two effects at work; the largest is the one of the promise: 10⁶ rows within 120 s and 4 GiB.
"""

import argparse
import json
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from benchmarks.concealed.flash import Reality, expect, illuminate
from benchmarks.concealed.logged import covariates
from benchmarks.concealed.rows import Design, lay_out, random_pixels

COLUMNS = 40
CHANNELS = ("intensity_counts", "distance_m")


class Cost(NamedTuple):
    """What one run took; `peak_gib` of the process alone."""

    rows: int
    wall_s: float
    cpu_s: float
    peak_gib: float
    effects: tuple[str, ...]
    answer: str


def large_table(rows: int, path: Path, seed: int = 3) -> None:
    """Write a table of `rows` rows and 40 columns: cycle after cycle of the bench, with decay and a timing drift.

    One cycle is at most 20 832 rows (3 DUTs, 16 steps, 31 angles, 14 pixels), so memory stays bounded while it is
    written; smaller tables have fewer pixels, so that they too hold several cycles.
    """
    rng = np.random.default_rng(seed)
    steps, angles_deg = tuple(range(0, 39, 2))[:16], np.arange(-27.0, 27.1, 1.8)
    count = int(np.clip(rows // (5 * 3 * len(steps) * angles_deg.size), 2, 14))
    design = Design(steps=steps, angles_deg=angles_deg, pixels=random_pixels(rng, count))
    nominal = lay_out(design, rng)
    light = illuminate(nominal, Reality())
    sim = expect(nominal, Reality(), light)
    written, cycle, writer = 0, 0, None
    while written < rows:
        cycle += 1
        columns = covariates(rng, nominal, design, light)
        columns["cycle"] = np.full(len(nominal), cycle)
        age = cycle / max(rows / len(nominal), 1.0)
        share, step = np.unique(nominal.group, return_inverse=True)
        for channel in CHANNELS:
            mean, std = sim.mean[channel], sim.std[channel]
            common = 0.002 * mean if channel == CHANNELS[0] else np.full(mean.size, 3e-4)
            real = mean * (1 - 0.01 * age) if channel == CHANNELS[0] else mean + 2e-5 * (nominal.node_c["tof"] - 34.0)
            noise = rng.normal(size=mean.size) * std / np.sqrt(10.0) + common * rng.normal(size=share.size)[step]
            columns |= {
                channel: real + noise,
                f"sim_{channel}": mean,
                f"sim_{channel}_std": std,
                f"sim_{channel}_repeat_std": common,
            }
        columns["n_frames"] = np.full(len(nominal), 10)
        keep = min(rows - written, len(nominal))
        chosen = list(columns)[: COLUMNS - 9] + [n for n in columns if n.removeprefix("sim_").startswith(CHANNELS)]
        chosen += ["n_frames"]
        batch = pa.table({n: pa.array(columns[n][:keep]) for n in chosen[:COLUMNS]})
        writer = writer or pq.ParquetWriter(path, batch.schema)
        writer.write_table(batch)
        written += keep
    if writer is not None:
        writer.close()


def measure(table: Path, out: Path) -> Cost:
    """Run the tool as a process of its own, so that its memory is counted alone."""
    command = [sys.executable, "-m", "arl_fixtures.cli", "reconcile", str(table), "--out", str(out)]
    start = time.perf_counter()
    with (out.parent / "stderr.txt").open("w+") as stderr:
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=stderr)
        _, status, usage = os.wait4(process.pid, 0)
        wall = time.perf_counter() - start
        process.returncode = os.waitstatus_to_exitcode(status)
        stderr.seek(0)
        message = stderr.read()
    if process.returncode != 0:
        raise SystemExit(f"arl reconcile failed on {table}: {message.strip()[-300:]}")
    told = json.loads((out / "diagnosis.json").read_text())
    return Cost(
        pq.ParquetFile(table).metadata.num_rows,
        wall,
        usage.ru_utime + usage.ru_stime,
        usage.ru_maxrss / 2**20,
        tuple(f["effect"] for f in told["findings"]),
        json.dumps(told, sort_keys=True),
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rows", type=int, nargs="+", default=[10_000, 100_000, 1_000_000])
    parser.add_argument("--out", type=Path, default=Path("build/speed"))
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    print("|    rows | wall s |  CPU s | peak GiB | findings |\n| ---: | ---: | ---: | ---: | --- |")
    costs: list[Cost] = []
    for rows in sorted(given.rows):
        table = given.out / f"table_{rows}.parquet"
        if not table.exists():
            large_table(rows, table)
        costs.append(measure(table, given.out / f"diagnosis_{rows}"))
        c = costs[-1]
        print(
            f"| {c.rows:7d} | {c.wall_s:6.1f} | {c.cpu_s:6.1f} | {c.peak_gib:8.2f} | {', '.join(c.effects)} |",
            flush=True,
        )
    if len(costs) > 1:
        first, last = costs[0], costs[-1]
        power = np.log(last.cpu_s / first.cpu_s) / np.log(last.rows / first.rows)
        print(f"CPU time grows with rows to the power {power:.2f} (at most 1 was promised)")
    again = measure(given.out / f"table_{costs[0].rows}.parquet", given.out / "diagnosis_again")
    print("same input, same answer:", "yes" if again.answer == costs[0].answer else "NO")


if __name__ == "__main__":
    main()
