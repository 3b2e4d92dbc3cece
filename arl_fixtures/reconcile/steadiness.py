"""Whether a name holds wherever it acts: its strength, fitted anew in each bin of a column, must stay what it is.

An effect's law says how its change varies over the rows. What remains to every bin of a column is one common factor,
which is 1 for a true effect up to noise, and up to the part by which a real one's shape differs from the library's. A
name that stands only because its pattern resembles another's on average has a factor that moves with what drives the
other: a fixed pattern of pixels that comes and goes with the temperature is none.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import compress

import numpy as np
from numpy.typing import NDArray

from arl_fixtures.reconcile.cells import within_cells
from arl_fixtures.reconcile.channel_data import ChannelData
from arl_fixtures.reconcile.columns import FloatArray, IntArray
from arl_fixtures.reconcile.effect import Stage, State
from arl_fixtures.reconcile.effects_common import pure_rows
from arl_fixtures.reconcile.noise import fit_tau
from arl_fixtures.reconcile.own_driver import cells_of, driven_by
from arl_fixtures.reconcile.pilot import Looker
from arl_fixtures.reconcile.problem import Problem
from arl_fixtures.reconcile.roles import PER_TURN, Role
from arl_fixtures.reconcile.step_means import places_of
from arl_fixtures.reconcile.terms import Term, forward
from arl_fixtures.reconcile.unit_strengths import factors_of

BINS = 12
UNSTEADY, UNSTEADY_EXACT, UNSTEADY_WEATHER = 0.3, 0.15, 0.5
"""Standard deviation of a name's factor between bins, each counting by what the name changes there, from which it is
not that effect: shapes differ by less, those of plain numbers not at all, and those that hang on the day by more."""
SPARSE = 0.5
"""Share of an image's pixels below which a table holds few."""
OF_PLACES = 0.5
"""Share of a column's variance between what pixels see from which it tells of that rather than of conditions."""
UNSTEADY_GAIN = 6.0
"""Log-likelihood of such a scatter: among some twenty columns that tell something of their own, chance gives it once
in two hundred names."""
OVERSHADOWING = 1e4
"""Squares by which others change a channel more than a name does, from which a hundredth of theirs is all of it."""
FEWEST_IMAGES = 12
"""Images beyond one in each bin from which their own scatter is known."""
STAYS, AGAIN = 0.8, 0.5
"""Share of a change's variance that what rays see must tell where it stays, and most places a row for that."""
LEAST_PURE, OF_PURE = 0.3, 0.15
"""Share of the rows that see one surface from which a clock's error must show in these, and share of its change."""
CALM, LEAST_CALM = 0.02, 0.25
"""Part of the most that weather or edges change up to which a row is free of them, and share of rows that must be."""


def is_asked(term: Term) -> bool:
    """Whether `is_unsteady` asks a term whatever the table; of what only displaces rays it asks what stays."""
    return not (term.variant.rough or _displaces(term))


def _displaces(term: Term) -> bool:
    return term.effect.displaces and not term.effect.mixes


def is_unsteady(looker: Looker, terms: Sequence[Term], term: Term) -> bool:
    """Whether the strength of one of the terms moves by much with a column.

    What mixes a pixel with its neighbours changes edges as roughly as its errors are, but by the same whenever the
    pixel sees the same: it is asked for what changes meanwhile; and so is what happens in pixels that see two
    surfaces, as no column tells where in a pixel the edge lies, and what comes from pixels of which the table holds
    few: others stand for them. Of what displaces rays only what stays where it is is asked, and so: as it grows,
    other edges come in.
    What a strong name's law leaves along its own drivers is not held against another: it is asked within cells of
    these.
    """
    if term.variant.rough:
        return False
    problem = looker.problem
    in_pixels = term.effect.displaces or term.effect.at_borders or (term.effect.mixes and _is_sparse(problem))
    place = places_of(problem) if in_pixels else None
    full, rest = forward(terms, problem.view), forward([t for t in terms if t is not term], problem.view)
    acting = [
        d for d in problem.data
        if full[d.channel.name] is not rest[d.channel.name] and d.channel.role is not Role.SCATTER
    ]  # fmt: skip
    if not acting:
        return False
    if term.fields:  # beside a scatter of pixels next to nothing is left of what pixels differ by
        acting = [replace(d, tau={**d.tau, "pixel": 0.0}) for d in acting]
    change = [d.whiten(d.expect * (full[d.channel.name] - rest[d.channel.name])[d.use]) for d in acting]
    if _displaces(term) and not _stays(change, acting, place):
        return False
    if _acts_in_mixed(term, acting, change, problem):
        return True
    clear = [not _overshadowed(d, c, rest, problem) for d, c in zip(acting, change, strict=True)]
    if any(clear):
        acting, change = list(compress(acting, clear)), list(compress(change, clear))
    left = [d.whiten(d.residual(full)) for d in acting]
    if not _moves(looker, term, acting, change, left, place):
        return False
    quiet = _quiet_rows(terms, term, acting, full, problem)
    if quiet is not None:
        change = [c * q for c, q in zip(change, quiet, strict=True)]
        left = [x * q for x, q in zip(left, quiet, strict=True)]
    for other in terms:
        cell = None
        if other is not term and not driven_by(other) & driven_by(term):
            cell = cells_of(problem.view, other.variant.drivers)
        if cell is not None:
            change = [within_cells(c, cell[d.use]) for c, d in zip(change, acting, strict=True)]
            left = [within_cells(x, cell[d.use]) for x, d in zip(left, acting, strict=True)]
    return _moves(looker, term, acting, change, left, place)


def _acts_in_mixed(
    term: Term, acting: Sequence[ChannelData], change: Sequence[FloatArray], problem: Problem
) -> bool:
    """Whether an error of the clock that times all pulses, or of the pixels, is on hardly any row of one surface.

    Pixels of two surfaces have ranges that no other has. A wave over the range then bends what they alone show. And
    a scene that stands elsewhere changes pixels at its edges, as if they differed.
    """
    of_pixels = bool(term.fields) and not term.effect.sparse
    if not (term.effect.stage is Stage.TIMING or of_pixels) or term.effect.at_borders:
        return False
    pure = pure_rows(problem.view)[problem.view.rows]
    one = [pure[d.use] for d in acting]
    power = sum(float(c @ c) for c in change)
    of_pure = sum(float(c[p] @ c[p]) for c, p in zip(change, one, strict=True))
    return float(np.mean(np.concatenate(one))) > LEAST_PURE and of_pure < OF_PURE * power


def _stays(change: Sequence[FloatArray], acting: Sequence[ChannelData], place: IntArray | None) -> bool:
    """Whether a change is the same whenever a ray sees the same, and rays see it more than once."""
    if place is None:
        return False
    told = [_told_by(place[d.use], c) for c, d in zip(change, acting, strict=True)]
    again = all(np.unique(place[d.use]).size < AGAIN * d.use.size for d in acting)
    return again and min(told) > STAYS


def _is_sparse(problem: Problem) -> bool:
    """Whether the table holds less than half of the pixels between its first and last columns and rows."""
    numbers, area = problem.columns.numbers, 1.0
    axes = [name for name in ("pixel_u", "pixel_v") if problem.view.varies(name)]
    for name in axes:
        area *= 1.0 + float(np.nanmax(numbers[name]) - np.nanmin(numbers[name]))
    return bool(axes) and 1.0 + float(problem.columns.group(*axes).max()) < SPARSE * area


def _quiet_rows(
    terms: Sequence[Term], term: Term, acting: Sequence[ChannelData], full: State, problem: Problem
) -> list[NDArray[np.bool_]] | None:
    """Rows on which nothing acts beside a term whose errors are rough; None where all is plain, or hardly a row is.

    Frost hangs on each day's moisture: what its law leaves on one day and not on the other says nothing of a name
    that grows from day to day. And what a displaced or blurred ray leaves at an edge says nothing of the surfaces.
    """
    rough = [
        t for t in terms if t is not term and (t.effect.weather or t.effect.displaces > term.effect.displaces)
    ]  # fmt: skip
    if not rough:
        return None
    without = forward([t for t in terms if t not in rough], problem.view)
    quiet = []
    for d in acting:
        moved = np.abs(full[d.channel.name] - without[d.channel.name])[d.use]
        quiet.append(moved <= CALM * float(moved.max()))
    if not any(np.any(~q) for q in quiet) or sum(map(np.sum, quiet)) < LEAST_CALM * sum(map(len, quiet)):
        return None
    return quiet


def _overshadowed(d: ChannelData, change: FloatArray, rest: State, problem: Problem) -> bool:
    """Whether other names change a channel by so much more that what they leave there drowns this one's change."""
    name = d.channel.name
    other = d.whiten(d.expect * (rest[name] - problem.view.sim[name])[d.use])
    return float(other @ other) > OVERSHADOWING * float(change @ change)


def _moves(
    looker: Looker,
    term: Term,
    acting: Sequence[ChannelData],
    change: Sequence[FloatArray],
    left: Sequence[FloatArray],
    place: IntArray | None,
) -> bool:
    """Whether a term's factor moves with a column; change and left are whitened, by channel."""
    power = np.concatenate([c * c for c in change])
    score = np.concatenate([c * x for c, x in zip(change, left, strict=True)])
    image: IntArray | None = looker.problem.groups.frame
    if image is not None:
        taken = np.concatenate([image[looker.problem.view.rows[d.use]] for d in acting])
        image = np.unique(taken, return_inverse=True)[1].astype(np.int64)
    most = UNSTEADY_EXACT if term.effect.exact else UNSTEADY_WEATHER if term.effect.weather else UNSTEADY
    for name, values in looker.features.items():
        if name.startswith(PER_TURN) or (place is not None and _told_by(place, values) > OF_PLACES):
            continue
        here = np.concatenate([values[d.use] for d in acting])
        tau, gain = factor_scatter(here, power, score, image)
        moving = gain > UNSTEADY_GAIN and tau > most
        if moving and not (name in looker.problem.groups.unit_columns and acts_in_all(here, power, score)):
            return True
    return False


def acts_in_all(unit: FloatArray, power: FloatArray, score: FloatArray) -> bool:
    """Whether a change acts in every unit, if more in one than in another: units are not alike."""
    code = _bins(unit)
    total, pull = (np.asarray(np.bincount(code, x), dtype=np.float64) for x in (power, score))
    return factors_of(total, pull) is not None


def _told_by(place: IntArray, values: FloatArray) -> float:
    """Share of a column's variance that places hold; all of it where each is seen once."""
    seen = np.isfinite(values)
    code, x = np.unique(place[seen], return_inverse=True)[1], values[seen]
    total = float(np.var(x)) if x.size else 0.0
    if total <= 0.0:
        return 1.0
    mean = np.bincount(code, x) / np.maximum(np.bincount(code), 1)
    return float(np.var(mean[code])) / total


def factor_scatter(
    values: FloatArray, power: FloatArray, score: FloatArray, image: IntArray | None = None
) -> tuple[float, float]:
    """Scatter of a change's factor between the bins of a column, and what a scatter gains in log-likelihood.

    The scatter is beyond what noise makes, the noise being that of the rows on which the change acts, within bins: a
    few that lie far off are no other factor. Each bin counts by the change's power in it: where an effect hardly acts
    (a beam that moves, in its middle), a small error is a large factor. Where rows of an image are off together (a
    stage that did not stand where it was sent moves all edges that it saw), images are what bins have several of.

    Args:
        values: of the column; power: the whitened change squared; score: times what is left.
        image: of each row, 0…k−1; None where the table has none.
    """
    code = _bins(values)
    total, pull = (np.asarray(np.bincount(code, x), dtype=np.float64) for x in (power, score))
    if total.sum() <= 0.0:
        return 0.0, 0.0
    there = total > 0.0
    factor = np.divide(pull, total, out=np.zeros_like(pull), where=there)
    rest = score - factor[code] * power
    noise = max(float(np.sum(rest**2) / total.sum()), _noise_of_images(rest, power, code, image), 1.0)
    pull = pull - total * (pull.sum() / total.sum())
    gain = fit_tau(pull / noise, total / noise, lost=1.0)[1]
    beyond = float(np.sum(pull[there] ** 2 / total[there])) - noise * (int(there.sum()) - 1)
    return float(np.sqrt(max(beyond, 0.0) / total.sum())), gain


def _noise_of_images(rest: FloatArray, power: FloatArray, code: IntArray, image: IntArray | None) -> float:
    """Variance per power of what images leave as wholes within bins, 0 where bins hold hardly more than one each."""
    if image is None:
        return 0.0
    acting = np.count_nonzero(np.bincount(image, power))
    free = acting - np.unique(code[power > 0.0]).size
    if free < FEWEST_IMAGES:
        return 0.0
    return float(np.sum(np.bincount(image, rest) ** 2) / power.sum()) * acting / free


def _bins(values: FloatArray) -> IntArray:
    """Bins of as many rows each, levels where they are few; rows without a value make their own."""
    seen = np.isfinite(values)
    levels = np.unique(values[seen])
    cuts = (levels[1:] + levels[:-1]) / 2.0
    if len(levels) > BINS:
        cuts = np.unique(np.quantile(values[seen], np.linspace(0.0, 1.0, BINS + 1)[1:-1]))
    code = np.searchsorted(cuts, np.where(seen, values, 0.0))
    return np.where(seen, code, len(cuts) + 1).astype(np.int64)
