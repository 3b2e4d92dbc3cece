"""Candidates for a law: functions of every column alone, and of the leading ones in pairs."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from arl_fixtures.reconcile.columns import FloatArray
from arl_fixtures.reconcile.features import in_degrees
from arl_fixtures.reconcile.law import GAP, PLATE, Axis, axes_of
from arl_fixtures.reconcile.law_bands import MOST_LINES, PRICE_STEP, bands_of, best_step
from arl_fixtures.reconcile.law_basis import (
    FEWEST_TURNS,
    FINE,
    FINE_KNOTS,
    KNOTS,
    MAP_KNOTS,
    PRICE_CURVE,
    PRICE_MARK,
    PRICE_ONE,
    PRICE_PRODUCT,
    PRICE_TWO,
    PRICE_ZERO,
    Basis,
    curve_axis,
    curves_of,
    folded,
    is_proxy,
    map_of,
    moves_waves,
    moving_rings_of,
    price_of,
    rings_of,
    smooth_prior,
    tables_of,
    waves_of,
)
from arl_fixtures.reconcile.law_bits import likely_bits, of_bits, where_bits
from arl_fixtures.reconcile.law_candidates import Candidates, shared_price, varied
from arl_fixtures.reconcile.law_crossed import crossed_of
from arl_fixtures.reconcile.law_lean import leant_of
from arl_fixtures.reconcile.law_peaks import peaks_of
from arl_fixtures.reconcile.law_pixels import drifts_of
from arl_fixtures.reconcile.law_saws import PRICE_FALL, best_saw
from arl_fixtures.reconcile.law_turned import turned_of
from arl_fixtures.reconcile.law_waves import best_moving_rings, best_pair_wave, best_rings, best_wave
from arl_fixtures.reconcile.law_work import Candidate, Work
from arl_fixtures.reconcile.pilot import Looker
from arl_fixtures.reconcile.roles import FIELD_COLUMNS, PER_TURN, PIXEL, Role

MOST_LEADING = 7
PRICE_PAIR_WAVE = 7.0
IMAGE, WENT_ON = ("pixel_u", "pixel_v"), ("step", "time_s", "cycle", "stage_angle_deg")
"""Columns over which a pattern stands in the image, and over which it may move."""
MOST_WAVES, GROWING = 4, frozenset({"linear", "ratio", "log", "inverse", "above", "below", "step"})
"""Waves that are tried with another column, and functions of it with which their size may go."""
MOST_MARKS, MOST_REFINED, FEW_SETTINGS = 20, 10, 4
UNSHIFTED = frozenset({"is", "ratio", "step", "band", "peak", "above", "below", "parity", "one"})
"""Functions whose zero means something."""
ALIKE = 0.98
"""Correlation from which two columns are one for the search of pairs."""


def pool_of(work: Work, looker: Looker, leading: Sequence[str]) -> Candidates:
    """Candidates: every column alone; the leading ones also in pairs."""
    view = looker.problem.view
    signal = _signal(work)
    units = looker.problem.groups.unit_columns
    pool = Candidates(work)
    ranked: dict[str, float] = {}
    simple: dict[str, list[Candidate]] = {}
    for name, values in work.features.items():
        if name == PIXEL or name.startswith(PER_TURN):
            continue
        category = not name.startswith(("~", "sim_")) and view.is_category(name)
        labels = view.labels(name) if category else ()
        extra = price_of((name,)) + shared_price(work, (name,))
        numbered = name in units  # a number of a zone is a name, not a size
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
            step = best_step(work, name)
            if step:
                bases.append(Basis(axes=(step,), price=PRICE_STEP + extra))
            wave = best_wave(work, name)
            if wave:
                bases.append(Basis(waves=waves_of(name, wave.turns), price=PRICE_TWO + extra + wave.price))
                if wave.turns * np.ptp(values[np.isfinite(values)]) >= FEWEST_TURNS:
                    phase, more = folded(name, wave.turns), PRICE_TWO + 2.0 + extra + wave.price
                    bases.append(Basis(axes=(phase,), prior=np.eye(phase.count), price=more))
                saw = best_saw(work, name, wave.turns)
                if saw:
                    bases.append(Basis(axes=(saw,), price=PRICE_TWO + PRICE_FALL + extra + wave.price))
            for rings in (PLATE, GAP) if name == FIELD_COLUMNS[0] and in_degrees(view) else ():
                best = best_rings(work, name, rings)
                if best:
                    price = PRICE_TWO + extra + best.price
                    bases.append(Basis(waves=rings_of(name, best.turns, rings), price=price))
        ratios = [b for b in bases if _is_ratio(b)]  # alone it is a line
        made = pool.add(b for b in bases if not _is_ratio(b))
        ranked[name] = max((item.gain for item in made), default=0.0)
        plain = [m for m in made if m.basis.prior is None and not m.basis.waves and not _falls(m.basis)]
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
    marks = marks_of(work, looker)
    own = [mark for mark in marks if mark.column in units]
    pool.add(_beating(work, own, signal))
    bits = pool.add(of_bits(work, looker, signal))
    pool.add(where_bits(work, likely_bits(bits), names, simple))
    pool.add(_pairs(work, looker, names, simple))
    pool.add(_moving(work, names, (*WENT_ON, *view.temperatures()[:2])))
    pool.add(_moving_rings(work, looker, (*WENT_ON, *view.temperatures())))
    lines = [m.basis.axes[0] for n in names for m in simple.get(n, []) if m.basis.axes[0].kind == "linear"]
    numeric = [n for n in ranking if not (n in units or (not n.startswith(("~", "sim_")) and view.is_category(n)))]
    pool.add(bands_of(work, numeric, lines))
    pool.add(peaks_of(work, numeric, lines[:MOST_LINES]))
    told = [*leading, *(n for n in ranking if ranked[n] > -PRICE_ONE)]
    sizes = distinct(work, [n for n in told if not is_proxy(n) and n not in units and not view.is_category(n)])
    pool.add(leant_of(work, sizes, lines[:MOST_LINES]))
    pool.add(drifts_of(work, numeric))
    recorded = [n for n in sorted(numeric) if not n.startswith(("~", "sim_"))]
    pool.add(crossed_of(work, distinct(work, recorded), marks))
    pool.add(turned_of(work, distinct(work, recorded), marks, simple))
    pool.add(_growing(work, names, simple, pool.items))
    pool.add(_refined(work, marks, pool.items))
    return pool


def _falls(basis: Basis) -> bool:
    """Whether a basis is a ramp that falls back: found by many looks, it is no plain factor of a product."""
    return basis.axes[0].kind == "saw"


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


def _beating(work: Work, marks: Sequence[Axis], signal: Axis | None) -> Iterator[Basis]:
    """Light that comes and goes with the time: of a lamp that beats with the frames, of the neighbour of one device.

    The same to bright and dark rows or a share of their signal; waves, and pulses of any form. The marks are those of
    single devices.
    """
    if "time_s" not in work.features:
        return
    added: list[tuple[Axis, ...]] = [] if signal is None else [(signal,)]
    for more in [*added, *((mark,) for mark in marks), *((*a, mark) for a in added for mark in marks)]:
        wave = best_wave(work, "time_s", np.prod([axis(work.features) for axis in more], axis=0))
        if wave:
            price = PRICE_TWO + price_of(("time_s",)) + shared_price(work, ("time_s",)) + wave.price
            price += sum(PRICE_MARK if axis in marks else 1.0 for axis in more)
            yield Basis(waves=tuple((*product, *more) for product in waves_of("time_s", wave.turns)), price=price)
            phase = folded("time_s", wave.turns)
            yield Basis(axes=(phase, *more), prior=np.eye(phase.count), price=price + 2.0)


def _pairs(work: Work, looker: Looker, names: Sequence[str], simple: dict[str, list[Candidate]]) -> Iterator[Basis]:
    view = looker.problem.view
    curves = {name: curve_axis(name, work.features[name], KNOTS) for name in names}
    maps = {name: curve_axis(name, work.features[name], MAP_KNOTS) for name in names}
    for i, first in enumerate(names):
        for second in names[i + 1 :]:
            apart = {name: shared_price(work, (name,)) for name in (first, second)}
            price = price_of((first, second)) + PRICE_ONE + PRICE_PRODUCT + shared_price(work, (first, second))
            for a in varied(simple.get(first, [])):
                for b in varied(simple.get(second, [])):
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
                turns = best_pair_wave(work, first, second) if moves_waves(first) and moves_waves(second) else None
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
            turns = best_pair_wave(work, place, order)
            if turns is not None:
                price = price_of((place, order)) + PRICE_ONE + PRICE_PRODUCT + PRICE_PAIR_WAVE
                yield Basis(waves=waves_of(place, turns[0], order, turns[1]), price=price)


def _moving_rings(work: Work, looker: Looker, orders: Sequence[str]) -> Iterator[Basis]:
    """Rings over the field that move as a gap opens or a line drifts: interference between two faces."""
    place = FIELD_COLUMNS[0]
    if place not in work.features or not in_degrees(looker.problem.view):
        return
    for order, rings in ((n, rings) for n in orders if n in work.features for rings in (PLATE, GAP)):
        turns = best_moving_rings(work, place, order, rings)
        if turns is not None:
            price = price_of((place, order)) + PRICE_ONE + PRICE_PRODUCT + PRICE_PAIR_WAVE
            yield Basis(waves=moving_rings_of(place, turns[0], order, turns[1], rings), price=price)


def _growing(
    work: Work, names: Sequence[str], simple: dict[str, list[Candidate]], pool: Sequence[Candidate]
) -> Iterator[Basis]:
    """The strongest waves over one column, of a size that goes with another: nil somewhere, or from a place on."""
    ranked = sorted(pool, key=lambda item: -item.gain)
    waves = [item.basis for item in ranked if item.basis.waves and len(item.basis.columns) == 1]
    sizes = {name: _sizes(simple.get(name, [])) for name in names}
    prices = {name: PRICE_PRODUCT + price_of((name,)) + shared_price(work, (name,)) for name in names}
    for basis in waves[:MOST_WAVES]:
        for name in names:
            if len(distinct(work, [*basis.columns, name])) < 2:
                continue
            for axis in sizes[name]:
                yield replace(
                    basis, waves=tuple((*p, axis) for p in basis.waves), price=basis.price + prices[name]
                )  # fmt: skip


def _sizes(functions: Sequence[Candidate]) -> list[Axis]:
    """Functions of a column with which a size may go: a line that is nil in the middle only where none is at nil."""
    axes = [item.basis.axes[0] for item in varied(functions) if item.basis.axes[0].kind in GROWING]
    at_nil = any(axis.kind == "ratio" for axis in axes)
    return [axis for axis in axes if not (at_nil and axis.kind == "linear")]


def is_mark(factor: Axis, work: Work) -> bool:
    """Whether a function says where a term holds, and no more."""
    values = work.features[factor.column]
    return factor.kind == "is" or len(np.unique(values[np.isfinite(values)])) <= 2


def marks_of(work: Work, looker: Looker) -> list[Axis]:
    """Functions that are 0 but in one category, or at one of the few levels of a column that the rows tell."""
    view = looker.problem.view
    marks: list[Axis] = []
    few: list[Axis] = []
    for name, values in looker.features.items():
        if name.startswith(("~", "sim_")) or name not in work.features:
            continue
        if view.is_category(name):
            marks += axes_of(name, values, view.labels(name))
            continue
        levels = np.unique(values[np.isfinite(values)])
        if len(levels) == 2:
            width = float(levels[1] - levels[0])
            marks += [Axis(column=name, kind="linear", middle=float(x), width=width) for x in levels]
        elif 2 < len(levels) <= FEW_SETTINGS and not is_proxy(name) and name != "cycle":  # what ages goes on
            few += [Axis(column=name, kind="is", at=float(x), label=f"{x:g}") for x in levels]  # gains, exposures
    return [*marks, *few][:MOST_MARKS]


def _refined(work: Work, marks: Sequence[Axis], pool: Sequence[Candidate]) -> Iterator[Basis]:
    """The best candidates in one category, or at one of two levels, and with a free zero of their lines.

    Each may do so much more than without that it comes first only so.
    """
    kinds: set[tuple[str, ...]] = set()
    room = {True: MOST_REFINED, False: MOST_REFINED}  # what goes along with all that was set must not leave none
    for item in sorted(pool, key=lambda item: -item.gain):
        basis = item.basis
        kind = (*sorted(basis.columns), "wave" if basis.waves else "open" if basis.prior is not None else "")
        stands_for = any(is_proxy(column) for column in basis.columns)
        if not basis.columns or kind in kinds or len(item.vectors) > KNOTS or not room[stands_for]:
            continue
        kinds.add(kind)
        room[stands_for] -= 1
        yield from _zeroed(basis)
        if not any(is_mark(axis, work) for axis in basis.axes):
            for mark in marks:
                if mark.column not in basis.columns:
                    waves = tuple((*product, mark) for product in basis.waves)
                    axes = basis.axes if waves else (*basis.axes, mark)
                    yield replace(basis, axes=axes, waves=waves, price=basis.price + PRICE_MARK)


def _zeroed(basis: Basis) -> Iterator[Basis]:
    """A product with a line, whose zero the data place: without it, that is the middle of the rows."""
    if basis.prior is not None or basis.waves or len(basis.axes) != 2:
        return
    for one, other in (basis.axes, basis.axes[::-1]):
        if one.kind == "linear":
            yield Basis(waves=((other, one), (other,)), price=basis.price + PRICE_ZERO)
