"""One cause rather than two: what cannot be told from a name that another channel bears has that name, too.

A lens takes the light of the corners from a laser's image and from that of the sun. In the one a second effect may do
by a little better in its place, and nothing tells it from the first; two lenses with an effect each are less likely.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from arl_fixtures.reconcile.diagnosis import Finding
from arl_fixtures.reconcile.fit import finish, fit
from arl_fixtures.reconcile.in_place import others_in_place, without_name
from arl_fixtures.reconcile.one_cause import conditions

if TYPE_CHECKING:
    from arl_fixtures.reconcile.decide import Decision


def share_names(decision: Decision, findings: Sequence[Finding]) -> bool:
    """Give a name the one of another channel's that cannot be told from it; tells whether any took one.

    Args:
        decision: with its names.
        findings: of the names, in their order.
    """
    for index, finding in enumerate(findings):
        for other in findings:
            if _may_share(finding, other) and _takes(decision, index, other.effect):
                return True
    return False


def _may_share(finding: Finding, other: Finding) -> bool:
    """Whether a finding is not told from the effect of another one of other channels, under the same conditions."""
    return (
        other.effect in finding.equivalent_to
        and finding.effect != other.effect
        and not set(finding.channels) & set(other.channels)
        and finding.term is not None and other.term is not None and finding.term.unit == other.term.unit
        and conditions(finding) == conditions(other)
    )  # fmt: skip


def _takes(decision: Decision, index: int, name: str) -> bool:
    """Put the best variant of another effect in a name's place, if it still cannot be told from it."""
    without, gain = without_name(decision, index)
    for ranked, _deficit, alike in others_in_place(decision, index, without, gain):
        if ranked.fit.terms[-1].effect.id == name and alike:
            terms = list(decision.best.terms)
            terms[index] = ranked.fit.terms[-1]
            decision.best = finish(decision.problem, fit(decision.problem, tuple(terms), rounds=4))
            decision.look()
            return True
    return False
