"""The guard process: one loop that serves the test, looks at the bench, and makes it safe.

It owns the control lines. While it waits, for time or for a device, it hears the test; of what it may do it does
first what is most urgent: safe actions, then the test's requests, then its own looks, one device at a time.
"""

from __future__ import annotations

import time
from typing import Any, Final, final

from arl_fixtures.bench.build import CONTROL_LINES
from arl_fixtures.bench.config import BenchConfig
from arl_fixtures.bench.drivers import Kind
from arl_fixtures.errors import ArlError, ConfigError, DeviceError, InterlockError
from arl_fixtures.guard.bookkeeping import Bookkeeping
from arl_fixtures.guard.conditions import Sample
from arl_fixtures.guard.core import GuardCore, SafeStep, State
from arl_fixtures.guard.hands import Hands
from arl_fixtures.guard.host import Host
from arl_fixtures.guard.line import open_lines
from arl_fixtures.guard.runtime import Lease, Places, process_state
from arl_fixtures.guard.sentinel import Sentinel
from arl_fixtures.guard.sessions import Ear, Session, Sessions
from arl_fixtures.guard.silence import SilenceCheck
from arl_fixtures.lab.framing import Message

_LOOK_LIMIT_S: Final = 10.0
_RETRY_S: Final = 3.0
_REST_S: Final = 1.0
_SETTLED: Final = frozenset({State.IDLE, State.SAFE})


@final
class GuardProcess:
    """The guard of one bench.

    Args:
        config: the bench file.
        host: time and lines.
        places: its files.
        lease: the right to guard this bench.
        sentinel: who calls another guard where test and guard die together.
        linger_s: wall time for which it stays, without a test, after one was lost; None: for ever.

    Raises:
        DeviceError: a line cannot be opened; the message names each, one a line.
    """

    def __init__(
        self,
        config: BenchConfig,
        host: Host,
        places: Places,
        lease: Lease,
        sentinel: Sentinel,
        *,
        linger_s: float | None,
    ) -> None:
        self._config, self._settings, self._host, self._lease = config, config.guard, host, lease
        self._sentinel, self._linger_s = sentinel, linger_s
        self._books = Bookkeeping(places, config.name)
        self._lines = open_lines(config, host)
        self._sessions = Sessions(
            places.socket, on_request=self._on_request, on_word=self._on_word, on_lost=self._on_lost
        )
        self._busy = Ear(self._sessions, lambda: self._urgent)
        self._hands = Hands(config, host, self._lines, self._busy)
        self._silence = SilenceCheck(config, host, self._hands.loads)
        self._waiting = Ear(self._sessions, lambda: self._urgent or self._has_requests())
        stop = self._books.last_stop
        self._core = GuardCore(self._settings, stopped=stop is not None and stop.blocks)
        self._driver: Session | None = None
        self._lost = ""
        self._commanded: dict[str, bool] = {}
        self._awaited: dict[str, float] = {}
        self._due_s: dict[Kind, float] = dict.fromkeys(CONTROL_LINES, 0.0)
        self._known_s: dict[Kind, float] = {}
        self._retry_s = 0.0
        self._alone_since_s = time.monotonic()
        self._orderly = self._ending = self._over = False
        self._end_what_nobody_ended()

    @property
    def _now_s(self) -> float:
        return self._host.clock.now_s

    # -- life

    def run(self) -> None:
        """Guard until told to end, or until nobody needs it any more."""
        try:
            while not self._over:
                self._turn()
            self._books.forget_session()
        except BaseException:
            # whatever it is that ends the guard: not without having tried
            if self._core.driven or self._core.to_do is not None:
                for step in SafeStep:
                    self._hands.do(step, self._settings.attempt_s)
            raise
        finally:
            self.close()

    def stop(self) -> None:
        """Make the bench safe and end; may be called from a signal handler."""
        self._ending = True

    def close(self) -> None:
        """Release socket, lines and lease."""
        self._sessions.close()
        for line in self._lines.values():
            line.close()
        self._host.close()
        self._lease.release()
        self._sentinel.end()

    def _turn(self) -> None:
        self._sessions.hear()
        self._judge_life()
        self._keep_books()
        if self._core.to_do is not None:
            self._act()
        elif self._silence.may_listen and not self._core.driven:
            self._listen()
        elif not self._serve_one() and not self._look_at_one():
            self._consider_ending()
            if not self._over:
                self._host.sleep(self._wake_s(), self._waiting)
        self._keep_books()
        self._sentinel.tend(needed=self._core.state not in _SETTLED or bool(self._core.unverified))
        self._lease.renew()

    def _judge_life(self) -> None:
        core = self._core
        watched = self._driver if self._settings.watch_stopped and not self._lost else None
        if watched is not None and process_state(watched.pid) in {"T", "t"}:
            self._lost = f"the test (process {watched.pid}) was stopped"
        if self._ending and core.driven:
            self._lost = self._lost or "the guard was told to end while a test drove the bench"
        if self._lost:
            core.lost(self._now_s, self._lost)
            self._lost = ""
        core.tick(self._now_s)
        if core.state is State.SAFE and core.unverified and self._now_s >= self._retry_s:
            core.retry(self._now_s)
        if not core.driven:
            self._driver = None

    def _end_what_nobody_ended(self) -> None:
        """A predecessor died while a test drove the bench, or in the middle of making it safe: do that first."""
        how, needs_ack = self._books.what_nobody_ended
        if how:
            self._core.found(self._now_s, how, needs_ack=needs_ack or self._settings.ack_after_lost_test)
            self._keep_books()

    @property
    def _urgent(self) -> bool:
        return bool(self._lost) or (self._ending and self._core.driven)

    def _consider_ending(self) -> None:
        wall_s = time.monotonic()
        if self._sessions.all:
            self._alone_since_s = wall_s
        if self._core.state not in _SETTLED or ((self._core.unverified or self._silence.due) and not self._ending):
            return
        alone = self._linger_s is not None and not self._sessions.all
        # stopped and verified: whoever comes to look needs the lines, and the stop is on disk
        stopped = self._core.state is State.SAFE
        lingered = self._linger_s is not None and wall_s - self._alone_since_s > self._linger_s
        # after an orderly end nobody will come back for the guard's sake
        gone_home = self._orderly and self._linger_s is not None and not stopped
        self._over = self._ending or gone_home or (alone and (stopped or lingered))

    def _wake_s(self) -> float:
        now_s = self._now_s
        if not self._core.driven:
            return now_s + _REST_S
        times = [max(self._due_s[kind], line.free_for_guard_s()) for kind, line in self._lines.items()]
        times += [line.free_for_test_s() for line in self._lines.values() if line.free_for_test_s() > now_s]
        return min(times)

    def _keep_books(self) -> None:
        self._books.write_down(self._core, self._core.take_records())

    # -- what is heard

    def _on_request(self, session: Session) -> None:
        if session is self._driver:
            self._core.beat(self._now_s)
        if session.lab:
            self._host.adopt(session.lab)

    def _on_word(self, session: Session, message: Message) -> None:
        header = message.header
        op = header.get("op")
        if op == "status":
            self._answer(session, header.get("n"))
            return
        if session is not self._driver:
            return
        self._core.beat(self._now_s)
        if op == "commanded":
            for load, on in dict(header.get("loads", {})).items():
                if on is None:
                    self._commanded.pop(load, None)
                else:
                    self._commanded[load] = bool(on)
        elif op == "awaited":
            # ages are the test's; from here they grow with the guard's clock
            now_s = self._now_s
            self._awaited = {str(dut): now_s - float(age_s) for dut, age_s in header.get("silent_s", {}).items()}
        elif op == "heed":
            self._core.heed(self._now_s)
            self._hands.renew_one("stage", self._lines["stage"])

    def _on_lost(self, session: Session) -> None:
        if session is self._driver:
            self._lost = f"the test (process {session.pid}) died"

    def _has_requests(self) -> bool:
        return any(session.inbox for session in self._sessions.all)

    # -- serving

    def _serve_one(self) -> bool:
        for session in list(self._sessions.all):
            if session.inbox and self._turn_has_come(session.inbox[0]):
                message = session.inbox.popleft()
                number = message.header.get("n")
                try:
                    payload = self._serve(session, message)
                except ArlError as error:
                    self._reply(session, number, error=type(error).__name__, message=str(error))
                except (TypeError, ValueError) as error:
                    self._reply(session, number, error="LocalProtocolError", message=f"guard: bad request: {error}")
                else:
                    self._reply(session, number, payload=payload)
                return True
        return False

    def _turn_has_come(self, message: Message) -> bool:
        header = message.header
        if header["op"] in {"hello", "ack"}:
            # who says hello while it is about to end is hung up on, and calls the next one
            return self._core.to_do is None and not (header["op"] == "hello" and self._ending)
        if message.payload and self._core.driven:
            line = self._lines.get(header.get("line", ""))
            return line is None or line.free_for_test_s() <= self._now_s
        return True

    def _serve(self, session: Session, message: Message) -> bytes:
        header = message.header
        match header["op"]:
            case "hello":
                self._join(session, header)
            case "ack":
                self._core.acknowledge(self._now_s, str(header.get("by", "")), str(header.get("note", "")))
            case "bye":
                self._leave(session)
            case "listen":
                if self._silence.due:
                    self._listen()
            case op:
                return self._use_line(session, str(op), message)
        return b""

    def _join(self, session: Session, header: dict[str, Any]) -> None:
        if header.get("sha256") != self._config.sha256:
            if self._core.state in _SETTLED:
                self._ending = True
            raise ConfigError("the guard runs with another version of the bench file")
        if self._driver is not None:
            raise InterlockError(f"another test (process {self._driver.pid}) drives this bench")
        stop = self._books.last_stop
        if self._core.state is State.SAFE:
            raise InterlockError(f"{stop}; acknowledge with: arl ack")
        self._core.join(self._now_s)
        # the good-bye was another's
        self._orderly = False
        self._silence.forget()
        self._driver = session
        self._commanded, self._awaited = {}, {}
        self._known_s = dict.fromkeys(CONTROL_LINES, self._now_s)
        self._hands.renew()
        # the sentinel goes by the mark that is on disk then
        self._keep_books()
        self._sentinel.begin(session.pid)

    def _leave(self, session: Session) -> None:
        if session is self._driver:
            self._core.leave(self._now_s)
            while self._core.to_do is not None:
                self._keep_books()
                self._act()
            self._driver = None
            self._keep_books()
            self._orderly = True

    def _use_line(self, session: Session, op: str, message: Message) -> bytes:
        if session is not self._driver or not self._core.driven:
            cause = self._core.cause or (self._books.last_stop.cause if self._books.last_stop else "not connected")
            raise InterlockError(f"the guard has made the bench safe: {cause}")
        header = message.header
        line = self._lines.get(header.get("line", ""))
        if line is None:
            raise DeviceError(f"the guard has no line '{header.get('line')}'")
        timeout_s = float(header.get("timeout_s", 0.0))
        return line.serve(
            op,
            message.payload,
            drain=bool(header.get("drain")),
            read=lambda port: self._host.read(port, timeout_s, self._busy),
        )

    def _reply(self, session: Session, number: Any, *, payload: bytes = b"", **header: Any) -> None:  # noqa: ANN401
        self._keep_books()
        if session.lab:
            self._host.release(session.lab)
        self._answer(session, number, payload=payload, **header)

    def _answer(self, session: Session, number: Any, *, payload: bytes = b"", **header: Any) -> None:  # noqa: ANN401
        core, stop = self._core, self._books.last_stop
        request = None if core.request is None else [str(core.request.action), core.request.reason]
        body = {"n": number, "now_s": self._now_s, "state": str(core.state), "cause": core.cause, "request": request}
        body |= {"unverified": core.unverified, "actions": core.actions, "stop": None if stop is None else str(stop)}
        body["sentinel"] = self._sentinel.pid
        session.peer.send(body | header, payload)

    # -- looking and acting

    def _look_at_one(self) -> bool:
        if not self._core.driven:
            return False
        now_s = self._now_s
        due = [
            kind
            for kind, line in self._lines.items()
            if self._due_s[kind] <= now_s and line.free_for_guard_s() <= now_s
        ]
        if not due:
            return False
        kind = min(due, key=lambda one: self._due_s[one])
        poll_s = self._settings.poll_s
        self._due_s[kind] = now_s + poll_s
        if self._hands.look(kind, _LOOK_LIMIT_S):
            # waiting for a silent device must not hold up the test's requests to the others all the time
            self._due_s[kind] = self._now_s + min(4.0 * poll_s, 1.0)
        else:
            self._known_s[kind] = self._now_s
        self._forget_what_is_old()
        if not self._urgent:
            self._core.see(self._sample(kind))
        return True

    def _forget_what_is_old(self) -> None:
        oldest_s = self._now_s - max(4.0 * self._settings.poll_s, 2.0)
        for kind, known_s in self._known_s.items():
            if known_s < oldest_s:
                self._hands.forget(kind)

    def _sample(self, asked: Kind) -> Sample:
        """What is known; of states only what was asked just now, for commands may have changed the others since."""
        findings, now_s = self._hands.findings, self._now_s
        return Sample(
            time_s=now_s,
            temperatures_c=findings.temperatures_c,
            housings=self._config.thermometer.housing_names(),
            chiller=findings.chiller if asked == "chiller" else None,
            stage_fault=findings.stage_fault if asked == "stage" else None,
            commanded=self._commanded,
            read_back=findings.read_back if asked == "relays" else None,
            duts_awaited_s={serial: now_s - since_s for serial, since_s in self._awaited.items()},
        )

    def _act(self) -> None:
        """One safe action; later rounds are given more time, for devices that need pauses between commands."""
        step, core = self._core.to_do, self._core
        if step is None:
            return
        fault = self._hands.do(step, self._settings.attempt_s * 2.0 ** (core.round - 1))
        if step is SafeStep.POWER_OFF and not fault:
            self._silence.power_is_off()
        core.did(step, fault, self._now_s)
        self._retry_s = self._now_s + _RETRY_S
        self._lease.renew()

    def _listen(self) -> None:
        """Are the DUTs as dark as the relays say?"""
        if who := self._silence.listen():
            self._core.sending(self._now_s, who)
            self._retry_s = self._now_s + _RETRY_S
            self._keep_books()
