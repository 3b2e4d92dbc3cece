"""One control line and its two users: the test's exchanges and the guard's own, never one inside the other.

All four protocols are question and answer. A test's exchange begins with its write and counts as open until
`HOLD_S` after its last byte was fetched, so that an answer in pieces is not torn. A question that was left
without an answer makes the line *unsettled*: its answer may still come and would be taken for another's. Then the
other user keeps away until the one who asked has settled it, or nothing can come any more (`quiet_s`). Only on
the way into the safe state the guard does not wait: what it does then may be done twice and is read back.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Final, final

from arl_fixtures.bench.build import CONTROL_LINES
from arl_fixtures.bench.config import BenchConfig
from arl_fixtures.bench.drivers import Kind
from arl_fixtures.devices.port import Clock, StreamPort
from arl_fixtures.errors import ArlError, DeviceError, DeviceTimeoutError
from arl_fixtures.guard.host import Attention, Host

HOLD_S: Final = 0.05


@final
class Patience:
    """Until when the guard's own exchanges may last, for all devices at once; over when one of them is cut short.

    Cut short once, an exchange must not go on asking: every further question that is cut short is one more answer
    that may still come, and once all kinds are missing the line has to rest before anything can be asked of it.

    Args:
        attention: who is heard while a device is waited for.
    """

    def __init__(self, attention: Attention) -> None:
        self.deadline_s = float("inf")
        self.may_be_cut = True
        self._attention = attention

    def sockets(self) -> Sequence[Any]:
        """Everything that may speak."""
        return self._attention.sockets()

    def attend(self) -> bool:
        """Hear; true if something is more urgent, unless this is what is most urgent."""
        cut = self._attention.attend() and self.may_be_cut
        if cut:
            self.deadline_s = float("-inf")
        return cut


@final
class PatientClock:
    """The bench clock for the guard's own drivers: sleeping ends at the deadline, and hears the test.

    Args:
        host: time.
        patience: the deadline, and who is heard while sleeping.
    """

    def __init__(self, host: Host, patience: Patience) -> None:
        self._host, self._patience = host, patience

    @property
    def now_s(self) -> float:
        """Seconds on the bench clock."""
        return self._host.clock.now_s

    def utc_ns(self) -> int:
        """Bench UTC."""
        return self._host.clock.utc_ns()

    def sleep(self, duration_s: float) -> None:
        """Let bench time pass.

        Raises:
            DeviceTimeoutError: the deadline came first, or something more important.
        """
        if duration_s <= 0.0:
            return
        until_s = self.now_s + duration_s
        if self._patience.deadline_s > self.now_s:
            self._host.sleep(min(until_s, self._patience.deadline_s), self._patience)
        if self.now_s < until_s - 1e-9:
            raise DeviceTimeoutError("no time left to wait for the device")


@final
class OwnPort:
    """The line as the guard's own driver sees it.

    Args:
        line: the line.
        host: time and the port's reading.
        patience: the deadline, and who is heard while waiting for the device.
    """

    def __init__(self, line: Line, host: Host, patience: Patience) -> None:
        self._line, self._host, self._patience = line, host, patience
        self.name = line.port.name

    def write(self, data: bytes) -> None:
        """Send all of `data`."""
        self._left_s()
        self._line.port.write(data)
        self._line.unsettled_by, self._line.asked_s = "guard", self._host.clock.now_s

    def read(self, timeout_s: float) -> bytes:
        """What arrives before time-out and deadline."""
        data = self._host.read(self._line.port, min(timeout_s, self._left_s()), self._patience)
        if data:
            self._line.unsettled_by = ""
        return data

    def drain(self) -> bytes:
        """Take what lies unread."""
        return self._line.port.drain()

    def reopen(self) -> None:
        """Close and open again."""
        self._line.port.reopen()
        self._line.unsettled_by = ""

    def close(self) -> None:
        """The line stays with the guard."""

    def _left_s(self) -> float:
        left_s = self._patience.deadline_s - self._host.clock.now_s
        if left_s <= 0.0:
            raise DeviceTimeoutError(f"{self.name}: no time left")
        return left_s


@final
class Line:
    """A control line owned by the guard.

    Args:
        kind: role of its device.
        port: the opened line.
        clock: the bench clock.
        quiet_s: no answer is later than this.
    """

    def __init__(self, kind: Kind, port: StreamPort, clock: Clock, *, quiet_s: float) -> None:
        self.kind, self.port = kind, port
        self._clock, self._quiet_s = clock, quiet_s
        self.unsettled_by = ""
        self.asked_s = self._used_s = float("-inf")

    def free_for_guard_s(self) -> float:
        """From when on the guard may ask something; a time that has passed: now."""
        if self.unsettled_by == "test":
            return self.asked_s + self._quiet_s
        return self._used_s + HOLD_S

    def free_for_test_s(self) -> float:
        """From when on a question of the test may be sent; a time that has passed: now."""
        return self.asked_s + self._quiet_s if self.unsettled_by == "guard" else float("-inf")

    def serve(self, op: str, payload: bytes, *, drain: bool, read: Callable[[StreamPort], bytes]) -> bytes:
        """Carry out one request of the test.

        Args:
            op: `write`, `read` or `reopen`.
            payload: what to write first.
            drain: whether to forget first what lies unread.
            read: how to read, with the test's time-out.

        Raises:
            DeviceError: what the line says, for the test to see.
        """
        try:
            if drain:
                self.port.drain()
            if payload:
                self.port.write(payload)
                self.unsettled_by, self.asked_s = "test", self._clock.now_s
            if op == "read":
                data = read(self.port)
                if data:
                    self.unsettled_by = ""
                return data
            if op == "reopen":
                self.port.reopen()
                self.unsettled_by = ""
            return b""
        finally:
            self._used_s = self._clock.now_s

    def close(self) -> None:
        """Release the line."""
        try:
            self.port.close()
        except DeviceError:
            return

    @property
    def place(self) -> str:
        """For messages."""
        return f"{self.kind} at {self.port.name}"


def why(error: ArlError) -> str:
    """One line of an error."""
    return " ".join(str(error).split())


def open_lines(config: BenchConfig, host: Host) -> dict[Kind, Line]:
    """Own every control line.

    Raises:
        DeviceError: some cannot be opened; the message names each, one a line.
    """
    opened: dict[Kind, Line] = {}
    faults = []
    for kind in CONTROL_LINES:
        try:
            opened[kind] = Line(kind, host.open(kind), host.clock, quiet_s=config.guard.line_quiet_s)
        except DeviceError as error:
            faults.append(f"{kind}: {error}")
    if faults:
        for line in opened.values():
            line.close()
        raise DeviceError("\n".join(faults))
    return opened
