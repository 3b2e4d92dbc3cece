"""What each surface of a known bench adds to a pixel's light, in a table that names no surfaces.

The bench is recognised from its light and ranges (`effects_bench`): which of its surfaces a pixel sees at a stage
angle, and how much of each at an edge, then follows from its rays.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from arl_fixtures.reconcile.effects_bench import Bench, bench_of
from arl_fixtures.reconcile.effects_common import FloatArray, per_table
from arl_fixtures.reconcile.effects_rays import look
from arl_fixtures.reconcile.view import View
from arl_fixtures.twin.scene import SceneSettings

_LEAST_SHARE, _LEAST_SPOTS = 0.02, 3
"""Share of a spot's light from which it sees a surface, and such spots that tell of it."""
_BRIGHTER = 0.01
"""Part by which a surface is made brighter to see what it adds: light is linear in it."""


def unnamed_panels(view: View) -> tuple[str, ...]:
    """Surfaces of the bench that a table shows without a column that names them, the most seen first."""
    if "surface" in view.columns.categories:
        return ()

    def find() -> tuple[str, ...]:
        bench = bench_of(view)
        if bench is None:
            return ()
        names = [bench.optics.scene.wall.name, *(panel.name for panel in bench.optics.scene.panels)]
        seen = {name: int(np.sum(_shares(view, bench, name)[0] > _LEAST_SHARE)) for name in names}
        return tuple(sorted((n for n in names if seen[n] >= _LEAST_SPOTS), key=lambda n: -seen[n]))

    return per_table(view, "unnamed panels", find)


def panel_shares(view: View, panel: str) -> tuple[FloatArray, FloatArray]:
    """A surface's share of each row's light, and of its light times range; nil where the bench is not known.

    Args:
        view: rows under work; panel: one of `unnamed_panels`.
    """
    bench = bench_of(view)
    if bench is None:
        return np.zeros(view.n), np.zeros(view.n)
    spot = bench.index[view.rows]
    light, moment = _shares(view, bench, panel)
    return light[spot], moment[spot]


def _shares(view: View, bench: Bench, name: str) -> tuple[FloatArray, FloatArray]:
    """A surface's share of each spot's light and of its light times range."""

    def make() -> tuple[FloatArray, FloatArray]:
        now = per_table(view, "bench as it is", lambda: look(bench.optics, bench.spots))
        then = look(replace(bench.optics, scene=_brighter(bench.optics.scene, name)), bench.spots)
        light, moment = ((b / np.maximum(a, 1e-300) - 1.0) / _BRIGHTER for a, b in zip(now, then, strict=True))
        return np.clip(light, 0.0, 1.0), np.clip(moment, 0.0, 1.0)

    return per_table(view, ("share of panel", name), make)


def _brighter(scene: SceneSettings, name: str) -> SceneSettings:
    more = 1.0 + _BRIGHTER
    if scene.wall.name == name:
        return scene.model_copy(
            update={"wall": scene.wall.model_copy(update={"reflectance": more * scene.wall.reflectance})}
        )
    panels = []
    for panel in scene.panels:
        if panel.name == name:
            circles = panel.circles and panel.circles.model_copy(
                update={"reflectance": more * panel.circles.reflectance}
            )
            panel = panel.model_copy(update={"reflectance": more * panel.reflectance, "circles": circles})
        panels.append(panel)
    return scene.model_copy(update={"panels": tuple(panels)})
