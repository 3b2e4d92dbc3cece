"""The bench that a table's simulation shows: is it the nominal scene, through which camera and rays, calibrated how?

Checked on the table, nothing is assumed: pixels, stage angles and simulated channels agree with the nominal scene, or
do so but for what a calibration of the device puts into a simulation (a gain, an additive signal, a constant range).
DUT heights, the camera and the number of rays are read from the table.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from arl_fixtures.reconcile.effects_bench_scene import scenes_of
from arl_fixtures.reconcile.effects_camera import Camera, cameras_of
from arl_fixtures.reconcile.effects_common import distances, per_table, signals
from arl_fixtures.reconcile.effects_rays import Optics, Spots, look
from arl_fixtures.reconcile.roles import per_metre, unit_of
from arl_fixtures.reconcile.view import View
from arl_fixtures.twin.scene import SceneSettings

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_RAYS = (3, 1, 2, 4, 5, 7)
_SOFT_RAYS = 3
_SPREAD_PX, _SPREAD_ERROR_PX = (0.05, 0.8), 0.01
"""Standard deviations between which the simulation's own point spread is looked for, and to what error."""
_CLEARLY_SOFTER = 0.6
"""Share of the misfit that a point spread must leave at most: what lies beside an edge otherwise is no softness."""
_HEIGHTS_M = (0.10, 0.0, -0.10)
_OTHER_HEIGHTS_M = np.round(np.arange(-0.40, 0.401, 0.01), 2)
_MOST_MISFIT, _BETTER = 0.05, 0.8
_LIKELY_HEIGHTS = 8
_CHECKED = 2000
_FEWEST = 20
_SHARP_LIGHT, _SHARP_RANGE_M = 4e-3, 2e-3
_SOFT_MISFIT = 0.01
"""Mean error of light and range from which soft edges of a bench that is not the nominal one lie elsewhere."""
_LIT_MISFIT, _RANGED_MISFIT_M = 0.02, 1e-3
"""Mean error of light or of range up to which one of them alone tells of the nominal bench."""
_LIT_SPREAD, _RANGED_SPREAD_M = 0.3, 0.05
"""Scatter of the rows' light (natural logarithm) or range from which they see more than one surface."""
_ONLY_HERE, _ALIKE = 0.3, 1.1
"""Share that the misfit is of the next height's, unless all heights look alike to these rows, within this ratio."""
_MOST_UNEQUAL, _HARDLY_UNEQUAL = 0.03, 0.005
_FEWEST_OF_PIXEL = 5
_AGREED, _CLEARLY = 3e-4, 0.5
"""Typical error below which nothing is calibrated, and the share of it that a calibration must leave at most."""
_ROUNDS, _EXACT = 30, 1e-4
"""Rounds of the fit of a calibration, and the relative error below which rows count alike in it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Bench:
    """The bench that a table's simulation shows.

    Attributes:
        index: spot of every row of the whole table.
        spots: what the table looks at: every pixel of a DUT at every stage angle.
        frame: image of each spot.
        unit: distance unit over a metre.
        optics: camera, rays and surfaces.
        pedestal: what a calibration added to the simulated signal of each spot, in the unit of rendered light.
        ahead_m: and to its range.
    """

    index: IntArray
    spots: Spots
    frame: IntArray
    unit: float
    optics: Optics
    pedestal: FloatArray
    ahead_m: FloatArray

    @property
    def sharp(self) -> bool:
        """Whether edges jump from ray to ray."""
        return self.optics.soft_rad == 0.0


# ---- is the table's simulation that bench? -------------------------------------------------------------------


def bench_of(view: View) -> Bench | None:
    """The bench of a table; None where its simulation is not the nominal scene."""
    return per_table(view, "bench", lambda: _recognise(view))


def is_sharp(view: View) -> bool:
    """Whether the simulation jumps where a ray crosses an edge: a fit's derivatives then need finite steps."""
    found = bench_of(view)
    return found is not None and found.sharp


def is_zero_fitted(view: View) -> bool:
    """Whether the simulation shows that its user has fitted a zero to the signal, beside the gain."""
    found = bench_of(view)
    return found is not None and bool(np.any(found.pedestal != 0.0))


@dataclass(frozen=True, slots=True, kw_only=True)
class _Sample:
    """Spots of one DUT with their simulated signal and range, and what a calibration is taken to have put into them.

    Attributes:
        spots: of the sample; pixel: of each spot, a number.
        signal: simulated; beam: illumination of the pixel; range_m: simulated; empty where the table has none.
        pedestal: additive signal; ahead_m: constant range; gain: of the signal over beam and light.
    """

    spots: Spots
    signal: FloatArray
    beam: FloatArray
    range_m: FloatArray
    pixel: IntArray
    pedestal: float = 0.0
    ahead_m: float = 0.0
    gain: float = 1.0

    def off(self, optics: Optics, height_m: float) -> tuple[FloatArray, FloatArray]:
        """Logarithm of light and range that a bench leaves; NaN where not seen."""
        light, range_m = self._seen(optics, height_m)
        bright, away = 0.0 * light, 0.0 * range_m  # what the table does not simulate agrees
        with np.errstate(invalid="ignore", divide="ignore"):
            if self.signal.size:
                bright = np.log((self.signal - self.pedestal) / self.beam) - np.log(light)
            if self.range_m.size:
                away = self.range_m - self.ahead_m - range_m
        return bright, away

    def calibrated(self, optics: Optics, height_m: float) -> _Sample:
        """The sample with gain, additive signal and constant range as the bench at a height leaves them.

        By least absolute deviations (relative ones of the signal), since edges and other surfaces may differ.
        """
        light, range_m = self._seen(optics, height_m)
        near = self.range_m - range_m if self.range_m.size else 0.0 * range_m
        if not self.signal.size:
            seen = near[np.isfinite(near)]
            return replace(self, ahead_m=float(np.median(seen))) if seen.size >= _FEWEST else self
        with np.errstate(invalid="ignore", divide="ignore"):
            column = light * self.beam / self.signal
        good = np.isfinite(column) & (column > 0.0) & np.isfinite(near)
        if good.sum() < _FEWEST:
            return self
        design = np.column_stack([column[good], 1.0 / self.signal[good]])
        weight: FloatArray = np.ones(len(design))
        found: FloatArray = np.zeros(2)
        for _ in range(_ROUNDS):
            found = np.asarray(np.linalg.lstsq(design * weight[:, None], weight, rcond=None)[0])
            weight = np.asarray(1.0 / np.sqrt(np.maximum(np.abs(design @ found - 1.0), _EXACT)))
        if found[0] <= 0.0:
            return self
        ahead = float(np.median(near[good]))
        return replace(self, pedestal=float(found[1]), ahead_m=ahead, gain=float(found[0]))

    def _seen(self, optics: Optics, height_m: float) -> tuple[FloatArray, FloatArray]:
        """Light and range of the spots through optics, from a height."""
        spots = self.spots
        placed = Spots(
            u=spots.u, v=spots.v, stage_deg=spots.stage_deg, height_m=np.full(spots.u.size, height_m)
        )  # fmt: skip
        light, moment = look(optics, placed)
        with np.errstate(invalid="ignore", divide="ignore"):
            return light, moment / light


def _recognise(view: View) -> Bench | None:
    table = view.columns
    needed = ("pixel_u", "pixel_v", "stage_angle_deg")
    if any(name not in table.numbers for name in needed) or not (distances(view) or signals(view)):
        return None
    code = table.group("dut", *needed)
    first = np.zeros(int(code.max()) + 1, dtype=np.int64)
    first[code] = np.arange(table.n)
    if not all(np.isfinite(table.numbers[name][first]).all() for name in needed):
        return None
    found = (
        _through(view, camera, scene, code, first)
        for camera in cameras_of(view)
        for scene in scenes_of(view, camera, first)
    )
    return next((bench for bench in found if bench is not None), None)


def _through(view: View, camera: Camera, scene: SceneSettings, code: IntArray, first: IntArray) -> Bench | None:
    """A scene seen through a camera; None where that is not what the simulation shows.

    Args:
        code: spot of every row of the whole table; first: a row of each spot.
    """
    table = view.columns
    u, v, stage = (table.numbers[name][first] for name in ("pixel_u", "pixel_v", "stage_angle_deg"))
    lit, ranged = next(iter(signals(view)), ""), next(iter(distances(view)), "")
    unit = per_metre(unit_of(ranged))
    device = table.group("dut")[first]
    soft = Optics(camera=camera, rays=_SOFT_RAYS, soft_rad=1.0 / (_SOFT_RAYS * camera.fx), scene=scene)
    beam, nothing = np.exp(camera.log_beam(u, v)), np.zeros(0)
    signal = table.numbers[f"sim_{lit}"][first] if lit else nothing
    range_m = table.numbers[f"sim_{ranged}"][first] / unit if ranged else nothing
    heights, pedestal, ahead = np.zeros(first.size), np.zeros(first.size), np.zeros(first.size)
    seen_by: list[_Sample] = []
    places = [np.flatnonzero(device == dut) for dut in range(int(device.max()) + 1)]
    for mine in places:
        some = mine[np.unique(np.linspace(0, mine.size - 1, min(_CHECKED, mine.size)).astype(np.int64))]
        spots = Spots(u=u, v=v, stage_deg=stage, height_m=heights).take(some)
        pixel = np.unique(spots.u * 4096.0 + spots.v, return_inverse=True)[1]
        seen_by.append(
            _Sample(
                spots=spots, signal=signal[some] if lit else nothing, beam=beam[some],
                range_m=range_m[some] if ranged else nothing, pixel=pixel,
            )
        )  # fmt: skip
    soft, samples = _softened(soft, seen_by), []
    for mine, seen in zip(places, seen_by, strict=True):
        sample = _likelier(seen, soft)
        height = _height(sample, soft)
        if height is None:
            return None
        heights[mine] = height
        pedestal[mine] = sample.pedestal / sample.gain / beam[mine]
        ahead[mine] = sample.ahead_m
        samples.append((sample, height))
    # what one channel, or surfaces elsewhere, nearly agree with may be another bench
    usual = bool(lit and ranged and scene == SceneSettings())
    most = _MOST_UNEQUAL if usual else _HARDLY_UNEQUAL
    optics = next(
        (
            sharp
            for sharp in (Optics(camera=camera, rays=rays, soft_rad=0.0, scene=soft.scene) for rays in _RAYS)
            if all(_unequal(*sample.off(sharp, height), sample.pixel) < most for sample, height in samples)
        ),
        soft,
    )
    if lit and ranged:
        alike = all(_misfit(sample, soft, h) < _SOFT_MISFIT for sample, h in samples)
    else:
        alike = scene == SceneSettings() and all(_only_from(sample, soft, h) for sample, h in samples)
    if optics is soft and not (usual or alike):
        return None
    if optics is not soft:  # sharp rays tell heights apart that look alike through soft ones: circles repeat
        for mine, (sample, height) in zip(places, samples, strict=True):
            off = {h: _unequal(*sample.off(optics, h), sample.pixel) for h in (height, *_HEIGHTS_M)}
            heights[mine] = min(off, key=lambda h: off[h])
    frame = np.unique(device * 1_000_000 + np.round(stage * 100.0), return_inverse=True)[1]
    spots = Spots(u=u, v=v, stage_deg=stage, height_m=heights)
    return Bench(
        index=code, spots=spots, frame=frame, unit=unit, optics=optics, pedestal=pedestal, ahead_m=ahead
    )  # fmt: skip


def _softened(soft: Optics, samples: list[_Sample]) -> Optics:
    """Pixels with as wide a point spread as the simulation's edges show, of the first device."""
    misfit, height = min((_misfit(_likelier(samples[0], soft), soft, height), height) for height in _HEIGHTS_M)
    if not np.isfinite(misfit):
        return soft

    def spread(px: float) -> float:
        optics = replace(soft, spread_px=px)
        return min(_misfit(_likelier(samples[0], optics), optics, height), 1.0)

    found = minimize_scalar(spread, bounds=_SPREAD_PX, method="bounded", options={"xatol": _SPREAD_ERROR_PX})
    return replace(soft, spread_px=float(found.x)) if found.fun < _CLEARLY_SOFTER * misfit else soft


def _only_from(sample: _Sample, soft: Optics, height_m: float) -> bool:
    """Whether the one channel that there is agrees with the nominal bench, from this height and no other."""
    own = _misfit(sample, soft, height_m)
    others = [_misfit(sample, soft, h) for h in _HEIGHTS_M if abs(h - height_m) > 0.05]
    if sample.signal.size:
        with np.errstate(invalid="ignore", divide="ignore"):
            seen, most, least = np.log(sample.signal / sample.beam), _LIT_MISFIT, _LIT_SPREAD
    else:
        seen, most, least = sample.range_m, _RANGED_MISFIT_M, _RANGED_SPREAD_M
    told = own < _ONLY_HERE * min(others) or max(others) < _ALIKE * own
    return own < most and told and float(np.std(seen[np.isfinite(seen)])) > least


def _likelier(sample: _Sample, soft: Optics) -> _Sample:
    """A sample as it is, or less a calibration where most of its rows then agree clearly better with the bench."""
    best = min((_misfit(sample, soft, height), height) for height in _HEIGHTS_M)[1]
    typical = _typical(sample, soft, best)
    others = [sample.calibrated(soft, height) for height in _HEIGHTS_M]
    misfit, calibrated = min(
        ((_misfit(other, soft, height), other) for other, height in zip(others, _HEIGHTS_M, strict=True)),
        key=lambda one: one[0],
    )
    if not (np.isfinite(misfit) and typical > _AGREED):
        return sample
    now = min(_typical(calibrated, soft, height) for height in _HEIGHTS_M)
    return calibrated if now < _CLEARLY * typical else sample


def _typical(sample: _Sample, soft: Optics, height_m: float) -> float:
    """Median error of light (relative, but for a gain) plus that of range (metres), which edges do not touch."""
    bright, away = sample.off(soft, height_m)
    seen = np.isfinite(bright) & np.isfinite(away)
    if seen.sum() < _FEWEST:
        return np.inf
    return float(np.median(np.abs(bright - np.median(bright[seen]))[seen]) + np.median(np.abs(away[seen])))


def _height(sample: _Sample, soft: Optics) -> float | None:
    """Height of a DUT at which the bench looks like its simulation; None where at none.

    A nominal one unless it leaves rows unequal through the nominal rays and another looks clearly better.
    """
    nominal = min((_misfit(sample, soft, height), height) for height in _HEIGHTS_M)
    rays = replace(soft, rays=_RAYS[0], soft_rad=0.0)
    best = nominal
    if _unequal(*sample.off(rays, nominal[1]), sample.pixel) > _MOST_UNEQUAL:
        others = sorted((_misfit(sample, soft, float(height)), float(height)) for height in _OTHER_HEIGHTS_M)
        others = [found for found in others[:_LIKELY_HEIGHTS] if found[0] < _BETTER * nominal[0]]
        # boards of circles look alike a pitch higher: sharp rays tell them apart
        best = min(others, key=lambda found: _unequal(*sample.off(rays, found[1]), sample.pixel), default=nominal)
    alike = best[0] < _MOST_MISFIT or any(
        _unequal(*sample.off(replace(rays, rays=count), best[1]), sample.pixel) < _MOST_UNEQUAL for count in _RAYS
    )
    return best[1] if alike and np.isfinite(best[0]) else None


def _misfit(sample: _Sample, soft: Optics, height_m: float) -> float:
    bright, away = sample.off(soft, height_m)
    seen = np.isfinite(bright) & np.isfinite(away)
    if seen.sum() < _FEWEST:
        return np.inf
    uneven, away = np.abs(bright - np.median(bright[seen]))[seen], np.abs(away[seen])
    if np.median(away) > 3e-3 or np.median(uneven) > 0.03:
        return np.inf
    return float(np.mean(np.minimum(uneven, 0.5)) + np.mean(np.minimum(away, 0.05)))


def _unequal(bright: FloatArray, away: FloatArray, pixel: IntArray) -> float:
    """Share of rows in which light or range differ by more than rounding, but for a calibration."""
    seen = np.isfinite(bright) & np.isfinite(away)
    whole = [np.abs(values - np.median(values[seen])) for values in (bright, away)]
    each = [np.abs(_less_pixel(values, seen, pixel)) for values in (bright, away)]
    shares = [
        float(np.mean(((light > _SHARP_LIGHT) | (far > _SHARP_RANGE_M))[seen & np.isfinite(light)]))
        for light, far in (whole, each)
        if (seen & np.isfinite(light)).sum() >= _FEWEST
    ]
    return min(shares, default=1.0)


def _less_pixel(values: FloatArray, seen: NDArray[np.bool_], pixel: IntArray) -> FloatArray:
    """Without each pixel's median: a simulation may have been calibrated pixel by pixel. NaN for few rows."""
    centred = np.full(values.size, np.nan)
    good = np.flatnonzero(seen)
    order = good[np.argsort(pixel[good], kind="stable")]
    for part in np.split(order, np.flatnonzero(np.diff(pixel[order])) + 1):
        if part.size >= _FEWEST_OF_PIXEL:
            centred[part] = values[part] - np.median(values[part])
    return centred
