"""The bench with its surfaces as far away, and as bright, as a table's own columns say.

A bench is rebuilt with the panels nearer or farther, or before another wall: what the rows of each surface agree on
is taken, the rest (bearings, sizes, circles) stays nominal. Whether that is what the simulation shows is checked on
the table like the nominal bench itself.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from arl_fixtures.reconcile.effects_camera import Camera
from arl_fixtures.reconcile.effects_common import distances
from arl_fixtures.reconcile.effects_rays import Optics, Spots, look
from arl_fixtures.reconcile.roles import per_metre, unit_of
from arl_fixtures.reconcile.view import View
from arl_fixtures.twin.scene import SceneSettings

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_SAME, _AGREE = 0.003, 0.01
"""Relative difference up to which a surface is where it nominally is, and scatter of rows that tell where it is."""
_FEWEST, _RAYS = 5, 3


def scenes_of(view: View, camera: Camera, first: IntArray) -> tuple[SceneSettings, ...]:
    """The nominal scene, and that which the table's columns tell of where it is another one.

    Args:
        view: whole table.
        camera: of its pixels.
        first: a row of each pixel at each stage angle.
    """
    nominal = SceneSettings()
    table = view.columns
    ranges = _ranges(view)
    if ranges is None or "surface" not in table.categories:
        return (nominal,)
    codes, labels = table.categories["surface"]
    u, v, stage, range_m = (x[first] for x in (*(table.numbers[n] for n in _PLACE), ranges))
    right, up = camera.angles_deg(u, v)
    level_m, azimuth = range_m * np.cos(np.radians(up)), -right - stage
    bright = table.numbers.get("reflectance")
    own = {label: codes[first] == k for k, label in enumerate(labels)}

    def told(name: str, values: FloatArray | None, usual: float) -> float:
        here = own.get(name)
        good = None if here is None or values is None else values[here & np.isfinite(values)]
        if good is None or good.size < _FEWEST:
            return usual
        middle = float(np.median(good))
        alike = float(np.median(np.abs(good - middle))) < _AGREE * abs(middle)
        return middle if alike and abs(middle - usual) > _SAME * usual else usual

    paint = None if bright is None else bright[first]
    wall = nominal.wall.model_copy(update={
        "radius_m": told(nominal.wall.name, level_m, nominal.wall.radius_m),
        "reflectance": told(nominal.wall.name, paint, nominal.wall.reflectance),
    })  # fmt: skip
    panels = tuple(
        panel.model_copy(update={
            "radius_m": told(
                panel.name, level_m * np.cos(np.radians(azimuth - panel.azimuth_deg)), panel.radius_m
            ),
            "reflectance": panel.reflectance if panel.circles else told(panel.name, paint, panel.reflectance),
        })
        for panel in nominal.panels
    )  # fmt: skip
    rebuilt = nominal.model_copy(update={"wall": wall, "panels": panels})
    if rebuilt == nominal:
        return (nominal,)
    height = np.zeros(u.size)  # ranges over their level parts do not depend on it
    spots = Spots(u=u, v=v, stage_deg=stage, height_m=height)
    light, moment = look(Optics(camera=camera, rays=_RAYS, soft_rad=0.0, scene=rebuilt), spots)
    with np.errstate(invalid="ignore", divide="ignore"):
        farther = range_m * light / moment  # a pixel's mean range is not that of its middle

    def mended(name: str, radius_m: float, usual: float) -> float:
        here = own.get(name)
        good = None if here is None or radius_m == usual else farther[here & np.isfinite(farther)]
        return radius_m if good is None or not good.size else radius_m * float(np.median(good))

    wall = wall.model_copy(update={"radius_m": mended(wall.name, wall.radius_m, nominal.wall.radius_m)})
    panels = tuple(
        panel.model_copy(update={"radius_m": mended(panel.name, panel.radius_m, usual.radius_m)})
        for panel, usual in zip(panels, nominal.panels, strict=True)
    )
    return nominal, nominal.model_copy(update={"wall": wall, "panels": panels})


_PLACE = ("pixel_u", "pixel_v", "stage_angle_deg")


def _ranges(view: View) -> FloatArray | None:
    """Range of each row in metres as the simulation or the table says."""
    if distances(view):
        name = distances(view)[0]
        return view.columns.numbers[f"sim_{name}"] / per_metre(unit_of(name))
    return view.columns.numbers.get("true_range_m")
