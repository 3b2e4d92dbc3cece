"""What a table could not have shown: effects whose columns it lacks, or whose usual size noise and calibration hide.

A tangent per typical size, whitened and without the units' constants, has the power Σz². An amplitude of `a` typical
sizes gains ½·a²·Σz² of log-likelihood; it is seen where that passes the threshold of the search. The most favourable
way of acting counts: what is called invisible here is so in every way.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from arl_fixtures.reconcile.effect import Effect, Parameter, Variant
from arl_fixtures.reconcile.scores import tangents_of
from arl_fixtures.reconcile.terms import Term, default_values, forward

if TYPE_CHECKING:
    from arl_fixtures.reconcile.decide import Decision

NO_COLUMNS = "the table lacks the columns it needs, or they do not vary"
ANY_SIZE = "noise and calibration would hide it at any size that is physical"
NO_TRACE = "what it acts on, such as a neighbouring pixel, is not among the rows, or calibration takes all of it away"
FALLBACK_GAIN = 12.0
"""Log-likelihood to be seen, where no search set a threshold."""


def invisible_effects(decision: Decision) -> dict[str, str]:
    """Effects that may be there although nothing was found: id to the reason, in plain words.

    Effects that were found, or that the table cannot tell from one that was, are not listed.
    """
    named = {term.effect.id for term in decision.terms}
    tried: dict[str, list[tuple[Effect, Variant]]] = {}
    for effect, variant in decision.search.variants:
        tried.setdefault(effect.id, []).append((effect, variant))
    reasons: dict[str, str] = {}
    for effect in decision.effects:
        if effect.id in named:
            continue
        if effect.id in tried:
            reason = _smallest_seen(decision, tried[effect.id])
            if reason:
                reasons[effect.id] = reason
        elif not any(True for _ in effect.variants(decision.search.small.view)):
            reasons[effect.id] = NO_COLUMNS
    return dict(sorted(reasons.items()))


def _smallest_seen(decision: Decision, variants: list[tuple[Effect, Variant]]) -> str:
    """Why the effect's typical size is not seen; empty where it would be."""
    problem, others = decision.search.small, decision.best.terms
    base = forward(others, problem.view)
    stages = decision.found.stages
    needed = stages[0].threshold if stages else FALLBACK_GAIN
    best, sized = np.inf, None
    for effect, variant in variants:
        term = Term(effect=effect, variant=variant, values=default_values(variant))
        amplitudes = [p for p in variant.amplitudes() if not p.per]
        for p, z in zip(amplitudes, tangents_of(problem, others, base, term), strict=True):
            power = float(z @ z)
            share = np.sqrt(2.0 * needed / power) if power > 0 else np.inf
            if share < best:
                best, sized = share, p
        if best <= 1.0:
            return ""
    if sized is None:
        return NO_TRACE
    if best > _largest(sized):
        return ANY_SIZE
    unit = "" if sized.unit == "1" else f" {sized.unit}"
    return (
        f"'{sized.name}' would show only beyond {best * abs(sized.typical):.2g}{unit} "
        f"(usual: {abs(sized.typical):.2g}{unit})"
    )


def _largest(p: Parameter) -> float:
    """Largest amplitude that is physical, in typical sizes."""
    null = p.null if p.null is not None else 0.0
    return max(abs(p.high - null), abs(p.low - null)) / abs(p.typical)
