"""Candidates for a law: functions of every column alone, and of the leading ones in pairs."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from arl_fixtures.reconcile.columns import FloatArray
from arl_fixtures.reconcile.law import Axis, axes_of
from arl_fixtures.reconcile.law_bands import bands_of
from arl_fixtures.reconcile.law_basis import (
    FINE,
    FINE_KNOTS,
    KNOTS,
    MAP_KNOTS,
    PRICE_CURVE,
    PRICE_ONE,
    PRICE_PRODUCT,
    PRICE_TWO,
    Basis,
    curve_axis,
    curves_of,
    map_of,
    price_of,
    smooth_prior,
    tables_of,
    waves_of,
)
from arl_fixtures.reconcile.law_candidates import Candidates
from arl_fixtures.reconcile.law_crossed import crossed_of
from arl_fixtures.reconcile.law_pixels import drifts_of
from arl_fixtures.reconcile.law_work import Candidate, Work
from arl_fixtures.reconcile.pilot import Looker
from arl_fixtures.reconcile.roles import PIXEL, Role

MOST_LEADING = 7
SHARED_PRICE, PRICE_PAIR_WAVE = 3.0, 7.0
IMAGE, ORDERS = ("pixel_u", "pixel_v"), ("step", "time_s", "cycle", "stage_angle_deg")
"""Columns over which a pattern stands in the image, and over which it may move."""
MOST_MARKS, MOST_REFINED = 20, 10
PRICE_MARK, PRICE_ZERO = 2.0, 2.0
"""Further price of a term that holds in one category only, and of saying where one of its factors is zero."""
UNSHIFTED = frozenset({"is", "ratio", "step", "band", "above", "below", "parity", "one"})
"""Functions whose zero means something."""
_CELLS = 100_000
FAR_APART, FAR_BESIDE = 0.9, 0.25
"""Share of the gaps between a column's levels of which half a wave must be longer; of one over two columns."""
_FILLED = 0.5
"""Share of the thirds of a wave's turns in which a column must have levels."""
MOST_TURNS, ALONE_TURNS = 16.0, 24.0
"""Turns of a wave over the span of each of two columns, and of one column alone."""
_FINENESS = 0.125
ALIKE = 0.98
"""Correlation from which two columns are one for the search of pairs."""


def pool_of(work: Work, looker: Looker, leading: Sequence[str]) -> Candidates:
    """Candidates: every column alone; the leading ones also in pairs."""
    view = looker.problem.view
    signal = _signal(work)
    pool = Candidates(work)
    ranked: dict[str, float] = {}
    simple: dict[str, list[Candidate]] = {}
    for name, values in work.features.items():
        if name == PIXEL:
            continue
        category = not name.startswith(("~", "sim_")) and view.is_category(name)
        labels = view.labels(name) if category else ()
        extra = price_of((name,)) + _shared_price(work, (name,))
        numbered = name in looker.problem.groups.unit_columns  # a number of a zone is a name, not a size
        bases = [
            Basis(axes=(axis,), price=PRICE_ONE + extra)
            for axis in axes_of(name, values, labels)
            if axis.kind not in {"sin", "cos"} and (category or not numbered)
        ]
        bases += [
            Basis(axes=(axis,), prior=np.eye(axis.count), price=PRICE_CURVE + extra)
            for axis in tables_of(name, values, category=category)
            if recurs(work, axis)
        ]
        if not category and not numbered:
            curve = curve_axis(name, values, KNOTS)
            bases += list(curves_of(curve, PRICE_CURVE + extra)) if curve else []
            fine = curve_axis(name, values, FINE_KNOTS)
            if fine is not None and len(fine.edges) > KNOTS:
                bases.append(Basis(axes=(fine,), prior=smooth_prior(fine, FINE), price=PRICE_CURVE + extra))
            wave = _best_wave(work, name)
            if wave:
                bases.append(Basis(waves=waves_of(name, wave), price=PRICE_TWO + extra))
                phase = Axis(column=name, kind="table", at=1.0 / wave, edges=tuple(np.arange(1, 8) / 8.0 / wave))
                bases.append(Basis(axes=(phase,), prior=np.eye(8), price=PRICE_TWO + 2.0 + extra))
        ratios = [b for b in bases if _is_ratio(b)]  # alone it is a line
        made = pool.add(b for b in bases if not _is_ratio(b))
        ranked[name] = max((item.gain for item in made), default=0.0)
        plain = [m for m in made if m.basis.prior is None and not m.basis.waves]
        straight = [m for m in plain if m.basis.axes[0].kind == "linear"]
        plain += [replace(line, basis=ratio) for line, ratio in zip(straight, ratios, strict=False)]
        simple[name] = sorted(plain, key=lambda m: -m.gain)
    if not work.data.calibrated:
        pool.add([Basis(axes=(Axis(column="", kind="one"),), price=2.0)])
    ranking = sorted(ranked, key=lambda n: -ranked[n])
    names = distinct(work, [*leading, *(n for n in ranking if ranked[n] > -PRICE_ONE)])[:MOST_LEADING]
    if signal is not None:  # what is added, not multiplied
        alone = [m.basis for n in names for m in pool.items if m.basis.columns == (n,) and not m.basis.waves][:80]
        pool.add(Basis(axes=(*b.axes, signal), prior=b.prior, price=b.price + 1.0) for b in alone)
    pool.add(_pairs(work, looker, names, simple))
    pool.add(_moving(work, names, (*ORDERS, *view.temperatures()[:2])))
    lines = [m.basis.axes[0] for n in names for m in simple.get(n, []) if m.basis.axes[0].kind == "linear"]
    units = looker.problem.groups.unit_columns
    numeric = [n for n in ranking if not (n in units or (not n.startswith(("~", "sim_")) and view.is_category(n)))]
    pool.add(bands_of(work, numeric, lines))
    pool.add(drifts_of(work, numeric))
    recorded = [n for n in sorted(numeric) if not n.startswith(("~", "sim_"))]
    pool.add(crossed_of(work, distinct(work, recorded), marks_of(looker)))
    pool.add(_refined(work, looker, pool.items))
    return pool


def _is_ratio(basis: Basis) -> bool:
    return bool(basis.axes) and basis.axes[0].kind == "ratio"


def recurs(work: Work, axis: Axis, factor: Axis | None = None) -> bool:
    """Whether a table is met in more than one block at each level (where a factor is not 0): else it tells none."""
    code, block = axis.bin_of(work.features[axis.column]), work.block
    if factor is not None:
        there = factor(work.features) != 0.0
        code, block = code[there], block[there]
    pairs = np.bincount(code * (int(work.block.max()) + 1) + block)
    return bool(np.count_nonzero(pairs) >= 1.5 * np.count_nonzero(np.bincount(code)))


def distinct(work: Work, names: Sequence[str]) -> list[str]:
    """Columns in order, without those that tell nearly the same as one before."""
    kept: dict[str, FloatArray] = {}
    for name in dict.fromkeys(names):
        x = np.nan_to_num(work.features[name])
        spread = float(x.std())
        if spread > 0.0:
            x = (x - x.mean()) / spread
            if all(abs(float(np.mean(x * other))) < ALIKE for other in kept.values()):
                kept[name] = x
    return list(kept)


def _shared_price(work: Work, columns: tuple[str, ...]) -> float:
    """Further price of what varies only from step to step: few witnesses, and many columns that follow them."""
    return SHARED_PRICE if work.is_shared(columns) else 0.0


def _signal(work: Work) -> Axis | None:
    """One over the simulated signal: turns a share of it into an amount."""
    name = f"sim_{work.data.channel.name}"
    if work.data.channel.role is not Role.INTENSITY or name not in work.features:
        return None
    values = work.features[name]
    low, high = float(np.quantile(values, 0.02)), float(np.quantile(values, 0.98))
    if low <= 0 or high < 1.3 * low:
        return None
    middle = 0.5 * (low + high)
    return Axis(column=name, kind="inverse", middle=middle, width=high - low)


def _pairs(work: Work, looker: Looker, names: Sequence[str], simple: dict[str, list[Candidate]]) -> Iterator[Basis]:
    view = looker.problem.view
    curves = {name: curve_axis(name, work.features[name], KNOTS) for name in names}
    maps = {name: curve_axis(name, work.features[name], MAP_KNOTS) for name in names}
    for i, first in enumerate(names):
        for second in names[i + 1 :]:
            apart = {name: _shared_price(work, (name,)) for name in (first, second)}
            price = price_of((first, second)) + PRICE_ONE + PRICE_PRODUCT + _shared_price(work, (first, second))
            for a in _varied(simple.get(first, [])):
                for b in _varied(simple.get(second, [])):
                    extra = _nearly_one(a.basis.axes[0], apart[second]) + _nearly_one(b.basis.axes[0], apart[first])
                    yield Basis(axes=(*a.basis.axes, *b.basis.axes), price=price + extra)
            for one, other in ((first, second), (second, first)):
                values = work.features[other]
                category = not other.startswith(("~", "sim_")) and view.is_category(other)
                plain = {m.basis.axes[0].kind: m.basis.axes[0] for m in simple.get(one, [])}
                line = plain.get("linear")
                shapes = [plain[kind] for kind in ("linear", "ratio", "log", "inverse") if kind in plain]
                marks = [m.basis.axes[0] for m in simple.get(one, []) if m.basis.axes[0].kind == "is"]
                numbered = other in looker.problem.groups.unit_columns
                curve = None if category or numbered else curves[other]
                for factor in [*shapes, *marks[:6]]:
                    for table in tables_of(other, values, category=category):
                        if not recurs(work, table, factor):
                            continue
                        extra = _nearly_one(factor, apart[other])
                        yield Basis(axes=(table, factor), prior=np.eye(table.count), price=price + 1.0 + extra)
                    if curve and (factor is line or factor.kind == "is"):
                        yield from (
                            Basis(axes=(b.axes[0], factor), prior=b.prior, price=price + 1.0)
                            for b in curves_of(curve, 0.0)
                        )
            one_map, other_map = maps[first], maps[second]
            if one_map and other_map and not (view.is_category(first) or view.is_category(second)):
                yield map_of(one_map, other_map, price + 2.0)
                turns = _best_pair_wave(work, first, second)
                if turns is not None:
                    yield Basis(waves=waves_of(first, turns[0], second, turns[1]), price=price + PRICE_PAIR_WAVE)


def _nearly_one(axis: Axis, other: float) -> float:
    """What a product pays for its other column when that is steady within steps: a ratio hardly changes it there."""
    return other if axis.kind == "ratio" else 0.0


def _moving(work: Work, names: Sequence[str], orders: Sequence[str]) -> Iterator[Basis]:
    """Waves over the image that move from step to step or pose to pose, over which alone nothing is seen."""
    for place in (n for n in IMAGE if n in work.features):
        for order in (n for n in orders if n in work.features):
            if place in names and order in names:
                continue
            turns = _best_pair_wave(work, place, order)
            if turns is not None:
                price = price_of((place, order)) + PRICE_ONE + PRICE_PRODUCT + PRICE_PAIR_WAVE
                yield Basis(waves=waves_of(place, turns[0], order, turns[1]), price=price)


def is_mark(factor: Axis, work: Work) -> bool:
    """Whether a function says where a term holds, and no more."""
    values = work.features[factor.column]
    return factor.kind == "is" or len(np.unique(values[np.isfinite(values)])) <= 2


def marks_of(looker: Looker) -> list[Axis]:
    """Functions that are 0 but in one category, or at one of the two levels of a column."""
    view = looker.problem.view
    marks: list[Axis] = []
    for name, values in looker.features.items():
        if name.startswith(("~", "sim_")):
            continue
        if view.is_category(name):
            marks += axes_of(name, values, view.labels(name))
            continue
        levels = np.unique(values[np.isfinite(values)])
        if len(levels) == 2:
            width = float(levels[1] - levels[0])
            marks += [Axis(column=name, kind="linear", middle=float(x), width=width) for x in levels]
    return marks[:MOST_MARKS]


def _refined(work: Work, looker: Looker, pool: Sequence[Candidate]) -> Iterator[Basis]:
    """The best candidates in one category, or at one of two levels, and with a free zero of their lines.

    Each may do so much more than without that it comes first only so.
    """
    marks = marks_of(looker)
    kinds: set[tuple[str, ...]] = set()
    for item in sorted(pool, key=lambda item: -item.gain):
        basis = item.basis
        kind = (*sorted(basis.columns), "wave" if basis.waves else "open" if basis.prior is not None else "")
        if not basis.columns or kind in kinds or len(item.vectors) > KNOTS:
            continue
        kinds.add(kind)
        yield from _zeroed(basis)
        if not any(is_mark(axis, work) for axis in basis.axes):
            for mark in marks:
                if mark.column not in basis.columns:
                    waves = tuple((*product, mark) for product in basis.waves)
                    axes = basis.axes if waves else (*basis.axes, mark)
                    yield replace(basis, axes=axes, waves=waves, price=basis.price + PRICE_MARK)
        if len(kinds) == MOST_REFINED:
            return


def _zeroed(basis: Basis) -> Iterator[Basis]:
    """A product with a line, whose zero the data place: without it, that is the middle of the rows."""
    if basis.prior is not None or basis.waves or len(basis.axes) != 2:
        return
    for one, other in (basis.axes, basis.axes[::-1]):
        if one.kind == "linear":
            yield Basis(waves=((other, one), (other,)), price=basis.price + PRICE_ZERO)


def _varied(ranked: Sequence[Candidate], most: int = 4) -> list[Candidate]:
    """Strongest functions of a column, one of a kind, the line always among them."""
    kinds: set[str] = set()
    kept: list[Candidate] = []
    for item in ranked:
        kind = item.basis.axes[0].kind
        if (kind not in kinds or kind == "is") and (len(kept) < most or kind in {"linear", "ratio", "parity"}):
            kinds.add(kind)
            kept.append(item)
    return kept


def _best_wave(work: Work, name: str) -> float | None:
    """Turns per unit of a column at which the residual swings most, None for columns with few values."""
    x = work.features[name]
    good = np.isfinite(x)
    levels, code = np.unique(x[good], return_inverse=True)
    if len(levels) < 8 or not good.any():
        return None
    span = float(levels[-1] - levels[0])
    if name == "time_s":  # a pump, a fan: images that follow each other closely tell what steps far apart cannot
        most = min(_most_turns(levels, FAR_BESIDE), max(_FINENESS * _CELLS / len(levels), ALONE_TURNS))
    else:
        most = _told_turns(levels, min(len(levels) / 3.0, ALONE_TURNS, _most_turns(levels)))
    frequencies: FloatArray = np.arange(0.5, most, _FINENESS, dtype=np.float64) / span
    direction = work.direction[good]
    score: FloatArray = np.bincount(code, direction * work.residual[good]).astype(np.float64)
    weight: FloatArray = np.bincount(code, direction**2).astype(np.float64)
    return float(frequencies[_strongest(levels, score, weight, frequencies)])


def _most_turns(levels: FloatArray, apart: float = FAR_APART) -> float:
    """Turns over a column up to which its levels lie close enough together; whole numbers are all there are."""
    if bool(np.all(levels == np.round(levels))):
        return np.inf
    gap = float(np.quantile(np.diff(levels), apart))
    return 0.5 * float(levels[-1] - levels[0]) / gap


def _told_turns(levels: FloatArray, most: float) -> float:
    """Turns up to which a column's levels fill half of the thirds of a turn: fewer cannot tell a wave from another.

    Levels in a few clusters, or on a lattice of every third number, see a short wave as a slow one.
    """
    place = (levels - levels[0]) / max(float(levels[-1] - levels[0]), 1e-300)
    for turns in np.arange(1.0, most, 0.5):
        cells = int(np.ceil(3.0 * turns))
        if np.unique(np.minimum((place * cells).astype(np.int64), cells - 1)).size < _FILLED * cells:
            return float(turns)
    return most


def _strongest(levels: FloatArray, score: FloatArray, weight: FloatArray, frequencies: FloatArray) -> int:
    """Frequency with the largest drop of the weighted sum of squares, sine and cosine beside a constant."""
    gains = np.empty(len(frequencies))
    part = max(1, _CELLS // len(levels))
    for start in range(0, len(frequencies), part):
        phase = (2.0 * np.pi) * np.outer(frequencies[start : start + part], levels)
        wave = [np.ones_like(phase), np.sin(phase), np.cos(phase)]
        weighed = [w * weight for w in wave]
        push = np.stack([w @ score for w in wave], axis=1)
        gram = np.empty((len(phase), 3, 3))
        for i in range(3):
            for j in range(i, 3):
                gram[:, i, j] = gram[:, j, i] = np.einsum("fn,fn->f", weighed[i], wave[j])
        inverse = np.linalg.pinv(gram, rcond=1e-9, hermitian=True)
        gains[start : start + part] = np.einsum("fi,fij,fj->f", push, inverse, push)
    return int(np.argmax(gains))


def _best_pair_wave(work: Work, first: str, second: str) -> tuple[float, float] | None:
    """Turns per unit of two columns at which a wave over both is strongest, from a periodogram of cells."""
    x, y = work.features[first], work.features[second]
    good = np.isfinite(x) & np.isfinite(y)
    cells = []
    for values in (x[good], y[good]):
        levels = np.unique(values)
        if len(levels) < 6:
            return None
        if len(levels) > 48:
            cuts = np.linspace(levels[0], levels[-1], 49)
            code = np.clip(np.searchsorted(cuts, values, side="right") - 1, 0, 47)
            cells.append((0.5 * (cuts[1:] + cuts[:-1]), code))
        else:
            cells.append((levels, np.searchsorted(levels, values)))
    (a, code_a), (b, code_b) = cells
    direction = work.direction[good]
    flat = code_a * len(b) + code_b
    score = np.bincount(flat, direction * work.residual[good], minlength=len(a) * len(b)).reshape(len(a), len(b))
    span_a, span_b = float(a[-1] - a[0]), float(b[-1] - b[0])
    most_a, most_b = (
        most if name.endswith(("time_s", "time_s)")) else _told_turns(np.unique(work.features[name][good]), most)
        for name, most in (
            (first, min(len(a) / 3.0, MOST_TURNS, _most_turns(a, FAR_BESIDE))),
            (second, min(MOST_TURNS, _most_turns(b, FAR_BESIDE))),
        )
    )  # fmt: skip
    turns_a = np.arange(0.0, most_a, 0.125) / span_a
    turns_b = np.arange(-most_b, most_b, 0.125) / span_b
    power = np.abs(np.exp(2j * np.pi * np.outer(turns_a, a)) @ score @ np.exp(2j * np.pi * np.outer(b, turns_b))) ** 2
    power[turns_a * span_a < 0.3, :] = 0.0
    power[:, np.abs(turns_b * span_b) < 0.3] = 0.0
    i, j = np.unravel_index(int(np.argmax(power)), power.shape)
    return (float(turns_a[i]), float(turns_b[j])) if power[i, j] > 0 else None
