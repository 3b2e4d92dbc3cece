"""Channels that read the stage's angle itself: an encoder on the shaft, an autocollimator."""

from __future__ import annotations

import numpy as np

from arl_fixtures.reconcile.effects_common import per_table
from arl_fixtures.reconcile.roles import Role, unit_of
from arl_fixtures.reconcile.view import View

_FOLLOWS = 0.999
"""Correlation with the stage's angle from which a simulated angle is that of the stage."""


def encoders(view: View) -> tuple[str, ...]:
    """Channels in degrees whose simulation turns with the stage."""

    def make() -> tuple[str, ...]:
        stage = view.columns.numbers["stage_angle_deg"]
        found = []
        for channel in view.channels(Role.OTHER):
            simulated = view.columns.numbers[f"sim_{channel.name}"]
            good = np.isfinite(stage) & np.isfinite(simulated)
            if unit_of(channel.name) != "deg" or good.sum() < 3 or np.ptp(simulated[good]) == 0.0:
                continue
            if abs(np.corrcoef(stage[good], simulated[good])[0, 1]) > _FOLLOWS:
                found.append(channel.name)
        return tuple(found)

    return per_table(view, "encoders", make) if view.varies("stage_angle_deg") else ()
