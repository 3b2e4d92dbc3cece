"""An empirical law for a mismatch that no effect explains: few products of simple functions of the located columns.

A channel's correction is Σ coefficient · f(column) · g(column), times the simulated value where the channel is
calibrated by a gain. Each axis function is dimensionless: its argument is a ratio (column over its own range), so
the coefficients carry the channel's unit, or none. Terms enter one by one, simple ones first, and only while unseen
blocks gain. What the law cannot say but the columns can predict may be kept as boosted trees beside it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from arl_fixtures.reconcile.boosting import Binned, Boosted, Tree, bin_columns
from arl_fixtures.reconcile.columns import FloatArray, IntArray
from arl_fixtures.reconcile.effect import State
from arl_fixtures.reconcile.features import category_id
from arl_fixtures.reconcile.pilot import Looker, Structure
from arl_fixtures.reconcile.problem import ChannelData
from arl_fixtures.reconcile.roles import Role, unit_of

MOST_COLUMNS = 8
MOST_TERMS = 5
MOST_ROWS = 10_000
PRICE_SINGLE, PRICE_PRODUCT = 6.0, 9.0
"""Log-likelihood that a term must earn: the price of having chosen it among some hundred or thousand."""
INTEGER_AXES = ("pixel_u", "pixel_v", "step", "cycle")


@dataclass(frozen=True, slots=True, kw_only=True)
class Axis:
    """A dimensionless function of one column.

    Attributes:
        column: feature name (see `features_of`).
        kind: `linear`, `square`, `above`, `below` (hinges), `step`, `exp`, `inverse`, `log`, `sin`, `cos`, `parity`,
            `is` (a category), `table` (one value per bin), `one`.
        middle, width: the ratio is (x − middle) / width.
        at: knot or period in the column's unit, or number of a category.
        label: category label of `is`.
        edges, values: bins of `table` and their coefficients.
    """

    column: str
    kind: str
    middle: float = 0.0
    width: float = 1.0
    at: float = 0.0
    label: str = ""
    edges: tuple[float, ...] = ()
    values: tuple[float, ...] = ()

    def bin_of(self, x: FloatArray) -> IntArray:
        """Bin of each value of the column (modulo the period, where there is one); NaN falls into the last bin."""
        folded = np.mod(x, self.at) if self.at > 0 else x
        return np.searchsorted(np.asarray(self.edges), folded, side="right").astype(np.int64)

    def __call__(self, features: dict[str, FloatArray]) -> FloatArray:
        """Values on rows; NaN inputs give 0 (nothing known, nothing corrected)."""
        if self.kind == "one":
            return np.ones(len(next(iter(features.values()))))
        x = features[self.column]
        with np.errstate(all="ignore"):
            value = _function(self.kind, x, self)
        return np.nan_to_num(value, nan=0.0, posinf=0.0, neginf=0.0)

    @property
    def text(self) -> str:
        """The function as it stands in an expression."""
        c, m, w, a = self.column, f"{self.middle:.5g}", f"{self.width:.5g}", f"{self.at:.5g}"
        return {
            "one": "1", "linear": f"({c} - {m})/{w}", "square": f"(({c} - {m})/{w})^2",
            "above": f"max({c} - {a}, 0)/{w}", "below": f"max({a} - {c}, 0)/{w}", "step": f"[{c} > {a}]",
            "exp": f"exp(3*({c} - {m})/{w})", "inverse": f"{m}/{c}", "log": f"ln({c}/{m})",
            "sin": f"sin(2*pi*{c}/{a})", "cos": f"cos(2*pi*{c}/{a})", "parity": f"(-1)^{c}",
            "is": f"[{c} = {self.label}]", "table": f"table({c}{f' mod {a}' if self.at else ''})",
        }[self.kind]  # fmt: skip


@dataclass(slots=True, kw_only=True)
class LawTerm:
    """coefficient · product of axis functions."""

    axes: tuple[Axis, ...]
    value: float = 0.0
    error: float = 0.0

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

    def correction(self, features: dict[str, FloatArray], sim: FloatArray) -> FloatArray:
        """What to add to the corrected simulation, from feature columns on the same rows."""
        total = np.zeros(len(sim))
        for term in self.terms:
            product = np.ones(len(sim))
            for axis in term.axes:
                product = product * (axis(features) if axis.column in features or axis.kind == "one" else 0.0)
            total = total + term.value * product
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
        body = " + ".join(f"c{k + 1}*{term.text}" for k, term in enumerate(self.terms)) or "0"
        return head + body + (" + trees(" + ", ".join(self.binned_names[:4]) + ", ...)" if self.trees else "")

    @property
    def unit(self) -> str:
        """Unit of the coefficients."""
        return "1" if self.relative else unit_of(self.channel)


def _function(kind: str, x: FloatArray, axis: Axis) -> FloatArray:
    ratio = (x - axis.middle) / axis.width
    match kind:
        case "linear":
            return ratio
        case "square":
            return np.asarray(ratio**2)
        case "above":
            return np.asarray(np.maximum(x - axis.at, 0.0) / axis.width)
        case "below":
            return np.asarray(np.maximum(axis.at - x, 0.0) / axis.width)
        case "step":
            return (x > axis.at).astype(np.float64)
        case "exp":
            return np.asarray(np.exp(np.clip(3.0 * ratio, -20.0, 20.0)))
        case "inverse":
            return np.asarray(axis.middle / np.where(x > 0, x, np.nan))
        case "log":
            return np.asarray(np.log(np.where(x > 0, x, np.nan) / axis.middle))
        case "sin":
            return np.asarray(np.sin(2.0 * np.pi * x / axis.at))
        case "cos":
            return np.asarray(np.cos(2.0 * np.pi * x / axis.at))
        case "table":
            return np.asarray(np.asarray(axis.values)[axis.bin_of(x)])
        case "parity":
            return np.where(np.mod(x, 2.0) < 0.5, 1.0, -1.0)
        case _:
            return np.equal(x, axis.at).astype(np.float64)


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
    if low > 0 and high > 1.3 * low:
        yield Axis(column=name, kind="log", middle=middle, width=width)
        yield Axis(column=name, kind="inverse", middle=middle, width=width)
    yield Axis(**base, kind="exp")  # type: ignore[arg-type]  # as above
    for q in (0.15, 0.3, 0.5, 0.7, 0.85):
        at = float(np.quantile(finite, q))
        yield Axis(column=name, kind="above", middle=middle, width=width, at=at)
        yield Axis(column=name, kind="below", middle=middle, width=width, at=at)
        yield Axis(column=name, kind="step", middle=middle, width=width, at=at)
    if name in INTEGER_AXES:
        yield Axis(column=name, kind="parity")
    span = float(finite.max() - finite.min())
    distinct = len(np.unique(finite))
    for pieces in (1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 16.0):
        if distinct >= 3 * pieces:
            for kind in ("sin", "cos"):
                yield Axis(column=name, kind=kind, at=span / pieces)


def find_law(looker: Looker, data: ChannelData, state: State, structure: Structure) -> Law:
    """Greedy law of a channel's residual on its located columns."""
    view = looker.problem.view
    pick = data.use if len(data.use) <= MOST_ROWS else data.use[:: len(data.use) // MOST_ROWS + 1]
    inside = np.searchsorted(data.use, pick)
    order = [n for n, share in sorted(structure.ceiling.importance.items(), key=lambda kv: -kv[1]) if share > 0.01]
    names = order[:MOST_COLUMNS]
    features = {name: looker.features[name] for name in names}
    axes: list[Axis] = []
    for name in names:
        labels = view.labels(name) if view.is_category(name) else ()
        axes += list(axes_of(name, features[name], labels))
    relative = data.channel.role in {Role.INTENSITY, Role.SCATTER}
    sim = state[data.channel.name]
    scale = data.expect * (sim[data.use] if relative else np.ones(len(data.use)))
    residual = data.whiten(data.residual(state))[inside]
    local = {name: values[data.use] for name, values in features.items()}
    singles = [axis(local) for axis in axes]
    fold = data.fold[inside]

    def whitened(columns: list[FloatArray]) -> FloatArray:
        return np.stack([data.whiten(scale * c)[inside] for c in columns]) if columns else np.zeros((0, len(inside)))

    pool: list[tuple[Axis, ...]] = [(axis,) for axis in axes]
    vectors = whitened(singles)
    strength = _gains(vectors, residual)
    by_column: dict[str, list[int]] = {}
    for k in np.argsort(-strength, kind="stable"):
        by_column.setdefault(axes[k].column, []).append(int(k))
    pairs: list[tuple[int, int]] = []
    leading = names[:5]
    for i, first in enumerate(leading):
        for second in leading[i + 1 :]:
            for a in _varied(by_column.get(first, []), axes):
                for b in _varied(by_column.get(second, []), axes):
                    pairs.append((a, b))
    pool += [(axes[a], axes[b]) for a, b in pairs]
    vectors = np.concatenate([vectors, whitened([singles[a] * singles[b] for a, b in pairs])])
    if not data.calibrated:
        pool.append((Axis(column="", kind="one"),))
        vectors = np.concatenate([vectors, whitened([np.ones(len(data.use))])])
    price = np.array([PRICE_SINGLE if len(item) == 1 else PRICE_PRODUCT for item in pool])
    if pool and pool[-1][0].kind == "one":
        price[-1] = 2.0
    chosen: list[int] = []
    left = residual
    held = 0.0
    while len(chosen) < MOST_TERMS:
        gains = _gains(_orthogonal(vectors, vectors[chosen]), left) - price
        gains[chosen] = -np.inf
        k = int(np.argmax(gains))
        if not gains[k] > 0:
            break
        trial = _held_out(vectors[[*chosen, k]], residual, fold)
        if trial <= held + 1.0:
            break
        held = trial
        chosen.append(k)
        left = residual - _solve(vectors[chosen], residual)[0] @ vectors[chosen]
    values, errors = _solve(vectors[chosen], residual)
    terms = [
        LawTerm(axes=pool[k], value=float(v), error=float(e)) for k, v, e in zip(chosen, values, errors, strict=True)
    ]
    ratio = len(data.use) / max(len(inside), 1)
    law = Law(
        channel=data.channel.name, relative=relative, terms=terms, drivers=_drivers(terms, order),
        law_gain=held * ratio, gain=held * ratio,
    )  # fmt: skip
    _add_trees(law, looker, data, state, structure)
    return law


def _varied(ranked: list[int], axes: list[Axis], most: int = 7) -> list[int]:
    """Strongest functions of a column, at most two of a kind, linear and parity always among them."""
    counts: dict[str, int] = {}
    chosen: list[int] = []
    for k in ranked:
        kind = axes[k].kind
        if counts.get(kind, 0) < 2 and (len(chosen) < most or kind in {"linear", "parity", "is"}):
            counts[kind] = counts.get(kind, 0) + 1
            chosen.append(k)
    return chosen


def _gains(vectors: FloatArray, residual: FloatArray) -> FloatArray:
    power = np.einsum("kn,kn->k", vectors, vectors)
    score = vectors @ residual
    return np.where(power > 1e-9, 0.5 * score**2 / np.maximum(power, 1e-9), 0.0)


def _orthogonal(vectors: FloatArray, basis: FloatArray) -> FloatArray:
    if len(basis) == 0:
        return vectors
    q, _ = np.linalg.qr(basis.T)
    return np.asarray(vectors - (vectors @ q) @ q.T)


def _solve(vectors: FloatArray, residual: FloatArray) -> tuple[FloatArray, FloatArray]:
    if len(vectors) == 0:
        return np.zeros(0), np.zeros(0)
    gram = vectors @ vectors.T
    gram = gram + np.eye(len(gram)) * 1e-9 * np.trace(gram)
    inverse = np.linalg.inv(gram)
    return np.asarray(inverse @ (vectors @ residual)), np.sqrt(np.diag(inverse))


def _held_out(vectors: FloatArray, residual: FloatArray, fold: IntArray) -> float:
    """Log-likelihood gained on each fold by coefficients from the others."""
    total = 0.0
    for k in np.unique(fold):
        train, test = fold != k, fold == k
        if not train.any():
            continue
        values, _ = _solve(vectors[:, train], residual[train])
        left = residual[test] - values @ vectors[:, test]
        total += 0.5 * float(residual[test] @ residual[test] - left @ left)
    return total


def _drivers(terms: list[LawTerm], order: list[str]) -> list[str]:
    named: list[str] = []
    for term in terms:
        named += [axis.column for axis in term.axes if axis.column and axis.column not in named]
    return named or order[:3]


def _add_trees(law: Law, looker: Looker, data: ChannelData, state: State, structure: Structure) -> None:
    """Keep boosted trees beside the law where unseen blocks gain clearly."""
    after = dict(state)
    after[law.channel] = state[law.channel] + law.correction(looker.features, state[law.channel])
    rest = looker.look(data, after)
    if not (rest.z > 3.0 and rest.gain > 0.1 * max(structure.gain, 1.0) and rest.gain > 12.0):
        return
    rows = looker.rows_of(data)
    target, weight = looker.target_of(data, after, rows)
    names = tuple(n for n, share in sorted(rest.ceiling.importance.items(), key=lambda kv: -kv[1]) if share > 0.02)[
        :8
    ]
    binned: Binned = bin_columns({n: looker.features[n][data.use[rows]] for n in names})
    model = Boosted()
    model.fit(binned.codes, target, weight, trees=40)
    law.trees, law.binned_names, law.edges, law.rate = model.trees, binned.names, binned.edges, model.rate
    law.gain += rest.gain
