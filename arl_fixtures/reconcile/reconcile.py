"""The whole comparison: table in, diagnosis out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.columns import Columns
from arl_fixtures.reconcile.constants import constants_of, of_unseen, zeros_of
from arl_fixtures.reconcile.decide import Decision
from arl_fixtures.reconcile.diagnosis import ChannelFit, Diagnosis
from arl_fixtures.reconcile.effect import Effect
from arl_fixtures.reconcile.fitted_scales import hold_unstretched, scales_of
from arl_fixtures.reconcile.held_out import mean_square
from arl_fixtures.reconcile.model_file import ModelFile, model_of
from arl_fixtures.reconcile.rivals import is_structure
from arl_fixtures.reconcile.roles import Role
from arl_fixtures.reconcile.search import Found, Progress, Search

LOOKS = 500.0
"""Places at which structure is looked for in a channel (see `locate`)."""


def diagnose(
    columns: Columns, *, sha256: str = "", rows: int | None = None, effects: Sequence[Effect] | None = None,
    progress: Progress | None = None,
) -> tuple[Diagnosis, ModelFile, Decision]:  # fmt: skip
    """Compare a table's measured and simulated values.

    Args:
        columns: the table (or the part of it that fits into memory).
        sha256, rows: of the file, for the report.
        effects: library to use; all installed effects where None.
        progress: called with a sentence and the share done.
    """
    known = list(library().values()) if effects is None else list(effects)
    search = Search(columns, known, progress)
    found = search.run()
    decision = Decision(search, found, known)
    findings, fits = decision.run()
    fits = {name: _agreeing(name, fit, decision) for name, fit in fits.items()}
    hold_unstretched(decision)
    constants = constants_of(decision) if findings else {}
    lines = {**search.lines, **(scales_of(decision) if findings else {})}
    diagnosis = Diagnosis(
        sha256=sha256, rows=columns.n if rows is None else rows,
        channels=[d.channel.name for d in found.problem.data],
        false_alarm_probability=_chance_of(found, decision), findings=findings, fit=fits, constants=constants,
        notes={**columns.ignored, **search.failed, **found.looker.failed}, lines=lines,
    )  # fmt: skip
    relative = tuple(
        d.channel.name for d in found.problem.data if d.channel.role in {Role.INTENSITY, Role.SCATTER}
    )  # fmt: skip
    gaps = (columns.sweep_gap_deg, columns.frame_gap_s)
    model = model_of(
        diagnosis, found.problem.groups.unit_columns, relative, gaps, columns.ceilings,
        units=of_unseen(decision, constants), rays_derived=bool(columns.derived), lens=columns.lens,
        smoothed=decision.search.smoothed, zeros=zeros_of(decision, constants) if findings else None,
        lines=lines,
    )  # fmt: skip
    return diagnosis, model, decision


def _agreeing(name: str, fit: ChannelFit, decision: Decision) -> ChannelFit:
    """The agreement with its unexplained share on the scale of its mean squares.

    What columns still predict is measured on cut residuals, which a huge mismatch exceeds: set beside the drop of the
    sum of squares that the findings bring.
    """
    if fit.unexplained <= 0.0:
        return fit
    d = next(d for d in decision.problem.data if d.channel.name == name)
    rest = fit.unexplained * max(decision.found.before[name].gain, decision.after[name].gain, 1.0)
    start = mean_square(d, decision.problem.view.fresh_state(), centred=True)
    explained = 0.5 * len(d.use) * max(start - fit.after, 0.0) / d.spread**2
    return replace(fit, unexplained=rest / max(rest + explained, 1e-9))


def _chance_of(found: Found, decision: Decision) -> float:
    """Probability of the verdict's evidence without any mismatch, over all searches made."""
    p = found.stages[0].p_value if found.stages else 1.0
    if (found.best.terms or decision.laws) and any(is_structure(s) for s in found.before.values()):
        p = min(p, 1e-3)
    if decision.laws:
        p = min(p, LOOKS * float(np.exp(-max(law.gain for law in decision.laws))))
    return float(np.clip(p, 0.0, 1.0))
