"""Two effects in the place of one whose parts they are: of places and of conditions, or of a signal and of a range.

A passband that angle and temperature move together is one effect, and so is a beam that widens with heat: at the edge
of the image the temperature does something else than in its middle. Where it does the same everywhere, a law of the
image and one of the temperature say as much with fewer parameters. And a law of the signal by which both signals and
ranges go is one effect only where the same strength and shape make both.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from arl_fixtures.reconcile.acceptance import Ranked
from arl_fixtures.reconcile.own_driver import driven_by
from arl_fixtures.reconcile.roles import PIXEL_COLUMNS, Role, role_of
from arl_fixtures.reconcile.scores import Candidate
from arl_fixtures.reconcile.screen import Screening
from arl_fixtures.reconcile.terms import Term

SECOND_NAME = 2.0
"""Log-likelihood, beside the price of parameters, by which two names must do better than one."""
_PLACES = PIXEL_COLUMNS | {"incidence_deg"}
_TRIED = 2


class Sides(NamedTuple):
    """Candidates for either of two effects; none where the chosen one is not of both."""

    one: list[Candidate]
    other: list[Candidate]


def sides(screening: Screening, chosen: Ranked) -> Sides:
    """Likeliest candidates of the chosen one's parts: of places and of conditions, or of a signal and of a range."""
    term = chosen.candidate.term
    like = [c for c in screening.candidates if not c.term.unit and driven_by(c.term)]
    of_each = _of_places_and_conditions(term, like) or _of_signal_and_range(term, like)
    if term.unit or of_each is None or not all(of_each):
        return Sides([], [])
    return Sides(*(part[:_TRIED] for part in of_each))


def _of_places_and_conditions(term: Term, like: Sequence[Candidate]) -> Sides | None:
    if not (driven_by(term) & _PLACES and driven_by(term) - _PLACES):
        return None
    like = [
        c for c in like if c.term.effect is not term.effect and c.term.variant.channels == term.variant.channels
    ]  # fmt: skip
    return Sides(
        [c for c in like if driven_by(c.term) <= _PLACES], [c for c in like if _is_of_conditions(c.term, term)]
    )


def _of_signal_and_range(term: Term, like: Sequence[Candidate]) -> Sides | None:
    """An amplifier that gives way ranges flattened pulses otherwise; a threshold walks without any of it."""
    signals, ranges = ({n for n in _moves(term) if role_of(n) is role} for role in (Role.INTENSITY, Role.DISTANCE))
    if not (signals and ranges and driven_by(term) <= signals):
        return None
    like = [c for c in like if driven_by(c.term) == driven_by(term)]
    one, other = ([c for c in like if _moves(c.term) <= moved] for moved in (signals, ranges))
    return Sides(one, other)


def _moves(term: Term) -> set[str]:
    return {name for name in term.variant.channels if not name.endswith("_std")}


def _is_of_conditions(term: Term, chosen: Term) -> bool:
    return not driven_by(term) & _PLACES and bool(driven_by(term) & driven_by(chosen))
