"""Emulated Huber thermostat: PB commands on one side, the plant's coolant on the other."""

from __future__ import annotations

import math
from typing import Final, final

from pydantic import Field

from arl_fixtures.emulators.device import Outgoing
from arl_fixtures.emulators.fault_kinds import FaultKind
from arl_fixtures.emulators.faults import Fault
from arl_fixtures.emulators.noise import gauss
from arl_fixtures.emulators.plant import Plant
from arl_fixtures.protocols import huber_pb as pb
from arl_fixtures.protocols.huber_pb import Address, PbWire, Status
from arl_fixtures.yaml_model import FileModel

_ATMOSPHERE_MBAR: Final = 1000.0
_NOISE_STREAM: Final = 0x4342
_LEVEL_TOO_LOW: Final = -75
_PLAIN: Final = {0x12: 1, 0x13: 0, 0x15: 0, 0x17: 0}
"""Read-write variables that only remember, with their values after power-up."""


class ChillerEmulatorSettings(FileModel):
    """What the emulated thermostat is like; defaults suit the nominal bench."""

    setpoint_min_c: float = Field(default=-40.0, description="lower values are clamped")
    setpoint_max_c: float = Field(default=110.0, description="higher values are clamped")
    setpoint_start_c: float = Field(default=20.0, description="the panel's value, taken after power-up")
    setpoint_ramp_k_per_min: float = Field(default=math.inf, gt=0, description="limit on the set-point in effect")
    bath_noise_k: float = Field(default=0.01, ge=0, description="one standard deviation, new each second")
    serial: int = Field(default=423_117, ge=0, lt=2**32, description="serial number")
    pump_rpm: int = Field(default=3500, ge=0, le=32000, description="pump speed after power-up")
    pump_head_mbar: float = Field(default=350.0, ge=0, description="above atmosphere, at the default speed")
    level_percent: float = Field(default=82.0, ge=0, le=100, description="fill level")
    level_warning_percent: float = Field(default=10.0, description="below it warns")
    level_stop_percent: float = Field(default=5.0, description="below it stops the pump with error -75")
    level_warning_code: int = Field(default=-2098, lt=0, description="code of that warning")
    maintenance_days: int = Field(default=200, ge=0, le=32766, description="until maintenance")
    reply_delay_s: float = Field(default=0.02, ge=0, description="from question to answer")
    silent_after_start_s: float = Field(default=0.0, ge=0, description="Petite Fleur: 10")
    silent_after_circulation_s: float = Field(default=0.0, ge=0, description="Petite Fleur: 5")
    lower_case: bool = Field(default=False, description="hexadecimal digits of answers")
    boot_s: float = Field(default=5.0, ge=0, description="deaf after power-up")


@final
class ChillerEmulator:
    """A thermostat that answers PB requests.

    Args:
        plant: whose coolant it drives.
        wire: what sources disagree about.
        settings: what it is like.
        name: to which faults are addressed.
    """

    def __init__(
        self,
        plant: Plant,
        wire: PbWire | None = None,
        settings: ChillerEmulatorSettings | None = None,
        *,
        name: str = "chiller",
    ) -> None:
        self._plant, self._wire = plant, wire or PbWire()
        self._settings = settings or ChillerEmulatorSettings()
        self._buffer = bytearray()
        self._faults: list[Fault] = []
        self._frozen_c: float | None = None
        self._drift_since_s = 0.0
        self._power_up()
        plant.attach(name, self._on_fault)

    @property
    def boot_s(self) -> float:
        """How long it is deaf after power comes back."""
        return self._settings.boot_s

    def receive(self, data: bytes, now_s: float) -> list[Outgoing]:
        """Answer each well-formed request; anything else gets no answer."""
        self._buffer += data
        answers = []
        for request in pb.take_requests(self._buffer):
            self._plant.advance(now_s)
            if now_s < self._silent_until_s:
                continue
            if request.word is not None:
                self._write(request.address, request.word, now_s)
            reply = pb.encode_reply(request.address, self._read(request.address, now_s))
            if self._settings.lower_case:
                reply = reply[:2] + reply[2:].lower()
            answers.append(Outgoing(now_s + self._settings.reply_delay_s, reply))
        return answers

    def disconnect(self, now_s: float) -> None:
        """Forget what was half received."""
        self._buffer.clear()

    def reset(self, now_s: float) -> None:
        """Come back with the panel's values, pump and control off."""
        self._power_up()
        self._buffer.clear()
        self._evaluate(now_s)

    def _power_up(self) -> None:
        settings = self._settings
        self._setpoint_c = self._followed_c = settings.setpoint_start_c
        self._controlling = self._circulation_asked = False
        self._error = self._warning = 0
        self._pump_rpm = settings.pump_rpm
        self._plain = dict(_PLAIN)
        self._silent_until_s = -math.inf

    # -- variables

    def _read(self, address: int, now_s: float) -> int:
        settings, wire = self._settings, self._wire
        if address in self._plain:
            return self._plain[address]
        match address:
            case Address.SETPOINT:
                return pb.encode_temperature(self._setpoint_c)
            case Address.BATH:
                return pb.encode_temperature(self._bath_c(now_s))
            case Address.PUMP_PRESSURE:
                share = (self._pump_rpm / settings.pump_rpm) ** 2 if self._pumping and settings.pump_rpm else 0.0
                mbar = _ATMOSPHERE_MBAR + settings.pump_head_mbar * share
                return round(mbar / wire.pressure_mbar_per_count) & 0xFFFF
            case Address.ERROR:
                return pb.to_word(self._error)
            case Address.WARNING:
                return pb.to_word(self._warning)
            case Address.PROCESS | Address.PROCESS_3A if address == wire.process_address:
                return pb.SENSOR_MISSING
            case Address.STATUS:
                return pb.encode_status(self._status(), wire.status_bit_order)
            case Address.LEVEL:
                return round(self._level_percent() * 10.0)
            case Address.CONTROL:
                return int(self._controlling)
            case Address.CIRCULATION:
                return int(self._circulating)
            case Address.SERIAL_1B | Address.SERIAL_1C:
                return pb.encode_serial(settings.serial, wire.serial_word_order)[address - Address.SERIAL_1B]
            case Address.PUMP_SPEED:
                return self._pump_rpm if self._pumping else 0
            case Address.PUMP_SPEED_SETPOINT:
                return self._pump_rpm
            case Address.SETPOINT_MIN:
                return pb.encode_temperature(settings.setpoint_min_c)
            case Address.SETPOINT_MAX:
                return pb.encode_temperature(settings.setpoint_max_c)
            case Address.MAINTENANCE_DAYS:
                return settings.maintenance_days
        return pb.NOT_AVAILABLE

    def _write(self, address: int, word: int, now_s: float) -> None:
        settings = self._settings
        if address in self._plain:
            self._plain[address] = word
        match address:
            case Address.SETPOINT:
                value_c = pb.decode_temperature(word)
                ignored = self._fault(FaultKind.SETPOINT_IGNORED)
                if value_c is None or (ignored is not None and ignored.amount == 1):
                    return
                self._setpoint_c = min(max(value_c, settings.setpoint_min_c), settings.setpoint_max_c)
            case Address.CONTROL:
                on = bool(word) and not self._error
                if on and not self._controlling:
                    self._silent_until_s = now_s + settings.silent_after_start_s
                self._controlling = on
            case Address.CIRCULATION:
                on = bool(word) and self._level_percent() >= settings.level_stop_percent
                if on and not self._circulating:
                    self._silent_until_s = now_s + settings.silent_after_circulation_s
                self._circulation_asked = on
                self._controlling = self._controlling and on
            case Address.PUMP_SPEED_SETPOINT:
                self._pump_rpm = min(word, 32000)
            case Address.ERROR if word == 1:
                self._error = 0
            case Address.WARNING if word == 1:
                self._warning = 0
        self._evaluate(now_s)

    def _bath_c(self, now_s: float) -> float:
        if self._frozen_c is not None:
            return self._frozen_c
        settings, seed = self._settings, self._plant.settings.seed
        value_c = self._plant.coolant_c + settings.bath_noise_k * gauss(seed, _NOISE_STREAM, int(now_s))
        drift = self._fault(FaultKind.DRIFT)
        if drift is not None:
            value_c += drift.amount * (now_s - self._drift_since_s) / 3600.0
        return value_c

    def _status(self) -> Status:
        flags = {
            Status.CONTROLLING: self._controlling,
            Status.CIRCULATING: self._circulating,
            Status.PUMPING: self._pumping,
            Status.COMPRESSOR: self._controlling,
            Status.COOLING_AVAILABLE: True,
            Status.KEY_LOCK: bool(self._plain[0x17]),
            Status.PID_AUTO: bool(self._plain[0x12]),
            Status.ERROR: self._error != 0,
            Status.WARNING: self._warning != 0,
            # said by one source to be 0 after a restart until read; nothing relies on it
            Status.BIT_14: True,
        }
        word = Status(0)
        for flag, holds in flags.items():
            word |= flag if holds else Status(0)
        return word

    # -- behaviour

    @property
    def _circulating(self) -> bool:
        # temperature control needs flow, and without it only what was asked for goes on
        return self._circulation_asked or self._controlling

    @property
    def _pumping(self) -> bool:
        return self._circulating and self._fault(FaultKind.PUMP_STOP) is None

    def _level_percent(self) -> float:
        low = self._fault(FaultKind.LOW_LEVEL)
        return self._settings.level_percent if low is None else min(max(low.amount, 0.0), 100.0)

    def _fault(self, kind: FaultKind) -> Fault | None:
        for fault in reversed(self._faults):
            if fault.kind is kind:
                return fault
        return None

    def _on_fault(self, fault: Fault, begins: bool, at_s: float) -> None:
        if not begins:
            self._faults.remove(fault)
            if fault.kind is FaultKind.STUCK_VALUE:
                self._frozen_c = None
        elif fault.kind is FaultKind.STUCK_VALUE:
            self._frozen_c = self._bath_c(at_s)
            self._faults.append(fault)
        else:
            if fault.kind is FaultKind.DRIFT:
                self._drift_since_s = at_s
            self._faults.append(fault)
        self._evaluate(at_s)

    def _evaluate(self, now_s: float) -> None:
        """Alarms from their causes, then what the coolant is told."""
        settings = self._settings
        alarm = self._fault(FaultKind.CHILLER_ALARM)
        level = self._level_percent()
        if level < settings.level_stop_percent:
            self._error = _LEVEL_TOO_LOW
            self._circulation_asked = False
        elif level < settings.level_warning_percent:
            self._warning = settings.level_warning_code
        if alarm is not None:
            self._error = min(round(alarm.amount), -1)
        if self._error:
            self._controlling = False
        if self._fault(FaultKind.SETPOINT_IGNORED) is None:
            self._followed_c = self._setpoint_c
        self._plant.drive_coolant(
            now_s,
            target_c=self._followed_c,
            controlling=self._controlling,
            circulating=self._pumping,
            ramp_k_per_min=settings.setpoint_ramp_k_per_min,
        )
