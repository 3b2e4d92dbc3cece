"""What recording costs: time per frame, size of a cycle on disk, reading back.

`python -m benchmarks.recording` writes one step of three DUTs at full resolution with the twin's noise. Times are
processor time of this process, so that a busy machine changes them little; ratios compare with the `mcap` library on
the same messages in the same run.
"""

from __future__ import annotations

import argparse
import resource
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from mcap.reader import make_reader
from mcap.writer import Writer

from arl_fixtures.metrics.block import AngleBlock
from arl_fixtures.recording.bag_folder import BagReceipt
from arl_fixtures.recording.metadata import StepMetadata
from arl_fixtures.recording.reader import read_step
from arl_fixtures.recording.recover import recover
from arl_fixtures.recording.writer import StepBagWriter
from arl_fixtures.twin.frame import Renderer
from arl_fixtures.twin.noise import FrameCoder, scatter
from arl_fixtures.twin.scene import SceneSettings
from arl_fixtures.twin.settings import DutSettings

FRAMES, ANGLES, STEPS, DUTS = 10, 134, 39, ("SN-1", "SN-2", "SN-3")
CYCLE_FRAMES = FRAMES * ANGLES * STEPS * len(DUTS)
CYCLE_BUDGET_S = 144.0
START_NS = 1_767_225_600_000_000_000


class Cost(NamedTuple):
    """Seconds of the calling thread and of the whole process."""

    thread_s: float
    process_s: float


def measured(action: Callable[[], object]) -> Cost:
    thread, process = time.thread_time(), time.process_time()
    action()
    return Cost(time.thread_time() - thread, time.process_time() - process)


def blocks() -> list[AngleBlock]:
    """One step, angle by angle, three DUTs each."""
    dut, scene = DutSettings(serial="SN-1"), SceneSettings()
    renderer = Renderer(dut, scene)
    rng = np.random.default_rng(1)
    made = []
    for index in range(ANGLES):
        angle_deg = -59.85 + 0.9 * index
        coder = FrameCoder(scatter(renderer.expected(angle_deg), dut.noise), dut.noise)
        for seed, serial in enumerate(DUTS):
            counts, codes = coder.code(seed, range(index * FRAMES, (index + 1) * FRAMES))
            made.append(block(serial, index, angle_deg, counts, codes, dut.noise.no_return_code, rng))
    return made


def block(
    serial: str,
    index: int,
    angle_deg: float,
    counts: np.ndarray,
    codes: np.ndarray,
    no_return: int,
    rng: np.random.Generator,
) -> AngleBlock:
    intensity = np.zeros((FRAMES, 2, *counts.shape[1:]), dtype=np.uint16)
    distance = np.full(intensity.shape, np.nan, dtype=np.float32)
    intensity[:, 0] = counts
    distance[:, 0] = np.where(codes == no_return, np.nan, codes / np.float32(256))
    return AngleBlock(
        dut=serial,
        angle_index=index,
        stage_angle_deg=angle_deg,
        time_ns=START_NS + (index * 1_000 + np.arange(FRAMES) * 40) * 1_000_000,
        intensity_counts=intensity,
        distance_m=distance,
        row_valid=np.ones((FRAMES, counts.shape[1]), dtype=np.bool_),
        operating={f"signal_{k}_v": float(rng.normal()) for k in range(15)},
    )


def metadata() -> StepMetadata:
    return StepMetadata(
        campaign="benchmark",
        cycle=0,
        step=7,
        step_id="c0000-07-up+25C",
        attempt=1,
        set_temperature_c=25.0,
        ramp=1,
        started_utc_ns=START_NS,
        duts=DUTS,
        software_version="0",
        bench_sha256="",
        profile_sha256="",
        limits_sha256="",
    )


def write(path: Path, step: list[AngleBlock]) -> BagReceipt:
    with StepBagWriter(path, metadata()) as bag:
        for each in step:
            if each.dut == DUTS[0]:
                bag.temperatures(int(each.time_ns[0]), {f"T{k}": 25.0 for k in range(5)})
                bag.stage(int(each.time_ns[0]), each.stage_angle_deg)
            bag.block(each)
        return bag.close()


def library_write(source: Path, target: Path) -> Callable[[], None]:
    """The same messages through `mcap.writer.Writer`, serialising not counted."""
    with source.open("rb") as stream:
        messages = [(channel, message) for _, channel, message in make_reader(stream).iter_messages()]

    def run() -> None:
        writer = Writer(str(target))
        writer.start("ros2")
        schema = writer.register_schema("any", "ros2msg", b"")
        ids: dict[str, int] = {}
        for channel, message in messages:
            if channel.topic not in ids:
                ids[channel.topic] = writer.register_channel(channel.topic, "cdr", schema)
            writer.add_message(ids[channel.topic], message.log_time, message.data, message.log_time)
        writer.finish()

    return run


def library_read(path: Path) -> None:
    with path.open("rb") as stream:
        for _ in make_reader(stream).iter_messages():
            pass


def best(times: int, action: Callable[[int], Callable[[], object]]) -> Cost:
    return min((measured(action(k)) for k in range(times)), key=lambda cost: cost.process_s)


def recording(folder: Path, times: int) -> Iterator[str]:
    step = blocks()
    frames = len(step) * FRAMES
    receipts: list[BagReceipt] = []
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss

    def one(k: int) -> Callable[[], object]:
        return lambda: receipts.append(write(folder / f"own{k}", step))

    own = best(times, one)
    growth_mib = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024
    bag = receipts[0].path
    file = next(bag.glob("*.mcap"))
    theirs = best(times, lambda k: library_write(file, folder / f"library{k}.mcap"))
    us = 1e6 / frames
    cycle_s = own.process_s / frames * CYCLE_FRAMES
    yield f"writing, calling thread        {own.thread_s * us:8.1f} µs per frame (I and D of both returns, mask)"
    yield f"writing, all threads           {own.process_s * us:8.1f} µs per frame"
    yield f"mcap.writer.Writer, same       {theirs.thread_s * us:8.1f} µs per frame, without making the messages"
    yield f"calling thread / mcap.Writer   {own.thread_s / theirs.thread_s:8.2f}"
    yield f"a cycle, both cores / budget    {cycle_s / (2 * CYCLE_BUDGET_S):8.3f} of {CYCLE_BUDGET_S:.0f} s each"
    yield f"memory beyond the step itself  {growth_mib:8.1f} MiB"
    yield f"a cycle on disk                {receipts[0].size_bytes * STEPS / 1e9:8.2f} GB ({CYCLE_FRAMES} frames)"
    plain = sum(each.intensity_counts.nbytes + each.distance_m.nbytes for each in step)
    yield f"on disk / plain images         {receipts[0].size_bytes / plain:8.3f}"

    mcap_read = best(times, lambda _: lambda: library_read(file))
    own_read = best(times, lambda _: lambda: [None for _ in read_step(bag)[1]])
    yield f"read_step to blocks            {own_read.process_s * us:8.1f} µs per frame"
    yield f"read_step / mcap reader alone  {own_read.process_s / mcap_read.process_s:8.2f}"

    cut = folder / "cut.part"
    cut.mkdir()
    data = file.read_bytes()
    (cut / file.name).write_bytes(data[: len(data) * 2 // 3])
    took = measured(lambda: recover(cut))
    yield f"recover two thirds of a step   {took.process_s:8.2f} s"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--times", type=int, default=3, help="repetitions; the best counts")
    parser.add_argument("--folder", type=Path, help="where to write (default: a temporary folder)")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(dir=options.folder) as folder:
        for line in recording(Path(folder), options.times):
            print(line)


if __name__ == "__main__":
    main()
