"""The lab: plant and emulators in one process, their clock shared by whoever is connected.

Time jumps while every connected client waits and one of them is a *driver* (a test process); a client that
computes holds the clock. *Followers* (a guard) hold it too, but it never jumps for their sake alone; *onlookers*
neither hold it nor let it jump. Of several whose waiting ends at the same instant one runs at a time, in the order in
which they connected, so that the same session runs the same way each time. A client that neither waits nor says
anything for `grace_s` (stopped, hung) holds the clock no longer: from then on, as when no driver is connected,
time passes as on the wall of a machine that does nothing else (`OwnTime`). A client that dies counts no more.
"""

from __future__ import annotations

import contextlib
import math
import os
import selectors
import socket
from pathlib import Path
from typing import Any, Final, final

from arl_fixtures.bench.links import VirtualStreamPort
from arl_fixtures.bench.profile import CycleStep
from arl_fixtures.emulators.faults import parse_fault
from arl_fixtures.errors import ArlError, DeviceLostError, LocalProtocolError
from arl_fixtures.lab.clients import NEVER, Client, Waiting, World, role_of
from arl_fixtures.lab.datagrams import pack_datagrams
from arl_fixtures.lab.framing import Message, Peer, PeerLostError, listen
from arl_fixtures.lab.own_time import OwnTime
from arl_fixtures.lab.watch import PlantWatch

_MOURNING_S: Final = 0.5
"""Wall time that is granted to notice that a client is gone, before bench time may jump to what others wait for."""


@final
class LabServer:
    """Serves a world on a Unix socket.

    Args:
        world: plant, emulators and their clock.
        path: where to listen.
        grace_s: wall time for which a client that does not wait holds the clock.
    """

    def __init__(self, world: World, path: Path, *, grace_s: float = 2.0) -> None:
        self._world, self._clock, self._grace_s = world, world.clock, grace_s
        self._wall_s = OwnTime(self._who_counts)
        self._path = path
        self._watch = PlantWatch(world.plant)
        self._clients: dict[int, Client] = {}
        self._next_number = 1
        self._lost_wall_s = self._wall_s() - _MOURNING_S
        self._pace: tuple[float, float] | None = None
        self._selector = selectors.DefaultSelector()
        self._listener = listen(path)
        self._selector.register(self._listener, selectors.EVENT_READ)
        self._waker, self._woken = socket.socketpair()
        self._selector.register(self._woken, selectors.EVENT_READ)
        self._stopping = False

    # -- life

    def serve(self) -> None:
        """Serve until `stop`."""
        self._wall_s.start()
        try:
            while not self._stopping:
                self._turn()
        finally:
            self.close()

    def stop(self) -> None:
        """Make `serve` return; may be called from a signal handler or another thread."""
        self._stopping = True
        # `serve` may see it before it is woken, and be gone
        with contextlib.suppress(OSError):
            self._waker.send(b"x")

    def close(self) -> None:
        """Hang up on everybody."""
        self._wall_s.stop()
        for client in self._clients.values():
            client.peer.close()
        self._clients.clear()
        for end in (self._listener, self._waker, self._woken):
            end.close()
        self._selector.close()
        self._path.unlink(missing_ok=True)

    def _turn(self) -> None:
        heard = self._selector.select(self._patience_s())
        if self._pace is not None:
            # what was heard was said now, not when time was last let pass
            self._advance()
        for key, _ in heard:
            if key.fileobj is self._listener:
                self._accept()
            elif isinstance(key.data, Client):
                self._hear(key.data)
        self._advance()

    def _accept(self) -> None:
        connection, _ = self._listener.accept()
        peer = Peer(connection)
        client = Client(self._next_number, peer, peer.pid, runs_since_s=self._wall_s())
        self._next_number += 1
        self._clients[client.number] = client
        self._selector.register(client.peer, selectors.EVENT_READ, client)

    def _hear(self, client: Client) -> None:
        client.peer.flush()
        try:
            messages = client.peer.receive()
        except PeerLostError:
            self._lose(client)
            return
        for message in messages:
            self._handle(client, message)
        if client.number in self._clients:
            self._want(client)

    def _want(self, client: Client) -> None:
        """Ask to be told when the rest of an answer can be sent, while there is a rest."""
        events = selectors.EVENT_READ | (selectors.EVENT_WRITE if client.peer.unsent else 0)
        if self._selector.get_key(client.peer).events != events:
            self._selector.modify(client.peer, events, client)

    def _lose(self, client: Client) -> None:
        self._selector.unregister(client.peer)
        client.peer.close()
        del self._clients[client.number]
        for port in client.lines.values():
            port.close()
        for other in self._clients.values():
            if other.lent_to == client.number:
                self._give_back(other)
        self._watch.note(self._clock.now_s, "client lost", client.name)
        self._lost_wall_s = self._wall_s()

    # -- time

    def _who_counts(self) -> list[int]:
        """This process and its clients, but nobody who only looks on or has not said yet who it is."""
        clients = list(self._clients.values())
        return [os.getpid(), *(each.pid for each in clients if each.name and each.role != "onlooker")]

    def _patience_s(self) -> float | None:
        """How long to wait for messages before time must pass by itself; None: for ever."""
        runners = [client for client in self._clients.values() if client.runs]
        if self._pace is None:
            if not runners:
                return None
            return max(min(client.runs_since_s for client in runners) + self._grace_s - self._wall_s(), 0.0)
        wake_s = min(self._next_wake_s(), self._clock.next_event_s)
        if wake_s == NEVER:
            return None if not runners else self._grace_s
        patience_s = max(wake_s - self._paced_s(self._pace), 0.0)
        mourning_s = self._mourning_s()
        return min(patience_s, mourning_s) if mourning_s > 0.0 else patience_s

    def _mourning_s(self) -> float:
        """Wall time for which bench time must not jump: who is left may not have heard yet that a client is gone."""
        return self._lost_wall_s + _MOURNING_S - self._wall_s()

    def _advance(self) -> None:
        """Let whoever can run do so, and time pass as far as it may."""
        while True:
            runners = [client for client in self._clients.values() if client.runs]
            stalled = all(self._wall_s() - client.runs_since_s > self._grace_s for client in runners)
            if runners and not stalled:
                self._pace = None
                return
            if self._finish_one():
                continue
            wake_s = self._next_wake_s()
            jump = not runners and any(client.jumps for client in self._clients.values())
            jump = jump and self._mourning_s() <= 0.0
            if jump:
                self._pace = None
                limit_s = wake_s
            else:
                self._pace = self._pace or (self._clock.now_s, self._wall_s())
                limit_s = min(wake_s, self._paced_s(self._pace))
            if limit_s == NEVER or not self._clients:
                return
            finished = self._clock.wait(self._finish_one, limit_s - self._clock.now_s)
            self._watch.look(self._clock.now_s)
            if not finished and not jump and limit_s < wake_s:
                return

    def _paced_s(self, pace: tuple[float, float]) -> float:
        bench_s, wall_s = pace
        return bench_s + self._wall_s() - wall_s

    def _next_wake_s(self) -> float:
        waiting = [client.waiting.wake_s for client in self._clients.values() if client.waiting is not None]
        return max(min(waiting, default=NEVER), self._clock.now_s)

    def _finish_one(self) -> bool:
        """Answer the first waiting request that can be answered now; its client runs then."""
        for client in self._clients.values():
            if client.waiting is not None and client.waiting.finish():
                client.waiting = None
                client.runs_since_s = self._wall_s()
                self._want(client)
                return True
        return False

    # -- requests

    def _handle(self, client: Client, message: Message) -> None:
        header, payload = message
        client.runs_since_s = self._wall_s()
        if client.lent_to:
            # it speaks for itself again: whoever had borrowed it is done with it
            client.lent_to = 0
        try:
            if header.get("op") in {"adopt", "release", "cancel"}:
                self._signal(client, header)
                return
            # whoever asks anew was torn from waiting for what it asked before
            client.waiting, client.asked = None, header.get("n")
            self._request(client, header, payload)
        except ArlError as error:
            self._answer(client, error=type(error).__name__, message=str(error))
        except (KeyError, TypeError, ValueError) as error:
            self._answer(client, error="LocalProtocolError", message=f"lab: bad request {header}: {error}")
        self._watch.look(self._clock.now_s)

    def _request(self, client: Client, header: dict[str, Any], payload: bytes) -> None:
        now_s = self._clock.now_s
        match header["op"]:
            case "hello":
                client.name, client.role = str(header["name"]), role_of(header["role"])
                self._watch.note(now_s, "client joined", client.name)
                self._world.plant.advance(now_s)
                self._answer(client, number=client.number, epoch_ns=self._clock.host_epoch_ns)
            case "now":
                self._answer(client)
            case "open":
                self._open(client, str(header["line"]))
            case "write":
                self._write(client, header, payload)
                self._answer(client)
            case "reopen":
                self._line(client, header).reopen()
                self._answer(client)
            case "close":
                port = client.lines.pop(str(header["line"]), None)
                if port is not None:
                    port.close()
                self._answer(client)
            case "read":
                port = self._write(client, header, payload)
                self._read(client, port, until_s=now_s + max(float(header["timeout_s"]), 0.0))
            case "sleep":
                self._sleep(client, float(header["until_s"]))
            case "listen":
                self._listen(client, int(header["port"]))
            case "hush":
                client.networks.pop(int(header["port"]), None)
                self._answer(client)
            case "receive":
                until_s = now_s + max(float(header["timeout_s"]), 0.0)
                self._receive(client, int(header["port"]), until_s)
            case "discard":
                before_s = NEVER if header["before_s"] is None else float(header["before_s"])
                self._answer(client, count=client.networks[int(header["port"])].discard(before_s))
            case "enter_step":
                self._enter_step(header)
                self._answer(client)
            case "inspect":
                self._world.plant.advance(now_s)
                names = [other.name for other in self._clients.values()]
                self._answer(client, state=self._watch.state(now_s), events=self._watch.events(), clients=names)
            case "inject":
                self._world.plant.faults.inject(parse_fault(str(header["fault"])))
                self._answer(client)
            case "clear":
                self._answer(client, count=self._world.plant.faults.clear(header.get("device")))
            case unknown:
                raise LocalProtocolError(f"lab: unknown request '{unknown}'")

    def _answer(self, client: Client, *, payload: bytes = b"", **header: Any) -> None:  # noqa: ANN401 - JSON
        client.peer.send({"n": client.asked, "now_s": self._clock.now_s, **header}, payload)

    def _enter_step(self, header: dict[str, Any]) -> None:
        step = CycleStep(
            int(header["cycle"]), int(header["index"]), float(header["set_temperature_c"]), int(header["ramp"])
        )
        self._world.enter_step(step)

    def _open(self, client: Client, line: str) -> None:
        owner = next((other for other in self._clients.values() if line in other.lines), None)
        if owner is not None:
            whom = "this process" if owner is client else f"'{owner.name}'"
            raise DeviceLostError(f"emulated {line}: the line is owned by {whom}")
        client.lines[line] = self._world.port(line)
        self._answer(client)

    def _line(self, client: Client, header: dict[str, Any]) -> VirtualStreamPort:
        line = str(header["line"])
        port = client.lines.get(line)
        if port is None:
            raise DeviceLostError(f"emulated {line}: the line is closed")
        return port

    def _write(self, client: Client, header: dict[str, Any], payload: bytes) -> VirtualStreamPort:
        """Forget what lies unread, if asked to, and send what is to be sent."""
        port = self._line(client, header)
        if header.get("drain"):
            port.drain()
        if payload:
            port.write(payload)
        return port

    def _read(self, client: Client, port: VirtualStreamPort, *, until_s: float) -> None:
        def finish() -> bool:
            try:
                data = port.read(0.0)
            except DeviceLostError as error:
                self._answer(client, error="DeviceLostError", message=str(error))
                return True
            if not data and self._clock.now_s < until_s:
                return False
            self._answer(client, payload=data)
            return True

        self._park(client, Waiting(finish, until_s))

    def _sleep(self, client: Client, until_s: float) -> None:
        def finish() -> bool:
            if self._clock.now_s < until_s:
                return False
            self._answer(client)
            return True

        self._park(client, Waiting(finish, until_s))

    def _listen(self, client: Client, port: int) -> None:
        owner = next((other for other in self._clients.values() if port in other.networks), None)
        if owner is not None and owner is not client:
            raise DeviceLostError(f"emulated udp port {port}: in use by '{owner.name}'")
        client.networks[port] = self._world.network.listen(port)
        self._answer(client)

    def _receive(self, client: Client, port: int, until_s: float) -> None:
        network = client.networks[port]

        def finish() -> bool:
            datagrams = network.receive(0.0)
            if not datagrams and self._clock.now_s < until_s:
                # a time that does not move would have the lab look for ever
                later_s = math.nextafter(self._clock.now_s, NEVER)
                waiting.wake_s = max(self._world.network.next_look_s(until_s), later_s)
                return False
            self._answer(client, payload=pack_datagrams(datagrams))
            return True

        waiting = Waiting(finish, self._clock.now_s)
        self._park(client, waiting)

    def _park(self, client: Client, waiting: Waiting) -> None:
        if not waiting.finish():
            client.waiting = waiting

    def _signal(self, client: Client, header: dict[str, Any]) -> None:
        """What has no answer of its own: a client acts for another, which waits for it outside the lab; is done
        with that; or will not wait any longer for what it asked."""
        if header["op"] == "cancel":
            if client.waiting is not None:
                client.waiting = None
                self._answer(client, cancelled=True)
            return
        other = self._clients.get(int(header["client"]))
        if other is None or other is client:
            return
        if header["op"] == "adopt" and other.waiting is None:
            other.lent_to = client.number
        elif header["op"] == "release" and other.lent_to == client.number:
            self._give_back(other)

    def _give_back(self, client: Client) -> None:
        client.lent_to = 0
        client.runs_since_s = self._wall_s()
