"""What the guard does with devices: look at them and make them safe, with drivers and a patience of its own."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, final

from arl_fixtures.bench.config import BenchConfig
from arl_fixtures.bench.drivers import Kind, find_driver
from arl_fixtures.devices.interfaces import Chiller, ChillerStatus, Relays, Stage, Thermometer
from arl_fixtures.errors import ArlError
from arl_fixtures.guard.core import SafeStep
from arl_fixtures.guard.host import Attention, Host
from arl_fixtures.guard.line import Line, OwnPort, Patience, PatientClock, why
from arl_fixtures.guard.safe_actions import carry_out


@final
class Findings:
    """The newest of what each device said; None where it did not answer the last time it was asked."""

    def __init__(self) -> None:
        self.temperatures_c: dict[str, float | None] = {}
        self.chiller: ChillerStatus | None = None
        self.stage_fault: str | None = None
        self.read_back: Mapping[str, bool] | None = None


@final
class Hands:
    """The guard's own drivers on the lines that it owns.

    Args:
        config: the bench file.
        host: time and lines.
        lines: the opened lines.
        attention: who is heard while a device is waited for.
    """

    def __init__(self, config: BenchConfig, host: Host, lines: Mapping[Kind, Line], attention: Attention) -> None:
        self._config, self._host, self._lines = config, host, lines
        self._patience = Patience(attention)
        self._clock = PatientClock(host, self._patience)
        self._drivers: dict[Kind, Any] = {}
        self.findings = Findings()
        self.findings.temperatures_c = dict.fromkeys([*config.thermometer.named_channels(), "coolant"])
        self.renew()

    def renew(self) -> None:
        """Forget whatever the drivers remember of their devices."""
        for kind, line in self._lines.items():
            self.renew_one(kind, line)

    def renew_one(self, kind: Kind, line: Line) -> None:
        """Forget what one driver remembers, as a stage's faults, which stay until the next homing."""
        driver = find_driver(self._config.devices()[kind].driver, kind)
        port = OwnPort(line, self._host, self._patience)
        self._drivers[kind] = driver.make(port, self._clock, self._config.device_settings(kind))

    @property
    def loads(self) -> Sequence[str]:
        """What the relays switch."""
        relays: Relays = self._drivers["relays"]
        return relays.loads()

    # -- looking

    def look(self, kind: Kind, limit_s: float) -> str:
        """Ask one device for what the conditions need, for at most `limit_s`; returns why it could not be asked."""
        self._patience.deadline_s = self._host.clock.now_s + limit_s
        try:
            self._looks[kind]()
        except ArlError as error:
            self.forget(kind)
            return why(error)
        finally:
            self._patience.deadline_s, self._patience.may_be_cut = float("inf"), True
        return ""

    @property
    def _looks(self) -> dict[str, Callable[[], None]]:
        return {
            "chiller": self._look_at_chiller,
            "thermometer": self._look_at_thermometer,
            "stage": self._look_at_stage,
            "relays": self._look_at_relays,
        }

    def _look_at_chiller(self) -> None:
        chiller: Chiller = self._drivers["chiller"]
        self.findings.temperatures_c["coolant"] = chiller.bath_c()
        self.findings.chiller = chiller.status()

    def _look_at_thermometer(self) -> None:
        thermometer: Thermometer = self._drivers["thermometer"]
        readings = thermometer.read_c()
        for name, channel in self._config.thermometer.named_channels().items():
            self.findings.temperatures_c[name] = readings[channel].value_c if channel < len(readings) else None

    def _look_at_stage(self) -> None:
        stage: Stage = self._drivers["stage"]
        self.findings.stage_fault = stage.fault()

    def _look_at_relays(self) -> None:
        relays: Relays = self._drivers["relays"]
        self.findings.read_back = dict(relays.states())

    def forget(self, kind: Kind) -> None:
        """What one device said is no longer known."""
        findings = self.findings
        if kind == "chiller":
            findings.temperatures_c["coolant"], findings.chiller = None, None
        elif kind == "thermometer":
            findings.temperatures_c |= dict.fromkeys(self._config.thermometer.named_channels())
        elif kind == "stage":
            findings.stage_fault = None
        else:
            findings.read_back = None

    # -- acting

    def do(self, step: SafeStep, limit_s: float) -> str:
        """Carry out a safe action within `limit_s` and read it back; returns what went wrong, empty if verified."""
        self._patience.deadline_s = self._host.clock.now_s + limit_s
        # nothing is more urgent
        self._patience.may_be_cut = False
        try:
            carry_out(
                step,
                relays=self._drivers["relays"],
                chiller=self._drivers["chiller"],
                stage=self._drivers["stage"],
                safe_temperature_c=self._config.safe_temperature_c,
            )
        except ArlError as error:
            return why(error)
        finally:
            self._patience.deadline_s, self._patience.may_be_cut = float("inf"), True
        return ""
