"""One question, one answer, on a line that may be late, noisy or cut.

The danger is the late answer: after a time-out it still arrives, and the next question of the same kind would
take it for its own. On a connection that forgets when it is opened again (TCP) that is what `Exchange` does. On a
serial line it puts a *fence* first: a question whose answer cannot be mistaken for any that is still missing.
Devices answer in order, so once the fence's answer is there, everything older has come or never will.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator
from dataclasses import dataclass
from typing import Generic, TypeVar, final

from arl_fixtures.devices.port import Clock, StreamPort
from arl_fixtures.errors import DeviceError, DeviceLostError, DeviceTimeoutError, RemoteProtocolError

AnswerT = TypeVar("AnswerT")
AnswerT_co = TypeVar("AnswerT_co", covariant=True)

_LONGEST_ANSWER = 4096


@dataclass(frozen=True, slots=True)
class Question(Generic[AnswerT_co]):
    """What to send and how to know the answer.

    Attributes:
        what: name for messages.
        kind: answers to questions of one kind cannot be told apart.
        data: bytes to send.
        find: looks for the answer in everything received since; None while it is not there. May raise
            RemoteProtocolError for an answer that came and makes no sense; the question is then asked again.
    """

    what: str
    kind: Hashable
    data: bytes
    find: Callable[[bytes], AnswerT_co | None]


Fences = Callable[[], Iterator[Question[object]]]
"""Questions without effect that the device always answers, of as many kinds as there are."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ExchangeSettings:
    """How patient an exchange is; all times on the bench clock.

    Attributes:
        timeout_s: how long an answer may take.
        retries: how often a question is asked again. All questions of these drivers may be asked twice.
        gap_s: shortest time between an answer and the next question.
        quiet_s: with every kind of fence unanswered, this long after the last question nothing is expected to
            arrive any more.
        reopening_forgets: whether opening the port again discards what is under way (TCP: yes, serial: no).
    """

    timeout_s: float
    retries: int = 1
    gap_s: float = 0.0
    quiet_s: float = 3.0
    reopening_forgets: bool = False


@final
class Exchange:
    """Asks one device.

    A question takes at most (1 + retries) × `timeout_s` and, rarely, one wait of `quiet_s`; it is one
    write, one read and some ten microseconds of computing when all is well.

    Args:
        device: name for messages, as `chiller`.
        port: the line.
        clock: the bench clock.
        settings: patience.
        fences: see module text; unused where reopening forgets.
    """

    def __init__(
        self, device: str, port: StreamPort, clock: Clock, settings: ExchangeSettings, *, fences: Fences | None = None
    ) -> None:
        self._device, self._port, self._clock, self._settings = device, port, clock, settings
        self._fences: Fences = fences or _no_fences
        self._missing: set[Hashable] = set()
        self._lost = False
        self._last_s = float("-inf")

    @property
    def place(self) -> str:
        """Device and line, for messages."""
        return f"{self._device} at {self._port.name}"

    def ask(self, question: Question[AnswerT]) -> AnswerT:
        """Send the question and return its answer.

        Raises:
            DeviceTimeoutError: no answer, as often as it was asked.
            RemoteProtocolError: bytes came, but no answer to this.
            DeviceLostError: the line is gone, and opening it again did not help.
        """
        failure: DeviceError | None = None
        quiet = False
        for _ in range(1 + self._settings.retries):
            if isinstance(failure, DeviceLostError):
                # a line that comes back needs a moment
                self._clock.sleep(self._settings.timeout_s)
            try:
                quiet = self._make_clean(may_be_quiet=not quiet) or quiet
            except (DeviceTimeoutError, RemoteProtocolError) as error:
                # the fence failed; what went wrong before it says more
                failure = failure or error
                continue
            except DeviceLostError as error:
                failure, self._lost = error, True
                continue
            try:
                return self._attempt(question)
            except (DeviceTimeoutError, RemoteProtocolError) as error:
                failure = error
            except DeviceLostError as error:
                failure, self._lost = error, True
        raise failure or DeviceError(f"{self.place}: '{question.what}' was never asked")

    def close(self) -> None:
        """Release the line."""
        self._port.close()

    def _attempt(self, question: Question[AnswerT]) -> AnswerT:
        clock, port, settings = self._clock, self._port, self._settings
        if settings.gap_s > 0.0:
            clock.sleep(self._last_s + settings.gap_s - clock.now_s)
        # whatever lies here came unasked
        port.drain()
        port.write(question.data)
        self._last_s = clock.now_s
        deadline_s = self._last_s + settings.timeout_s
        received = b""
        while True:
            left_s = deadline_s - clock.now_s
            chunk = port.read(left_s) if left_s > 0.0 else b""
            if not chunk:
                break
            received += chunk
            try:
                answer = question.find(received)
            except RemoteProtocolError:
                # what made no sense need not have been the answer, which may still come
                self._missing.add(question.kind)
                raise
            if answer is not None:
                self._last_s = clock.now_s
                return answer
            if len(received) > _LONGEST_ANSWER:
                break
        self._missing.add(question.kind)
        if received:
            shown = received[:24].hex(" ") + (" …" if len(received) > 24 else "")
            raise RemoteProtocolError(f"{self.place}: no answer to '{question.what}' in what came: {shown}")
        raise DeviceTimeoutError(f"{self.place}: no answer to '{question.what}' within {settings.timeout_s:g} s")

    def _make_clean(self, *, may_be_quiet: bool) -> bool:
        """Bring the line to a state in which no old answer can be taken for a new one.

        Args:
            may_be_quiet: whether to wait for `quiet_s` if there is no fence left; else that is a time-out.

        Returns:
            Whether it waited.
        """
        settings = self._settings
        if self._lost or (self._missing and settings.reopening_forgets):
            self._port.reopen()
            self._lost = False
            if settings.reopening_forgets:
                self._missing.clear()
        if not self._missing:
            return False
        fence = next((fence for fence in self._fences() if fence.kind not in self._missing), None)
        if fence is not None:
            self._attempt(fence)
        elif may_be_quiet:
            self._clock.sleep(self._last_s + settings.quiet_s - self._clock.now_s)
        else:
            raise DeviceTimeoutError(f"{self.place}: answers are missing, and any to come could be one of them")
        self._missing.clear()
        return fence is None


def _no_fences() -> Iterator[Question[object]]:
    return iter(())
