"""What the guard decides, without any I/O: events and samples in, a state and things to do out.

    state    meaning                                            leaves it by
    IDLE     no test; the bench is safe                         JOIN, FOUND, SENDING
    ARMED    a test drives the bench                            HOLD, TRIP, LEAVE
    HOLDING  a condition asks the test to pause                 CLEAR, TRIP, LEAVE
    CLOSING  the test said good-bye; safe actions are verified  SETTLED, UNSAFE
    TRIPPED  safe actions under way                             SETTLED, UNSAFE
    SAFE     stopped; nothing may drive the bench               PARDON, ACK, RETRY, FOUND, SENDING

Whatever is not in `TRANSITIONS` cannot happen; everything that decides a transition is in this file. `SETTLED`
means that every safe action was verified by read-back, `UNSAFE` that some could not be, as often as it was tried.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum, StrEnum
from types import MappingProxyType
from typing import Any, Final, final

from arl_fixtures.bench.guard_settings import Action, GuardSettings
from arl_fixtures.errors import LocalProtocolError
from arl_fixtures.guard.conditions import ConditionWatch, Sample, Violation


class State(StrEnum):
    """Where the guard is."""

    IDLE = "idle"
    ARMED = "armed"
    HOLDING = "holding"
    CLOSING = "closing"
    TRIPPED = "tripped"
    SAFE = "safe"


class Event(Enum):
    """What can move it."""

    JOIN = "a test connected"
    LEAVE = "the test said good-bye"
    HOLD = "a condition asks for a pause"
    CLEAR = "the condition is over"
    TRIP = "the test is lost, or a condition asks for the safe state"
    SETTLED = "every safe action is verified"
    UNSAFE = "a safe action could not be verified"
    FOUND = "a session was found that nobody had ended"
    RETRY = "safe actions that could not be verified are tried again"
    PARDON = "verified, and nothing to acknowledge"
    ACK = "somebody acknowledged"
    SENDING = "a DUT sends though its power is off"


TRANSITIONS: Final[Mapping[State, Mapping[Event, State]]] = MappingProxyType(
    {
        State.IDLE: {Event.JOIN: State.ARMED, Event.FOUND: State.TRIPPED, Event.SENDING: State.SAFE},
        State.ARMED: {Event.HOLD: State.HOLDING, Event.TRIP: State.TRIPPED, Event.LEAVE: State.CLOSING},
        State.HOLDING: {Event.CLEAR: State.ARMED, Event.TRIP: State.TRIPPED, Event.LEAVE: State.CLOSING},
        State.CLOSING: {Event.SETTLED: State.IDLE, Event.UNSAFE: State.SAFE},
        State.TRIPPED: {Event.SETTLED: State.SAFE, Event.UNSAFE: State.SAFE},
        State.SAFE: {
            Event.PARDON: State.IDLE,
            Event.ACK: State.IDLE,
            Event.RETRY: State.TRIPPED,
            Event.FOUND: State.TRIPPED,
            Event.SENDING: State.SAFE,
        },
    }
)

DRIVEN: Final = frozenset({State.ARMED, State.HOLDING})
"""States in which the test's requests reach the devices."""


class SafeStep(StrEnum):
    """The safe state, in the order in which it is reached."""

    POWER_OFF = "laser and DUT power off"
    SETPOINT = "safe set-point"
    STAGE_STOP = "stage stopped"


@dataclass(frozen=True, slots=True)
class Record:
    """Something worth remembering: bench time, what happened, details fit for JSON."""

    time_s: float
    what: str
    detail: Mapping[str, Any] = field(default_factory=dict)


@final
class SafeSequence:
    """Safe actions in order; those that fail are tried again after all others have had their turn.

    Args:
        attempts: rounds before giving up.
    """

    def __init__(self, attempts: int) -> None:
        self._attempts = attempts
        self.round = 1
        self._open = list(SafeStep)
        self._failed: list[SafeStep] = []
        self.unverified: dict[SafeStep, str] = dict.fromkeys(SafeStep, "not tried")

    @property
    def next(self) -> SafeStep | None:
        """What to do now; None when all is done or given up."""
        return self._open[0] if self._open else None

    def done(self, step: SafeStep, fault: str) -> None:
        """The step was carried out; `fault` is empty when its read-back agreed."""
        if step is not self.next:
            raise LocalProtocolError(f"guard: '{step}' was not to be done now")
        self._open.pop(0)
        if fault:
            self.unverified[step] = fault
            self._failed.append(step)
        else:
            del self.unverified[step]
        if not self._open and self._failed and self.round < self._attempts:
            self.round += 1
            self._open, self._failed = self._failed, []


@dataclass(frozen=True, slots=True)
class Request:
    """What the guard asks of the test: `action` is hold or soak back."""

    action: Action
    reason: str


@final
class GuardCore:
    """The guard's mind.

    Args:
        settings: conditions and times.
        stopped: a stop that nobody has acknowledged yet (the guard was started again).

    Attributes:
        actions: safe actions carried out last, in order, each with what went wrong (empty when verified).
    """

    def __init__(self, settings: GuardSettings, *, stopped: bool = False) -> None:
        self._settings = settings
        self.state = State.SAFE if stopped else State.IDLE
        self.cause = ""
        self.needs_ack = stopped
        self.unverified: dict[str, str] = {}
        self.request: Request | None = None
        self._watches: list[ConditionWatch] = []
        self._safe: SafeSequence | None = None
        self.actions: list[tuple[str, str]] = []
        self._beat_s = self._held_since_s = self._violated_s = 0.0
        self._heeded = False
        self._records: list[Record] = []

    # -- what happens to it

    def join(self, now_s: float) -> None:
        """A test connected and may drive the bench from now on.

        Raises:
            LocalProtocolError: another one does, or the bench is stopped.
        """
        self._go(Event.JOIN, now_s)
        self._watches = [ConditionWatch(condition) for condition in self._settings.conditions]
        self._beat_s = now_s
        self.cause, self.needs_ack, self.unverified = "", False, {}

    def beat(self, now_s: float) -> None:
        """The test's main loop gave a sign of life."""
        self._beat_s = max(self._beat_s, now_s)

    def heed(self, now_s: float) -> None:
        """The test pauses as it was asked to."""
        if self.state is State.HOLDING and not self._heeded:
            self._heeded = True
            self._note(now_s, "pause heeded")

    def leave(self, now_s: float) -> None:
        """The test said good-bye."""
        if self.state in DRIVEN:
            self._make_safe(Event.LEAVE, now_s, "the session ended")

    def lost(self, now_s: float, how: str) -> None:
        """The test process died, was stopped or hangs; nothing if none was there."""
        if self.state in DRIVEN:
            self._trip(now_s, how, needs_ack=self._settings.ack_after_lost_test)

    def found(self, now_s: float, how: str, *, needs_ack: bool) -> None:
        """The guard has just started and finds that its predecessor died while a test drove the bench.

        Args:
            now_s: bench time.
            how: what is known of it.
            needs_ack: whether it is to be acknowledged even when every safe action is verified.
        """
        self._make_safe(Event.FOUND, now_s, how)
        self.needs_ack = needs_ack

    def retry(self, now_s: float) -> None:
        """Try safe actions again that could not be verified; nothing if all were, or something else is going on."""
        if self.state is State.SAFE and self.unverified:
            self._make_safe(Event.RETRY, now_s, self.cause, attempts=1)

    def see(self, sample: Sample) -> None:
        """Judge one look at the bench."""
        if self.state not in DRIVEN:
            return
        now_s = sample.time_s
        violations = [found for watch in self._watches if (found := watch.see(sample)) is not None]
        worst = max(violations, key=lambda found: found.condition.action.severity, default=None)
        if worst is None:
            if self.state is State.HOLDING and now_s - self._violated_s >= self._settings.clear_s:
                self.request = None
                self._go(Event.CLEAR, now_s)
            return
        self._violated_s = now_s
        if worst.condition.action is Action.SAFE_STATE:
            self._trip(now_s, str(worst), needs_ack=True)
        else:
            self._hold(now_s, worst)

    def tick(self, now_s: float) -> None:
        """Time passed: is the test still alive, does it pause as asked, does a pause last too long?"""
        settings = self._settings
        if self.state not in DRIVEN:
            return
        silent_s = now_s - self._beat_s
        if silent_s > settings.heartbeat_timeout_s:
            self.lost(now_s, f"no sign of life from the test for {silent_s:.1f} s")
        elif self.state is State.HOLDING and self.request is not None:
            held_s = now_s - self._held_since_s
            if not self._heeded and held_s > settings.obey_s:
                self._trip(now_s, f"the test did not pause within {settings.obey_s:g} s: {self.request.reason}")
            elif held_s > settings.hold_limit_s:
                self._trip(now_s, f"still not over after {settings.hold_limit_s:g} s: {self.request.reason}")

    def did(self, step: SafeStep, fault: str, now_s: float) -> None:
        """A safe action was carried out and read back; `fault` is empty when it is verified."""
        if self._safe is None:
            raise LocalProtocolError("guard: no safe action was asked for")
        self._safe.done(step, fault)
        self.actions.append((str(step), fault))
        self._note(now_s, "safe action", step=str(step), fault=fault)
        if self._safe.next is not None:
            return
        self.unverified = {str(step): why for step, why in self._safe.unverified.items()}
        self._safe = None
        if self.unverified:
            self.needs_ack = True
            self._go(Event.UNSAFE, now_s, unverified=self.unverified)
            return
        self._go(Event.SETTLED, now_s)
        if self.state is State.SAFE and not self.needs_ack:
            self._go(Event.PARDON, now_s)

    def sending(self, now_s: float, who: str) -> None:
        """After the relays read back as off: `who` still sends, in words."""
        self.unverified = {str(SafeStep.POWER_OFF): who}
        self.needs_ack = True
        self._go(Event.SENDING, now_s, unverified=self.unverified)

    def acknowledge(self, now_s: float, who: str, note: str) -> None:
        """Somebody has seen the stop and allows the bench to be driven again.

        Raises:
            LocalProtocolError: there is nothing to acknowledge.
        """
        self._go(Event.ACK, now_s, by=who, note=note)
        self.needs_ack, self.unverified = False, {}

    # -- what it wants

    @property
    def to_do(self) -> SafeStep | None:
        """The safe action to carry out now."""
        return self._safe.next if self._safe is not None else None

    @property
    def round(self) -> int:
        """Which round of safe actions is under way, from 1; 0 when none is."""
        return self._safe.round if self._safe is not None else 0

    @property
    def driven(self) -> bool:
        """Whether the test's requests may reach the devices."""
        return self.state in DRIVEN

    def take_records(self) -> list[Record]:
        """What happened since this was last asked."""
        taken, self._records = self._records, []
        return taken

    # -- inside

    def _hold(self, now_s: float, worst: Violation) -> None:
        before = self.request
        self.request = Request(worst.condition.action, str(worst))
        if self.state is State.ARMED:
            self._held_since_s, self._heeded = now_s, False
            self._go(Event.HOLD, now_s, action=str(self.request.action), reason=self.request.reason)
        elif before is not None and before.action is not self.request.action:
            self._heeded = False
            self._note(now_s, "pause changed", action=str(self.request.action), reason=self.request.reason)

    def _trip(self, now_s: float, cause: str, *, needs_ack: bool = True) -> None:
        self._make_safe(Event.TRIP, now_s, cause)
        self.needs_ack = needs_ack

    def _make_safe(self, event: Event, now_s: float, cause: str, *, attempts: int | None = None) -> None:
        self._go(event, now_s, cause=cause)
        self.cause, self.request = cause, None
        self._safe = SafeSequence(attempts or self._settings.attempts)
        self.actions = []

    def _go(self, event: Event, now_s: float, **detail: Any) -> None:  # noqa: ANN401 - details are the record's own
        target = TRANSITIONS[self.state].get(event)
        if target is None:
            raise LocalProtocolError(f"guard: '{event.value}' cannot happen while {self.state}")
        before, self.state = self.state, target
        self._note(now_s, event.value, before=str(before), after=str(target), **detail)

    def _note(self, now_s: float, what: str, **detail: Any) -> None:  # noqa: ANN401 - details are the record's own
        self._records.append(Record(now_s, what, detail))
