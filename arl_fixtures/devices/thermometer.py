"""Thermocouple module by DCON commands, on a serial line.

An answer to `#AA` carries neither address nor number, so after a time-out a command with an answer of another form
is put first; see `exchange`.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from typing import Final, TypeVar, final

from pydantic import Field

from arl_fixtures.devices.exchange import Exchange, ExchangeSettings, Question
from arl_fixtures.devices.interfaces import Identity, Reading
from arl_fixtures.devices.port import Clock, StreamPort
from arl_fixtures.errors import DeviceError, RemoteProtocolError
from arl_fixtures.protocols import dcon
from arl_fixtures.protocols.dcon import DconWire

AnswerT = TypeVar("AnswerT")

_STATUS_FORM: Final = re.compile(r"[0-9A-F]{2}")
_CONFIG_FORM: Final = re.compile(r"[0-9A-F]{6}")


class DconSettings(DconWire):
    """Patience with a DCON module; times on the bench clock."""

    timeout_s: float = Field(default=0.5, gt=0, description="58 characters at 9600 baud take 60 ms")
    retries: int = Field(default=1, ge=0, description="how often a question is asked again")
    quiet_s: float = Field(default=3.0, ge=0, description="no answer is later than this")
    type_code: int = Field(default=dcon.TYPE_K, ge=0, le=255, description="thermocouple type the module must have")
    open_wire_query: bool = Field(default=False, description="ask $AAB for open wires (ADAM-4019+ and alike)")


@final
class DconThermometer:
    """Driver for a DCON thermocouple module (ICP DAS I-7018, ADAM-4018 and alike).

    Args:
        port: the line.
        clock: the bench clock.
        settings: address, checksum and patience.
    """

    def __init__(self, port: StreamPort, clock: Clock, settings: DconSettings | None = None) -> None:
        self._settings = settings = settings or DconSettings()
        patience = ExchangeSettings(timeout_s=settings.timeout_s, retries=settings.retries, quiet_s=settings.quiet_s)
        self._exchange = Exchange("thermometer", port, clock, patience, fences=self._fences)
        self._address = f"{settings.address:02X}"
        self._read_all = self._question("read all channels", "values", f"#{self._address}", self._values)
        self._open_wires = self._question("open wires", "status", f"${self._address}B", self._mask)

    def identify(self) -> Identity:
        """Module name and firmware; also checks how the module is configured (three exchanges).

        Raises:
            DeviceError: the module is set to another thermocouple type or data format.
        """
        name = self._exchange.ask(self._question("name", "text", f"${self._address}M", self._text))
        firmware = self._exchange.ask(self._question("firmware", "text", f"${self._address}F", self._text))
        config = self._exchange.ask(self._question("configuration", "config", f"${self._address}2", self._config))
        place = self._exchange.place
        if not config.engineering:
            raise DeviceError(f"{place}: values are not in engineering units (format byte {config.format_code:02X})")
        if config.type_code != self._settings.type_code:
            raise DeviceError(
                f"{place}: thermocouple type code is {config.type_code:02X}, expected {self._settings.type_code:02X}"
            )
        return Identity(name=name, firmware=firmware)

    def read_c(self) -> tuple[Reading, ...]:
        """All channels of the module, used or not, in order (two exchanges with `open_wire_query`)."""
        values = self._exchange.ask(self._read_all)
        readings = [Reading(value.value_c, value.fault.value if value.fault else "") for value in values]
        if self._settings.open_wire_query:
            mask = self._exchange.ask(self._open_wires)
            readings = [
                Reading(None, "open") if mask >> channel & 1 else reading for channel, reading in enumerate(readings)
            ]
        return tuple(readings)

    def close(self) -> None:
        """Release the line."""
        self._exchange.close()

    def _question(
        self, what: str, kind: str, command: str, understand: Callable[[str], AnswerT | None]
    ) -> Question[AnswerT]:
        checked = self._settings.checksum

        def find(received: bytes) -> AnswerT | None:
            complaint = None
            for text in dcon.find_replies(received, with_checksum=checked):
                try:
                    answer = understand(text)
                except RemoteProtocolError as error:
                    complaint = error
                    continue
                if answer is not None:
                    return answer
                if text == f"?{self._address}":
                    complaint = RemoteProtocolError(f"the module refused '{command}'")
            if complaint is not None:
                raise RemoteProtocolError(f"{self._exchange.place}: {complaint}")
            return None

        return Question(what, kind, dcon.encode(command, with_checksum=checked), find)

    def _values(self, text: str) -> tuple[dcon.Value, ...] | None:
        if not text.startswith(">"):
            return None
        values = dcon.parse_values(text[1:])
        if len(values) != self._settings.channels:
            raise RemoteProtocolError(
                f"expected {self._settings.channels} channels, got {len(values)}: {text[:80]!r}"
            )
        return values

    def _after_address(self, text: str) -> str | None:
        lead = f"!{self._address}"
        return text[len(lead) :] if text.startswith(lead) else None

    def _text(self, text: str) -> str | None:
        rest = self._after_address(text)
        if not rest or _STATUS_FORM.fullmatch(rest) or _CONFIG_FORM.fullmatch(rest):
            return None
        return "".join(character if character.isprintable() else "?" for character in rest)

    def _config(self, text: str) -> dcon.Config | None:
        rest = self._after_address(text)
        return dcon.parse_config(text, self._settings.address) if rest and _CONFIG_FORM.fullmatch(rest) else None

    def _mask(self, text: str) -> int | None:
        rest = self._after_address(text)
        return int(rest, 16) if rest and _STATUS_FORM.fullmatch(rest) else None

    def _fences(self) -> Iterator[Question[object]]:
        address = self._address
        yield self._question("name", "text", f"${address}M", self._text)
        yield self._question("configuration", "config", f"${address}2", self._config)
        yield self._question("module status", "status", f"~{address}0", self._mask)
