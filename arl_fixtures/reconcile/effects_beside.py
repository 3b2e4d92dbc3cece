"""What neighbours outside a table see, from the scene that a sweep shows finer than the pixels are wide."""

from __future__ import annotations

import numpy as np

from arl_fixtures.reconcile.effects_common import FloatArray, distances, per_table, signals
from arl_fixtures.reconcile.effects_illumination import azimuth, elevation, illumination, log_profile, ray_column
from arl_fixtures.reconcile.effects_pointing import changes_elsewhere
from arl_fixtures.reconcile.effects_scene import gap_of, pixel_width, scene, sweeps_pixels
from arl_fixtures.reconcile.view import View


def seen_beside(view: View, du: int, dv: int) -> tuple[FloatArray, FloatArray] | None:
    """Light of the pixel `du` columns and `dv` rows further in units of the row's own, and how much farther it sees.

    From the scene that a sweep shows finer than its pixels; which way columns and rows run does not matter to what
    asks for both sides. None where a sweep shows nothing finer.
    """
    found = scene(view)
    if found is None or not sweeps_pixels(view):
        return None
    if not per_table(view, "sees pixels", lambda: gap_of(found.line, found.bearing) < np.median(pixel_width(view))):
        return None
    turn, lift = du * pixel_width(view)[view.rows], dv * _pixel_height(view)
    changes = changes_elsewhere(view, turn, lift)
    name, far = next(iter(signals(view)), ""), next(iter(distances(view)), "")
    if name not in changes:
        return None
    ratio = changes[name]
    profile = illumination(view, name)
    if profile is not None:
        ratio = ratio * np.exp(profile.log(azimuth(view) + turn, elevation(view) + lift) - log_profile(view, name))
    return ratio, changes.get(far, np.zeros(view.n))


def _pixel_height(view: View) -> float:
    """Elevation from one image row to the next, degrees."""

    def measure() -> float:
        if not (view.varies("pixel_v") and view.varies("elevation_deg")):
            return 0.0
        row, el = view.columns.numbers["pixel_v"], ray_column(view, "elevation_deg")
        good = np.isfinite(row) & np.isfinite(el)
        centred = row[good] - row[good].mean()
        return float(centred @ el[good]) / float(centred @ centred)

    return per_table(view, "pixel height", measure)
