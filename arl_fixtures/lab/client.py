"""A process's side of the lab: a clock and ports with the contracts of `devices.port`."""

from __future__ import annotations

import math
import select
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple, Self, final

from arl_fixtures.bench.drivers import Kind
from arl_fixtures.bench.profile import CycleStep
from arl_fixtures.devices.port import Datagram, DatagramPort, StreamPort
from arl_fixtures.errors import (
    ArlError,
    ConfigError,
    DeviceError,
    DeviceLostError,
    LocalProtocolError,
    RemoteProtocolError,
)
from arl_fixtures.lab.datagrams import unpack_datagrams
from arl_fixtures.lab.framing import Link, Message, PeerLostError

ERRORS: Final[dict[str, type[ArlError]]] = {
    error.__name__: error
    for error in (ConfigError, DeviceError, DeviceLostError, LocalProtocolError, RemoteProtocolError)
}


class Unsent(NamedTuple):
    """Bytes to be written with the next request."""

    line: str
    data: bytes
    drain: bool


@final
class LabClient:
    """A connection to a lab.

    Args:
        link: to the lab.
        name: how the lab and its messages call this process.
        role: `driver` (a test; time jumps for its sake), `follower` (a guard) or `onlooker` (never holds the clock).
    """

    def __init__(self, link: Link, name: str, *, role: str) -> None:
        self._link = link
        self.unsent: Unsent | None = None
        welcome = self.ask("hello", name=name, role=role).header
        self.number = int(welcome["number"])
        self.clock = LabClock(self, float(welcome["now_s"]), int(welcome["epoch_ns"]))

    @classmethod
    def connect(cls, path: Path, name: str, *, role: str) -> Self:
        """Connect to the lab at a socket.

        Raises:
            DeviceLostError: there is no lab.
        """
        try:
            return cls(Link.connect(path), name, role=role)
        except PeerLostError as error:
            raise DeviceLostError(f"no lab: {error}") from None

    def fileno(self) -> int:
        """For `select`."""
        return self._link.fileno()

    def ask(self, op: str, payload: bytes = b"", **header: Any) -> Message:  # noqa: ANN401 - JSON
        """Do one request.

        Raises:
            ArlError: what the lab says is wrong; DeviceLostError when it is gone.
        """
        self.flush()
        try:
            answer = self._link.ask({"op": op, **header}, payload)
        except PeerLostError as error:
            raise DeviceLostError(f"the lab is gone: {error}") from None
        return self._understood(answer)

    def flush(self) -> None:
        """Send what is to be written before anything else happens."""
        if (unsent := self.unsent) is not None:
            self.unsent = None
            self.ask("write", unsent.data, line=unsent.line, drain=unsent.drain)

    def _understood(self, answer: Message) -> Message:
        if op_clock := getattr(self, "clock", None):
            op_clock.note(float(answer.header["now_s"]))
        if "error" in answer.header:
            raise ERRORS.get(answer.header["error"], DeviceError)(str(answer.header["message"]))
        return answer

    def ask_attentively(
        self,
        op: str,
        header: dict[str, Any],
        sockets: Callable[[], Sequence[Any]],
        attend: Callable[[], bool],
        payload: bytes = b"",
    ) -> Message:
        """Do a request that takes time, and hear others meanwhile.

        Args:
            op, header, payload: the request.
            sockets: gives what else may speak.
            attend: called when one of them has; true cancels the request, which then ends without result.
        """
        self.flush()
        try:
            self._link.post({"op": op, **header}, payload)
            cancelled = False
            while True:
                others = [] if cancelled else list(sockets())
                ready = select.select([self._link, *others], [], [])[0]
                # what others say comes first: it was said before time passed
                if any(other is not self._link for other in ready):
                    if attend():
                        cancelled = True
                        self._link.send({"op": "cancel"})
                elif ready:
                    answer = self._link.answer()
                    assert answer is not None
                    return self._understood(answer)
        except PeerLostError as error:
            raise DeviceLostError(f"the lab is gone: {error}") from None

    def adopt(self, client: int) -> None:
        """Act for `client`, which waits for this process outside the lab and so must not hold the clock."""
        self._tell({"op": "adopt", "client": client})

    def release(self, client: int) -> None:
        """`client` acts for itself again from now on."""
        self._tell({"op": "release", "client": client})

    def _tell(self, header: dict[str, Any]) -> None:
        try:
            self._link.send(header)
        except PeerLostError as error:
            raise DeviceLostError(f"the lab is gone: {error}") from None

    # -- the lab's back door, for tests and `arl lab`

    def inspect(self) -> dict[str, Any]:
        """True state of the plant, what changed when, and who is connected."""
        return self.ask("inspect").header

    def inject(self, fault: str) -> None:
        """Let a fault happen; the text is that of `parse_fault`."""
        self.ask("inject", fault=fault)

    def clear_faults(self, device: str | None = None) -> None:
        """End faults, of one device or all."""
        self.ask("clear", device=device)

    # -- lines

    def port(self, kind: Kind) -> StreamPort:
        """Own a control line.

        Raises:
            DeviceLostError: another process owns it.
        """
        return LabStreamPort(self, kind)

    def datagrams(self, port: int) -> DatagramPort:
        """Listen at a UDP port of the lab.

        Raises:
            DeviceLostError: another process listens there.
        """
        return LabDatagramPort(self, port)

    def enter_step(self, step: CycleStep) -> None:
        """Tell the emulated DUTs which temperature step begins."""
        cycle, index = step.cycle, step.index
        self.ask("enter_step", cycle=cycle, index=index, set_temperature_c=step.set_temperature_c, ramp=step.ramp)

    def close(self) -> None:
        """Leave; all lines are free again."""
        self._link.close()


@final
class LabClock:
    """The lab's clock as this process knows it: exact while it holds the clock."""

    virtual = True

    def __init__(self, client: LabClient, now_s: float, epoch_ns: int) -> None:
        self._client, self._now_s, self._epoch_ns = client, now_s, epoch_ns

    @property
    def now_s(self) -> float:
        """Seconds on the bench clock."""
        return self._now_s

    def note(self, now_s: float) -> None:
        """Somebody who knows says what time it is."""
        self._now_s = max(self._now_s, now_s)

    def utc_ns(self) -> int:
        """Virtual UTC."""
        return self._epoch_ns + round(self._now_s * 1e9)

    def sleep(self, duration_s: float) -> None:
        """Let bench time pass."""
        if duration_s > 0.0:
            if not math.isfinite(duration_s):
                raise LocalProtocolError("lab: sleeping for ever")
            self._client.ask("sleep", until_s=self._now_s + duration_s)


@final
class LabStreamPort:
    """A control line of the lab.

    What is written leaves together with the next request of this process, be it the reading of the answer: no
    time passes between, so nobody can tell, and a question with its answer is one exchange with the lab.
    """

    def __init__(self, client: LabClient, line: str) -> None:
        self.name = f"emulated {line}"
        self.line = line
        self._client = client
        self._drain = False
        client.ask("open", line=line)
        self._open = True

    def write(self, data: bytes) -> None:
        """Send all of `data`; that the line is gone is said by the next request."""
        self._client.flush()
        if not self._open:
            raise DeviceLostError(f"{self.name}: the line is closed")
        self._client.unsent = Unsent(self.line, data, self._take_drain())

    def read(self, timeout_s: float) -> bytes:
        """What has arrived; lets time pass until something has."""
        header, payload = self.reading(timeout_s)
        return self._client.ask("read", payload, **header).payload

    def reading(self, timeout_s: float) -> tuple[dict[str, Any], bytes]:
        """The request that reads, with whatever is to be written before."""
        payload, drain = b"", self._take_drain()
        unsent = self._client.unsent
        if unsent is not None and unsent.line == self.line:
            payload, drain, self._client.unsent = unsent.data, unsent.drain, None
        return {"line": self.line, "timeout_s": timeout_s, "drain": drain}, payload

    def drain(self) -> bytes:
        """Forget what lies unread before the next request; says nothing about it, which saves an exchange."""
        self._drain = True
        return b""

    def reopen(self) -> None:
        """Forget what is under way in both directions."""
        self._client.ask("reopen", line=self.line)

    def close(self) -> None:
        """Leave the line to others."""
        if self._open:
            self._open = False
            self._client.ask("close", line=self.line)

    def _take_drain(self) -> bool:
        drain, self._drain = self._drain, False
        return drain


@final
class LabDatagramPort:
    """A UDP port of the lab."""

    def __init__(self, client: LabClient, port: int) -> None:
        self.name = f"emulated udp port {port}"
        self._client, self._port = client, port
        self._open = True
        client.ask("listen", port=port)

    def receive(self, timeout_s: float) -> list[Datagram]:
        """All datagrams that have arrived; lets time pass until one has."""
        if not self._open:
            raise DeviceLostError(f"{self.name}: the socket is closed")
        return unpack_datagrams(self._client.ask("receive", port=self._port, timeout_s=timeout_s).payload)

    def discard(self, before_s: float = math.inf) -> int:
        """Forget what lies unread and arrived before `before_s`."""
        before = None if before_s == math.inf else before_s
        return int(self._client.ask("discard", port=self._port, before_s=before).header["count"])

    def close(self) -> None:
        """Stop listening; the port is free for others."""
        if self._open:
            self._open = False
            self._client.ask("hush", port=self._port)
