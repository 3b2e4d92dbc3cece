"""How many times faster than three sensors send one core takes packets apart: `python -m benchmarks.decode`.

Counts CPU time, from datagrams in memory to pixel arrays of an angle: sorting by sender, assembling, decoding.
"""

from __future__ import annotations

import time

import numpy as np

from arl_fixtures.bench.clock import VirtualClock
from arl_fixtures.devices.dut import HflPorts, HflReceiver, HflSettings
from arl_fixtures.devices.port import Datagram
from arl_fixtures.protocols.hfl110 import Calibration, FrameEncoder, decode_frames

SENSORS = {f"SN-{unit}": f"192.168.10.{20 + unit}" for unit in (1, 2, 3)}
PACKETS_PER_S = len(SENSORS) * 32 * 25
FRAMES = 10
WANTED = 50


class Memory:
    """A port that has everything already."""

    name = "memory"

    def __init__(self, datagrams: list[Datagram]) -> None:
        self.datagrams = datagrams

    def receive(self, timeout_s: float) -> list[Datagram]:
        return self.datagrams

    def discard(self, before_s: float = float("inf")) -> int:
        return 0

    def close(self) -> None:
        pass


def angle(first_number: int) -> list[Datagram]:
    """What three sensors send while the stage stands, interleaved as on the wire."""
    rng = np.random.default_rng(first_number)
    datagrams = []
    for position, address in enumerate(SENSORS.values()):
        encoder = FrameEncoder(HflSettings(), Calibration(fx=58.0))
        for index in range(FRAMES):
            rows = encoder.encode(
                frame_number=first_number + index,
                timestamp=index,
                intensity_counts=rng.integers(0, 4096, (32, 128), np.uint16),
                range_codes=rng.integers(0, 400, (32, 128), np.uint16),
            )
            begin_s = 1.0 + index * 0.040 + position * 1e-4
            datagrams += [Datagram(row, address, begin_s + number * 4e-4) for number, row in enumerate(rows)]
    return sorted(datagrams, key=lambda datagram: datagram.time_s)


def measure(rounds: int = 40) -> dict[str, float]:
    """CPU time per packet and its ratio to the packets' rate, whole way and decoding alone."""
    angles = [angle(1000 * number) for number in range(4)]
    port = Memory([])
    duts = HflReceiver(HflPorts(frames=port), VirtualClock(), SENSORS, HflSettings(exposure_lead_s=0.0))
    packets = 0
    start_s = time.process_time()
    for number in range(rounds):
        port.datagrams = angles[number % len(angles)]
        blocks = duts.collect(list(SENSORS), FRAMES, not_before_s=0.0, timeout_s=1.0)
        packets += sum(block.row_valid.size for block in blocks.values())
    whole_s = (time.process_time() - start_s) / packets
    rows = [datagram.payload for datagram in angles[0] if datagram.sender == "192.168.10.21"]
    start_s = time.process_time()
    for _ in range(rounds):
        decode_frames(rows, HflSettings())
    decode_s = (time.process_time() - start_s) / (rounds * len(rows))
    return {
        "whole_us": whole_s * 1e6,
        "whole_ratio": 1 / (whole_s * PACKETS_PER_S),
        "decode_us": decode_s * 1e6,
        "decode_ratio": 1 / (decode_s * PACKETS_PER_S),
    }


def main() -> int:
    result = measure()
    print(f"three sensors send {PACKETS_PER_S} packets/s")
    for name, key in (("datagrams to pixels", "whole"), ("pixels alone", "decode")):
        print(f"{name:20s} {result[key + '_us']:5.2f} us/packet = {result[key + '_ratio']:.0f} x the sensors' rate")
    good = result["whole_ratio"] >= WANTED
    print(f"wanted: at least {WANTED} x on one core: {'reached' if good else 'MISSED'}")
    return 0 if good else 1


if __name__ == "__main__":
    raise SystemExit(main())
