"""An empirical law for a mismatch that no effect explains: few products of simple functions of the located columns.

A channel's correction is Σ coefficient · f(column) · g(column), times the simulated value where the channel is
calibrated by a gain. Each axis function is dimensionless: its argument is a ratio (column over its own range), so
the coefficients carry the channel's unit, or none. What the law cannot say but the columns can predict may be kept as
boosted trees beside it. How a law is found stands in `law_search`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from arl_fixtures.reconcile.boosting import Boosted, Tree
from arl_fixtures.reconcile.columns import FloatArray, IntArray
from arl_fixtures.reconcile.converter_bits import is_set
from arl_fixtures.reconcile.features import category_id
from arl_fixtures.reconcile.roles import PER_TURN, unit_of

Features = dict[str, FloatArray]
LEAST_RATIO = 1e-3
"""Least value of a column, as a share of its middle, of which `log` and `inverse` are taken."""
LEAST_SIDE = 0.05
"""Share of a column's range that must lie on either side of nil for its sign to mean two directions."""
NO_RATIO = frozenset({"°C", "deg"})
"""Units whose zero is a convention: what is a tenth of a temperature in one of them is no such part in another."""
INTEGER_AXES = ("pixel_u", "pixel_v", "step", "cycle")
CLUSTER_GAP, MOST_CLUSTERS = 0.03, 9
"""Share of a column's span from which a gap parts clusters of its values, and how many such gaps are looked at."""
OF_LABELS = "*"
NAMED_COLUMNS = 4
"""Columns of trees that a law spells out."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Axis:
    """A dimensionless function of one column.

    Attributes:
        column: feature name (see `features_of`).
        kind: `linear`, `ratio` (to the middle: nil at nil), `square`, `size` (without its sign), `above`, `below`
            (hinges), `step`, `band` (1 between two edges, else 0), `peak` (of a resonance: 1 at its place), `exp`,
            `inverse`, `log`, `sin`, `cos`, `saw` (a ramp over each period, from -1/2 to 1/2), `parity`, `is` (a
            category), `bit` (whether a code has it set), `table` (one value per bin), `curve` (straight lines
            between knots), `rings` (sine) and `ring_cos` of an angle (see `PLATE`), `gap_rings` and `gap_ring_cos`
            (see `GAP`), `one`.
        middle, width: the ratio is (x − middle) / width. Of a `saw` the middle is where it falls back.
        at: knot, place or period in the column's unit, angle at which a ring ends, weight of a bit, or number of a
            category.
        beside, lean: second column of a hinge or step whose place moves with it: then of x + lean · y, lean
            in the column's unit per that of the second.
        label: category label of `is`; `OF_LABELS` of a table over a category, each of whose labels has a bin between
            two of labels that were not seen.
        edges, values: bins of `table`, or knots of `curve`, and their coefficients; without values the axis is open:
            it stands for all functions of its kind. The two edges of a `band`. Of a `bit` the scatter of frames.
    """

    column: str
    kind: str
    middle: float = 0.0
    width: float = 1.0
    at: float = 0.0
    beside: str = ""
    lean: float = 0.0
    label: str = ""
    edges: tuple[float, ...] = ()
    values: tuple[float, ...] = ()

    def bin_of(self, x: FloatArray) -> IntArray:
        """Bin of each value of the column (modulo the period, where there is one); NaN falls into the last bin."""
        folded = np.mod(x, self.at) if self.at > 0 else x
        return np.searchsorted(np.asarray(self.edges), folded, side="right").astype(np.int64)

    @property
    def columns(self) -> tuple[str, ...]:
        """Columns that it depends on."""
        return tuple(name for name in (self.column, self.beside) if name)

    @property
    def is_open(self) -> bool:
        """Whether the values of a table or curve are still to be found."""
        return self.kind in {"table", "curve"} and not self.values

    @property
    def count(self) -> int:
        """Number of values of a table or curve."""
        return len(self.edges) + (1 if self.kind == "table" else 0)

    def __call__(self, features: Features) -> FloatArray:
        """Values on rows; NaN inputs give 0 (nothing known, nothing corrected)."""
        if self.kind == "one":
            return np.ones(len(next(iter(features.values()))))
        x = features[self.column] + self.lean * features[self.beside] if self.beside else features[self.column]
        with np.errstate(all="ignore"):
            value = _function(self.kind, x, self)
        if np.isfinite(value).all():
            return value
        return np.nan_to_num(value, nan=0.0, posinf=0.0, neginf=0.0)

    @property
    def text(self) -> str:
        """The function as it stands in an expression."""
        c = f"({self.column} {self.lean:+.5g}*{self.beside})" if self.beside else self.column
        m, w, a = f"{self.middle:.5g}", f"{self.width:.5g}", f"{self.at:.5g}"
        return {
            "one": "1", "ratio": f"{c}/{m}", "square": f"(({c} - {m})/{w})^2",
            "linear": f"({c} - {m})/{w}" if self.middle else c if self.width == 1.0 else f"{c}/{w}",
            "size": f"|{c}|/{w}",
            "above": f"max({c} - {a}, 0)/{w}", "below": f"max({a} - {c}, 0)/{w}", "step": f"[{c} > {a}]",
            "exp": f"exp(3*({c} - {m})/{w})", "inverse": f"{m}/{c}", "log": f"ln({c}/{m})",
            "rings": f"sin(2*pi*sin({c})^2/sin({a})^2)", "ring_cos": f"cos(2*pi*sin({c})^2/sin({a})^2)",
            "gap_rings": f"sin(2*pi*(1 - cos({c}))/(1 - cos({a})))",
            "gap_ring_cos": f"cos(2*pi*(1 - cos({c}))/(1 - cos({a})))",
            "saw": f"(({c} - {m})/{a} mod 1 - 1/2)",
            "sin": f"sin(2*pi*{c}/{a})", "cos": f"cos(2*pi*{c}/{a})", "parity": f"(-1)^{c}",
            "peak": f"1/(1 + (({c} - {a})/{w})^2)",
            "band": "[" + f" < {c} < ".join(f"{x:.5g}" for x in self.edges) + "]",
            "is": f"[{c} = {self.label}]", "curve": f"curve({c})",
            "bit": f"[bit {a} of {c}]", "table": f"table({c}{f' mod {a}' if self.at else ''})",
        }[self.kind]  # fmt: skip


@dataclass(slots=True, kw_only=True)
class LawTerm:
    """coefficient · product of axis functions.

    Attributes:
        axes: the functions.
        value, error: coefficient and its standard error.
        reach: size at which the product is held: where a band met few rows of a ramp, others may lie far up it.
    """

    axes: tuple[Axis, ...]
    value: float = 0.0
    error: float = 0.0
    reach: float = np.inf

    def product(self, features: Features, rows: int) -> FloatArray:
        """Product of the functions on so many rows; nil where a column is missing."""
        product = np.ones(rows)
        for axis in self.axes:
            product = product * (axis(features) if axis.kind == "one" or _known(axis, features) else 0.0)
        return np.clip(product, -self.reach, self.reach)

    @property
    def turns(self) -> bool:
        """Whether it is an error of the stage's angle: its coefficient is one in degrees."""
        return any(axis.column.startswith(PER_TURN) for axis in self.axes)

    @property
    def text(self) -> str:
        """Product of the functions."""
        return "*".join(axis.text for axis in self.axes)


@dataclass(slots=True, kw_only=True)
class Law:
    """Empirical law of one channel.

    Attributes:
        channel: what it corrects.
        relative: whether the correction is a share of the simulated value.
        terms: with coefficients and standard errors.
        drivers: columns, strongest first.
        trees, binned_names, edges, rate: boosted trees for the rest; empty where the law says it all.
        gain: held-out log-likelihood of law (and trees).
        law_gain: of the law alone.
        confirmed: share of what the terms gain on their own rows that unseen blocks confirm.
    """

    channel: str
    relative: bool
    terms: list[LawTerm]
    drivers: list[str]
    trees: list[Tree] = field(default_factory=list)
    binned_names: tuple[str, ...] = ()
    edges: list[FloatArray] = field(default_factory=list)
    rate: float = 0.2
    gain: float = 0.0
    law_gain: float = 0.0
    confirmed: float = 0.0

    def correction(self, features: Features, sim: FloatArray) -> FloatArray:
        """What to add to the corrected simulation, from feature columns on the same rows."""
        total = np.zeros(len(sim))
        for term in self.terms:
            total = total + term.value * term.product(features, len(sim))
        if self.trees and all(name in features for name in self.binned_names):
            codes = [
                np.where(np.isfinite(features[n]), np.searchsorted(cuts, features[n], side="right") + 1, 0)
                for n, cuts in zip(self.binned_names, self.edges, strict=True)
            ]
            model = Boosted(rate=self.rate)
            model.trees = self.trees
            total = total + model.predict(np.stack(codes).astype(np.uint8))
        return total * sim if self.relative else total

    @property
    def expression(self) -> str:
        """The law in one line."""
        head = f"{self.channel} *= 1 + " if self.relative else f"{self.channel} += "
        if not self.terms and not self.trees:
            return f"{self.channel} depends on {', '.join(self.drivers)}; no law predicts unseen rows"
        parts = [f"c{k + 1}*{term.text}" for k, term in enumerate(self.terms)]
        if self.trees:
            more = ", ..." if len(self.binned_names) > NAMED_COLUMNS else ""
            parts.append(f"trees({', '.join(self.binned_names[:NAMED_COLUMNS])}{more})")
        return head + " + ".join(parts)

    @property
    def unit(self) -> str:
        """Unit of the coefficients."""
        return "1" if self.relative else unit_of(self.channel)


def _known(axis: Axis, features: Features) -> bool:
    return all(name in features for name in axis.columns)


def _function(kind: str, x: FloatArray, axis: Axis) -> FloatArray:
    ratio = (x - axis.middle) / axis.width
    match kind:
        case "linear":
            return ratio
        case "ratio":
            return np.asarray(x / axis.middle)
        case "square":
            return np.asarray(ratio**2)
        case "size":
            return np.asarray(np.abs(x) / axis.width)
        case "above":
            return np.asarray(np.maximum(x - axis.at, 0.0) / axis.width)
        case "below":
            return np.asarray(np.maximum(axis.at - x, 0.0) / axis.width)
        case "step":
            return (x > axis.at).astype(np.float64)
        case "band":
            return ((x > axis.edges[0]) & (x < axis.edges[1])).astype(np.float64)
        case "peak":
            return np.asarray(1.0 / (1.0 + ((x - axis.at) / axis.width) ** 2))
        case "exp":
            return np.asarray(np.exp(np.clip(3.0 * ratio, -20.0, 20.0)))
        case "inverse":
            return np.asarray(1.0 / np.where(x > 0, np.maximum(x / axis.middle, LEAST_RATIO), np.nan))
        case "log":
            return np.asarray(np.log(np.where(x > 0, np.maximum(x / axis.middle, LEAST_RATIO), np.nan)))
        case "sin":
            return np.asarray(np.sin(2.0 * np.pi * x / axis.at))
        case "cos":
            return np.asarray(np.cos(2.0 * np.pi * x / axis.at))
        case "saw":
            return np.asarray(np.mod((x - axis.middle) / axis.at, 1.0) - 0.5)
        case "rings" | "gap_rings":
            return np.asarray(np.sin(2.0 * np.pi * RINGS[kind].turns(x, axis.at)))
        case "ring_cos" | "gap_ring_cos":
            return np.asarray(np.cos(2.0 * np.pi * RINGS[kind].turns(x, axis.at)))
        case "table":
            return np.asarray(np.asarray(axis.values)[axis.bin_of(x)])
        case "curve":
            return np.asarray(np.interp(x, np.asarray(axis.edges), np.asarray(axis.values)))
        case "bit":
            return is_set(x, axis.at, (axis.edges[0], axis.edges[1]))
        case "parity":
            return np.where(np.mod(x, 2.0) < 0.5, 1.0, -1.0)
        case _:
            return np.equal(x, axis.at).astype(np.float64)


class Rings(NamedTuple):
    """Interference between two faces, over the angle at which one looks through them (Born & Wolf, sec. 7.6).

    Attributes:
        sine, cosine: kinds of axes.
        phase: by what the phase falls, a function of the angle in radians; angle: its inverse.
    """

    sine: str
    cosine: str
    phase: Callable[[FloatArray], FloatArray]
    angle: Callable[[float], float]

    def of(self, angle_deg: FloatArray | float) -> FloatArray:
        """By what the phase falls at angles in degrees, (n,)."""
        return np.asarray(self.phase(np.radians(angle_deg)))

    def turns(self, angle_deg: FloatArray, end_deg: float) -> FloatArray:
        """Turns of the phase up to angles, of which there is one up to `end_deg`; (n,)."""
        return np.asarray(self.of(angle_deg) / self.of(end_deg))

    def end(self, turns: float) -> float:
        """Angle in degrees up to which there is one turn, for so many per unit of `phase`."""
        return float(np.degrees(self.angle(1.0 / turns)))


PLATE = Rings("rings", "ring_cos", lambda x: np.sin(x) ** 2, lambda y: float(np.arcsin(min(y**0.5, 1.0))))
"""Of a plate: by the square of the sine."""
GAP = Rings("gap_rings", "gap_ring_cos", lambda x: 1.0 - np.cos(x), lambda y: float(np.arccos(1.0 - min(y, 2.0))))
"""Of an empty gap: by 1 - cos."""
RINGS = {kind: rings for rings in (PLATE, GAP) for kind in (rings.sine, rings.cosine)}
"""Kinds of axes to the rings that they are of."""


def thresholds(values: FloatArray, shares: Sequence[float]) -> list[float]:
    """Where a column may be parted: between its clusters if it has few, else at shares of its rows.

    Args:
        values: (n,) finite values in the column's unit.
        shares: of the rows that lie below, 0 to 1, for a column without clusters.
    """
    levels = np.unique(values)
    gaps = np.diff(levels)
    wide = gaps > CLUSTER_GAP * float(levels[-1] - levels[0])
    within = np.where(wide, 0.0, gaps)
    if 0 < wide.sum() <= MOST_CLUSTERS and float(within.sum()) < 0.5 * float(levels[-1] - levels[0]):
        return [float(x) for x in (0.5 * (levels[1:] + levels[:-1]))[wide]]
    return [float(np.quantile(values, q)) for q in shares]


def axes_of(name: str, values: FloatArray, labels: tuple[str, ...]) -> Iterator[Axis]:
    """Axis functions of a column, simple ones first."""
    if labels:
        for label in labels[:12]:
            yield Axis(column=name, kind="is", at=category_id(label), label=label)
        return
    finite = values[np.isfinite(values)]
    low, high = np.quantile(finite, [0.01, 0.99])
    if high <= low:
        low, high = float(finite.min()), float(finite.max())
    if high <= low:
        return
    middle, width = float(0.5 * (low + high)), float(high - low)
    base = {"column": name, "middle": middle, "width": width}
    yield Axis(**base, kind="linear")  # type: ignore[arg-type]  # mypy does not see through the dict
    if len(np.unique(finite)) < 3:
        return
    yield Axis(**base, kind="square")  # type: ignore[arg-type]  # as above
    if unit_of(name) != "°C" and min(-low, high) > LEAST_SIDE * width:  # a rate, a slope, a way to either side
        if abs(middle) > LEAST_SIDE * width:
            yield Axis(column=name, kind="square", middle=0.0, width=width)
        yield Axis(column=name, kind="size", middle=0.0, width=width)
    if unit_of(name) not in NO_RATIO and low > LEAST_RATIO * middle and high > 1.3 * low:
        for kind in ("ratio", "log", "inverse"):
            yield Axis(column=name, kind=kind, middle=middle, width=width)
    yield Axis(**base, kind="exp")  # type: ignore[arg-type]  # as above
    for at in thresholds(finite, (0.15, 0.3, 0.5, 0.7, 0.85)):
        yield Axis(column=name, kind="above", middle=middle, width=width, at=at)
        yield Axis(column=name, kind="below", middle=middle, width=width, at=at)
        yield Axis(column=name, kind="step", middle=middle, width=width, at=at)
    if name in INTEGER_AXES and np.ptp(np.mod(finite, 2.0)) > 0.0:  # every sixth row is even
        yield Axis(column=name, kind="parity")
    span = float(finite.max() - finite.min())
    distinct = len(np.unique(finite))
    for pieces in (1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 16.0):
        if distinct >= 3 * pieces:
            for kind in ("sin", "cos"):
                yield Axis(column=name, kind=kind, at=span / pieces)
