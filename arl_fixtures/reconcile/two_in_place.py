"""Two effects in the place of one: a law of places and conditions together, where neither changes the other's part.

A passband that angle and temperature move together is one effect, and so is a beam that widens with heat: at the edge
of the image the temperature does something else than in its middle. Where it does the same everywhere, a law of the
image and one of the temperature say as much with fewer parameters.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import product

from arl_fixtures.reconcile.acceptance import Ranked
from arl_fixtures.reconcile.own_driver import driven_by
from arl_fixtures.reconcile.roles import PIXEL_COLUMNS
from arl_fixtures.reconcile.scores import Candidate
from arl_fixtures.reconcile.screen import Screening
from arl_fixtures.reconcile.terms import Term

SECOND_NAME = 2.0
"""Log-likelihood, beside the price of parameters, by which two names must do better than one."""
_PLACES = PIXEL_COLUMNS | {"incidence_deg"}
_TRIED = 2


def sides(screening: Screening, chosen: Ranked) -> list[Candidate]:
    """Likeliest candidates of places alone and of conditions alone; none where the chosen one is not of both."""
    term = chosen.candidate.term
    if term.unit or not (driven_by(term) & _PLACES and driven_by(term) - _PLACES):
        return []
    like = [
        c for c in screening.candidates
        if not c.term.unit and c.term.effect is not term.effect
        and c.term.variant.channels == term.variant.channels and driven_by(c.term)
    ]  # fmt: skip
    of_places = [c for c in like if driven_by(c.term) <= _PLACES]
    of_conditions = [c for c in like if _is_of_conditions(c.term, term)]
    return [*of_places[:_TRIED], *of_conditions[:_TRIED]] if of_places and of_conditions else []


def pairs(ranked: Sequence[Ranked]) -> Iterator[tuple[Ranked, Ranked]]:
    """Each candidate of places with each of conditions."""
    of_places = [r for r in ranked if driven_by(r.candidate.term) <= _PLACES]
    return product(of_places, [r for r in ranked if r not in of_places])


def _is_of_conditions(term: Term, chosen: Term) -> bool:
    return not driven_by(term) & _PLACES and bool(driven_by(term) & driven_by(chosen))
