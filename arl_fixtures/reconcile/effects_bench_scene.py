"""The bench with its surfaces as far away, and as bright, as a table's own columns say.

A bench is rebuilt with the panels nearer or farther, or before another wall: what the rows of each surface agree on
is taken, the rest (bearings, sizes, circles) stays nominal. Whether that is what the simulation shows is checked on
the table like the nominal bench itself. A simulated range may hold a constant of each unit's calibration, and a
signal a gain and a zero: these are solved for beside the surfaces.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from arl_fixtures.reconcile.effects_camera import Camera
from arl_fixtures.reconcile.effects_common import distances, pure_rows, signals
from arl_fixtures.reconcile.effects_rays import Optics, Spots, look
from arl_fixtures.reconcile.roles import per_metre, unit_of
from arl_fixtures.reconcile.view import View
from arl_fixtures.twin.scene import SceneSettings

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_SAME, _AGREE = 0.003, 0.01
"""Relative difference up to which a surface is where it nominally is, and scatter of rows that tell where it is."""
_FEWEST, _MOST, _RAYS = 2, 20_000, 3
"""Rows that tell of a surface at least, rows of all surfaces that are asked at most, and rays across a pixel."""
_WITHIN, _BEYOND = 0.5, 1.4
"""Shares of half a panel's angle within which a ray meets it at any radius, and beyond which at none."""
_ROUNDS, _WIDTHS = 30, (3e-2, 3e-5)
"""Rounds of a fit that rows must agree on, and the relative error up to which they do: in the first, in the last."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Seen:
    """What pixels see at stage angles, one row each: only such that see one surface.

    Attributes:
        surface: number of the surface, in the scene's order (the wall first), −1 for others; unit: of the device.
        spots, beam: what is looked at, through which illumination.
        longer: the range over a surface's radius, as a sensor on the axis sees the middle of the pixel.
    """

    surface: IntArray
    unit: IntArray
    spots: Spots
    beam: FloatArray
    longer: FloatArray


def scenes_of(view: View, camera: Camera, first: IntArray) -> tuple[SceneSettings, ...]:
    """The nominal scene, and that which the table's columns tell of where it is another one.

    Args:
        view: whole table.
        camera: of its pixels.
        first: a row of each pixel at each stage angle.
    """
    nominal = SceneSettings()
    first = first[np.unique(np.linspace(0, first.size - 1, min(_MOST, first.size)).astype(np.int64))]
    seen = _seen(view, camera, first, nominal)
    rebuilt = _placed(view, first, seen, nominal)
    if rebuilt is None:
        return (nominal,)
    rebuilt = _mended(view, camera, first, seen, rebuilt)
    rebuilt = _painted(view, camera, first, seen, rebuilt)
    return (nominal,) if rebuilt == nominal else (nominal, rebuilt)


def _seen(view: View, camera: Camera, first: IntArray, scene: SceneSettings) -> _Seen:
    table = view.columns
    u, v, stage = (table.numbers[n][first] for n in _PLACE)
    right, up = camera.angles_deg(u, v)
    if "surface" in table.categories:
        codes, labels = table.categories["surface"]
        names = (scene.wall.name, *(panel.name for panel in scene.panels))
        known = np.array([names.index(label) if label in names else -1 for label in labels] + [-1])
        surface = known[codes[first]]
    else:
        surface = _by_bearing(-right - stage, up, scene)
    azimuth = np.array([0.0, *(panel.azimuth_deg for panel in scene.panels)])
    aside = np.where(surface > 0, -right - stage - azimuth[surface], 0.0)
    longer = 1.0 / (np.cos(np.radians(up)) * np.cos(np.radians(aside)))
    surface = np.where(pure_rows(view)[first], surface, -1)
    return _Seen(
        surface=surface, unit=table.group("dut")[first], longer=longer, beam=np.exp(camera.log_beam(u, v)),
        spots=Spots(u=u, v=v, stage_deg=stage, height_m=np.zeros(u.size)),
    )  # fmt: skip


def _by_bearing(bearing_deg: FloatArray, up_deg: FloatArray, scene: SceneSettings) -> IntArray:
    """Surface that a ray meets for sure, wherever within some tens of percent the panels stand; −1 where none."""
    surface = np.zeros(bearing_deg.size, dtype=np.int64)
    for k, panel in enumerate(scene.panels):
        wide, tall = (np.degrees(np.arctan(0.5 * m / panel.radius_m)) for m in (panel.width_m, panel.height_m))
        aside = np.abs((bearing_deg - panel.azimuth_deg + 180.0) % 360.0 - 180.0)
        surface[aside < _BEYOND * wide] = -1
        surface[(aside < _WITHIN * wide) & (np.abs(up_deg) < _WITHIN * tall)] = k + 1
    return surface


def _placed(view: View, first: IntArray, seen: _Seen, scene: SceneSettings) -> SceneSettings | None:
    """The scene with its surfaces as far away as the rows' ranges say; None where the table has none.

    The range of a row is a surface's radius times how much longer the ray is, and maybe its unit's constant.
    """
    ranges, calibrated = _ranges(view)
    if ranges is None:
        return None
    range_m, good = ranges[first], (seen.surface >= 0) & np.isfinite(ranges[first])
    present = [s for s in range(1 + len(scene.panels)) if np.sum(good & (seen.surface == s)) >= _FEWEST]
    good &= np.isin(seen.surface, present)
    if not present:
        return scene
    columns = [np.where(seen.surface == s, seen.longer, 0.0)[good] for s in present]
    if calibrated:
        columns += [(seen.unit[good] == u).astype(np.float64) for u in np.unique(seen.unit[good])]
    design = np.column_stack(columns)
    middles = [float(np.median((range_m / seen.longer)[good & (seen.surface == s)])) for s in present]
    start = np.array([*middles, *np.zeros(design.shape[1] - len(present))])
    found = _agreed(design, range_m[good], np.ones(len(design)), start)
    left = np.abs(design @ found - range_m[good])
    radii = {
        s: float(radius) for s, radius in zip(present, found[: len(present)], strict=True)
        if float(np.median(left[seen.surface[good] == s])) < _AGREE * radius
    }  # fmt: skip
    return _at(scene, radii)


def _at(scene: SceneSettings, radii: dict[int, float]) -> SceneSettings:
    """The scene with some surfaces at other radii, where these are not nearly the same."""

    def moved(number: int, usual: float) -> float:
        radius = radii.get(number, usual)
        return radius if abs(radius - usual) > _SAME * usual else usual

    wall = scene.wall.model_copy(update={"radius_m": moved(0, scene.wall.radius_m)})
    panels = tuple(
        panel.model_copy(update={"radius_m": moved(k + 1, panel.radius_m)}) for k, panel in enumerate(scene.panels)
    )
    return scene.model_copy(update={"wall": wall, "panels": panels})


def _mended(view: View, camera: Camera, first: IntArray, seen: _Seen, scene: SceneSettings) -> SceneSettings:
    """The scene with its moved surfaces where the mean range of pixels puts them, not that of their middles."""
    ranges, calibrated = _ranges(view)
    if scene == SceneSettings() or ranges is None or not calibrated:
        return scene
    _, longer, alike = _rendered(camera, seen, scene)
    nearly = replace(seen, surface=np.where(alike, seen.surface, -1), longer=longer)
    return _placed(view, first, nearly, SceneSettings()) or scene


def _rendered(camera: Camera, seen: _Seen, scene: SceneSettings) -> tuple[FloatArray, FloatArray, NDArray[np.bool_]]:
    """Light of the rows, how much longer their ranges are than the radius, and whether they see what is named.

    Heights of devices are not known here: what is seen above and below a panel may be another surface.
    """
    light, moment = look(Optics(camera=camera, rays=_RAYS, soft_rad=0.0, scene=scene), seen.spots)
    radius = np.array([scene.wall.radius_m, *(panel.radius_m for panel in scene.panels)])
    with np.errstate(invalid="ignore", divide="ignore"):
        longer = moment / light / radius[seen.surface]
    return light, longer, np.abs(longer / seen.longer - 1.0) < _SAME


def _painted(view: View, camera: Camera, first: IntArray, seen: _Seen, scene: SceneSettings) -> SceneSettings:
    """The scene with its surfaces as bright as the table says; else the wall against the panels, as signals say."""
    paint = view.columns.numbers.get("reflectance")
    if paint is None:
        share = _wall_share(view, camera, first, seen, scene)
        wall = scene.wall.model_copy(update={"reflectance": scene.wall.reflectance * share})
        return scene if abs(share - 1.0) < _SAME else scene.model_copy(update={"wall": wall})

    def told(number: int, usual: float) -> float:
        values = paint[first][(seen.surface == number) & np.isfinite(paint[first])]
        if values.size < _FEWEST:
            return usual
        middle = float(np.median(values))
        alike = float(np.median(np.abs(values - middle))) < _AGREE * abs(middle)
        return middle if alike and abs(middle - usual) > _SAME * usual else usual

    wall = scene.wall.model_copy(update={"reflectance": told(0, scene.wall.reflectance)})
    panels = tuple(
        panel if panel.circles else panel.model_copy(update={"reflectance": told(k + 1, panel.reflectance)})
        for k, panel in enumerate(scene.panels)
    )
    return scene.model_copy(update={"wall": wall, "panels": panels})


def _wall_share(view: View, camera: Camera, first: IntArray, seen: _Seen, scene: SceneSettings) -> float:
    """Reflectance of the wall over the scene's: every unit has a gain and a zero for all of its plain surfaces."""
    if not signals(view):
        return 1.0
    signal = view.columns.numbers[f"sim_{signals(view)[0]}"][first]
    light, _, alike = _rendered(camera, seen, scene)
    light = seen.beam * light
    plain = np.array([True, *(panel.circles is None for panel in scene.panels)])
    good = alike & (seen.surface >= 0) & plain[seen.surface] & np.isfinite(signal) & (signal > 0.0)
    shares = []
    for unit in np.unique(seen.unit[good]):
        mine = good & (seen.unit == unit)
        wall = seen.surface[mine] == 0
        if min(int(wall.sum()), int((~wall).sum())) < _FEWEST:
            continue
        design = np.column_stack(
            [np.where(wall, 0.0, light[mine]), np.where(wall, light[mine], 0.0), np.ones(wall.size)]
        )
        level = float(np.median(signal[mine][~wall] / light[mine][~wall]))
        start = np.array([level, float(np.median(signal[mine][wall] / light[mine][wall])), 0.0])
        panels, far, _ = _agreed(design, signal[mine], signal[mine], start)
        if panels > 0.0 and far > 0.0:
            shares.append(float(far / panels))
    return float(np.median(shares)) if shares else 1.0


def _agreed(design: FloatArray, values: FloatArray, size: FloatArray, start: FloatArray) -> FloatArray:
    """Coefficients on which most rows agree, from a start: rows at edges may be anything.

    Least squares relative to `size` with the weights of a Cauchy law that gets ever narrower.
    """
    scaled, target, found = design / size[:, None], values / size, start
    for width in np.geomspace(*_WIDTHS, _ROUNDS):
        weight = 1.0 / np.hypot(1.0, (scaled @ found - target) / width)
        found = np.asarray(np.linalg.lstsq(scaled * weight[:, None], target * weight, rcond=1e-9)[0])
    return found


_PLACE = ("pixel_u", "pixel_v", "stage_angle_deg")


def _ranges(view: View) -> tuple[FloatArray | None, bool]:
    """Range of each row in metres, and whether it is one that a calibration may have changed."""
    true = view.columns.numbers.get("true_range_m")
    if true is not None:
        return true, False
    if not distances(view):
        return None, False
    name = distances(view)[0]
    return view.columns.numbers[f"sim_{name}"] / per_metre(unit_of(name)), True
