"""Where a mismatch sits: the shortest range of a column that holds nearly all of its energy."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from arl_fixtures.reconcile.columns import FloatArray, IntArray
from arl_fixtures.reconcile.roles import FIELD_COLUMNS, MADE_OF, Role, played, role_of
from arl_fixtures.reconcile.view import View

HOLDS = 0.95
NARROWER_THAN = 0.6


def rows_of_most(power: FloatArray, share: float) -> IntArray:
    """Fewest rows that hold a share of the power, the strongest first."""
    order = np.argsort(-power)
    return order[: int(np.searchsorted(np.cumsum(power[order]), share * float(power.sum()))) + 1]


def energy_region(values: FloatArray, power: FloatArray) -> list[float] | None:
    """Shortest interval of a column with `HOLDS` of the power; None where it is hardly a part."""
    good = np.isfinite(values) & np.isfinite(power)
    x, p = values[good], power[good]
    if len(x) < 8 or p.sum() <= 0:
        return None
    order = np.argsort(x, kind="stable")
    x, total = x[order], np.cumsum(p[order])
    span = float(x[-1] - x[0])
    if span <= 0:
        return None
    starts = np.linspace(0, len(x) - 1, min(len(x), 400)).astype(int)
    before = np.where(starts > 0, total[starts - 1], 0.0)
    ends = np.searchsorted(total, before + HOLDS * total[-1])
    fits = ends < len(x)
    if not fits.any():
        return None
    width = x[ends[fits]] - x[starts[fits]]
    best = int(np.argmin(width))
    if width[best] > NARROWER_THAN * span:
        return None
    return [float(x[starts[fits][best]]), float(x[ends[fits][best]])]


def _as_predicted(column: str, view: View) -> str:
    """The column of a quantity that rows to be predicted have, too; of a temperature the one that is logged."""
    simulated = f"sim_{column}"
    return simulated if view.has(simulated) and role_of(column) is not Role.TEMPERATURE else column


def columns_as_drivers(names: Sequence[str], view: View) -> list[str]:
    """Feature names as columns of the table: derived features give the columns that they are made of."""
    drivers: list[str] = []
    for name in names:
        if not name.startswith("~"):
            parts = [name]
        elif name.startswith("~parity"):
            parts = [re.sub(r"~parity\((.*)\)", r"\1", name)]
        elif name.startswith("~within"):
            parts = ["time_s"]
        elif played(name):
            parts = ["ramp", played(name)]
        elif name in MADE_OF:
            parts = list(MADE_OF[name])
        elif name.startswith("~edge"):
            parts = ["pixel_u", "pixel_v"]
        elif name in FIELD_COLUMNS:
            rays = all(view.varies(r) and r not in view.columns.derived for r in ("azimuth_deg", "elevation_deg"))
            parts = ["azimuth_deg", "elevation_deg"] if rays else ["pixel_u", "pixel_v"]
        elif name.startswith("~frame"):
            parts = ["stage_angle_deg", re.sub(r"~frame\((.*)\)", r"\1", name)]
        else:
            parts = ["stage_angle_deg"]
        drivers += [_as_predicted(p.removeprefix("sim_"), view) for p in parts]
    return [d for k, d in enumerate(drivers) if d not in drivers[:k] and view.has(d)]
