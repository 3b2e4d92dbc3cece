"""Whole small cycles in three processes, as on hardware: a lab that holds the plant, a guard, and a test.

The lab kills test and guard at exact bench times, or we kill them from outside; what became of the bench is the
plant's own word, which the lab keeps.
"""

from __future__ import annotations

import contextlib
import json
import os
import select
import signal
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from unittest import mock

from arl_fixtures.bench.build import Emulated, open_bench
from arl_fixtures.bench.clock import VirtualClock
from arl_fixtures.errors import ArlError, DeviceLostError
from arl_fixtures.guard.guarding import open_guard
from arl_fixtures.guard.run import run_guard
from arl_fixtures.guard.runtime import NoGuardError, Places, lease_holder, process_state
from arl_fixtures.lab.client import LabClient
from arl_fixtures.lab.server import LabServer
from arl_fixtures.plugin.cycle import CycleSession
from arl_fixtures.plugin.resume import Past
from arl_fixtures.plugin.setup import SessionFiles
from tests_bench.killed_cycles import PATIENCE_S, fork, past_of, wait_for
from tests_bench.small_cycle import Quiet, measure_all

GRACE_S = 1.5
DEAD = {"", "Z", "X"}
CALLED = "nobody is left: the next guard is called"
OVER = 3
"""Exit status of a session that ended early by itself."""


@dataclass(frozen=True)
class Kill:
    """Processes that die at a bench time: clients of the lab by name, and the guard's sentinel."""

    at_s: float
    victims: tuple[str, ...]


@dataclass
class Laboratory:
    """A lab in a process of its own, with room for a guard's files.

    Attributes:
        socket: where it listens.
        runtime: folder of the guard.
        bench: name of the bench.
        pid: of the lab.
    """

    socket: Path
    runtime: Path
    bench: str
    pid: int

    @property
    def places(self) -> Places:
        """Files of the guard."""
        return Places.of(self.bench, self.runtime)

    def guard_pid(self) -> int:
        """The guard's process; 0 if none lives."""
        return lease_holder(self.places.lease, lease_s=1e9)

    def listens(self) -> bool:
        """Whether it can be reached."""
        with contextlib.suppress(DeviceLostError):
            return bool(self.inspect())
        return False

    def inspect(self) -> dict[str, Any]:
        """What the plant says."""
        onlooker = LabClient.connect(self.socket, "onlooker", role="onlooker")
        try:
            return onlooker.inspect()
        finally:
            onlooker.close()

    def inject(self, fault: str) -> None:
        """Let a fault happen."""
        onlooker = LabClient.connect(self.socket, "onlooker", role="onlooker")
        onlooker.inject(fault)
        onlooker.close()

    def over(self) -> str:
        """Why a session ended early the last time, in its own words."""
        file = self.runtime / "over"
        return file.read_text() if file.exists() else ""

    def events(self) -> list[tuple[float, str, Any]]:
        """What the plant and the lab have noted."""
        return [(time_s, what, value) for time_s, what, value in self.inspect()["events"]]

    def log(self) -> list[dict[str, Any]]:
        """What guards and sentinels have noted."""
        file, entries = self.places.log, []
        for line in file.read_text().splitlines() if file.exists() else ():
            # whoever was killed while it wrote leaves half a line
            with contextlib.suppress(ValueError):
                entries.append(json.loads(line))
        return entries

    def sentinel_pid(self) -> int:
        """The newest sentinel's process; 0 if it does not live."""
        pid = next((int(entry["pid"]) for entry in reversed(self.log()) if entry["what"] == "sentinel"), 0)
        return pid if pid and process_state(pid) not in DEAD else 0

    @contextlib.contextmanager
    def witness(self) -> Iterator[None]:
        """Somebody looks on, so that bench time passes, as on the wall, also while nobody else is left."""
        onlooker = LabClient.connect(self.socket, "witness", role="onlooker")
        try:
            yield
        finally:
            onlooker.close()

    def wait_for_safety(self) -> bool:
        """Wait until whoever is left has made the bench safe, and has gone if it came for that; False: nobody is."""
        until(
            lambda: not self.places.driven.exists() or not (self.sentinel_pid() or self.guard_pid()),
            "somebody has made the bench safe",
        )
        if self.places.driven.exists():
            return False
        last = [entry["what"] for entry in self.log() if entry["what"] in {"sentinel", CALLED}][-1:]
        if last == [CALLED]:
            until(lambda: not self.guard_pid(), "the guard that was called has gone")
            until(lambda: "guard" not in self.inspect()["clients"], "the lab knows that it has gone")
        return True


def open_laboratory(folder: Path, files: SessionFiles, kills: Sequence[Kill] = ()) -> Laboratory:
    """Start a lab that kills as planned."""
    folder.mkdir()
    socket = folder / "s"

    def serve() -> None:
        world = Emulated(files.bench, VirtualClock())
        server = LabServer(world, socket, grace_s=GRACE_S)
        for kill in kills:
            world.clock.at(kill.at_s, lambda kill=kill: _kill(server, lab, kill.victims))
        signal.signal(signal.SIGTERM, lambda *_: server.stop())
        server.serve()

    lab = Laboratory(socket, folder / "r", files.bench.name, 0)
    lab.pid = fork(serve)
    until(lab.listens, "the lab listens")
    return lab


def close_laboratory(lab: Laboratory) -> None:
    """End it; the guard must have gone home before."""
    until(lambda: not lab.guard_pid(), "the guard has gone home")
    until(lambda: not lab.sentinel_pid(), "so has its sentinel")
    os.kill(lab.pid, signal.SIGTERM)
    assert wait_for(lab.pid) == 0


@contextlib.contextmanager
def laboratory(folder: Path, files: SessionFiles, kills: Sequence[Kill] = ()) -> Iterator[Laboratory]:
    """A lab, and nothing left of it and of its guard afterwards."""
    lab = open_laboratory(folder, files, kills)
    try:
        yield lab
        close_laboratory(lab)
    except BaseException:
        for pid in (lab.sentinel_pid(), lab.guard_pid(), lab.pid):
            if pid:
                with contextlib.suppress(ProcessLookupError):
                    os.kill(pid, signal.SIGKILL)
        raise


def drive(files: SessionFiles, lab: Laboratory, *, own_program: bool = False) -> None:
    """One session, new or resumed, as the plugin's fixtures run it.

    Args:
        files: bench, profile, limits, output folder.
        lab: where the hardware is.
        own_program: whether the guard is started as a program, which takes a second; else it is forked from here.

    Raises:
        SystemExit: with `OVER` when the session ended early; why stands in the output folder.
    """
    past = past_of(files.options.out)
    try:
        said = _drive(files, lab, past, own_program=own_program)
    except ArlError as error:
        said = str(error)
    if said:
        lab.runtime.mkdir(exist_ok=True)
        (lab.runtime / "over").write_text(said)
        raise SystemExit(OVER)


def _drive(files: SessionFiles, lab: Laboratory, past: Past, *, own_program: bool) -> str:
    program = mock.patch("arl_fixtures.guard.guarding.start_guard", fork_guard)
    with contextlib.nullcontext() if own_program else program:
        guard = open_guard(files.bench, bench_file=files.options.bench, lab=lab.socket, runtime=lab.runtime)
    with guard:
        bench = open_bench(files.bench, guard.lines)
        guard.attach(bench)
        session = CycleSession(bench, files, files.profile.steps(0), past, screen=Quiet(), guard=guard)
        try:
            session.start()
            over = measure_all(session, files, {})
        except ArlError as error:
            over = f"did not start: {error}"
        finally:
            session.close(over or "finished")
            unsafe = bench.close()
    return "; ".join([over, *unsafe]) if over or unsafe else ""


def fork_guard(_bench_file: str, places: Places, *, lab: Path | None) -> int:
    """Instead of `start_guard`: the same guard in a process of its own, without the second that Python needs."""
    from arl_fixtures.bench.config import load_bench

    config = load_bench(_bench_file)
    reader, writer = os.pipe()

    def guard() -> None:
        os.setsid()
        # nothing of the test may live on in it, its connection to the lab least of all
        os.dup2(writer, 3)
        os.closerange(4, 256)
        run_guard(config, places, lab=lab, linger_s=300.0, ready_fd=3)

    pid = fork(guard)
    os.close(writer)
    with os.fdopen(reader, "rb") as pipe:
        if pipe.read() != b"ready\n":
            raise NoGuardError("the guard did not start")
    return pid


def until(condition: Callable[[], Any], what: str) -> Any:
    """Wait until `condition()` is true, and return what it gave."""
    deadline_s = time.monotonic() + PATIENCE_S
    while not (found := condition()):
        assert time.monotonic() < deadline_s, f"never happened: {what}"
        select.select([], [], [], 0.005)
    return found


def _kill(server: LabServer, lab: Laboratory, names: Sequence[str]) -> None:
    """SIGKILL at this very instant of bench time: the lab hears of it before time goes on."""
    clients = [client for client in server._clients.values() if client.name in names]
    # the sentinel first: else it would act on the death of the others
    sentinels = [lab.sentinel_pid()] if "sentinel" in names else []
    victims = [pid for pid in [*sentinels, *(client.peer.pid for client in clients)] if pid]
    for pid in victims:
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)
    for pid in victims:
        until(lambda pid=pid: process_state(pid) in DEAD, "a killed process dies")
    for client in clients:
        server._lose(client)
