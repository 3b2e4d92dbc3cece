"""The guard's conditions watched inside the test process, where the emulated hardware dies with it anyway."""

from __future__ import annotations

import contextlib
import itertools
from collections.abc import Mapping
from dataclasses import replace
from typing import Final, Self, final

from arl_fixtures.bench.bench import Bench, BenchReading
from arl_fixtures.bench.build import Lines
from arl_fixtures.bench.config import BenchConfig
from arl_fixtures.bench.guard_settings import Action
from arl_fixtures.devices.interfaces import ChillerStatus
from arl_fixtures.errors import ArlError, DeviceError, HoldError, InterlockError
from arl_fixtures.guard.bookkeeping import Bookkeeping
from arl_fixtures.guard.conditions import Sample
from arl_fixtures.guard.core import GuardCore, SafeStep
from arl_fixtures.guard.runtime import Places
from arl_fixtures.guard.safe_actions import carry_out
from arl_fixtures.guard.watched import WatchedDuts, WatchedRelays

_SHORTEST_S: Final = 0.6
"""Time between two looks; in a sweep there is one at each angle, which takes at least that."""


@final
class InsideGuard:
    """Judges each reading of the bench, and looks at everything by itself every 1.5 s.

    It looks between two exchanges: while the bench waits, the stage turns or is homed, and frames come or do not.

    Args:
        config: the bench file.
        places: where stops are kept; None: nowhere, the hardware is emulated in this process.
        lines: clock and ports, if they are not the bench's own.

    Raises:
        InterlockError: a stop waits for its acknowledgement.
    """

    def __init__(self, config: BenchConfig, places: Places | None, lines: Lines | None = None) -> None:
        self._config = config
        self.lines = lines
        self._books = None if places is None else Bookkeeping(places, config.name)
        stop = None if self._books is None else self._books.last_stop
        if stop is not None and stop.blocks:
            raise InterlockError(f"{stop}; acknowledge with: arl ack")
        self.last_stop = "" if stop is None else str(stop)
        self._core = GuardCore(config.guard)
        self._bench: Bench | None = None
        self._commanded: dict[str, bool] = {}
        self._awaited: Mapping[str, float] = {}
        self._halves = itertools.cycle((self._ask_coolant_and_power, self._ask_housings_and_stage))
        self._looked_s = float("-inf")
        self._coolant_c: float | None = None
        self._pausing = False

    def attach(self, bench: Bench) -> None:
        """Judge every reading of the bench from now on."""
        self._bench = bench
        bench.relays = WatchedRelays(bench.relays, self._note_commanded)
        bench.duts = WatchedDuts(bench.duts, bench.clock, self._note_awaited)
        bench.observers.append(self._see)
        bench.look = self._look
        self._core.join(bench.clock.now_s)
        self._write_down()

    def beat(self) -> None:
        """Nothing to do: this guard shares the test's fate."""

    def check(self) -> None:
        """Is everything well?

        Raises:
            HoldError: the bench must pause.
            InterlockError: the bench was made safe.
        """
        core = self._core
        if self._bench is not None and not core.driven:
            raise InterlockError(self._stopped())
        if core.request is not None and not self._pausing:
            raise HoldError(core.request.reason, soak_back=core.request.action is Action.SOAK_BACK)

    def wait_until_clear(self, bench: Bench) -> float:
        """Pause as was asked until it is over; returns the seconds it took.

        Raises:
            InterlockError: it was not over in time.
        """
        start_s = bench.clock.now_s
        self._core.heed(start_s)
        self._pausing = True
        try:
            while (request := self._core.request) is not None:
                if request.action is Action.SOAK_BACK:
                    bench.set_temperature_c = bench.config.safe_temperature_c
                bench.wait_for_turn()
                bench.turn()
        finally:
            self._pausing = False
        self.check()
        return bench.clock.now_s - start_s

    @property
    def actions(self) -> list[tuple[str, str]]:
        """Safe actions carried out last, in order, each with what went wrong (empty when verified)."""
        return self._core.actions

    def close(self) -> None:
        """The session is over; the bench has made itself safe by closing."""
        if self._bench is not None and self._core.driven:
            self._core.leave(self._bench.clock.now_s)
            while (step := self._core.to_do) is not None:
                self._core.did(step, "", self._bench.clock.now_s)
        self._write_down()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _note_commanded(self, loads: Mapping[str, bool | None]) -> None:
        for load, on in loads.items():
            if on is None:
                self._commanded.pop(load, None)
            else:
                self._commanded[load] = on

    def _note_awaited(self, since_s: Mapping[str, float]) -> None:
        self._awaited = since_s

    def _see(self, reading: BenchReading) -> None:
        """Judge what the bench has read."""
        self._judge(Sample(time_s=reading.time_s, temperatures_c=reading.temperatures_c, housings=reading.housings))

    def _look(self) -> None:
        """Ask half of the devices, if the last time was long enough ago, so that each is asked every 1.5 s.

        Half of them, because in a sweep this is done while the stage turns, and must not take longer than that.
        """
        bench = self._bench
        if bench is None or not self._core.driven or bench.clock.now_s - self._looked_s < _SHORTEST_S:
            return
        self._looked_s = bench.clock.now_s
        self._judge(next(self._halves)(bench))

    def _judge(self, sample: Sample) -> None:
        bench, core = self._bench, self._core
        if bench is None or not core.driven:
            return
        core.beat(sample.time_s)
        silent_s = {serial: sample.time_s - since_s for serial, since_s in self._awaited.items()}
        core.see(replace(sample, duts_awaited_s=silent_s))
        core.tick(bench.clock.now_s)
        if core.to_do is not None:
            self._make_safe(bench)
        self._write_down()
        self.check()

    def _ask_coolant_and_power(self, bench: Bench) -> Sample:
        chiller: ChillerStatus | None = None
        read_back: Mapping[str, bool] | None = None
        self._coolant_c = None
        # one that does not answer says nothing; that it does not is for whoever needs it to say
        with contextlib.suppress(DeviceError):
            chiller = bench.chiller.status()
            self._coolant_c = bench.chiller.bath_c()
        with contextlib.suppress(DeviceError):
            read_back = bench.relays.states()
        return Sample(
            time_s=bench.clock.now_s,
            temperatures_c={"coolant": self._coolant_c},
            chiller=chiller,
            commanded=self._commanded,
            read_back=read_back,
        )

    def _ask_housings_and_stage(self, bench: Bench) -> Sample:
        config = self._config.thermometer
        temperatures_c: dict[str, float | None] = {"coolant": self._coolant_c}
        stage_fault: str | None = None
        with contextlib.suppress(DeviceError):
            stage_fault = bench.stage.fault()
        with contextlib.suppress(DeviceError):
            readings = bench.thermometer.read_c()
            for name, channel in config.named_channels().items():
                temperatures_c[name] = readings[channel].value_c if channel < len(readings) else None
        return Sample(
            time_s=bench.clock.now_s,
            temperatures_c=temperatures_c,
            housings=config.housing_names(),
            stage_fault=stage_fault,
        )

    def _make_safe(self, bench: Bench) -> None:
        self._write_down()
        bench.set_temperature_c = None
        while (step := self._core.to_do) is not None:
            self._core.did(step, self._try(bench, step), bench.clock.now_s)

    def _try(self, bench: Bench, step: SafeStep) -> str:
        safe_c = self._config.safe_temperature_c
        try:
            carry_out(
                step, relays=bench.relays, chiller=bench.chiller, stage=bench.stage, safe_temperature_c=safe_c
            )
        except ArlError as error:
            return str(error)
        return ""

    def _stopped(self) -> str:
        core = self._core
        if not core.unverified:
            return f"the bench was made safe: {core.cause}"
        what = "; ".join(f"{step}: {why}" for step, why in core.unverified.items())
        return f"the bench must be safe but could NOT be verified ({what}): {core.cause}"

    def _write_down(self) -> None:
        records = self._core.take_records()
        if self._books is not None:
            self._books.write_down(self._core, records)
