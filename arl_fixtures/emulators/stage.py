"""Emulated Trinamic module that turns the plant's stage: TMCL direct mode, frame by frame."""

from __future__ import annotations

import math
from typing import Final, final

from pydantic import Field

from arl_fixtures.emulators.device import Outgoing
from arl_fixtures.emulators.motor import EmulatedMotor, MotorSettings
from arl_fixtures.emulators.plant import Plant
from arl_fixtures.protocols import tmcl
from arl_fixtures.protocols.tmcl import Command, MoveType, Reply, Request, StatusCode, TmclWire, VersionType

_USER_VARIABLES: Final = 56
_COMMANDS: Final = frozenset(int(command) for command in Command)
_MOVE_TYPES: Final = frozenset(int(kind) for kind in MoveType)


class StageEmulatorSettings(MotorSettings):
    """What the emulated module is like, beside its motor and stage."""

    module_number: int = Field(default=1240, ge=0, le=0xFFFF, description="in the binary version")
    version: tuple[int, int] = Field(default=(1, 5), description="in the binary version")
    version_text: str = Field(default="1240V105", min_length=8, max_length=8, description="version as text")
    baud: int = Field(default=115200, gt=0, description="how long answers take on the line")
    reply_delay_s: float = Field(default=0.0005, ge=0, description="from question to answer, without the line")
    telegram_pause_s: float = Field(default=0.05, gt=0, description="a half frame is forgotten after this")
    boot_s: float = Field(default=0.5, ge=0, description="deaf after power-up")


@final
class StageEmulator:
    """A module that answers TMCL requests and turns the plant's stage.

    Args:
        plant: whose stage it turns.
        wire: addresses and motor number.
        settings: what it is like.
        name: to which faults are addressed.
    """

    def __init__(
        self,
        plant: Plant,
        wire: TmclWire | None = None,
        settings: StageEmulatorSettings | None = None,
        *,
        name: str = "stage",
    ) -> None:
        self._plant, self._wire = plant, wire or TmclWire()
        self._settings = settings = settings or StageEmulatorSettings()
        self._motor = EmulatedMotor(settings, plant.stage_track)
        self._buffer = bytearray()
        self._last_byte_s = -math.inf
        self._globals = self._fresh_globals()
        plant.attach(name, self._motor.on_fault)

    @property
    def boot_s(self) -> float:
        """How long it is deaf after power comes back."""
        return self._settings.boot_s

    def receive(self, data: bytes, now_s: float) -> list[Outgoing]:
        """Answer each frame for this module; a wrong checksum is answered with status 1."""
        settings, wire = self._settings, self._wire
        if now_s - self._last_byte_s > settings.telegram_pause_s:
            self._buffer.clear()
        self._last_byte_s = now_s
        self._buffer += data
        answers = []
        while len(self._buffer) >= tmcl.FRAME_BYTES:
            frame = bytes(self._buffer[: tmcl.FRAME_BYTES])
            del self._buffer[: tmcl.FRAME_BYTES]
            if frame[0] != wire.module_address:
                continue
            self._plant.advance(now_s)
            answers += self._answer(frame, now_s)
        return answers

    def disconnect(self, now_s: float) -> None:
        """Nothing: a serial module does not notice."""

    def reset(self, now_s: float) -> None:
        """The motor loses its current; position, parameters and user variables are lost."""
        self._buffer.clear()
        self._motor.reset(now_s)
        self._globals = self._fresh_globals()

    def _fresh_globals(self) -> dict[tuple[int, int], int]:
        user = {(tmcl.USER_BANK, number): 0 for number in range(_USER_VARIABLES)}
        return user | {(0, 65): 7, (0, 66): self._wire.module_address, (0, 76): self._wire.host_address}

    # -- frames

    def _answer(self, frame: bytes, now_s: float) -> list[Outgoing]:
        wire, settings = self._wire, self._settings
        at_s = now_s + settings.reply_delay_s + 10.0 * tmcl.FRAME_BYTES / settings.baud
        request = tmcl.decode_request(frame)
        if request is None:
            reply = Reply(wire.host_address, wire.module_address, StatusCode.WRONG_CHECKSUM, frame[1], 0)
            return [Outgoing(at_s, tmcl.encode_reply(reply))]
        if request.command == Command.GET_VERSION and request.type == VersionType.TEXT:
            return [Outgoing(at_s, tmcl.encode_version_text(wire.host_address, settings.version_text))]
        status, value = self._execute(request, now_s)
        reply = Reply(wire.host_address, wire.module_address, status, request.command, value)
        return [Outgoing(at_s, tmcl.encode_reply(reply))]

    def _execute(self, request: Request, now_s: float) -> tuple[int, int]:
        _, command, kind, motor, value = request
        if command in (Command.SET_GLOBAL, Command.GET_GLOBAL):
            return self._global(command, kind, motor, value)
        if command == Command.GET_VERSION:
            major, minor = self._settings.version
            if kind != VersionType.BINARY:
                return StatusCode.WRONG_TYPE, 0
            return StatusCode.OK, tmcl.encode_version(self._settings.module_number, major, minor)
        if command == Command.NOTIFY_REACHED:
            return StatusCode.NOT_AVAILABLE, 0
        if command not in _COMMANDS:
            return StatusCode.INVALID_COMMAND, 0
        if motor != self._wire.motor:
            return StatusCode.INVALID_VALUE, 0
        match command:
            case Command.GET_AXIS:
                found = self._motor.read(kind, now_s)
                return (StatusCode.WRONG_TYPE, 0) if found is None else (StatusCode.OK, found)
            case Command.SET_AXIS:
                return self._motor.write(kind, value, now_s), value
            case Command.REFERENCE_SEARCH:
                return self._motor.search(kind, now_s)
            case Command.STOP:
                self._motor.stop(now_s)
                return StatusCode.OK, value
            case Command.MOVE if kind in _MOVE_TYPES:
                if self._motor.is_searching(now_s):
                    return StatusCode.NOT_AVAILABLE, 0
                target = value if kind == MoveType.ABSOLUTE else self._motor.target + value
                self._motor.move(target, now_s)
                return StatusCode.OK, target
            case Command.ROTATE_RIGHT | Command.ROTATE_LEFT:
                self._motor.rotate(value if command == Command.ROTATE_RIGHT else -value, now_s)
                return StatusCode.OK, value
        return StatusCode.WRONG_TYPE, 0

    def _global(self, command: int, kind: int, bank: int, value: int) -> tuple[int, int]:
        if (bank, kind) not in self._globals:
            return StatusCode.WRONG_TYPE, 0
        if command == Command.SET_GLOBAL:
            if bank != tmcl.USER_BANK:
                return StatusCode.EEPROM_LOCKED, value
            self._globals[bank, kind] = value
        return StatusCode.OK, self._globals[bank, kind]
