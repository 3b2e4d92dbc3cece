"""What measuring a step costs, against reading the same bytes through `mcap` alone.

    python -m benchmarks.metrics

One bag of a step at full size (134 angles × 10 frames × 3 DUTs, the twin's frames and noise), written by the
recorder. Compared in processor time of one process: reading every message with the `mcap` library, and reading the
blocks, reducing them, and measuring and judging every metric of the three DUTs. The twin's expectation is rendered
once for a bench, in a session while the stage turns back from its first sweep, and kept beside its output, where a
later process finds it. What a bag costs that is measured where nothing was kept is told, and held to no limit.
"""

from __future__ import annotations

import resource
import tempfile
import time
from pathlib import Path

import numpy as np
from mcap.reader import make_reader

from arl_fixtures.metrics.collect import collect
from arl_fixtures.metrics.conditions import Conditions
from arl_fixtures.metrics.geometry import GeometryCache
from arl_fixtures.metrics.judge import judge
from arl_fixtures.metrics.limits import load_limits
from arl_fixtures.metrics.reference import Reference
from arl_fixtures.metrics.registry import expect, measure, remember
from arl_fixtures.metrics.simulated import simulated_blocks
from arl_fixtures.metrics.statistics import SweepStatistics
from arl_fixtures.metrics.step import StepData
from arl_fixtures.recording.metadata import StepMetadata
from arl_fixtures.recording.reader import StepBag
from arl_fixtures.recording.writer import StepBagWriter
from arl_fixtures.twin.frame import Renderer
from arl_fixtures.twin.settings import DutSettings
from benchmarks.metric_coverage import ANGLES_DEG, FRAMES, LIMITS

DUTS = tuple(DutSettings(serial=f"SN-{k}", height_m=height_m) for k, height_m in enumerate((0.1, 0.0, -0.1), start=1))
MOST_RATIO = 3.0
MOST_BYTES = 1024**3
MOST_REDUCTION_MS = 1.0
FROM_NOTHING = "very first step of a bench from its bag, nothing rendered before"


def write_bag(folder: Path) -> Path:
    metadata = StepMetadata(
        campaign="benchmark",
        cycle=0,
        step=0,
        step_id="c0000-00-up+25C",
        attempt=1,
        set_temperature_c=25.0,
        ramp=1,
        started_utc_ns=0,
        duts=tuple(dut.serial for dut in DUTS),
        software_version="0",
        bench_sha256="",
        profile_sha256="",
        limits_sha256="",
    )
    with StepBagWriter(folder / "bag", metadata) as bag:
        sweeps = [simulated_blocks(Renderer(dut), ANGLES_DEG, frames=FRAMES, seed=k) for k, dut in enumerate(DUTS)]
        for row in zip(*sweeps, strict=True):
            for block in row:
                bag.block(block)
        bag.close()
    return folder / "bag"


def read_alone(bag: Path) -> tuple[float, int]:
    started, count = time.process_time(), 0
    for path in bag.glob("*.mcap"):
        with path.open("rb") as file:
            for _, _, message in make_reader(file).iter_messages():
                count += len(message.data)
    return time.process_time() - started, count


def main() -> int:
    limits = load_limits(LIMITS)
    conditions = Conditions(set_temperature_c=25.0)
    references: dict[str, Reference] = {}
    with tempfile.TemporaryDirectory() as folder:
        bag = write_bag(Path(folder))
        alone_s, size = min(read_alone(bag) for _ in range(3))
        print(f"mcap alone: {alone_s:.2f} s for {size / 1e6:.0f} MB of messages")
        store = Path(folder) / "cache"
        caches: dict[str, GeometryCache] = {}
        held: list[float] = []
        for label, fresh, rendered in (
            (FROM_NOTHING, True, False),
            ("second step", False, False),
            ("third step", False, False),
            ("very first step of a bench in a session, expectation rendered while the stage turned back", True, True),
            ("first step of a later process (expectation on disk)", True, False),
        ):
            started = time.process_time()
            if fresh:
                kept = None if label == FROM_NOTHING else store
                caches = {dut.serial: GeometryCache(dut, store=kept) for dut in DUTS}
            if rendered:
                for cache in caches.values():
                    expect(cache.at(np.array(ANGLES_DEG)))
                print(f"rendering the expectation, while the stage turns back: {time.process_time() - started:.2f} s")
                started = time.process_time()
            collected = collect(StepBag(bag).blocks(), [dut.serial for dut in DUTS])
            read_s = time.process_time() - started
            measured = []
            for dut in DUTS:
                sweep = collected.statistics[dut.serial].summary()
                step = StepData(
                    dut=dut,
                    conditions=conditions,
                    sweep=sweep,
                    geometry=caches[dut.serial].at(sweep.stage_angle_deg),
                    expected_angles=len(ANGLES_DEG),
                    reference=references.get(dut.serial),
                )
                measured += measure(step)
                references.setdefault(dut.serial, remember(step))
            judged = judge(measured, limits, conditions)
            total_s = time.process_time() - started
            allowed = f" (allowed {MOST_RATIO:g})" if label != FROM_NOTHING else ""
            held += [total_s / alone_s] if allowed else []
            print(
                f"{label}: {total_s:.2f} s ({read_s:.2f} s reading and reducing), {len(measured)} values, "
                f"{len(judged)} verdicts: {total_s / alone_s:.2f} × mcap alone{allowed}"
            )
        one = next(StepBag(bag).blocks())
        statistics = SweepStatistics(one.dut)
        started = time.process_time()
        for _ in range(200):
            statistics.add(one)
        reduction_ms = (time.process_time() - started) / 200 * 1e3
        started = time.process_time()
        for _ in range(100):
            judge(measured, limits, conditions)
        judging_ms = (time.process_time() - started) / 100 * 1e3
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    print(f"reducing one block of {FRAMES} frames: {reduction_ms:.2f} ms (allowed {MOST_REDUCTION_MS:g})")
    print(f"judging {len(measured)} values: {judging_ms:.2f} ms")
    print(f"peak memory: {peak / 1024**2:.0f} MiB (allowed {MOST_BYTES / 1024**2:.0f})")
    return int(max(held) > MOST_RATIO or peak > MOST_BYTES or reduction_ms > MOST_REDUCTION_MS)


if __name__ == "__main__":
    raise SystemExit(main())
