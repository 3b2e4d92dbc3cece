"""How obliquely the surfaces are seen that share a pixel: a row's own angle is that of the one in its middle."""

from __future__ import annotations

import numpy as np

from arl_fixtures.reconcile.effects_bounce import incidence_deg
from arl_fixtures.reconcile.effects_common import FloatArray
from arl_fixtures.reconcile.effects_surface import IntArray, light_share, mixed_rows, neighbours, surface_names
from arl_fixtures.reconcile.view import View

_MOST_SURFACES = 24


def seen_in_mixed(view: View, channel: str) -> tuple[IntArray, dict[str, tuple[FloatArray, FloatArray]]]:
    """Rows under work that see several surfaces, and each surface's share of their light and its incidence there.

    A surface that is not in a pixel's middle is seen as the next pixels and stage angles see it that look at it.

    Returns:
        rows, (m,); by surface its share, (m,), and its angle of incidence in degrees, (m,).
    """
    at, angle = np.flatnonzero(mixed_rows(view)), incidence_deg(view)
    if angle is None or not at.size or not view.labels("surface"):
        return at[:0], {}
    codes, labels = view.codes("surface")
    own = angle[view.rows]
    near = neighbours(view, "incidence_deg") if "incidence_deg" in view.columns.numbers else []
    seen: dict[str, tuple[FloatArray, FloatArray]] = {}
    for name in surface_names(view, _MOST_SURFACES):
        share = light_share(view, channel, name)[at]
        if not np.any(share > 0.0):
            continue
        index = labels.index(name)
        total, count = np.zeros(view.n), np.zeros(view.n)
        for code, values in near:
            there = (code == index) & np.isfinite(values)
            total, count = total + np.where(there, values, 0.0), count + there
        beside = np.where(count > 0, total / np.maximum(count, 1.0), own)
        seen[name] = share, np.where(codes == index, own, beside)[at]
    return at, seen
