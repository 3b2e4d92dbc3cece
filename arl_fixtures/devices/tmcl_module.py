"""One axis of a Trinamic module as parameters that can be read and written, over TMCL direct mode.

An answer has no number, so after a time-out a nonce is written to a user variable: the module echoes it, and
nothing older can be mistaken for that.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from typing import final

from pydantic import Field

from arl_fixtures.devices.exchange import Exchange, ExchangeSettings, Question
from arl_fixtures.devices.port import Clock, StreamPort
from arl_fixtures.errors import DeviceError, RemoteProtocolError
from arl_fixtures.protocols import tmcl
from arl_fixtures.protocols.tmcl import Axis, Command, Request, StatusCode, TmclWire, VersionType


class TmclModuleSettings(TmclWire):
    """Patience with a module; times on the bench clock."""

    timeout_s: float = Field(default=0.25, gt=0, description="for one answer")
    retries: int = Field(default=1, ge=0, description="how often a question is asked again")
    nonce_variable: int | None = Field(
        default=51, ge=0, le=55, description="user variable for the fence; null: be quiet for quiet_s instead"
    )
    quiet_s: float = Field(default=3.0, ge=0, description="no answer is later than this (without nonce)")
    version_text: bool = Field(default=False, description="ask the version as text, not as number")


@final
class TmclModule:
    """Commands to one axis.

    Args:
        device: name for messages.
        port: the line.
        clock: the bench clock.
        settings: addresses and patience.
    """

    def __init__(self, device: str, port: StreamPort, clock: Clock, settings: TmclModuleSettings) -> None:
        self._settings = settings
        patience = ExchangeSettings(timeout_s=settings.timeout_s, retries=settings.retries, quiet_s=settings.quiet_s)
        self._exchange = Exchange(device, port, clock, patience, fences=self._fences)
        self._nonces = itertools.count(1)

    @property
    def place(self) -> str:
        """Device and line, for messages."""
        return self._exchange.place

    def close(self) -> None:
        """Release the line."""
        self._exchange.close()

    def version(self) -> tuple[str, str]:
        """Module number and firmware version."""
        if self._settings.version_text:
            host = self._settings.host_address
            request = self._request(Command.GET_VERSION, VersionType.TEXT, 0, None)
            data = tmcl.encode_request(request)
            question = Question("version", "text", data, lambda b: tmcl.find_version_text(b, host=host))
            module, _, version = self._exchange.ask(question).partition("V")
            return module, version
        number, major, minor = tmcl.decode_version(self.do(Command.GET_VERSION, VersionType.BINARY))
        return str(number), f"{major}.{minor:02d}"

    def axis(self, parameter: Axis) -> int:
        """Read an axis parameter."""
        return self.do(Command.GET_AXIS, parameter)

    def set_axis(self, parameter: Axis, value: int) -> None:
        """Write an axis parameter."""
        self.do(Command.SET_AXIS, parameter, value)

    def user(self, variable: int) -> int:
        """Read a user variable; zero after a restart."""
        return self.do(Command.GET_GLOBAL, variable, motor=tmcl.USER_BANK)

    def set_user(self, variable: int, value: int) -> None:
        """Write a user variable."""
        self.do(Command.SET_GLOBAL, variable, value, motor=tmcl.USER_BANK)

    def do(self, command: Command, kind: int = 0, value: int = 0, *, motor: int | None = None) -> int:
        """Any command; returns the answer's value.

        Raises:
            DeviceError: the module refused it.
        """
        request = self._request(command, kind, value, motor)
        reply = self._exchange.ask(self._question(request))
        if reply.status not in (StatusCode.OK, StatusCode.LOADED):
            meaning = StatusCode(reply.status).name.lower().replace("_", " ")
            raise DeviceError(f"{self.place}: refused {_name(request)}: {meaning} (status {reply.status})")
        return reply.value

    def _request(self, command: Command, kind: int, value: int, motor: int | None) -> Request:
        settings = self._settings
        return Request(settings.module_address, command, kind, settings.motor if motor is None else motor, value)

    def _question(self, request: Request, *, nonce: int | None = None) -> Question[tmcl.Reply]:
        host, module, command = self._settings.host_address, request.module, request.command

        def find(received: bytes) -> tmcl.Reply | None:
            reply = tmcl.find_reply(received, host=host, module=module, command=command, value=nonce)
            if reply is not None and reply.status == StatusCode.WRONG_CHECKSUM:
                raise RemoteProtocolError(f"{self.place}: {_name(request)} arrived broken at the module")
            return reply

        return Question(_name(request), (command, nonce), tmcl.encode_request(request), find)

    def _fences(self) -> Iterator[Question[object]]:
        if self._settings.nonce_variable is not None:
            nonce = next(self._nonces)
            request = self._request(Command.SET_GLOBAL, self._settings.nonce_variable, nonce, tmcl.USER_BANK)
            yield self._question(request, nonce=nonce)


def _name(request: Request) -> str:
    name = Command(request.command).name.lower().replace("_", " ")
    if request.command in (Command.GET_AXIS, Command.SET_AXIS):
        return f"{name} {Axis(request.type).name.lower().replace('_', ' ')}"
    return name
