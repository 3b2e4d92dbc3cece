"""Whether an effect acts by a driver of its own: what it gains where all that drives another one stays the same.

No law of the library is quite the real one. Of a strong effect it leaves some per cent, along the columns that drive
it, and what happens to go with these columns finds a gain there. Cells of the strong one's drivers tell: within them
it says the same of all rows, and whatever its shape should be, it leaves the differences to others.
"""

from __future__ import annotations

from collections.abc import Collection, Container, Sequence

import numpy as np

from arl_fixtures.reconcile.cells import FEWEST_IN_CELL, PARTS, alike_in, parts_of, within_cells
from arl_fixtures.reconcile.columns import FloatArray, IntArray
from arl_fixtures.reconcile.effects_common import is_of
from arl_fixtures.reconcile.problem import Problem
from arl_fixtures.reconcile.roles import MADE_OF, told_by, unit_of
from arl_fixtures.reconcile.terms import Term, forward
from arl_fixtures.reconcile.view import View

OWN_SHARE, OWN_GAIN = 0.2, 6.0
"""Share of a further effect's gain that must lie within cells of an earlier one's drivers, and how much: of a change
that grows from none with a driver of its own more than half is the same in all cells."""
FINE_PARTS, FINE_ROWS, FINE_GAIN = 200, 4 * FEWEST_IN_CELL, 12.0
"""Parts of a driver's range within which no curve over it changes, rows in each at least, and what is clear there."""
MAIN_SHARE = 0.2
"""Share of what an effect moves from which a channel is one that it acts in, not one that it touches."""

_PARTS = {
    "laser": ("laser", "diode", "heatsink", "sink", "emitter", "vcsel"),
    "detector": ("detector", "apd", "spad", "tof", "photodiode", "pd"),
}
"""Family of effects to the words by which a temperature is that part's."""


def drives_another_part(term: Term) -> bool:
    """Whether a temperature that drives an effect is another part's by its name, not its own's, or only asked for."""
    own = _PARTS.get(term.effect.id.split(".")[0])
    temperatures = [name for name in term.variant.drivers if unit_of(name) == "°C"]
    if any(name.startswith("set_") for name in temperatures):
        return True
    if own is None or any(is_of(name, *own) for name in temperatures):
        return False
    return any(is_of(name, *words) for words in _PARTS.values() for name in temperatures)


def driven_by(*terms: Term) -> set[str]:
    """What drives effects."""
    return {told_by(name) for term in terms for name in term.variant.drivers}


def says_of(column: str, own: Container[str]) -> bool:
    """Whether a column may say something of what drives an effect (`told_by`): one derived from it, or from rows."""
    parts = MADE_OF.get(column, (column,))
    return any(part.startswith("~") or told_by(part) in own for part in parts)


def cells_of(view: View, names: Sequence[str], parts: int = PARTS) -> IntArray | None:
    """Cell of each row: drivers that vary, each cut into parts of as many rows (of a channel
    its simulation, which has no noise); None where too few rows share one."""
    simulated = [f"sim_{name}" if view.varies(f"sim_{name}") else name for name in names]
    drivers = [name for name in simulated if view.is_category(name) or view.varies(name)]
    if not drivers:
        return None
    codes = [view.codes(n)[0] if view.is_category(n) else np.nan_to_num(view.number(n)) for n in drivers]
    return alike_in([parts_of(values, parts) for values in codes])


def has_own_driver(problem: Problem, terms: Sequence[Term], term: Term) -> bool:
    """Whether the last of the terms gains enough where all that drives an earlier one of like drivers stays the same.

    What mends a law of some columns is another law of these, unless it acts on other rows: an offset and a gain of
    one temperature differ by the signal. So one without a column of its own must gain beside an earlier one whose
    strength is free in every cell.
    """
    cell = cells_of(problem.view, term.variant.drivers)
    if cell is None:
        return False
    alike = term if driven_by(terms[-1]) <= driven_by(term) else None
    whole, own = _gains(problem, terms, cell, beside=alike)
    return own > max(OWN_GAIN, OWN_SHARE * whole)


def mends_shape(problem: Problem, terms: Sequence[Term], term: Term) -> bool:
    """Whether the last of the terms, of other drivers, gains next to nothing where what drives a strong one stays.

    Asked of what one column drives, whose cells do not tell single steps or images.
    """
    if len(driven_by(term)) != 1:
        return False
    cell = cells_of(problem.view, term.variant.drivers[:1])
    if cell is None:
        return False
    whole, own = _gains(problem, terms, cell)
    if own >= OWN_SHARE * whole or _clear_in_fine_cells(problem, terms, term):
        return False
    there, _ = _gains(problem, terms, cell, channels=_mainly_in(problem, terms, term))
    return there > 0.5 * whole


def _clear_in_fine_cells(problem: Problem, terms: Sequence[Term], term: Term) -> bool:
    """Whether the last of the terms gains clearly where rows have next to the same of what drives an earlier one.

    Glare is a curve over the signal for its greatest part, and so is what a compression's law leaves: only that it
    differs from image to image tells it, by a small share of what it moves.
    """
    fine = cells_of(problem.view, term.variant.drivers[:1], min(FINE_PARTS, len(problem.view.rows) // FINE_ROWS))
    return fine is not None and _gains(problem, terms, fine)[1] > FINE_GAIN


def _mainly_in(problem: Problem, terms: Sequence[Term], term: Term) -> set[str]:
    """Channels that an earlier term moves for a good part: what it does to others on the side has hardly a shape."""
    before = forward(terms[:-1], problem.view)
    rest = forward([t for t in terms[:-1] if t is not term], problem.view)
    energy = {}
    for d in problem.data:
        name = d.channel.name
        change = d.whiten(d.expect * (before[name] - rest[name])[d.use]) if before[name] is not rest[name] else None
        energy[name] = 0.0 if change is None else float(change @ change)
    return {name for name, found in energy.items() if found > MAIN_SHARE * sum(energy.values())}


def _gains(
    problem: Problem, terms: Sequence[Term], cell: IntArray, *, beside: Term | None = None,
    channels: Collection[str] | None = None,
) -> tuple[float, float]:  # fmt: skip
    """Log-likelihood that the last of the terms gains, and what it gains within cells or beside a term free there."""
    view = problem.view
    before, after = forward(terms[:-1], view), forward(terms, view)
    rest = before if beside is None else forward([t for t in terms[:-1] if t is not beside], view)
    whole = own = 0.0
    for d in problem.data:
        name = d.channel.name
        if after[name] is before[name] or (channels is not None and name not in channels):
            continue
        change = d.whiten(d.expect * (after[name] - before[name])[d.use])
        left = d.whiten(d.residual(before))
        whole += float(change @ left - 0.5 * change @ change)
        here = cell[d.use]
        if beside is None:
            within = within_cells(change, here)
        else:
            earlier = d.whiten(d.expect * (before[name] - rest[name])[d.use])
            within = _beside(change, earlier, here)
        own += float(within @ left - 0.5 * within @ within)
    return whole, own


def _beside(change: FloatArray, earlier: FloatArray, cell: IntArray) -> FloatArray:
    """What a change holds that no strength of an earlier one makes, whichever it has in each cell."""
    top, bottom = np.bincount(cell, change * earlier), np.bincount(cell, earlier * earlier)
    return np.asarray(change - (top / np.maximum(bottom, 1e-300))[cell] * earlier)
