"""Where pixels look, told by a sweep: the same scene passes one pixel after the other.

A table may give pixels and stage angles but no rays. Drawn over azimuth + stage angle what all pixels of an image row
see is one curve, if the azimuths are the right ones: with any others it jumps from sample to sample between what
different pixels see. The camera for which it jumps least is the simulation's. Where a row holds few pixels the curve
is dense only if all rows are taken for one, which they are in front of upright surfaces. The camera's pixels are
taken as square and its axis as the middle of the image, for a sweep tells neither.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from arl_fixtures.reconcile.effects_camera import Camera
from arl_fixtures.reconcile.effects_common import distances, signals
from arl_fixtures.reconcile.view import View

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_FEWEST_COLUMNS, _FEWEST_ANGLES = 6, 6
_PITCHES_DEG = np.geomspace(0.02, 8.0, 300)
_DISTORTIONS = (0.0, 0.1, 0.2, 0.33)
"""From a pinhole to a lens whose angle is the place in the image, as k4."""
_WIDEST_DEG = 160.0
_CLEARLY = 0.25
"""Share of the jumps along single sweeps below which the curve is one scene's."""
_OTHER, _BEST = 0.1, 0.5
"""From which relative difference a pitch is another one, and how much rougher all of these must be."""
_MOST_ROWS = 4000
_POLISHED, _AS_SMOOTH = 2, 1.3
"""Starts of each kind of lens that are followed, and how much rougher a curve may be for the plainer lens's sake:
where a pixel is as wide as a step of the sweep, samples lie in heaps, and which one is smoother is chance."""
_SAME_DEG = 2e-3


def camera_of_sweep(view: View) -> Camera | None:
    """Camera that a table's sweep shows; None where it shows none, or nothing is swept."""
    table = view.columns
    told = _seen(view)
    if told is None or not (view.varies("pixel_u") and view.varies("stage_angle_deg")):
        return None
    seen, power = told
    u, v, stage = table.numbers["pixel_u"], rows_of_pixels(view), table.numbers["stage_angle_deg"]
    line = table.group("dut", "pixel_v")
    places = np.unique(np.column_stack([line, u, stage, seen]), axis=0, return_index=True)[1]
    good = places[np.isfinite(u[places]) & np.isfinite(stage[places]) & np.isfinite(seen[places])]
    kept = max(1, int(_MOST_ROWS * (int(line.max()) + 1) / max(good.size, 1)))
    good = good[np.isin(line[good], np.unique(line[good])[:kept])]
    if np.unique(u[good]).size < _FEWEST_COLUMNS or np.unique(stage[good]).size < _FEWEST_ANGLES:
        return None
    sweep = _Sweep(
        line=line[good], u=u[good], v=v[good], stage=stage[good], level=seen[good],
        centre=tuple(0.5 * float(np.nanmin(x) + np.nanmax(x)) for x in (u, v)), power=power,
    )  # fmt: skip
    found = _smoothest(sweep)
    if found is None and view.varies("pixel_v"):
        found = _smoothest(replace(sweep, line=table.group("dut")[good], joined=True))
    return found


@dataclass(frozen=True, slots=True, kw_only=True)
class _Sweep:
    """What pixels saw at stage angles.

    Attributes:
        line: image row of each sample, or the device whose rows are taken for one.
        u, v, stage, level: pixel, stage angle and what was seen there.
        centre: of the image, pixels.
        power: of the cosine of the elevation that flattens what upright surfaces show.
        joined: that rows are taken for one: in a scene of upright surfaces all of them see the same.
    """

    line: IntArray
    u: FloatArray
    v: FloatArray
    stage: FloatArray
    level: FloatArray
    centre: tuple[float, ...]
    power: float
    joined: bool = False

    def camera(self, pitch_deg: float, k4: float) -> Camera:
        """A camera of square pixels."""
        f = float(1.0 / np.radians(pitch_deg))
        return Camera(fx=f, fy=f, cx=self.centre[0], cy=self.centre[1], k4=k4)

    @property
    def reach(self) -> float:
        """Pixels from the middle to the last column."""
        return float(np.max(np.abs(self.u - self.centre[0])))

    def jumps(self, pitch_deg: float, k4: float, way: float) -> float:
        """How the curve jumps that a camera draws; infinite for one that folds its image."""
        if not (pitch_deg > 0.0 and self.camera(pitch_deg, k4).is_possible(self.reach)):
            return np.inf
        azimuth, elevation = self.camera(pitch_deg, k4).angles_deg(self.u, self.v)
        level = self.level
        if self.joined:  # an upright surface is as far away above the horizon as its cosine says
            level = level + self.power * np.log(np.cos(np.radians(elevation)))
        return _jumps(self.line, azimuth + way * self.stage, level)

    def alone(self) -> float:
        """How what one pixel sees jumps along the sweep."""
        pixel = np.rint(self.v - self.v.min()) * 4096 + np.rint(self.u - self.u.min())
        return _jumps(np.unique(np.column_stack([self.line, pixel]), axis=0, return_inverse=True)[1].ravel(),
                      self.stage, self.level)  # fmt: skip


def _smoothest(sweep: _Sweep) -> Camera | None:
    """Camera whose curve jumps least; None where it is not clearly that of one scene."""
    alone = sweep.alone()
    starts = [(p, k4) for p in _PITCHES_DEG if p * sweep.reach < _WIDEST_DEG for k4 in _DISTORTIONS]
    tried = sorted((sweep.jumps(*start, way), *start, way) for start in starts for way in (1.0, -1.0))
    if not (alone > 0.0 and tried[0][0] < alone):
        return None
    # a lens of another kind may come near with a pitch of its own: the best of each are followed to their ends
    ends: list[tuple[float, float, float]] = []
    for _, pitch, k4, way in [one for kind in _DISTORTIONS for one in [t for t in tried if t[2] == kind][:_POLISHED]]:
        simplex = np.array([[pitch, k4], [1.02 * pitch, k4], [pitch, k4 + 0.04]])

        def rough(place: FloatArray, way: float = way) -> float:
            return sweep.jumps(float(place[0]), float(place[1]), way)

        polished = minimize(
            rough, simplex[0], method="Nelder-Mead",
            options={"initial_simplex": simplex, "maxiter": 120, "xatol": 1e-5},
        )  # fmt: skip
        ends.append((float(polished.fun), float(polished.x[0]), float(polished.x[1])))
    least = min(ends)[0]
    if least > _CLEARLY * alone or (sweep.joined and not _stands_out(least, min(ends)[1], tried)):
        return None
    _, pitch, k4 = min((end for end in ends if end[0] <= _AS_SMOOTH * least), key=lambda end: end[2])
    return sweep.camera(pitch, k4)


def _stands_out(least: float, pitch_deg: float, tried: list[tuple[float, float, float, float]]) -> bool:
    """Whether a curve is much smoother than those of other pitches: rows taken for one lie dense with any."""
    others = [jumps for jumps, pitch, _, _ in tried if np.isfinite(jumps) and abs(np.log(pitch / pitch_deg)) > _OTHER]
    return bool(others) and least <= min(_BEST * min(others), _CLEARLY * float(np.median(others)))


def rows_of_pixels(view: View) -> FloatArray:
    """Image row of every row of the table; zero where it is a line of pixels."""
    return view.columns.numbers.get("pixel_v", np.zeros(view.columns.n))


def _seen(view: View) -> tuple[FloatArray, float] | None:
    """What a row sees of the scene: the logarithm of its range, or of its light, and what flattens it (`_Sweep`)."""
    numbers = view.columns.numbers
    ranges, light = [*(f"sim_{n}" for n in distances(view)), "true_range_m"], [f"sim_{n}" for n in signals(view)]
    name = next((n for n in [*ranges, *light] if n in numbers and np.nanstd(numbers[n]) > 0.0), None)
    if name is None:
        return None
    values = numbers[name]
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(np.where(values > 0.0, np.log(values), np.nan)), 1.0 if name in ranges else -3.0


def _jumps(line: IntArray, place: FloatArray, level: FloatArray) -> float:
    """Mean distance of samples from the straight line between those before and after them on their curve."""
    place = np.rint(place / _SAME_DEG) * _SAME_DEG
    # where a pixel is as wide as a step of the sweep many places are one: in the table's order they look smooth
    order = np.lexsort((np.random.default_rng(1).permutation(len(place)), place, line))
    x, y, code = place[order], level[order], line[order]
    inner = code[2:] == code[:-2]
    if not inner.any():
        return 0.0
    wide = (x[2:] - x[:-2])[inner]
    share = np.where(wide > 0.5 * _SAME_DEG, (x[1:-1] - x[:-2])[inner] / np.maximum(wide, _SAME_DEG), 0.0)
    return float(np.mean(np.abs(y[1:-1][inner] - y[:-2][inner] - share * (y[2:] - y[:-2])[inner])))
