"""A bench under guard, as the test sees it: the same few calls, whether the guard is a process of its own or not.

    with open_guard(config, bench_file=FILE, lab=SOCKET) as guard:
        bench = open_bench(config, lines=guard.lines)
        guard.attach(bench)
        ...
        guard.check()              # between any two things: raises HoldError or InterlockError
        ...
        bench.close()
"""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from pathlib import Path
from typing import Final, Protocol, Self, final

from arl_fixtures.bench.bench import Bench, BenchReading
from arl_fixtures.bench.build import Lines
from arl_fixtures.bench.clock import RealClock
from arl_fixtures.bench.config import BenchConfig
from arl_fixtures.bench.drivers import Kind, find_driver
from arl_fixtures.bench.guard_settings import Action
from arl_fixtures.bench.ports import UdpPort, open_stream
from arl_fixtures.bench.profile import CycleStep
from arl_fixtures.devices.port import Clock, DatagramPort, StreamPort
from arl_fixtures.errors import ArlError, ConfigError, HoldError, InterlockError
from arl_fixtures.guard.inside import InsideGuard
from arl_fixtures.guard.link import BeatingClock, GuardedPort, GuardLink, connect_guard
from arl_fixtures.guard.run import start_guard
from arl_fixtures.guard.runtime import NoGuardError, Places, StopReport, lease_holder, read_stop, wait_for_lease
from arl_fixtures.guard.watched import WatchedDuts, WatchedRelays
from arl_fixtures.lab.client import LabClient

_BEATS_PER_TIMEOUT: Final = 4.0
_LONGEST_BEAT_S: Final = 1.0
"""A guard that died is noticed at the next beat."""
_BYE_S: Final = 60.0
_TRIES: Final = 4


class Guard(Protocol):
    """What a test needs of its guard."""

    @property
    def lines(self) -> Lines | None:
        """Clock and ports for `open_bench`; None: the bench opens its own."""

    @property
    def last_stop(self) -> str:
        """What happened before this session, in words; empty if nothing did."""

    def attach(self, bench: Bench) -> None:
        """Have the bench's readings, commands and its making safe pass through the guard."""

    def beat(self) -> None:
        """A sign of life, for stretches without any request to a device."""

    def check(self) -> None:
        """Is everything well?

        Raises:
            HoldError: the bench must pause.
            InterlockError: the bench was made safe, or the guard is gone: the session is over.
        """

    def wait_until_clear(self, bench: Bench) -> float:
        """Pause as was asked, at the safe temperature if need be, until it is over; returns the seconds it took.

        Raises:
            InterlockError: it was not over in time.
        """

    @property
    def actions(self) -> list[tuple[str, str]]:
        """Safe actions carried out last, in order, each with what went wrong (empty when verified)."""

    def close(self) -> None:
        """The session is over."""


@final
class ProcessGuard:
    """The guard in a process of its own.

    Args:
        config: the bench file.
        link: connection to it.
        lab: connection to the lab; None with real hardware.
        last_stop: what happened before.
    """

    def __init__(self, config: BenchConfig, link: GuardLink, clock: Clock, lab: LabClient | None) -> None:
        self._config, self._link, self._clock, self._lab = config, link, clock, lab
        beat_s = min(config.guard.heartbeat_timeout_s / _BEATS_PER_TIMEOUT, _LONGEST_BEAT_S)
        self.lines: Lines | None = GuardedLines(config, link, BeatingClock(clock, link, beat_s), lab)
        self.last_stop = link.last_stop or ""
        self._pausing = self._ended = False
        self._bench: Bench | None = None

    @property
    def pid(self) -> int:
        """Its process number."""
        return self._link.pid

    def attach(self, bench: Bench) -> None:
        """Have the bench's readings, commands and its making safe pass through the guard."""
        bench.relays = WatchedRelays(bench.relays, self._commanded)
        bench.duts = WatchedDuts(bench.duts, bench.clock, self._await)
        bench.look = self.beat
        bench.observers.append(self._on_reading)
        bench.made_safe_by = self._make_safe
        self._bench = bench

    def beat(self) -> None:
        """A sign of life."""
        self._link.tell("beat")

    def check(self) -> None:
        """Is everything well?"""
        self._link.check()
        if not self._link.driven:
            raise InterlockError(f"the guard has made the bench safe: {self._link.cause}")
        if self._link.request is not None:
            request = self._link.request
            raise HoldError(request.reason, soak_back=request.action is Action.SOAK_BACK)

    def wait_until_clear(self, bench: Bench) -> float:
        """Pause as was asked until it is over."""
        start_s = bench.clock.now_s
        self._link.tell("heed")
        self._pausing = True
        try:
            while (request := self._link.request) is not None:
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
        """Safe actions carried out last; none known where the guard itself is gone."""
        return [] if self._link.lost else self._link.actions

    def close(self) -> None:
        """Good-bye: the guard makes the bench safe if it is not yet."""
        if not self._link.lost and not self._ended:
            with contextlib.suppress(InterlockError):
                self._link.ask("bye", wait_s=_BYE_S)
        self._link.close()
        if self._lab is not None:
            self._lab.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _on_reading(self, _reading: BenchReading) -> None:
        with contextlib.suppress(HoldError) if self._pausing else contextlib.nullcontext():
            self.check()

    def _commanded(self, loads: Mapping[str, bool | None]) -> None:
        self._link.tell("commanded", loads=dict(loads))

    def _await(self, since_s: Mapping[str, float]) -> None:
        now_s = self._clock.now_s
        self._link.tell("awaited", silent_s={serial: now_s - each for serial, each in since_s.items()})

    def _make_safe(self) -> list[str] | None:
        """The guard does it; None when it is gone. Then it listens at the DUTs' ports, which are freed for that."""
        try:
            answer = self._link.ask("bye", wait_s=_BYE_S)
        except InterlockError:
            return None
        self._ended = True
        with contextlib.suppress(ArlError):
            if self._bench is not None:
                self._bench.duts.close()
            answer = self._link.ask("listen", wait_s=_BYE_S)
        return [f"{step} failed: {why}" for step, why in answer.header["unverified"].items()]


@final
class GuardedLines:
    """Clock and ports of a guarded bench: control lines through the guard, datagrams straight."""

    def __init__(self, config: BenchConfig, link: GuardLink, clock: Clock, lab: LabClient | None) -> None:
        self._config, self._link, self._lab = config, link, lab
        self.clock = clock

    def port(self, kind: Kind) -> StreamPort:
        """A control line, through the guard."""
        entry = self._config.devices()[kind]
        name = entry.url if self._lab is None else f"emulated {kind}"
        return GuardedPort(kind, name, self._link, lambda: self._open(kind))

    def datagrams(self, port: int) -> DatagramPort:
        """What is sent to a UDP port."""
        if self._lab is not None:
            return self._lab.datagrams(port)
        host = self._config.duts.listen
        return UdpPort(f"udp://{host}:{port}", host, port, self.clock)

    def enter_step(self, step: CycleStep) -> None:
        """A temperature step begins."""
        if self._lab is not None:
            self._lab.enter_step(step)

    def _open(self, kind: Kind) -> StreamPort:
        if self._lab is not None:
            return self._lab.port(kind)
        entry = self._config.devices()[kind]
        return open_stream(entry.url, default_baud=find_driver(entry.driver, kind).default_baud)


def open_guard(
    config: BenchConfig, *, bench_file: str, lab: Path | None = None, runtime: Path | None = None
) -> ProcessGuard | InsideGuard:
    """The guard that the bench file asks for: a process of its own, started if none is there, or one inside.

    Args:
        config: the bench file.
        bench_file: where it was read from, for the guard process.
        lab: socket of the lab that holds the emulated hardware.
        runtime: where guards keep their files.

    Raises:
        InterlockError: a stop waits for its acknowledgement, another test drives the bench, or no guard starts.
    """
    emulated_here = lab is None and any(entry.emulated for entry in config.devices().values())
    wanted = config.guard.process if config.guard.process is not None else not emulated_here
    if wanted and emulated_here:
        raise ConfigError(
            f"bench '{config.name}': guard.process needs hardware outside the test process; emulated: give a lab"
        )
    if emulated_here:
        return InsideGuard(config, None)
    places = Places.of(config.name, runtime)
    if not wanted:
        lines = None if lab is None else LabClient.connect(lab, "test", role="driver")
        return InsideGuard(config, places, lines)
    client = None if lab is None else LabClient.connect(lab, "test", role="driver")
    try:
        return _connected(config, bench_file, places, client, lab)
    except BaseException:
        if client is not None:
            client.close()
        raise


def _connected(
    config: BenchConfig, bench_file: str, places: Places, client: LabClient | None, lab: Path | None
) -> ProcessGuard:
    clock: Clock = RealClock() if client is None else client.clock
    number = 0 if client is None else client.number
    # where guards come and go, as after a death, the one that is there now may be gone before it is spoken to
    for left in reversed(range(_TRIES)):
        try:
            pid = lease_holder(places.lease, lease_s=config.guard.lease_s)
            if pid == 0:
                _require_acknowledged(places, bench_file)
                pid = start_guard(bench_file, places, lab=lab)
            link = connect_guard(
                places.socket,
                pid,
                sha256=config.sha256,
                clock=clock,
                lab=number,
                patience_s=config.guard.reply_timeout_s,
            )
        except (ConfigError, NoGuardError) as error:
            # with another version of the bench file it ends by itself
            if left == 0:
                raise
            if isinstance(error, ConfigError) or pid:
                _wait_for_end(places, config)
        else:
            return ProcessGuard(config, link, clock, client)
    raise InterlockError(f"bench '{config.name}': the guard ends again and again")


def _require_acknowledged(places: Places, bench_file: str) -> None:
    stop: StopReport | None = read_stop(places)
    # where nobody has ended a session a guard must come first, and refuse the test after that
    if stop is not None and stop.blocks and not places.driven.exists():
        raise InterlockError(f"{stop}; acknowledge with: arl ack --bench {bench_file}")


def _wait_for_end(places: Places, config: BenchConfig) -> None:
    """Wait until a guard that is about to end has given up its lease."""
    wait_for_lease(places.lease, timeout_s=config.guard.lease_s)
