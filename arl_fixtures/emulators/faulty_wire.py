"""The line between an emulator and its host, with everything that can go wrong on a line."""

from __future__ import annotations

import math
import zlib
from typing import Protocol, final

from arl_fixtures.emulators.device import Outgoing, StreamDevice
from arl_fixtures.emulators.fault_kinds import FaultKind
from arl_fixtures.emulators.faults import Fault
from arl_fixtures.emulators.noise import noise_bytes
from arl_fixtures.emulators.plant import Plant


class Restartable(StreamDevice, Protocol):
    """An emulated device that can lose its supply."""

    @property
    def boot_s(self) -> float:
        """How long it is deaf after power comes back."""

    def reset(self, now_s: float) -> None:
        """Power up anew: whatever the device does not store is lost."""


@final
class FaultyWire:
    """An emulator as seen through its line; without faults it changes nothing.

    Answers never overtake each other, however late some are: a serial line and a TCP connection keep order.

    Args:
        name: device name, to which faults are addressed.
        device: the emulator.
        plant: shared plant; its book of faults is consulted.
    """

    def __init__(self, name: str, device: Restartable, plant: Plant) -> None:
        self.name = name
        self.device = device
        self._plant = plant
        self._deaf_until_s = -math.inf
        self._last_s = -math.inf
        self._held = b""
        self._garbled = 0
        self._stream = zlib.crc32(name.encode())
        plant.attach(name, self._on_fault)

    def is_connected(self, now_s: float) -> bool:
        """Whether the line carries bytes at `now_s`."""
        return self._plant.faults.active(self.name, FaultKind.DISCONNECT, now_s) is None

    def receive(self, data: bytes, now_s: float) -> list[Outgoing]:
        """Pass bytes to the device, unless it is deaf, and its answers back, as far as they survive."""
        self._plant.advance(now_s)
        if now_s < self._deaf_until_s or not self.is_connected(now_s):
            return []
        book = self._plant.faults
        if not book.faults and not self._held:
            answers = self.device.receive(data, now_s)
            if answers and answers[0].time_s >= self._last_s:
                self._last_s = answers[-1].time_s
                return answers
            return self._in_order(answers)
        silence = book.active(self.name, FaultKind.SILENCE, now_s)
        if silence is not None and silence.amount == 0:
            return []
        answers = self.device.receive(data, now_s)
        if silence is not None:
            return []
        return self._in_order([worn for answer in answers for worn in self._wear(answer, now_s)])

    def disconnect(self, now_s: float) -> None:
        """The host closed the line."""
        self._held = b""
        self._last_s = -math.inf
        self.device.disconnect(now_s)

    def _in_order(self, answers: list[Outgoing]) -> list[Outgoing]:
        ordered = []
        for answer in answers:
            self._last_s = max(self._last_s, answer.time_s)
            ordered.append(Outgoing(self._last_s, answer.data))
        return ordered

    def _wear(self, answer: Outgoing, now_s: float) -> list[Outgoing]:
        time_s, data = answer
        book, name = self._plant.faults, self.name
        if (fault := book.active(name, FaultKind.TRUNCATED_REPLY, now_s)) is not None:
            data = data[: max(round(fault.amount), 0)]
        if book.active(name, FaultKind.WRONG_CHECKSUM, now_s) is not None:
            data = _flip_last(data)
        if (fault := book.active(name, FaultKind.GARBAGE, now_s)) is not None:
            count = max(round(fault.amount), 0)
            self._garbled += 1
            garbage = noise_bytes(self._plant.settings.seed, self._stream, self._garbled, count or len(data))
            data = garbage + data if count else garbage
        if (fault := book.active(name, FaultKind.LATE_REPLY, now_s)) is not None:
            time_s += max(fault.amount, 0.0)
        if book.active(name, FaultKind.MERGED_REPLIES, now_s) is not None and not self._held:
            self._held = data
            return []
        data, self._held = self._held + data, b""
        return [Outgoing(time_s, data)] if data else []

    def _on_fault(self, fault: Fault, begins: bool, at_s: float) -> None:
        if fault.kind not in (FaultKind.RESET, FaultKind.BROWN_OUT):
            return
        if begins:
            self.device.reset(at_s)
            self._held = b""
            if fault.kind is FaultKind.BROWN_OUT:
                self._deaf_until_s = fault.end_s + self.device.boot_s
            else:
                self._deaf_until_s = at_s + self.device.boot_s
        elif fault.kind is FaultKind.BROWN_OUT:
            self._deaf_until_s = at_s + self.device.boot_s


def _flip_last(data: bytes) -> bytes:
    body = data.rstrip(b"\r\n")
    if not body:
        return data
    return body[:-1] + bytes((body[-1] ^ 1,)) + data[len(body) :]
