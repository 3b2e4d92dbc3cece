"""The `guard:` block of a bench file: what is watched, within which bounds, and what happens beyond them."""

from __future__ import annotations

from enum import StrEnum
from typing import Final, Literal, Self

from pydantic import Field, model_validator

from arl_fixtures.yaml_model import FileModel


class Action(StrEnum):
    """What a violated condition leads to, mildest first.

    `hold`: no new step begins, temperatures are held; goes on by itself when the condition is over.
    `soak_back`: as hold, at the safe temperature.
    `safe_state`: power off, safe set-point, stage stopped; nothing goes on before an acknowledgement.
    """

    HOLD = "hold"
    SOAK_BACK = "soak_back"
    SAFE_STATE = "safe_state"

    @property
    def severity(self) -> int:
        """0 for the mildest."""
        return list(Action).index(self)


Watched = Literal[
    "housings",
    "plate",
    "coolant",
    "ambient",
    "level",
    "chiller_alarm",
    "chiller_warning",
    "pump",
    "stage_fault",
    "relays",
    "duts",
]

TEMPERATURES: Final = frozenset({"housings", "plate", "coolant", "ambient"})
STATES: Final = frozenset({"chiller_alarm", "chiller_warning", "pump", "stage_fault", "relays"})


class Condition(FileModel):
    """One thing that must hold.

    Temperatures take exactly one of `floor`, `ceiling`, `rate_per_min`, `disagreement`, `stale_s`; the chiller's
    level takes `floor` or `stale_s`; DUTs take `stale_s`. Alarms, faults, pump and relays need no bound: they are
    violated by being there, or by a read-back that differs from what was commanded.

    Attributes:
        watch: what is looked at.
        action: what follows.
        floor, ceiling: lowest and highest value, °C or percent.
        rate_per_min: largest change in either direction, K/min, as a straight line through the last `window_s`.
        window_s: length of that line.
        disagreement: largest distance, K, of a housing from the median of all, or of `watch` from `against`.
        against: the other temperature of a disagreement.
        stale_s: longest time without a value.
        for_s: how long it must be violated before the action; one wrong reading is no reason to stop.
    """

    watch: Watched
    action: Action = Action.SAFE_STATE
    floor: float | None = Field(default=None, allow_inf_nan=False)
    ceiling: float | None = Field(default=None, allow_inf_nan=False)
    rate_per_min: float | None = Field(default=None, gt=0, allow_inf_nan=False)
    window_s: float = Field(default=30.0, gt=0)
    disagreement: float | None = Field(default=None, gt=0, allow_inf_nan=False)
    against: Literal["plate", "coolant", "ambient"] | None = None
    stale_s: float | None = Field(default=None, gt=0)
    for_s: float = Field(default=0.0, ge=0)

    @model_validator(mode="after")
    def _one_bound(self) -> Self:
        bounds = [name for name in _BOUNDS if getattr(self, name) is not None]
        allowed = _allowed_bounds(self.watch)
        foreign = [name for name in bounds if name not in allowed]
        if foreign:
            expected = f"one of {', '.join(allowed)}" if allowed else "no bound"
            raise ValueError(f"'{foreign[0]}' means nothing for '{self.watch}'; expected {expected}")
        if allowed and len(bounds) != 1:
            raise ValueError(f"'{self.watch}' takes exactly one of {', '.join(allowed)}; got {len(bounds)}")
        if self.against is not None and (self.disagreement is None or self.against == self.watch):
            raise ValueError("'against' names the other temperature of a 'disagreement'")
        if self.disagreement is not None and self.watch != "housings" and self.against is None:
            raise ValueError(f"'disagreement' of '{self.watch}' needs 'against'")
        return self

    @property
    def name(self) -> str:
        """Short text for messages and records, as `housings ceiling 95`."""
        bound = next((name for name in _BOUNDS if getattr(self, name) is not None), None)
        parts = [self.watch] if bound is None else [self.watch, bound, f"{getattr(self, bound):g}"]
        return " ".join(parts + ([f"against {self.against}"] if self.against else []))


_BOUNDS: Final = ("floor", "ceiling", "rate_per_min", "disagreement", "stale_s")


def _allowed_bounds(watch: str) -> tuple[str, ...]:
    if watch in TEMPERATURES:
        return _BOUNDS
    if watch == "level":
        return ("floor", "stale_s")
    return ("stale_s",) if watch == "duts" else ()


DEFAULT_CONDITIONS: Final = (
    Condition(watch="housings", ceiling=95.0),
    Condition(watch="housings", floor=-20.0, action=Action.SOAK_BACK, for_s=2.0),
    Condition(watch="housings", stale_s=20.0),
    Condition(watch="housings", rate_per_min=25.0, action=Action.HOLD),
    Condition(watch="housings", disagreement=20.0, action=Action.SAFE_STATE, for_s=20.0),
    Condition(watch="plate", ceiling=102.0, for_s=2.0),
    Condition(watch="coolant", ceiling=98.0),
    Condition(watch="coolant", floor=-32.0),
    Condition(watch="coolant", stale_s=20.0),
    Condition(watch="level", floor=5.0),
    Condition(watch="chiller_alarm"),
    Condition(watch="pump", for_s=5.0),
    Condition(watch="stage_fault", action=Action.HOLD),
    Condition(watch="relays"),
    Condition(watch="duts", stale_s=10.0, action=Action.HOLD),
)
"""What is watched where the bench file names no conditions: bounds of the emulated bench, wide enough that a
healthy cycle from −10 to 85 °C never meets them."""


class GuardSettings(FileModel):
    """How the guard watches.

    Attributes:
        process: whether the guard is a process of its own. By default it is, unless every device is emulated
            inside the test process: such hardware dies with the test.
        poll_s: time between two looks at the devices; what trips is seen at most this much later.
        heartbeat_timeout_s: longest time without any sign of the test's main loop. Its death and its being
            stopped are seen at once by other means; this is for a main loop that hangs.
        watch_stopped: whether a stopped test process (SIGSTOP, debugger) counts as dead. Off while debugging.
        attempt_s: patience with one device in one attempt at a safe action; the next device is not kept waiting.
        attempts: how often each safe action is tried before it is reported as not verified.
        line_quiet_s: after a question without an answer, how long the guard leaves that line to whoever asked.
        clear_s: how long every condition must hold again before a pause is over.
        hold_limit_s: a hold or soak back that lasts longer becomes a safe state.
        obey_s: how soon the test must heed a hold; else safe state.
        reply_timeout_s: wall time after which a guard that does not answer counts as dead; it is killed then, and
            the test makes the bench safe itself.
        lease_s: a guard's lease is over when it has not been renewed for so long.
        ack_after_lost_test: whether the loss of the test process alone asks for an acknowledgement, too, though
            every safe action was verified.
        conditions: what is watched.
    """

    process: bool | None = None
    poll_s: float = Field(default=0.5, gt=0, le=1.0)
    heartbeat_timeout_s: float = Field(default=10.0, gt=0)
    watch_stopped: bool = True
    attempt_s: float = Field(default=0.4, gt=0)
    attempts: int = Field(default=5, ge=1, le=100)
    line_quiet_s: float = Field(default=3.0, ge=0)
    clear_s: float = Field(default=30.0, ge=0)
    hold_limit_s: float = Field(default=1800.0, gt=0)
    obey_s: float = Field(default=60.0, gt=0)
    reply_timeout_s: float = Field(default=10.0, gt=0)
    lease_s: float = Field(default=10.0, gt=1)
    ack_after_lost_test: bool = False
    conditions: tuple[Condition, ...] = DEFAULT_CONDITIONS
