"""Emulated Conrad relay board: switches the plant's loads, forgets everything on reset."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import final

from pydantic import Field

from arl_fixtures.emulators.device import Outgoing
from arl_fixtures.emulators.fault_kinds import FaultKind
from arl_fixtures.emulators.faults import Fault
from arl_fixtures.emulators.plant import Plant
from arl_fixtures.protocols import conrad
from arl_fixtures.protocols.conrad import Command, Frame
from arl_fixtures.yaml_model import FileModel


class RelaysEmulatorSettings(FileModel):
    """What the emulated board is like."""

    loads: dict[str, int] | None = Field(
        default=None, description="how it is really wired, load to relay; null: as the driver believes"
    )
    firmware: int = Field(default=0x10, ge=0, le=255, description="in the answer to SETUP")
    reply_delay_s: float = Field(default=0.02, ge=0, description="from question to answer, without the line")
    baud: int = Field(default=19200, gt=0, description="how long answers take on the line")
    frame_timeout_s: float = Field(default=0.1, gt=0, description="a half frame is forgotten after this")
    boot_s: float = Field(default=1.0, ge=0, description="deaf after a reset")


@final
class RelaysEmulator:
    """One board at the end of a chain of one.

    Args:
        plant: whose loads it switches.
        loads: load of the plant to relay, from 1; names the plant does not have switch nothing.
        settings: what it is like.
        name: to which faults are addressed.
    """

    def __init__(
        self,
        plant: Plant,
        loads: Mapping[str, int],
        settings: RelaysEmulatorSettings | None = None,
        *,
        name: str = "relays",
    ) -> None:
        self._plant = plant
        self._settings = settings = settings or RelaysEmulatorSettings()
        wiring = loads if settings.loads is None else settings.loads
        self._loads = {load: conrad.mask(relay) for load, relay in wiring.items() if load in plant.loads}
        self._buffer = bytearray()
        self._last_byte_s = -math.inf
        self._address: int | None = None
        self._options = conrad.OPTION_DEFAULT
        self._latch = self._contacts = self._welded = 0
        plant.attach(name, self._on_fault)

    @property
    def boot_s(self) -> float:
        """How long it is deaf after a reset."""
        return self._settings.boot_s

    @property
    def contacts(self) -> int:
        """What is really closed, bit 0 = K1."""
        return self._contacts

    def receive(self, data: bytes, now_s: float) -> list[Outgoing]:
        """Take frames of four bytes; what is for nobody on the chain goes back as it came."""
        settings = self._settings
        if now_s - self._last_byte_s > settings.frame_timeout_s:
            self._buffer.clear()
        self._last_byte_s = now_s
        self._buffer += data
        answers = []
        while len(self._buffer) >= conrad.FRAME_BYTES:
            raw = bytes(self._buffer[: conrad.FRAME_BYTES])
            del self._buffer[: conrad.FRAME_BYTES]
            self._plant.advance(now_s)
            sent = b"".join(conrad.encode(frame) for frame in self._answer(conrad.decode(raw), now_s))
            if sent:
                line_s = len(sent) * 10.0 / settings.baud
                answers.append(Outgoing(now_s + settings.reply_delay_s + line_s, sent))
        return answers

    def disconnect(self, now_s: float) -> None:
        """Nothing: a serial board does not notice."""

    def reset(self, now_s: float) -> None:
        """Address and relay states are lost."""
        self._buffer.clear()
        self._address = None
        self._options = conrad.OPTION_DEFAULT
        self._set_latch(0, now_s)

    def _answer(self, frame: Frame | None, now_s: float) -> list[Frame]:
        own = self._address or 0
        if frame is None:
            return [Frame(conrad.ERROR, own, 0)]
        if frame.command == Command.SETUP:
            if frame.address == conrad.BROADCAST:
                return [frame]
            self._address = frame.address
            answer = Frame(0xFF - Command.SETUP, frame.address, self._settings.firmware)
            return [answer, Frame(Command.SETUP, (frame.address + 1) & 0xFF, frame.data)]
        if frame.address == conrad.BROADCAST:
            if not self._options & conrad.OPTION_EXECUTE_BROADCAST:
                return [frame]
            taken = self._execute(frame, own, now_s)
            passed = [] if self._options & conrad.OPTION_BLOCK_BROADCAST else [frame]
            return ([taken] if taken else []) + passed
        if frame.address != self._address:
            return [frame]
        taken = self._execute(frame, own, now_s)
        return [taken] if taken else []

    def _execute(self, frame: Frame, own: int, now_s: float) -> Frame | None:
        data = frame.data
        match frame.command:
            case Command.NOP:
                pass
            case Command.GET_PORT:
                data = self._latch
            case Command.SET_PORT:
                self._set_latch(data, now_s)
                data = 0
            case Command.GET_OPTION:
                data = self._options
            case Command.SET_OPTION:
                self._options = data & 0x03
            case Command.SET_SINGLE:
                self._set_latch(self._latch | data, now_s)
            case Command.DEL_SINGLE:
                self._set_latch(self._latch & ~data & 0xFF, now_s)
            case Command.TOGGLE:
                self._set_latch(self._latch ^ data, now_s)
            case _:
                return None
        return Frame(0xFF - frame.command, own, data)

    def _set_latch(self, latch: int, now_s: float) -> None:
        self._latch = latch
        # a welded contact stays closed once it is
        self._contacts = latch | (self._contacts & self._welded)
        for load, mask in self._loads.items():
            self._plant.switch(load, bool(self._contacts & mask), now_s)

    def _on_fault(self, fault: Fault, begins: bool, at_s: float) -> None:
        if fault.kind is not FaultKind.RELAY_WELDED:
            return
        mask = 0xFF if fault.channel is None else conrad.mask(fault.channel)
        self._welded = self._welded | mask if begins else self._welded & ~mask
        self._set_latch(self._latch, at_s)
