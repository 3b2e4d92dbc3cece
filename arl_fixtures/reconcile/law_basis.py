"""What may enter an empirical law: functions of columns with a prior on their coefficients.

Three families, in the order of their price. One function with one coefficient (a line, a step, a wave); a curve or a
table over one column, whose values are drawn from one smooth or one exchangeable normal law; and both of them times a
line in a second column, or a smooth map over two. The prior's width is fitted, so that a curve bends only as far as
the data ask, and what a curve gains is comparable with what a line gains.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from arl_fixtures.reconcile.columns import FloatArray
from arl_fixtures.reconcile.law import OF_LABELS, Axis, Features, Rings
from arl_fixtures.reconcile.roles import BEARING_SIGNS, PER_TURN, PIXEL_COLUMNS, counts_visits, played, unit_of

KNOTS, MAP_KNOTS = 12, 6
FEWEST_TURNS = 2.0
"""Turns from which a form that recurs is one: of what is seen once or little more, the rest is a guess."""
FINE_KNOTS = 24
"""Knots of the curve of the shortest length."""
SMOOTH, FINE = (0.4, 0.12), 0.05
"""Lengths over which a curve keeps its value, as shares of the column's range."""
MAP_SMOOTH = 0.4
_BESIDE = 0.25
"""Width of a label's own bin on either side of its number."""
DECADES = 30.0
"""Ratio of a column's ends from which its values may lie by ratios."""
PERIODS = (2, 3, 4, 6, 8, 16)
MOST_LEVELS = 40
PRICE_ONE, PRICE_TWO, PRICE_CURVE, PRICE_PRODUCT = 6.0, 9.0, 7.0, 3.0
"""Log-likelihood that a term must earn for having been chosen: one function, a wave, a curve, each factor more."""
PRICE_MARK, PRICE_ZERO = 2.0, 2.0
"""Further price of a term that holds in one category only, and of saying where one of its factors is zero."""
UNLIKELY = {"time_s": 4.0, "step": 4.0, "set_temperature_c": 1.0, "~within(time_s)": 1.5}
WAVING = frozenset({
    "m", "mm", "cm", "km", "um", "nm", "deg", "rad", "s", "ms", "us", "ns", "ps", "min", "h", "°C", "K", "A", "mA",
})  # fmt: skip
"""Units of a path, an angle, a time or what tunes a laser: the phase of a wave follows these."""
FAR_FETCHED, FROM_WHERE, OPERATING = 4.0, 1.0, 1.5
"""Further price of columns that tell of unseen conditions less than a physical one that fits as well: what lies next
to a row, from which side its temperature came, and how it was operated."""


@dataclass(frozen=True, slots=True)
class Known:
    """Functions on rows by axis: of axes with one each, and of open ones, which soon fill the room."""

    single: dict[Axis, FloatArray] = field(default_factory=dict)
    open: dict[Axis, FloatArray] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class Basis:
    """A candidate term of a law.

    Attributes:
        axes: factors; those that stand for several functions (`curve`, `table`) have no values yet.
        prior: covariance of the coefficients up to its width, None for one free coefficient each.
        price: what it must earn.
        waves: products of axes with one free coefficient each, instead of `axes`.
    """

    axes: tuple[Axis, ...] = ()
    prior: FloatArray | None = None
    price: float = PRICE_ONE
    waves: tuple[tuple[Axis, ...], ...] = ()

    @property
    def columns(self) -> tuple[str, ...]:
        """Columns on which it depends."""
        axes = (a for product in (self.axes, *self.waves) for a in product)
        return tuple(dict.fromkeys(name for a in axes for name in a.columns))

    def with_axis(self, number: int, axis: Axis) -> Basis:
        """The same with another function in the place of one of its axes."""
        return replace(self, axes=(*self.axes[:number], axis, *self.axes[number + 1 :]))

    @property
    def count(self) -> int:
        """Number of its functions."""
        return len(self.waves) or math.prod(axis.count for axis in self.axes if axis.is_open)

    def vectors(self, features: Features, known: Known | None = None) -> FloatArray:
        """The functions on rows, shape (k, n); `known` keeps those of axes, which come back in products."""
        known = Known() if known is None else known
        if self.waves:
            return np.stack([_product(product, features, known) for product in self.waves])
        total: FloatArray | None = None
        for axis in self.axes:
            here = _on_rows(axis, features, known)
            total = here if total is None else (total[:, None, :] * here[None, :, :]).reshape(-1, here.shape[1])
        assert total is not None
        return total

    def closed(self, values: FloatArray) -> list[tuple[tuple[Axis, ...], float]]:
        """Products of axes and their coefficients that say what the fitted coefficients say."""
        if self.waves:
            return [(product, float(v)) for product, v in zip(self.waves, values, strict=True)]
        places = [k for k, axis in enumerate(self.axes) if axis.is_open]
        if not places:
            return [(self.axes, float(values[0]))]
        if len(places) == 1:
            axes = list(self.axes)
            axes[places[0]] = replace(axes[places[0]], values=_for_any_label(axes[places[0]], values))
            return [(tuple(axes), 1.0)]
        first, second = (self.axes[k] for k in places)
        left, size, right = np.linalg.svd(values.reshape(first.count, second.count))
        rest = tuple(a for k, a in enumerate(self.axes) if k not in places)
        kept = [k for k in range(len(size)) if size[k] > 0.05 * size[0]]
        return [
            (
                (
                    replace(first, values=_for_any_label(first, left[:, k] * size[k])),
                    replace(second, values=_for_any_label(second, right[k])),
                    *rest,
                ),
                1.0,
            )
            for k in kept
        ]


def _on_rows(axis: Axis, features: Features, known: Known) -> FloatArray:
    """The function or functions of an axis on rows, (k, n)."""
    kept = known.open if axis.is_open else known.single
    found = kept.get(axis)
    if found is None:
        found = members(axis, features[axis.column]) if axis.is_open else axis(features)[None, :]
        kept[axis] = found
    return found


def _product(axes: tuple[Axis, ...], features: Features, known: Known) -> FloatArray:
    total: FloatArray = _on_rows(axes[0], features, known)[0]
    for axis in axes[1:]:
        total = total * _on_rows(axis, features, known)[0]
    return total


def members(axis: Axis, x: FloatArray) -> FloatArray:
    """The functions that an open axis stands for, shape (count, n): hats of a curve, bins of a table."""
    found = np.zeros((axis.count, len(x)))
    good = np.isfinite(x)
    if axis.kind == "table":
        code = axis.bin_of(x)
        found[code[good], np.flatnonzero(good)] = 1.0
        return found
    knots = np.asarray(axis.edges)
    place = np.clip(x[good], knots[0], knots[-1])
    left = np.clip(np.searchsorted(knots, place, side="right") - 1, 0, len(knots) - 2)
    share = (place - knots[left]) / (knots[left + 1] - knots[left])
    rows = np.flatnonzero(good)
    found[left, rows] = 1.0 - share
    found[left + 1, rows] = share
    return found


def curve_axis(name: str, values: FloatArray, knots: int) -> Axis | None:
    """An open curve over a column, None where it has too few values."""
    finite = values[np.isfinite(values)]
    levels = np.unique(finite)
    if len(levels) < 4:
        return None
    if len(levels) <= knots:
        places = levels
    else:
        even = np.linspace(0.0, 1.0, knots)
        by_rank = np.quantile(finite, even)
        low, high = by_rank[0], by_rank[-1]
        places = low * (high / low) ** even if is_geometric(by_rank) else low + (high - low) * even
        places = np.unique(0.5 * (by_rank + places))
    if len(places) < 4 or not np.all(np.diff(places) > 0):
        return None
    return Axis(
        column=name, kind="curve", middle=float(places.mean()), width=float(np.ptp(places)),
        edges=tuple(float(x) for x in places),
    )  # fmt: skip


def is_geometric(places: FloatArray) -> bool:
    """Whether ordered places lie by ratios, over decades: exposures, attenuations, currents."""
    low, high, middle = float(places[0]), float(places[-1]), float(np.median(places))
    if low <= 0.0 or high < DECADES * low:
        return False
    return abs(middle - math.sqrt(low * high)) < abs(middle - 0.5 * (low + high))


def smooth_prior(axis: Axis, length: float) -> FloatArray:
    """Covariance of a curve's knots: a Gaussian kernel over a share of the range."""
    edges = np.asarray(axis.edges)
    place = np.log(edges) if is_geometric(edges) else edges
    place = (place - place[0]) / (place[-1] - place[0])
    gap = place[:, None] - place[None, :]
    return np.asarray(np.exp(-0.5 * (gap / length) ** 2) + 1e-4 * np.eye(len(place)))


def curves_of(axis: Axis, price: float) -> Iterator[Basis]:
    """Curves of two smoothnesses."""
    for length in SMOOTH if len(axis.edges) > 5 else SMOOTH[:1]:
        yield Basis(axes=(axis,), prior=smooth_prior(axis, length), price=price)


def tables_of(name: str, values: FloatArray, *, category: bool) -> Iterator[Axis]:
    """Open tables over a column with levels of its own, or over its remainders."""
    finite = values[np.isfinite(values)]
    levels = np.unique(finite)
    whole = bool(np.all(levels == np.round(levels)))
    few = category or (whole and len(levels) <= MOST_LEVELS) or len(levels) <= 8
    if category:
        if len(levels) >= 2:
            yield Axis(column=name, kind="table", label=OF_LABELS, edges=tuple(_apart(levels)))
        return
    if few and len(levels) >= 3:
        yield Axis(column=name, kind="table", edges=tuple(float(x) for x in (levels[1:] + levels[:-1]) / 2.0))
    if name in {"pixel_u", "pixel_v"}:
        for period in PERIODS:
            if len(levels) > period:
                yield Axis(
                    column=name, kind="table", at=float(period), edges=tuple(k + 0.5 for k in range(period - 1))
                )


def _apart(levels: FloatArray) -> Iterator[float]:
    """Edges of a bin for each label's number alone: numbers between them are of labels that were not seen."""
    for level in levels:
        yield from (float(level) - _BESIDE, float(level) + _BESIDE)


def _for_any_label(axis: Axis, values: FloatArray) -> tuple[float, ...]:
    """Values of a table's bins; over labels, those not seen have what the seen ones have in common, if anything."""
    if axis.label == OF_LABELS:
        seen = values[1::2]
        mean, error = float(np.mean(seen)), float(np.std(seen)) / np.sqrt(max(len(seen) - 1, 1))
        values = values.copy()
        values[0::2] = mean * mean**2 / max(mean**2 + error**2, 1e-300)
    return tuple(float(v) for v in values)


def map_of(first: Axis, second: Axis, price: float) -> Basis:
    """A smooth map over two columns."""
    prior: FloatArray = np.kron(smooth_prior(first, MAP_SMOOTH), smooth_prior(second, MAP_SMOOTH)).astype(np.float64)
    return Basis(axes=(first, second), prior=prior, price=price)


def waves_of(first: str, turns: float, second: str = "", more: float = 0.0) -> tuple[tuple[Axis, ...], ...]:
    """Sine and cosine of 2π(first·turns + second·more) as products of axes."""

    def wave(kind: str, name: str, frequency: float) -> Axis:
        return Axis(column=name, kind=kind, at=1.0 / frequency)

    if not second or more == 0.0:
        return ((wave("sin", first, turns),), (wave("cos", first, turns),))
    if turns == 0.0:
        return ((wave("sin", second, more),), (wave("cos", second, more),))
    return tuple(
        (wave(a, first, turns), wave(b, second, more))
        for a, b in (("sin", "cos"), ("cos", "sin"), ("cos", "cos"), ("sin", "sin"))
    )


def folded(name: str, turns: float) -> Axis:
    """A table over the eighths of a wave's turn."""
    return Axis(column=name, kind="table", at=1.0 / turns, edges=tuple(np.arange(1, 8) / 8.0 / turns))


def rings_of(name: str, turns: float, rings: Rings) -> tuple[tuple[Axis, ...], ...]:
    """Sine and cosine of 2π·turns·phase over a column in degrees."""
    return tuple((Axis(column=name, kind=kind, at=rings.end(turns)),) for kind in (rings.sine, rings.cosine))


def moving_rings_of(
    name: str, turns: float, second: str, more: float, rings: Rings
) -> tuple[tuple[Axis, ...], ...]:  # fmt: skip
    """Products of rings over a column in degrees and of waves over a second column, turns per unit of each."""
    return tuple((*ring, *wave) for ring in rings_of(name, turns, rings) for wave in waves_of(second, more))


def is_proxy(column: str) -> bool:
    """Whether a column goes along with what drives an effect rather than drives it: an order, or the simulation."""
    acts = column in BEARING_SIGNS or bool(played(column)) or column.startswith(PER_TURN)
    return column in UNLIKELY or (column.startswith(("~", "sim_")) and not acts)


def is_order(column: str) -> bool:
    """Whether a column tells when something was measured: whatever was changed meanwhile goes along with it."""
    return (column in UNLIKELY and unit_of(column) != "°C") or counts_visits(column)


def moves_waves(column: str) -> bool:
    """Whether fringes may lie along a column, or move with it: a place, an angle, a time, heat, a current."""
    place = column in PIXEL_COLUMNS or column.startswith("~bearing")
    return place or unit_of(column) in WAVING or column == "~within(time_s)"


def price_of(columns: tuple[str, ...]) -> float:
    """Further price for columns that hardly generalise, or that follow what drives an effect rather than drive it."""
    return sum(_price_of(c) for c in set(columns))


def _price_of(column: str) -> float:
    if column in UNLIKELY:
        return UNLIKELY[column]
    if counts_visits(column):
        return UNLIKELY["step"]
    if column in BEARING_SIGNS or column.startswith(PER_TURN):
        return 0.0
    if played(column):
        return FROM_WHERE
    if column.startswith("~"):
        return FAR_FETCHED
    return OPERATING if unit_of(column) in {"V", "A", "us"} and not column.startswith("sim_") else 0.0
