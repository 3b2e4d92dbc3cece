"""Emulated DCON thermocouple module: eight channels that measure the plant."""

from __future__ import annotations

import re
from typing import Final, Literal, final

from pydantic import Field

from arl_fixtures.emulators.device import Outgoing
from arl_fixtures.emulators.fault_kinds import FaultKind
from arl_fixtures.emulators.faults import Fault
from arl_fixtures.emulators.noise import gauss
from arl_fixtures.emulators.plant import Plant
from arl_fixtures.errors import ConfigError
from arl_fixtures.protocols import dcon
from arl_fixtures.protocols.dcon import Config, DconWire, RangeDialect, RangeFault, Value
from arl_fixtures.yaml_model import FileModel

_NOISE_STREAM: Final = 0x5443
_COLD_JUNCTION_C: Final = 24.3
_RANGE_C: Final[dict[RangeDialect, tuple[float, float]]] = {"adam": (0.0, 1370.0), "icp": (-270.0, 1372.0)}
"""Range of a thermocouple of type K; ADAM's ends at 0 °C, so below it an ADAM module reads under range."""

_SOURCE: Final = re.compile(r"ambient|plate|coolant|open|housing_[1-9][0-9]*")


class ThermometerEmulatorSettings(FileModel):
    """What the emulated module is like, and what its thermocouples are stuck to."""

    sources: tuple[str, ...] = Field(
        default=("ambient", "plate", "housing_1", "housing_2", "housing_3"),
        description="of each channel: ambient, plate, coolant, housing_1 …, or open; channels beyond are open",
    )
    offsets_k: tuple[float, ...] = Field(default=(), description="error of each channel; zero beyond the list")
    noise_k: float = Field(default=0.1, ge=0, description="one standard deviation, new each period_s")
    resolution_k: float = Field(default=0.1, gt=0, description="values are rounded to it")
    period_s: float = Field(default=0.1, gt=0, description="between two conversions")
    range_dialect: RangeDialect = Field(default="icp", description="text of a value out of range; adam ends at 0 °C")
    open_wire_query: bool = Field(default=False, description="answers $AAB with a mask of open wires")
    type_code: int = Field(default=dcon.TYPE_K, ge=0, le=255, description="thermocouple type, 15 = K")
    baud: Literal[1200, 2400, 4800, 9600, 19200, 38400, 57600, 115200] = Field(
        default=9600, description="how long answers take on the line"
    )
    name: str = Field(default="7018", pattern=r"^[0-9A-Z+-]{1,8}$", description="answer to $AAM")
    firmware: str = Field(default="B1.2", pattern=r"^[0-9A-Z.]{1,8}$", description="answer to $AAF")
    reply_delay_s: float = Field(default=0.005, ge=0, description="from question to answer, without the line")
    boot_s: float = Field(default=1.0, ge=0, description="deaf after power-up")


@final
class ThermometerEmulator:
    """A module that answers DCON commands.

    Args:
        plant: what it measures.
        wire: address, checksum, number of channels.
        settings: what it is like.
        name: to which faults are addressed.

    Raises:
        ConfigError: a source does not exist on the plant.
    """

    def __init__(
        self,
        plant: Plant,
        wire: DconWire | None = None,
        settings: ThermometerEmulatorSettings | None = None,
        *,
        name: str = "thermometer",
    ) -> None:
        self._plant, self._wire = plant, wire or DconWire()
        self._settings = settings = settings or ThermometerEmulatorSettings()
        for source in settings.sources:
            number = source.partition("housing_")[2]
            if not _SOURCE.fullmatch(source) or (number and int(number) > plant.dut_count):
                raise ConfigError(
                    f"thermometer emulator: no source '{source}' on a plant with {plant.dut_count} DUTs"
                )
        self._buffer = bytearray()
        self._faults: list[tuple[Fault, float, tuple[Value, ...]]] = []
        self._restarted = True
        self._latched: tuple[Value, ...] | None = None
        self._latched_read = False
        self._address, self._type_code = self._wire.address, settings.type_code
        plant.attach(name, self._on_fault)

    @property
    def boot_s(self) -> float:
        """How long it is deaf after power comes back."""
        return self._settings.boot_s

    def receive(self, data: bytes, now_s: float) -> list[Outgoing]:
        """Answer what is understood; wrong syntax, address or checksum get no answer."""
        self._buffer += data
        answers = []
        for text in dcon.take_requests(self._buffer, with_checksum=self._wire.checksum):
            self._plant.advance(now_s)
            reply = self._answer(text, now_s)
            if reply is not None:
                frame = dcon.encode(reply, with_checksum=self._wire.checksum)
                line_s = len(frame) * 10.0 / self._settings.baud
                answers.append(Outgoing(now_s + self._settings.reply_delay_s + line_s, frame))
        return answers

    def disconnect(self, now_s: float) -> None:
        """Nothing: a serial module does not notice; what it half received stays."""

    def reset(self, now_s: float) -> None:
        """Configuration is stored; the synchronous sample is lost."""
        self._buffer.clear()
        self._latched = None
        self._restarted = True

    # -- commands

    def _answer(self, text: str, now_s: float) -> str | None:
        if text == "#**":
            self._latched, self._latched_read = self._values(now_s), False
            return None
        address = f"{self._address:02X}"
        if text[1:3] != address or text == "~**":
            return None
        lead, command = text[0], text[3:]
        if lead == "#" and command == "":
            return ">" + self._text(self._values(now_s))
        if lead == "#" and re.fullmatch(r"[0-9A-F]", command):
            channel = int(command, 16)
            if channel >= self._wire.channels:
                return f"?{address}"
            return ">" + self._text(self._values(now_s)[channel : channel + 1])
        if lead == "~" and command == "0":
            return f"!{address}00"
        if lead == "%":
            return self._configure(command, address)
        if lead == "$":
            return self._dollar(command, address, now_s)
        return None

    def _dollar(self, command: str, address: str, now_s: float) -> str | None:
        settings = self._settings
        match command:
            case "M":
                return f"!{address}{settings.name}"
            case "F":
                return f"!{address}{settings.firmware}"
            case "2":
                return dcon.format_config(self._config(), self._address)
            case "3":
                return f">{_COLD_JUNCTION_C:+08.2f}"
            case "4":
                if self._latched is None:
                    return f"?{address}"
                first, self._latched_read = not self._latched_read, True
                return f">{address}{int(first)}{self._text(self._latched)}"
            case "6":
                return f"!{address}{(1 << min(self._wire.channels, 8)) - 1:02X}"
            case "B":
                if not settings.open_wire_query:
                    return f"?{address}"
                mask = sum(1 << channel for channel in range(self._wire.channels) if self._is_open(channel))
                return f"!{address}{mask & 0xFF:02X}"
        return None

    def _configure(self, command: str, address: str) -> str | None:
        match = re.fullmatch(r"([0-9A-F]{2})([0-9A-F]{2})([0-9A-F]{2})([0-9A-F]{2})", command)
        if match is None:
            return None
        new_address, type_code, baud_code, format_code = (int(part, 16) for part in match.groups())
        now = self._config()
        # baud, checksum and format only change with a jumper set; thermocouples have type codes 0E to 19
        if (baud_code, format_code) != (now.baud_code, now.format_code) or not 0x0E <= type_code <= 0x19:
            return f"?{address}"
        self._address, self._type_code = new_address, type_code
        return f"!{new_address:02X}"

    def _config(self) -> Config:
        baud_code = next(code for code, baud in dcon.BAUD_CODES.items() if baud == self._settings.baud)
        return Config(self._type_code, baud_code, dcon.CHECKSUM_BIT if self._wire.checksum else 0)

    def _text(self, values: tuple[Value, ...]) -> str:
        return "".join(dcon.format_value(value, self._settings.range_dialect) for value in values)

    # -- measurement

    def _values(self, now_s: float) -> tuple[Value, ...]:
        values = tuple(self._value(channel, now_s) for channel in range(self._wire.channels))
        for fault, _, frozen in self._faults:
            if fault.kind is FaultKind.STUCK_VALUE:
                values = tuple(
                    frozen[channel] if fault.channel in (None, channel) else value
                    for channel, value in enumerate(values)
                )
        return values

    def _value(self, channel: int, now_s: float) -> Value:
        if self._is_open(channel):
            return Value(None, RangeFault.OVER)
        settings = self._settings
        sample = int(now_s / settings.period_s) * self._wire.channels + channel
        value_c = self._true_c(self._source(channel))
        value_c += settings.noise_k * gauss(self._plant.settings.seed, _NOISE_STREAM, sample)
        if channel < len(settings.offsets_k):
            value_c += settings.offsets_k[channel]
        for fault, since_s, _ in self._faults:
            if fault.kind is FaultKind.DRIFT and fault.channel in (None, channel):
                value_c += fault.amount * (now_s - since_s) / 3600.0
        low_c, high_c = _RANGE_C[settings.range_dialect]
        if value_c > high_c:
            return Value(None, RangeFault.OVER)
        if value_c < low_c:
            return Value(None, RangeFault.UNDER)
        return Value(round(value_c / settings.resolution_k) * settings.resolution_k, None)

    def _source(self, channel: int) -> str:
        sources = self._settings.sources
        for fault, _, _ in self._faults:
            if fault.kind is FaultKind.WRONG_CHANNEL_ORDER and channel < len(sources):
                return sources[(channel - round(fault.amount)) % len(sources)]
        return sources[channel] if channel < len(sources) else "open"

    def _is_open(self, channel: int) -> bool:
        return self._source(channel) == "open" or any(
            fault.kind is FaultKind.OPEN_THERMOCOUPLE and fault.channel in (None, channel)
            for fault, _, _ in self._faults
        )

    def _true_c(self, source: str) -> float:
        plant = self._plant
        if source == "ambient":
            return plant.ambient_c
        if source == "plate":
            return plant.plate_c
        if source == "coolant":
            return plant.coolant_c
        return plant.housing_c[int(source.removeprefix("housing_")) - 1]

    def _on_fault(self, fault: Fault, begins: bool, at_s: float) -> None:
        if begins:
            frozen = self._values(at_s) if fault.kind is FaultKind.STUCK_VALUE else ()
            self._faults.append((fault, at_s, frozen))
        else:
            self._faults = [entry for entry in self._faults if entry[0] is not fault]
