"""A sweep in real time: emulators in a process of their own, 25 Hz, three DUTs, real sockets; then the stage alone.

Prints the sweep's duration over its physical minimum (frame periods plus stage motion), and lost packets. The sensors
run free, so beyond that minimum each angle waits for the next frame of the sensor whose turn comes last.
The stage alone takes its steps on a pseudo-terminal: what driver, wire and server add is at most 20 ms a step.
Run: python -m benchmarks.realtime [ANGLES]
"""

from __future__ import annotations

import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

from arl_fixtures.bench.build import open_bench
from arl_fixtures.bench.clock import RealClock
from arl_fixtures.bench.config import load_bench
from arl_fixtures.bench.ports import SerialPort
from arl_fixtures.bench.profile import AngleSweep
from arl_fixtures.bench.serve import EmulatorServer
from arl_fixtures.bench.sweep import sweep
from arl_fixtures.devices.stage import TmclSettings, TmclStage
from arl_fixtures.emulators.plant import Plant
from arl_fixtures.emulators.stage import StageEmulator

FRAMES = 10
STEPS = 60


def motion_s(settings: TmclSettings, step_deg: float) -> float:
    """Duration of a trapezoidal move."""
    speed, acceleration = settings.max_speed_deg_s, settings.acceleration_deg_s2
    if step_deg < speed**2 / acceleration:
        return 2 * (step_deg / acceleration) ** 0.5
    return step_deg / speed + speed / acceleration


def main(angles: int = 40) -> None:
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "bench.yaml"
        command = [sys.executable, "-m", "arl_fixtures.cli", "emulate", "--write-bench", str(file)]
        emulators = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        assert emulators.stdout is not None
        for line in emulators.stdout:
            if line.startswith("running"):
                break
        bench = open_bench(load_bench(str(file)))
        try:
            bench.start()
            bench.soak(3.0)  # boot of the sensors
            sweep_angles = AngleSweep(from_deg=-0.45 * angles, to_deg=0.45 * angles).angles_deg(0)[:angles]
            bench.stage.move_to_deg(sweep_angles[0])
            bench.stage.wait_until_reached(60)
            start_s = bench.clock.now_s
            last_s = start_s
            for _ in sweep(bench, sweep_angles, frames=FRAMES):
                last_s = bench.clock.now_s
            status = bench.duts.status()
        finally:
            bench.close()
            emulators.terminate()
            emulators.wait()
    moves = (len(sweep_angles) - 1) * motion_s(bench.config.device_settings("stage"), 0.9)
    minimum_s = len(sweep_angles) * FRAMES * bench.config.sweep.frame_period_s + moves
    lost = {serial: each.counts for serial, each in status.items()}
    print(f"{len(sweep_angles)} angles x {FRAMES} frames x {len(status)} DUTs in real time")
    ratio = (last_s - start_s) / minimum_s
    print(f"duration {last_s - start_s:.2f} s, physical minimum {minimum_s:.2f} s, ratio {ratio:.3f} (at most 1.05)")
    for serial, counts in lost.items():
        asked = len(sweep_angles) * FRAMES
        print(
            f"{serial}: {counts.frames} frames of {asked} asked for, {counts.lost_rows} rows lost, "
            f"{counts.lost_frames} frames lost, {counts.malformed} packets malformed"
        )
    stage_alone()


def stage_alone() -> None:
    """Duration of single steps of a sweep over that of the motion."""
    clock = RealClock()
    server = EmulatorServer(clock)
    line = server.add_pty("stage", StageEmulator(Plant()))
    settings = TmclSettings(search_mode=5, reference_angle_deg=0.0)
    spent_s = []
    with server:
        stage = TmclStage(SerialPort("stage", line, baud=115200), clock, settings)
        stage.home(30.0)
        for step in range(STEPS):
            start_s = clock.now_s
            stage.move_to_deg(0.9 * (step + 1))
            stage.wait_until_reached(10.0)
            spent_s.append(clock.now_s - start_s)
        stage.close()
    least_s = motion_s(settings, 0.9)
    for what, each_s in (("median", statistics.median(spent_s)), ("longest", max(spent_s))):
        print(f"a step of 0.9°, {what}: {1e3 * each_s:.1f} ms, {each_s / least_s:.3f} of the motion", end="; ")
        print(f"{(each_s - least_s) / 0.02:.2f} of the 20 ms allowed")


if __name__ == "__main__":
    main(*(int(argument) for argument in sys.argv[1:]))
