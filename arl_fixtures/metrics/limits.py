"""Limits file: per metric the unit, the bounds, where they apply, and by which rule they are decided."""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from enum import StrEnum
from functools import cached_property
from pathlib import Path
from typing import Annotated, Final, Self

from pydantic import AfterValidator, Field, field_validator, model_validator

from arl_fixtures.errors import ConfigError, UnitError
from arl_fixtures.quantity import check_unit, convert
from arl_fixtures.yaml_model import FileModel, fault_at, load_model, named_file


class Rule(StrEnum):
    """Decision rule.

    SIMPLE: within the limits is PASS, outside is FAIL; at the limit the risk of false acceptance is 50 % (ILAC-G8).
    GUARD_BAND: PASS within the limits shrunk by the guard band w, FAIL outside the limits widened by w, CONDITIONAL
    between (ISO 14253-1, JCGM 106:2012 8.3; ILAC-G8 non-binary statement).
    """

    SIMPLE = "simple"
    GUARD_BAND = "guard_band"


class Severity(StrEnum):
    """What exceeding a limit means: a minor one makes the verdict CONDITIONAL, the others FAIL."""

    CRITICAL = "critical"
    MAJOR = "major"
    MINOR = "minor"


def _known_unit(text: str) -> str:
    try:
        return check_unit(text)
    except UnitError as error:
        raise ValueError(str(error)) from None


UnitText = Annotated[str, AfterValidator(_known_unit)]


class Decision(FileModel):
    """How values are compared with limits.

    The guard band is `guard_factor` · U, U the expanded uncertainty with two-sided `coverage`; the default
    w = U(95 %) keeps the risk of false acceptance below 2.5 %.
    """

    rule: Rule = Rule.GUARD_BAND
    coverage: float = Field(default=0.95, gt=0.5, lt=1.0)
    guard_factor: float = Field(default=1.0, ge=0.0, le=5.0)


class Where(FileModel):
    """Conditions under which a limit applies; what is not named does not matter."""

    set_temperature_c: tuple[float, float] | None = None
    ramp: tuple[int, ...] | None = None
    scope: tuple[str, ...] | None = None
    dut: tuple[str, ...] | None = None
    dut_type: tuple[str, ...] | None = None

    @model_validator(mode="after")
    def _range_in_order(self) -> Self:
        if self.set_temperature_c and self.set_temperature_c[0] > self.set_temperature_c[1]:
            low_c, high_c = self.set_temperature_c
            msg = f"set_temperature_c from {low_c:g} to {high_c:g} is empty; expected [lowest, highest]"
            raise ValueError(msg)
        return self


class Limit(FileModel):
    """Bounds of one metric in `unit`."""

    metric: str = Field(min_length=1)
    unit: UnitText
    lower: float | None = Field(default=None, allow_inf_nan=False)
    upper: float | None = Field(default=None, allow_inf_nan=False)
    where: Where = Where()
    severity: Severity = Severity.MAJOR
    reason: str = Field(min_length=1)
    decision: Decision | None = None
    """Overrides the file's decision rule for this limit."""

    @model_validator(mode="after")
    def _bounds_in_order(self) -> Self:
        if self.lower is None and self.upper is None:
            msg = f"limit of '{self.metric}' has neither lower nor upper"
            raise ValueError(msg)
        if self.lower is not None and self.upper is not None and self.lower > self.upper:
            msg = f"limit of '{self.metric}': lower {self.lower:g} is above upper {self.upper:g}"
            raise ValueError(msg)
        return self

    def __str__(self) -> str:
        unit = "" if self.unit in {"", "1"} else f" {self.unit}"
        if self.lower is None:
            return f"≤ {self.upper:g}{unit}"
        if self.upper is None:
            return f"≥ {self.lower:g}{unit}"
        return f"{self.lower:g} … {self.upper:g}{unit}"


class LimitSet(FileModel):
    """A limits file."""

    name: str = Field(min_length=1)
    version: int = Field(ge=1)
    decision: Decision = Decision()
    limits: tuple[Limit, ...]

    @field_validator("limits")
    @classmethod
    def _not_empty(cls, limits: tuple[Limit, ...]) -> tuple[Limit, ...]:
        # pydantic's own min_length also counts a limit as missing that was refused
        if not limits:
            msg = "no limit given; expected at least one"
            raise ValueError(msg)
        return limits

    @cached_property
    def by_metric(self) -> dict[str, tuple[Limit, ...]]:
        """Limits grouped by metric, in the order of the file."""
        return {
            metric: tuple(limit for limit in self.limits if limit.metric == metric)
            for metric in dict.fromkeys(limit.metric for limit in self.limits)
        }

    def decision_of(self, limit: Limit) -> Decision:
        """The rule that decides `limit`."""
        return limit.decision or self.decision


BUILT_IN: Final = Path(__file__).parent.parent / "data" / "limits"


def limits_path(name_or_path: str) -> Path:
    """The file that a limits name stands for: itself, or one of those that come with the package.

    Raises:
        ConfigError: no such limits.
    """
    return named_file(name_or_path, BUILT_IN, "limits")


def load_limits(path: Path) -> LimitSet:
    """Read a limits file.

    Raises:
        ConfigError: every fault of the file, one a line, each with file, line and column.
    """
    return load_model(path, LimitSet)


def check_metrics(
    limits: LimitSet, known: frozenset[str], units: Mapping[str, str], path: Path | None = None
) -> None:
    """Refuse limits that could never be judged: of metrics that nothing measures, or in a foreign dimension.

    Args:
        limits: the limits file.
        known: names of all metrics.
        units: unit in which a metric is always measured, where there is one.
        path: of the file, for line and column in the message.

    Raises:
        ConfigError: names the first such limit and what was expected.
    """
    for number, limit in enumerate(limits.limits):
        if limit.metric not in known:
            near = difflib.get_close_matches(limit.metric, known, n=1)
            hint = f"did you mean '{near[0]}'? There" if near else "there"
            message = f"no metric '{limit.metric}'; {hint} are {', '.join(sorted(known))}"
            raise _fault(path, [number, "metric"], message)
        try:
            convert(1.0, units.get(limit.metric, limit.unit), limit.unit)
        except UnitError as error:
            raise _fault(path, [number, "unit"], f"limit of '{limit.metric}': {error}") from None


def _fault(path: Path | None, place: list[str | int], message: str) -> ConfigError:
    return ConfigError(message) if path is None else fault_at(path, ["limits", *place], message)
