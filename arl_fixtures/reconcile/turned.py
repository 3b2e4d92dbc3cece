"""What a row would show if the stage stood a little farther: by it, an unknown error of the angle shows as a product.

A coupling that winds up, a clock that runs ahead of the stage, a bearing that has worn: what is wrong with the angle
goes with a speed, a time or a temperature, and each row shows it by how steep the scene is where it looks. No column
of the table has that, and no law of columns alone says what happens at every edge.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from arl_fixtures.reconcile.columns import FloatArray
from arl_fixtures.reconcile.effects_encoder import STAGE
from arl_fixtures.reconcile.effects_pointing import turn_stage
from arl_fixtures.reconcile.features import features_of
from arl_fixtures.reconcile.law import Law
from arl_fixtures.reconcile.roles import PER_TURN, Role
from arl_fixtures.reconcile.view import View

STEP_DEG = 0.02
"""Turn to either side from which the slope is taken."""


def features_for(view: View, laws: Iterable[Law]) -> dict[str, FloatArray]:
    """Every column of which laws may be, on the rows of the view; slopes only where one of them has one."""
    turned = any(term.turns for law in laws for term in law.terms)
    return features_of(view) | (per_turn(view) if turned else {})


def per_turn(view: View) -> dict[str, FloatArray]:
    """Change of every signal, as a share of it, and of every distance per degree of the stage; nil where not known.

    Args:
        view: rows under work, of a stage that turns or, as rows to be predicted may be, stands.

    Returns:
        `~per_turn(X)` to values of shape (n,), in 1/deg or the distance's unit per degree; none where no angle is.
    """
    if not view.has(STAGE):
        return {}
    ahead, behind = view.fresh_state(), view.fresh_state()
    found = {}
    with np.errstate(all="ignore"):
        turn_stage(view, ahead, STEP_DEG)
        turn_stage(view, behind, -STEP_DEG)
        for channel in view.columns.channels:
            name = channel.name
            if channel.role not in {Role.INTENSITY, Role.DISTANCE} or ahead[name] is behind[name]:
                continue
            slope = (ahead[name] - behind[name]) / (2.0 * STEP_DEG)
            if channel.role is Role.INTENSITY:
                slope = slope / view.sim[name]
            found[f"{PER_TURN}{name})"] = np.nan_to_num(slope, posinf=0.0, neginf=0.0)
    return found
