"""What a faulty network or sensor does to the rows of a frame: lost, doubled, out of order, corrupted."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, final

from arl_fixtures.emulators.fault_kinds import FaultKind
from arl_fixtures.emulators.faults import FaultBook
from arl_fixtures.emulators.noise import hash64, noise_bytes, uniform

CORRUPT_BYTES: Final = 64
"""Bytes in a corrupted row that are replaced, in one piece."""

_STREAMS: Final = {
    FaultKind.REORDERED_ROWS: 11,
    FaultKind.LOST_ROWS: 12,
    FaultKind.DUPLICATED_ROWS: 13,
    FaultKind.CORRUPTED_ROWS: 14,
}


@final
class RowFaults:
    """Faults of one DUT's rows, reproducible from seed and time.

    Args:
        faults: faults of the bench.
        device: the DUT's name on the bench.
        seed: of the choice of rows.
    """

    def __init__(self, faults: FaultBook, device: str, seed: int) -> None:
        self._faults, self._device, self._seed = faults, device, seed

    def apply(self, rows: Sequence[bytes], times_s: Sequence[float]) -> list[tuple[float, bytes]]:
        """Times and payloads as they leave the sensor.

        Args:
            rows: payloads of a frame in order.
            times_s: when each would leave.
        """
        sent = list(zip(times_s, rows, strict=True))
        start_s = times_s[0]
        for kind, stream in _STREAMS.items():
            fault = self._faults.active(self._device, kind, start_s)
            if fault is None:
                continue
            frame = round(start_s * 1e6)
            chosen = [
                uniform(self._seed, stream, frame * len(rows) + index) < fault.amount for index in range(len(sent))
            ]
            sent = _CHANGES[kind](sent, chosen, hash64(self._seed, stream, frame))
        return sent


Sent = list[tuple[float, bytes]]


def _reorder(sent: Sent, chosen: Sequence[bool], seed: int) -> Sent:
    """Chosen rows change places among themselves."""
    places = [index for index, hit in enumerate(chosen) if hit]
    if len(places) == 1:
        # one alone changes places with its neighbour
        places.append(places[0] + 1 if places[0] + 1 < len(sent) else places[0] - 1)
    turned = places[1:] + places[:1]
    payloads = [payload for _, payload in sent]
    for place, other in zip(places, turned, strict=True):
        payloads[place] = sent[other][1]
    return [(time_s, payload) for (time_s, _), payload in zip(sent, payloads, strict=True)]


def _lose(sent: Sent, chosen: Sequence[bool], seed: int) -> Sent:
    return [row for row, hit in zip(sent, chosen, strict=True) if not hit]


def _double(sent: Sent, chosen: Sequence[bool], seed: int) -> Sent:
    return [row for row, hit in zip(sent, chosen, strict=True) for _ in range(1 + hit)]


def _corrupt(sent: Sent, chosen: Sequence[bool], seed: int) -> Sent:
    corrupted = []
    for index, ((time_s, payload), hit) in enumerate(zip(sent, chosen, strict=True)):
        if hit:
            start = hash64(seed, 1, index) % (len(payload) - CORRUPT_BYTES)
            nonsense = noise_bytes(seed, 2, index, CORRUPT_BYTES)
            payload = payload[:start] + nonsense + payload[start + CORRUPT_BYTES :]
        corrupted.append((time_s, payload))
    return corrupted


_CHANGES: Final = {
    FaultKind.REORDERED_ROWS: _reorder,
    FaultKind.LOST_ROWS: _lose,
    FaultKind.DUPLICATED_ROWS: _double,
    FaultKind.CORRUPTED_ROWS: _corrupt,
}
