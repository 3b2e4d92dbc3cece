"""Is the bench within its bounds? Samples in, violations out, no device and no clock."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from statistics import median
from typing import Final, final

from arl_fixtures.bench.guard_settings import TEMPERATURES, Condition
from arl_fixtures.devices.interfaces import ChillerStatus

_LEAST_POINTS: Final = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class Sample:
    """What one look at the bench gave; None where a device was not asked or did not answer.

    Attributes:
        time_s: bench time.
        temperatures_c: sensor name (`ambient`, `plate`, `coolant`, `T2` …) to °C.
        housings: which of them are housings.
        chiller: its status.
        stage_fault: the stage's own words; empty when it is well.
        commanded: load to what the test switched last; loads that nobody commanded are missing.
        read_back: load to what the board holds.
        duts_awaited_s: serial number to seconds without a frame, of those that should be sending.
    """

    time_s: float
    temperatures_c: Mapping[str, float | None] = field(default_factory=dict)
    housings: Sequence[str] = ()
    chiller: ChillerStatus | None = None
    stage_fault: str | None = None
    commanded: Mapping[str, bool] = field(default_factory=dict)
    read_back: Mapping[str, bool] | None = None
    duts_awaited_s: Mapping[str, float] = field(default_factory=dict)

    def watched(self, name: str) -> dict[str, float | None]:
        """Temperatures by which a condition on `name` is judged."""
        names = self.housings if name == "housings" else (name,)
        return {sensor: self.temperatures_c.get(sensor) for sensor in names}


@dataclass(frozen=True, slots=True)
class Violation:
    """A condition that does not hold.

    `since_s` is the bench time of the first sample of it, `detail` says which sensor and how far.
    """

    condition: Condition
    since_s: float
    detail: str

    def __str__(self) -> str:
        return f"{self.condition.name}: {self.detail}"


@final
class ConditionWatch:
    """One condition over time.

    Args:
        condition: what must hold.
    """

    def __init__(self, condition: Condition) -> None:
        self.condition = condition
        self._judge = _judge_of(condition)
        self._since_s: float | None = None
        self._detail = ""

    def see(self, sample: Sample) -> Violation | None:
        """Judge one sample; a sample that says nothing about the condition leaves it as it is."""
        detail = self._judge(sample)
        if detail == "":
            self._since_s = None
        elif detail is not None:
            self._detail = detail
            if self._since_s is None:
                self._since_s = sample.time_s
        if self._since_s is None or sample.time_s - self._since_s < self.condition.for_s:
            return None
        return Violation(self.condition, self._since_s, self._detail)


Judge = Callable[[Sample], str | None]
"""What is wrong, in words; empty when nothing is; None when the sample cannot tell."""


def _judge_of(condition: Condition) -> Judge:
    if condition.stale_s is not None:
        return _Staleness(condition) if condition.watch != "duts" else _duts_judge(condition.stale_s)
    if condition.rate_per_min is not None:
        return _Rate(condition)
    if condition.disagreement is not None:
        return _disagreement_judge(condition, condition.disagreement)
    if condition.watch in TEMPERATURES:
        return _bound_judge(condition)
    return {
        "level": _level_judge(condition),
        "chiller_alarm": _alarm,
        "chiller_warning": _warning,
        "pump": _pump,
        "stage_fault": lambda sample: sample.stage_fault,
        "relays": _relays,
    }[condition.watch]


def _bound_judge(condition: Condition) -> Judge:
    floor, ceiling = condition.floor, condition.ceiling

    def judge(sample: Sample) -> str | None:
        known = {name: value for name, value in sample.watched(condition.watch).items() if value is not None}
        for name, value in known.items():
            if ceiling is not None and value > ceiling:
                return f"{name} reads {value:.1f} °C, above {ceiling:g} °C"
            if floor is not None and value < floor:
                return f"{name} reads {value:.1f} °C, below {floor:g} °C"
        return "" if known else None

    return judge


def _level_judge(condition: Condition) -> Judge:
    def judge(sample: Sample) -> str | None:
        level = None if sample.chiller is None else sample.chiller.level_percent
        if level is None:
            return None
        low = condition.floor is not None and level < condition.floor
        return f"coolant level is {level:.1f} %, below {condition.floor:g} %" if low else ""

    return judge


def _disagreement_judge(condition: Condition, limit_k: float) -> Judge:
    def judge(sample: Sample) -> str | None:
        values = {name: value for name, value in sample.watched(condition.watch).items() if value is not None}
        if condition.against is not None:
            reference, named = sample.temperatures_c.get(condition.against), str(condition.against)
        else:
            reference, named = median(values.values()) if len(values) > 1 else None, "the median housing"
        if reference is None or not values:
            return None
        name, value = max(values.items(), key=lambda item: abs(item[1] - reference))
        distance_k = value - reference
        if abs(distance_k) <= limit_k:
            return ""
        return f"{name} reads {value:.1f} °C, {distance_k:+.1f} K from {named} (limit {limit_k:g} K)"

    return judge


def _duts_judge(limit_s: float) -> Judge:
    def judge(sample: Sample) -> str:
        silent = [f"{serial} for {age_s:.1f} s" for serial, age_s in sample.duts_awaited_s.items() if age_s > limit_s]
        return f"no frame of {', '.join(silent)}" if silent else ""

    return judge


def _alarm(sample: Sample) -> str | None:
    if sample.chiller is None:
        return None
    return f"chiller reports error {sample.chiller.error_code}" if sample.chiller.error_code else ""


def _warning(sample: Sample) -> str | None:
    if sample.chiller is None:
        return None
    return f"chiller reports warning {sample.chiller.warning_code}" if sample.chiller.warning_code else ""


def _pump(sample: Sample) -> str | None:
    if sample.chiller is None:
        return None
    stands = sample.chiller.circulating and not sample.chiller.pumping
    return "the pump stands though circulation is on" if stands else ""


def _relays(sample: Sample) -> str | None:
    if sample.read_back is None:
        return None
    different = [
        f"{load} is {'on' if sample.read_back[load] else 'off'}"
        for load, on in sample.commanded.items()
        if sample.read_back.get(load, on) != on
    ]
    return f"{', '.join(different)}, against what was commanded" if different else ""


@final
class _Staleness:
    """Since when each sensor has had no value; counting starts with the first sample that should have one."""

    def __init__(self, condition: Condition) -> None:
        self._watch, self._limit_s = condition.watch, condition.stale_s or 0.0
        self._good_s: dict[str, float] = {}

    def __call__(self, sample: Sample) -> str:
        oldest, oldest_s = "", self._limit_s
        for name, value in self._values(sample):
            good_s = self._good_s.setdefault(name, sample.time_s)
            if value is not None:
                self._good_s[name] = sample.time_s
            elif sample.time_s - good_s > oldest_s:
                oldest, oldest_s = name, sample.time_s - good_s
        return f"no value of {oldest} for {oldest_s:.1f} s" if oldest else ""

    def _values(self, sample: Sample) -> Iterator[tuple[str, float | None]]:
        if self._watch == "level":
            yield "level", None if sample.chiller is None else sample.chiller.level_percent
        else:
            yield from sample.watched(self._watch).items()


@final
class _Rate:
    """Slope of the straight line through the last seconds, by least squares."""

    def __init__(self, condition: Condition) -> None:
        self._watch, self._window_s = condition.watch, condition.window_s
        self._limit = condition.rate_per_min or 0.0
        self._history: dict[str, deque[tuple[float, float]]] = {}

    def __call__(self, sample: Sample) -> str | None:
        judged = False
        for name, value in sample.watched(self._watch).items():
            if value is None:
                continue
            points = self._history.setdefault(name, deque())
            points.append((sample.time_s, value))
            while points[0][0] < sample.time_s - self._window_s:
                points.popleft()
            rate = _slope_per_min(points, self._window_s)
            if rate is None:
                continue
            judged = True
            if abs(rate) > self._limit:
                return f"{name} changes by {rate:+.1f} K/min (limit {self._limit:g} K/min)"
        return "" if judged else None


def _slope_per_min(points: deque[tuple[float, float]], window_s: float) -> float | None:
    """None while less than half the window is covered: two neighbours are noise, not a trend."""
    if len(points) < _LEAST_POINTS or points[-1][0] - points[0][0] < 0.5 * window_s:
        return None
    mean_t = sum(t for t, _ in points) / len(points)
    mean_y = sum(y for _, y in points) / len(points)
    spread = sum((t - mean_t) ** 2 for t, _ in points)
    return 60.0 * sum((t - mean_t) * (y - mean_y) for t, y in points) / spread
