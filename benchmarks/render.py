"""What the emulated sensors cost: `python -m benchmarks.render`.

CPU time of an expected frame, of noise and coding, of packing, and of the whole way through the virtual network to
the receiver, each as a share of the frame period of three sensors.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from arl_fixtures.bench.clock import VirtualClock
from arl_fixtures.bench.links import VirtualNetwork
from arl_fixtures.devices.dut import HflPorts, HflReceiver, HflSettings
from arl_fixtures.emulators.dut import DutEmulator
from arl_fixtures.emulators.plant import Plant
from arl_fixtures.protocols.hfl110 import Calibration, FrameEncoder, Hfl110Wire
from arl_fixtures.twin.frame import Renderer
from arl_fixtures.twin.noise import FrameCoder, scatter
from arl_fixtures.twin.settings import DutSettings

FRAME_PERIOD_S = 0.040
CYCLE_FRAMES = 39 * 134 * 10 * 3
SENSORS = 3


def cpu_s(action: Callable[[int], object], repeats: int) -> float:
    """CPU seconds of one call."""
    action(0)
    start_s = time.process_time()
    for index in range(repeats):
        action(index)
    return (time.process_time() - start_s) / repeats


def measure() -> dict[str, float]:
    """CPU seconds of each part."""
    dut = DutSettings(serial="BENCH", seed=1)
    renderer = Renderer(dut)
    expected = renderer.expected(0.0)
    coder = FrameCoder(scatter(expected, dut.noise), dut.noise)
    encoder = FrameEncoder(Hfl110Wire(), Calibration(fx=58.1))
    intensity, codes = coder.code(1, (0,))

    def pack(index: int) -> object:
        return encoder.encode(
            frame_number=index, timestamp=index, intensity_counts=intensity[0], range_codes=codes[0]
        )

    return {
        "render an angle": cpu_s(lambda index: renderer.expected(-60 + 0.37 * index), 200),
        "noise and coding": cpu_s(lambda index: coder.code(1, (index,)), 500),
        "32 packets": cpu_s(pack, 500),
        "all, to the receiver": whole_way_s(),
    }


def whole_way_s(angles: int = 60, frames: int = 10) -> float:
    """CPU seconds per frame through plant, emulator, virtual network and receiver; angles seen before."""
    clock, plant = VirtualClock(), Plant()
    units = [DutSettings(serial=f"B{i}", sender_address=f"127.0.0.{21 + i}", seed=i) for i in range(3)]
    network = VirtualNetwork([DutEmulator(plant, i, unit) for i, unit in enumerate(units)], clock)
    ports = HflPorts(frames=network.listen(57410), telemetry=network.listen(57413), operating=network.listen(57420))
    senders = {unit.serial: unit.sender_address for unit in units}
    duts = HflReceiver(ports, clock, senders, HflSettings(exposure_lead_s=0.012))
    for unit in (1, 2, 3):
        plant.switch(f"dut_{unit}", True, 0.0)
        plant.switch(f"laser_{unit}", True, 0.0)
    clock.sleep(5.0)

    def sweep() -> None:
        for _ in range(angles):
            clock.sleep(0.2)
            blocks = duts.collect(list(senders), frames, not_before_s=clock.now_s, timeout_s=5.0)
            assert all(np.all(block.row_valid) for block in blocks.values())

    return cpu_s(lambda _: sweep(), 1) / (angles * frames * len(units))


def main() -> int:
    parts = measure()
    for name, seconds in parts.items():
        share = FRAME_PERIOD_S / SENSORS / seconds
        print(f"{name:22s} {seconds * 1e3:7.3f} ms CPU = 1/{share:.0f} of the period of three sensors' frames")
    frame_s = parts["noise and coding"] + parts["32 packets"]
    cycle_s = parts["all, to the receiver"] * CYCLE_FRAMES + parts["render an angle"] * 3 * 134
    print(f"a full cycle of {CYCLE_FRAMES} frames: {cycle_s:.0f} s CPU = 6 h / {6 * 3600 / cycle_s:.0f}")
    good = frame_s <= 0.20e-3 and parts["render an angle"] <= 3e-3
    print(f"wanted: at most 0.20 ms to make a frame and 3 ms to render an angle: {'reached' if good else 'MISSED'}")
    return 0 if good else 1


if __name__ == "__main__":
    raise SystemExit(main())
