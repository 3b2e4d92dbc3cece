"""A measured number: value, unit, standard uncertainty, degrees of freedom and what the uncertainty is made of.

Terms are those of the GUM (JCGM 100:2008): type A from statistics, type B from certificates and specifications,
effective degrees of freedom after Welch and Satterthwaite, coverage factor from Student's t. Propagation is linear
and takes operands as uncorrelated. Units are checked by dimension: counts, pixels, angles and ratios are dimensions
of their own here, so that none of them passes for another.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Final, final

import pint
from scipy.special import stdtrit

from arl_fixtures.errors import UnitError

_DEFINITIONS: Final = """
micro- = 1e-6 = µ- = μ- = u-
milli- = 1e-3 = m-
centi- = 1e-2 = c-
kilo- = 1e3 = k-
mega- = 1e6 = M-
nano- = 1e-9 = n-
pico- = 1e-12 = p-
meter = [length] = m = metre
second = [time] = s
gram = [mass] = g
ampere = [current] = A
kelvin = [temperature]; offset: 0 = K
degree_Celsius = kelvin; offset: 273.15 = degC = °C
degree_Fahrenheit = 5 / 9 * kelvin; offset: 233.15 + 200 / 9 = degF = °F
radian = [angle] = rad
degree = 3.141592653589793 / 180 * radian = deg = °
counts = [detector_signal]
px = [sensor_pixel] = _ = pixel
percent = 0.01 = %
ppm = 1e-6
minute = 60 * second = min
hour = 60 * minute = h
hertz = 1 / second = Hz
newton = kilogram * meter / second ** 2 = N
joule = newton * meter = J
watt = joule / second = W
volt = watt / ampere = V
ohm = volt / ampere = Ω
"""

_KELVIN: Final = "K"


@functools.cache
def _registry() -> pint.UnitRegistry[float]:
    registry: pint.UnitRegistry[float] = pint.UnitRegistry(None)
    registry.load_definitions(_DEFINITIONS.strip().splitlines())
    return registry


@functools.cache
def _unit(text: str) -> pint.Unit:
    name = text.strip().replace("°C", "degC").replace("°F", "degF").replace("%", "percent")
    if name in {"", "1"}:
        return _registry().Unit("")
    try:
        return _registry().Unit(_registry().parse_units(name))
    # pint's parser raises whatever its tokeniser happens to raise on text that is no unit
    except (pint.errors.PintError, AssertionError, AttributeError, SyntaxError, TypeError, ValueError) as error:
        raise UnitError(f"unknown unit '{text}'") from error


def check_unit(text: str) -> str:
    """Return `text` if it is a unit this package knows.

    Raises:
        UnitError: it is not.
    """
    _unit(text)
    return text


@functools.cache
def _linear_map(source: str, target: str) -> tuple[float, float]:
    """Scale and offset with target value = scale · source value + offset."""
    try:
        zero, one = (_registry().Quantity(x, _unit(source)).to(_unit(target)).magnitude for x in (0.0, 1.0))
    except pint.DimensionalityError:
        raise UnitError(f"a value in '{source}' cannot be given in '{target}': another dimension") from None
    return float(one - zero), float(zero)


def _has_offset(unit: str) -> bool:
    return not _unit(unit).dimensionless and _registry().Quantity(0.0, _unit(unit)).to_base_units().magnitude != 0.0


def convert(value: float, source: str, target: str) -> float:
    """Convert a number between units of one dimension.

    Raises:
        UnitError: a unit is unknown or of another dimension.
    """
    if source == target:
        return value
    scale, offset = _linear_map(source, target)
    return scale * value + offset


class Kind(StrEnum):
    """How a contribution was evaluated (GUM 2.3.2, 2.3.3)."""

    A = "A"
    B = "B"


@dataclass(frozen=True, slots=True)
class Contribution:
    """One named source of standard uncertainty, in the unit of its quantity.

    Attributes:
        name: the source, e.g. ``repeatability``, ``target position``.
        u: standard uncertainty that it contributes to the result.
        kind: type A or B.
        dof: degrees of freedom; infinity for a type B value taken as known.
    """

    name: str
    u: float
    kind: Kind = Kind.A
    dof: float = math.inf

    def __post_init__(self) -> None:
        if not (self.u >= 0.0 and self.dof > 0.0):
            msg = f"contribution '{self.name}': standard uncertainty {self.u} must be >= 0, dof {self.dof} > 0"
            raise ValueError(msg)


def effective_dof(contributions: Iterable[Contribution]) -> float:
    """Effective degrees of freedom of a sum (Welch–Satterthwaite, GUM G.2b)."""
    parts = [(part.u, part.dof) for part in contributions if part.u > 0.0]
    largest = max((u for u, _ in parts), default=0.0)
    if largest == 0.0:
        return math.inf
    # relative to the largest part: fourth powers of small numbers leave the range of a float
    denominator = sum((u / largest) ** 4 / dof for u, dof in parts)
    total = sum((u / largest) ** 2 for u, _ in parts)
    return total**2 / denominator if denominator > 0.0 else math.inf


@functools.lru_cache(maxsize=4096)
def coverage_factor(dof: float, coverage: float = 0.95) -> float:
    """Factor k of a two-sided interval with `coverage`, from Student's t with `dof` degrees of freedom."""
    # beyond this t and the normal distribution agree to 1e-9 and stdtrit loses digits
    return float(stdtrit(min(dof, 1e9), 0.5 * (1.0 + coverage)))


@final
@dataclass(frozen=True, slots=True, repr=False)
class Quantity:
    """A value with unit and standard uncertainty.

    Attributes:
        value: best estimate, in `unit`.
        unit: unit as written by whoever measured it; known to `check_unit`.
        u: combined standard uncertainty, in `unit` (in kelvin-sized steps where the unit is a temperature scale).
        dof: effective degrees of freedom of `u`.
        contributions: what `u` is made of; their root sum of squares is `u`.

    Raises:
        UnitError: the unit is not known.
        ValueError: `u` is negative or NaN, or `dof` is not positive.
    """

    value: float
    unit: str
    u: float = 0.0
    dof: float = math.inf
    contributions: tuple[Contribution, ...] = ()

    def __post_init__(self) -> None:
        check_unit(self.unit)
        if not (self.u >= 0.0 and self.dof > 0.0):
            msg = f"standard uncertainty {self.u} must be >= 0 and degrees of freedom {self.dof} > 0"
            raise ValueError(msg)

    @classmethod
    def of(cls, value: float, unit: str, *contributions: Contribution) -> Quantity:
        """Combine contributions: root sum of squares, dof after Welch–Satterthwaite."""
        return cls(
            value=float(value),
            unit=unit,
            u=math.hypot(*(part.u for part in contributions)),
            dof=effective_dof(contributions),
            contributions=contributions,
        )

    def to(self, unit: str) -> Quantity:
        """Give the same quantity in another unit.

        Raises:
            UnitError: `unit` is unknown or of another dimension.
        """
        if unit == self.unit:
            return self
        scale, offset = _linear_map(self.unit, unit)
        return Quantity(
            value=scale * self.value + offset,
            unit=unit,
            u=abs(scale) * self.u,
            dof=self.dof,
            contributions=tuple(replace(part, u=abs(scale) * part.u) for part in self.contributions),
        )

    def expanded(self, coverage: float = 0.95) -> float:
        """Expanded uncertainty U = k·u of a two-sided interval with `coverage`, in `unit`."""
        return coverage_factor(self.dof, coverage) * self.u

    def interval(self, coverage: float = 0.95) -> tuple[float, float]:
        """Two-sided interval with `coverage`, in `unit`."""
        half = self.expanded(coverage)
        return self.value - half, self.value + half

    def __neg__(self) -> Quantity:
        """The negative value; refused on a temperature scale, whose zero is a convention."""
        return self * -1.0

    def __add__(self, other: Quantity) -> Quantity:
        """Sum of uncorrelated quantities, in the unit of the left one."""
        if _has_offset(self.unit):
            raise UnitError(f"values in '{self.unit}' cannot be added: its zero is a convention; use K")
        right = other.to(self.unit)
        return Quantity.of(self.value + right.value, self.unit, *_joined(self, right, 1.0, 1.0))

    def __sub__(self, other: Quantity) -> Quantity:
        """Difference of uncorrelated quantities, in the unit of the left one; in K between temperatures."""
        if _has_offset(self.unit):
            return self.to(_KELVIN) - other.to(_KELVIN)
        right = other.to(self.unit)
        return Quantity.of(self.value - right.value, self.unit, *_joined(self, right, 1.0, 1.0))

    def __mul__(self, factor: float) -> Quantity:
        """A multiple by an exact number."""
        if _has_offset(self.unit):
            raise UnitError(f"a value in '{self.unit}' has no multiples: its zero is a convention; use K")
        parts = tuple(replace(part, u=abs(factor) * part.u) for part in self.contributions)
        return replace(self, value=factor * self.value, u=abs(factor) * self.u, contributions=parts)

    __rmul__ = __mul__

    def relative_to(self, other: Quantity) -> Quantity:
        """Relative deviation self/other − 1 of uncorrelated quantities, dimensionless.

        Raises:
            UnitError: the units differ in dimension or have no absolute zero.
            ZeroDivisionError: `other` is zero.
        """
        if _has_offset(self.unit):
            raise UnitError(f"a ratio of values in '{self.unit}' means nothing; use K")
        base = other.to(self.unit)
        ratio = self.value / base.value
        return Quantity.of(ratio - 1.0, "1", *_joined(self, base, 1.0 / base.value, ratio / base.value))

    def __str__(self) -> str:
        """Value and standard uncertainty, the latter rounded to two digits."""
        unit = "" if self.unit in {"1", ""} else f" {self.unit}"
        if not math.isfinite(self.value) or self.u == 0.0 or not math.isfinite(self.u):
            return f"{self.value:.6g}{unit}" if self.u == 0.0 else f"{self.value:.6g} ± {self.u:.2g}{unit}"
        digits = 1 - math.floor(math.log10(self.u))
        if digits < 0 or digits > 6:
            return f"({self.value:.6g} ± {self.u:.2g}){unit}"
        return f"({self.value:.{digits}f} ± {self.u:.{digits}f}){unit}"

    def __repr__(self) -> str:
        parts = ", ".join(f"{part.name} {part.kind} {part.u:.2g}" for part in self.contributions)
        dof = "inf" if math.isinf(self.dof) else f"{self.dof:.3g}"
        return f"Quantity({self}, dof {dof}{f': {parts}' if parts else ''})"


def _joined(left: Quantity, right: Quantity, by_left: float, by_right: float) -> tuple[Contribution, ...]:
    """Contributions of both operands times their sensitivities; an operand without names counts as one."""
    parts: dict[tuple[str, Kind], list[Contribution]] = {}
    for operand, sensitivity in ((left, by_left), (right, by_right)):
        own = operand.contributions or (
            (Contribution("unnamed", operand.u, Kind.B, operand.dof),) if operand.u > 0.0 else ()
        )
        for part in own:
            scaled = replace(part, u=abs(sensitivity) * part.u)
            parts.setdefault((part.name, part.kind), []).append(scaled)
    return tuple(
        Contribution(name, math.hypot(*(part.u for part in group)), kind, effective_dof(group))
        for (name, kind), group in parts.items()
    )
