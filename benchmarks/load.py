"""Three DUTs at 25 Hz in real time beside a process that eats one core: is anything lost, does memory grow?

Emulators run in a process of their own and send on real sockets. Frames are taken without a pause, measured into a
bag a minute, and each bag is journalled and read back by its hash, as a cycle does.
Run: python -m benchmarks.load [MINUTES]
"""

from __future__ import annotations

import multiprocessing
import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

import arl_fixtures
from arl_fixtures.bench.bench import Bench
from arl_fixtures.bench.build import open_bench
from arl_fixtures.bench.config import load_bench
from arl_fixtures.bench.ports import UdpPort
from arl_fixtures.errors import DeviceTimeoutError
from arl_fixtures.journal import entries
from arl_fixtures.journal.journal import Journal
from arl_fixtures.journal.record import read_journal
from arl_fixtures.metrics.statistics import SweepStatistics
from arl_fixtures.recording.bag_folder import verify
from arl_fixtures.recording.metadata import StepMetadata
from arl_fixtures.recording.writer import StepBagWriter

FRAMES = 10
BAG_S = 60.0


def eat_one_core() -> None:
    while True:
        pass


def resident_mib() -> float:
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * resource.getpagesize() / 2**20


def kernel_drops(port: int) -> int:
    """Datagrams the kernel had no room for, on all sockets of a UDP port."""
    drops = 0
    for line in Path("/proc/net/udp").read_text(encoding="ascii").splitlines()[1:]:
        cells = line.split()
        if int(cells[1].rpartition(":")[2], 16) == port:
            drops += int(cells[-1])
    return drops


class Counted:
    """The frames' port, counting what it hands on."""

    def __init__(self, port: UdpPort) -> None:
        self._port, self.name = port, port.name
        self.delivered = self.discarded = 0

    def receive(self, timeout_s: float) -> list:
        taken = self._port.receive(timeout_s)
        self.delivered += len(taken)
        return taken

    def discard(self, before_s: float = float("inf")) -> int:
        lost = self._port.discard(before_s)
        self.discarded += lost
        return lost

    def close(self) -> None:
        self._port.close()

    @property
    def overrun(self) -> int:
        return self._port.overrun

    @property
    def bound_port(self) -> int:
        return self._port.bound_port


def begin(bench: Bench) -> entries.SessionBegin:
    duts = tuple(entries.Dut(serial=dut.serial, model=dut.model) for dut in bench.config.dut_settings)
    identity = entries.Identity(
        duts=duts,
        bench_name=bench.config.name,
        bench_sha256=bench.config.sha256,
        profile_name="load",
        profile_sha256="",
        limits_name="none",
        limits_sha256="",
        software_version=arl_fixtures.__version__,
    )
    return entries.SessionBegin(campaign="load", cycles=(0,), plan=(), identity=identity, environment={})


def record_one_bag(
    bench: Bench, journal: Journal, folder: Path, number: int, until_s: float, unanswered: list[float]
) -> int:
    """Frames of all DUTs into one bag until a bench time; returns how many frame sets that were.

    Emulators that get no processor for seconds do not answer: noted in `unanswered`, as a cycle would ask again.
    """
    step_id = f"load-{number:03d}"
    journal.append(
        entries.StepBegin(step_id=step_id, attempt=1, cycle=0, step_index=number, set_temperature_c=23.0, ramp=1)
    )
    metadata = StepMetadata(
        campaign="load",
        cycle=0,
        step=number,
        step_id=step_id,
        attempt=1,
        set_temperature_c=23.0,
        ramp=1,
        started_utc_ns=bench.clock.utc_ns(),
        duts=bench.serials,
        software_version=arl_fixtures.__version__,
        bench_sha256=bench.config.sha256,
        profile_sha256="",
        limits_sha256="",
        extra={},
    )
    sets = 0
    statistics = {serial: SweepStatistics(serial) for serial in bench.serials}
    with StepBagWriter(folder / "bags" / step_id, metadata) as bag:
        while bench.clock.now_s < until_s:
            blocks = bench.duts.collect(
                bench.serials, FRAMES, not_before_s=bench.clock.now_s, timeout_s=10.0, angle_index=sets
            )
            for serial, block in blocks.items():
                bag.block(block)
                statistics[serial].add(block)
            try:
                bench.turn()
            except DeviceTimeoutError:
                unanswered.append(bench.clock.now_s)
            sets += 1
        receipt = bag.close()
    verify(receipt.path, receipt.sha256)
    journal.append_many(
        [
            entries.Bag(
                step_id=step_id,
                attempt=1,
                path=receipt.path.relative_to(folder).as_posix(),
                sha256=receipt.sha256,
                size_bytes=receipt.size_bytes,
                message_count=receipt.message_count,
            ),
            entries.StepEnd(step_id=step_id, attempt=1, finished=True, verdict="PASS"),
        ]
    )
    return sets


def main(minutes: float = 10.0) -> None:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        file = folder / "bench.yaml"
        command = [sys.executable, "-m", "arl_fixtures.cli", "emulate", "--write-bench", str(file)]
        emulators = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        assert emulators.stdout is not None
        for line in emulators.stdout:
            if line.startswith("running"):
                break
        eater = multiprocessing.get_context("spawn").Process(target=eat_one_core, daemon=True)
        eater.start()
        try:
            bench = open_bench(load_bench(str(file)))
            for name, value in measured(bench, folder, minutes).items():
                print(f"{name}: {value}")
            bench.close()
        finally:
            eater.terminate()
            emulators.terminate()
            emulators.wait()


def measured(bench: Bench, folder: Path, minutes: float) -> dict[str, object]:
    """Run the load and say what came of it."""
    receiver = bench.duts
    ports = receiver._ports
    port = Counted(ports.frames)
    object.__setattr__(ports, "frames", port)
    bench.start()
    bench.soak(4.0)  # boot of the sensors
    drops = kernel_drops(port.bound_port)
    before = {serial: status.counts for serial, status in receiver.status().items()}
    cpu_s, start_s = sum(os.times()[:2]), bench.clock.now_s
    end_s = start_s + 60.0 * minutes
    sets, memory, unanswered = 0, [], []
    with Journal.create(folder / "session-0001.jsonl", begin(bench), bench.clock) as journal:
        for number in range(max(1, round(60.0 * minutes / BAG_S))):
            until_s = min(start_s + (number + 1) * BAG_S, end_s)
            sets += record_one_bag(bench, journal, folder, number, until_s, unanswered)
            memory.append(round(resident_mib(), 1))
    cpu_s = sum(os.times()[:2]) - cpu_s
    record = read_journal(folder / "session-0001.jsonl")
    lost = {}
    for serial, status in receiver.status().items():
        counts = status.counts
        was, frames = before[serial], counts.frames - before[serial].frames
        rows = counts.lost_rows - was.lost_rows
        lost[serial] = (
            f"{frames} frames, {counts.incomplete_frames - was.incomplete_frames} incomplete, "
            f"{rows} rows lost (share {rows / (32 * frames):.1e}), "
            f"{counts.late_packets - was.late_packets} came too late, {counts.malformed - was.malformed} malformed"
        )
    duration_s = bench.clock.now_s - start_s
    return {
        "minutes": round(duration_s / 60.0, 2),
        "load average": [round(each, 1) for each in os.getloadavg()],
        "frame sets of all DUTs": sets,
        "rate of DUT frames taken, Hz": round(sets * FRAMES / duration_s, 2),
        "datagrams delivered": port.delivered,
        "datagrams older than the set, thrown away unread": port.discarded,
        "datagrams lost after the kernel had them": port.overrun,
        "datagrams the kernel had no room for": kernel_drops(port.bound_port) - drops,
        **lost,
        "devices that did not answer in time": len(unanswered),
        "bags whole": sum(step.finished for step in record.steps.values()),
        "journal lines": len(record.lines),
        "processors used by the receiver": round(cpu_s / duration_s, 2),
        "resident after each bag, MiB": memory,
        "last over second": round(memory[-1] / memory[min(1, len(memory) - 1)], 3),
    }


if __name__ == "__main__":
    main(*(float(argument) for argument in sys.argv[1:]))
