"""The bench: devices in their roles, temperature control between them, and the way to make it safe."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, Protocol, final

from arl_fixtures.bench.config import BenchConfig
from arl_fixtures.bench.control import CascadedControl
from arl_fixtures.bench.profile import CycleStep
from arl_fixtures.bench.settle import SettleReport, SettleWatch
from arl_fixtures.devices.dut_status import DutStatus, OtherDutError
from arl_fixtures.devices.idling import Idle, nothing
from arl_fixtures.devices.interfaces import Chiller, Identity, Reading, Relays, Stage, Thermometer
from arl_fixtures.devices.port import Clock
from arl_fixtures.errors import DeviceError, HoldError, InterlockError
from arl_fixtures.metrics.block import AngleBlock

SAFE_ATTEMPTS: Final = 3
LOOK_S: Final = 0.75
"""How often, while the bench only waits, somebody may look whether all is well."""
CONTROL_CHECK_S: Final = 30.0
"""How often the chiller is asked, while the housings settle, whether it still controls."""
LISTEN_S: Final = 0.25
SILENCE_CHECK_S: Final = 0.3
DARK_AFTER_S: Final = 0.1
"""A DUT that sends later than this after its supply was switched off has still power."""


class Duts(Protocol):
    """The receiver of all DUTs' frames."""

    def collect(
        self,
        serials: Sequence[str],
        n_frames: int,
        *,
        not_before_s: float,
        timeout_s: float,
        angle_index: int = 0,
        stage_angle_deg: float = 0.0,
        idle: Idle = nothing,
    ) -> dict[str, AngleBlock]:
        """The first `n_frames` frames of each DUT whose exposure began at or after `not_before_s`.

        Takes `Breaks` with `idle`.
        """

    def identify(self) -> Identity:
        """Who the DUTs say they are."""

    def listen(self, duration_s: float) -> Mapping[str, DutStatus]:
        """Listen for a while, as a check of the connection; status by serial number."""

    def close(self) -> None:
        """Release the sockets."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BenchReading:
    """One look at all temperatures; None where a sensor gives no value.

    Attributes:
        time_s: bench time.
        time_ns: bench UTC.
        temperatures_c: sensor name (`ambient`, `plate`, `T2`…, `coolant`, `setpoint`) to °C.
        faults: sensor name to what is wrong with it.
        housings: names of the housing sensors in DUT order.
    """

    time_s: float
    time_ns: int
    temperatures_c: Mapping[str, float | None]
    faults: Mapping[str, str]
    housings: tuple[str, ...]

    @property
    def housings_c(self) -> dict[str, float | None]:
        """Housing sensors alone."""
        return {name: self.temperatures_c[name] for name in self.housings}


@final
class Bench:
    """Everything on the bench, opened.

    Args:
        config: the bench file.
        clock: bench clock.
        chiller, thermometer, stage, relays, duts: the opened devices.
        on_step: told of each temperature step before it begins.
    """

    def __init__(
        self,
        config: BenchConfig,
        clock: Clock,
        *,
        chiller: Chiller,
        thermometer: Thermometer,
        stage: Stage,
        relays: Relays,
        duts: Duts,
        on_step: Callable[[CycleStep], None] = lambda _step: None,
    ) -> None:
        self.config, self.clock = config, clock
        self.chiller, self.thermometer, self.stage, self.relays, self.duts = chiller, thermometer, stage, relays, duts
        self.observers: list[Callable[[BenchReading], None]] = []
        self.set_temperature_c: float | None = None
        self.enter_step = on_step
        self.made_safe_by: Callable[[], list[str] | None] = _nobody_else
        self.look: Idle = nothing
        self._control: CascadedControl | None = None
        self._next_turn_s = clock.now_s
        self._closed = False

    @property
    def serials(self) -> tuple[str, ...]:
        """Serial numbers of the DUTs, in housing order."""
        return tuple(dut.serial for dut in self.config.dut_settings)

    def start(self) -> None:
        """Home the stage, power the DUTs and their lasers, start the chiller at the present coolant temperature."""
        self.home()
        for load in self.relays.loads():
            self.relays.set(load, True)
        bath_c = self.chiller.bath_c()
        self.chiller.set_setpoint_c(bath_c)
        self.chiller.start()
        self._control = CascadedControl(self.config.control, setpoint_c=bath_c, now_s=self.clock.now_s)
        self._next_turn_s = self.clock.now_s

    def home(self) -> None:
        """Home the stage; looks meanwhile make the bench safe if need be."""
        self.stage.home(self.config.home_timeout_s, self._look_for_stops)

    def read(self) -> BenchReading:
        """Read all thermocouples and the chiller's bath; tells every observer."""
        config = self.config.thermometer
        readings = self.thermometer.read_c()
        named: dict[str, Reading] = {
            name: readings[channel] if channel < len(readings) else Reading(None, "no such channel")
            for name, channel in config.named_channels().items()
        }
        temperatures: dict[str, float | None] = {name: reading.value_c for name, reading in named.items()}
        temperatures["coolant"] = self.chiller.bath_c()
        if self._control is not None:
            temperatures["setpoint"] = self._control.state.setpoint_c
        reading = BenchReading(
            time_s=self.clock.now_s,
            time_ns=self.clock.utc_ns(),
            temperatures_c=temperatures,
            faults={name: reading.fault for name, reading in named.items() if reading.fault},
            housings=config.housing_names(),
        )
        for observer in self.observers:
            observer(reading)
        return reading

    def turn(self) -> BenchReading | None:
        """One turn of the control loop if it is due; else time to look whether all is well."""
        if self.clock.now_s < self._next_turn_s:
            self.look()
            return None
        self._next_turn_s = self.clock.now_s + self.config.control.period_s
        reading = self.read()
        known = [value for value in reading.housings_c.values() if value is not None]
        # without any housing temperature the set-point stays: the interlock decides what follows
        if self._control is not None and self.set_temperature_c is not None and known:
            mean_c = sum(known) / len(known)
            self.chiller.set_setpoint_c(
                self._control.next_setpoint_c(self.set_temperature_c, mean_c, self.clock.now_s)
            )
        return reading

    def settle(
        self, set_temperature_c: float, *, progress: Callable[[BenchReading, float], None] | None = None
    ) -> SettleReport:
        """Bring all housings to `set_temperature_c`.

        Args:
            set_temperature_c: where they shall be.
            progress: called with each reading and the seconds since the start.

        Raises:
            DeviceError: a device does not answer, or the chiller no longer controls.
        """
        self.set_temperature_c = set_temperature_c
        start_s = self.clock.now_s
        next_check_s = start_s + CONTROL_CHECK_S
        first = self.read()
        known = [value for value in first.housings_c.values() if value is not None]
        mean_c = sum(known) / len(known) if known else set_temperature_c
        watch = SettleWatch(self.config.settle, set_temperature_c, start_s=start_s, start_mean_c=mean_c)
        while True:
            reading = self.turn()
            if reading is not None:
                if reading.time_s >= next_check_s:
                    self.require_control()
                    next_check_s = reading.time_s + CONTROL_CHECK_S
                if progress is not None:
                    progress(reading, reading.time_s - start_s)
                report = watch.see(reading.time_s, reading.housings_c)
                if report is not None:
                    return report
            self.wait_for_turn()

    def require_control(self) -> None:
        """Make sure that the chiller still controls: one that restarted stands still and says nothing of it.

        Raises:
            DeviceError: it does not.
        """
        status = self.chiller.status()
        if status.controlling and status.pumping:
            return
        what = "temperature control" if not status.controlling else "the pump"
        code = f", error {status.error_code}" if status.error_code else ""
        raise DeviceError(f"chiller: {what} is off though it was started{code}")

    def require_own_duts(self, patience_s: float = 0.0) -> None:
        """Make sure that the DUTs are those of the bench file, as far as they have said who they are.

        Args:
            patience_s: how long to listen to those that have not, on the bench clock.

        Raises:
            OtherDutError: one has another serial number; the message names both.
        """
        for left in reversed(range(math.ceil(patience_s / LISTEN_S) + 1)):
            heard = self.duts.listen(LISTEN_S if patience_s else 0.0)
            said = {serial: each.telemetry.serial for serial, each in heard.items() if each.telemetry is not None}
            others = [f"'{own}' instead of '{serial}'" for serial, own in said.items() if own and own != serial]
            if others:
                raise OtherDutError(f"DUTs are not those of bench '{self.config.name}': {', '.join(others)}")
            if len(said) == len(self.serials):
                return
            if left:
                self._look_for_stops()

    def wait_for_turn(self) -> None:
        """Let time pass until the control loop is due."""
        self._wait_until(self._next_turn_s)

    def soak(self, duration_s: float) -> None:
        """Hold the temperature for `duration_s`."""
        end_s = self.clock.now_s + duration_s
        while self.clock.now_s < end_s:
            self.turn()
            self._wait_until(min(self._next_turn_s, end_s))

    def wait(self, duration_s: float) -> None:
        """Let time pass for a bench that does not work; who asks for a pause of it gets it later."""
        end_s = self.clock.now_s + duration_s
        while (left_s := end_s - self.clock.now_s) > 0.0:
            self.clock.sleep(min(left_s, LOOK_S))
            self._look_for_stops()

    def _look_for_stops(self) -> None:
        """Look where there is nothing to pause yet: who asks for a pause gets it at the next look."""
        with contextlib.suppress(HoldError):
            self.look()

    def _wait_until(self, time_s: float) -> None:
        while (left_s := time_s - self.clock.now_s) > 0.0:
            self.clock.sleep(min(left_s, LOOK_S))
            self.look()

    def make_safe(self) -> list[str]:
        """Laser and DUT power off, set-point to the safe temperature, stage stopped; each verified and retried.

        `made_safe_by` may do it instead (a guard, which owns the lines), or return None to leave it to us.

        Returns:
            what could not be verified, in words; empty when the bench is safe.
        """
        self.set_temperature_c = None
        done = self.made_safe_by()
        if done is not None:
            return done
        safe_c = self.config.safe_temperature_c

        def coolant_commanded() -> None:
            taken_c = self.chiller.set_setpoint_c(safe_c)
            if abs(taken_c - safe_c) > 0.1:
                raise InterlockError(f"chiller took {taken_c:g} °C instead of {safe_c:g} °C")

        actions = (
            ("power off", self._power_off),
            (f"set-point to {safe_c:g} °C", coolant_commanded),
            ("stage stop", self.stage.stop),
        )
        return [fault for name, action in actions if (fault := _attempt(name, action))]

    def _power_off(self) -> None:
        """Switch all loads off, and listen: a welded contact does not show in the read-back, but its DUT goes on."""
        self.relays.all_off()
        alive = still_sending(self.duts, self.config, self.relays.loads(), self.clock.now_s)
        if alive:
            raise InterlockError(f"{', '.join(alive)} still sends; its relay may be welded")

    def close(self) -> list[str]:
        """Make safe and release every line. Closing twice is no error."""
        if self._closed:
            return []
        self._closed = True
        faults = self.make_safe()
        for device in (self.duts, self.relays, self.stage, self.thermometer, self.chiller):
            with contextlib.suppress(DeviceError):
                device.close()
        return faults


def still_sending(duts: Duts, config: BenchConfig, loads: Collection[str], off_s: float) -> list[str]:
    """Serial numbers of the DUTs that send though their supply was switched off; takes `SILENCE_CHECK_S`.

    Args:
        duts: the receiver.
        config: whose DUTs they are, in the order of their supplies.
        loads: what was switched; a DUT without a relay of its own may go on.
        off_s: bench time of the read-back.
    """
    last_s = {serial: dut.last_packet_s for serial, dut in duts.listen(SILENCE_CHECK_S).items()}
    return [
        dut.serial
        for number, dut in enumerate(config.dut_settings, start=1)
        if f"dut_{number}" in loads and last_s.get(dut.serial, -math.inf) > off_s + DARK_AFTER_S
    ]


def _nobody_else() -> None:
    """Without a guard the bench makes itself safe."""


def _attempt(name: str, action: Callable[[], None]) -> str:
    """Do `action`, again if it fails; returns what went wrong at the last try, empty when it worked."""
    fault = ""
    for _ in range(SAFE_ATTEMPTS):
        try:
            action()
        except (DeviceError, InterlockError) as error:
            fault = f"{name} failed: {error}"
        else:
            return ""
    return fault
