"""How far what a device's simulation shows is from a bench: the parts of it that agree, and from which height.

A calibration of the device (a gain, an additive signal, a constant range) is taken out first.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from arl_fixtures.reconcile.effects_rays import Optics, Spots, echoes, look

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

RAYS = (3, 1, 2, 4, 5, 7)
HEIGHTS_M = (0.10, 0.0, -0.10)
_OTHER_HEIGHTS_M = np.round(np.arange(-0.40, 0.401, 0.01), 2)
_MOST_MISFIT, _BETTER = 0.05, 0.8
_LIKELY_HEIGHTS = 8
_FEWEST = 20
_SHARP_LIGHT, _SHARP_RANGE_M = 4e-3, 2e-3
_MOSTLY, _EDGES_RIGHT, _FEWEST_EDGES = 0.85, 0.7, 10
"""Share of all spots, and of those in which rays differ, that must agree, and of how many such spots at least."""
_EDGE_LIGHT, _EDGE_RANGE_M, _UNEVEN = 0.05, 0.02, 0.2
"""Errors of light (relative) and range up to which a spot agrees, and spread of its rays' light at an edge."""
_LIT_MISFIT, _RANGED_MISFIT_M = 0.02, 1e-3
"""Mean error of light or of range up to which one of them alone tells of the nominal bench."""
_LIT_SPREAD, _RANGED_SPREAD_M = 0.3, 0.05
"""Scatter of the rows' light (natural logarithm) or range from which they see more than one surface."""
_ONLY_HERE, _ALIKE = 0.3, 1.1
"""Share that the misfit is of the next height's, unless all heights look alike to these rows, within this ratio."""
MOST_UNEQUAL, HARDLY_UNEQUAL = 0.03, 0.005
_FEWEST_OF_PIXEL = 5
_AGREED, _CLEARLY = 3e-4, 0.5
"""Typical error below which nothing is calibrated, and the share of it that a calibration must leave at most."""
_ROUNDS, _EXACT = 30, 1e-4
"""Rounds of the fit of a calibration, and the relative error below which rows count alike in it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Sample:
    """Spots of one DUT with their simulated signal and range, and what a calibration is taken to have put into them.

    Attributes:
        spots: of the sample; pixel: of each spot, a number.
        signal: simulated; beam: illumination of the pixel; range_m: simulated; empty where the table has none.
        pedestal: additive signal; ahead_m: constant range; gain: of the signal over beam and light.
        looked: light and range of the spots by optics and height: they are the same whatever the calibration is.
    """

    spots: Spots
    signal: FloatArray
    beam: FloatArray
    range_m: FloatArray
    pixel: IntArray
    pedestal: float = 0.0
    ahead_m: float = 0.0
    gain: float = 1.0
    looked: dict[tuple[Optics, float], tuple[FloatArray, FloatArray]] = field(
        default_factory=dict, repr=False, compare=False
    )

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

    def calibrated(self, optics: Optics, height_m: float) -> Sample:
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
        known = self.looked.get((optics, height_m))
        if known is None:
            spots = self.spots
            placed = Spots(
                u=spots.u, v=spots.v, stage_deg=spots.stage_deg, height_m=np.full(spots.u.size, height_m)
            )  # fmt: skip
            light, moment = look(optics, placed)
            with np.errstate(invalid="ignore", divide="ignore"):
                known = self.looked[optics, height_m] = light, moment / light
        return known


def shows_its_edges(samples: list[tuple[Sample, float]], soft: Optics) -> bool:
    """Whether a bench agrees in nearly all that devices look at, pixels that see its edges among it.

    A panel may be cut otherwise than is known; where few pixels look over that edge, all others tell of the bench.
    """
    right = edges = 0
    for sample, height in samples:
        bright, away = sample.off(soft, height)
        seen = np.isfinite(bright) & np.isfinite(away)
        if seen.sum() < _FEWEST:
            return False
        same = (np.abs(bright - np.median(bright[seen])) < _EDGE_LIGHT) & (np.abs(away) < _EDGE_RANGE_M) & seen
        if float(np.mean(same[seen])) < _MOSTLY:
            return False
        placed = replace(sample.spots, height_m=np.full(sample.spots.u.size, height))
        light = echoes(replace(soft, soft_rad=0.0, spread_px=0.0), placed)[0]
        uneven = seen & (np.ptp(light, axis=1) > _UNEVEN * light.mean(axis=1))
        right, edges = right + int(np.sum(same & uneven)), edges + int(np.sum(uneven))
    return right >= _FEWEST_EDGES and right > _EDGES_RIGHT * edges


def only_from(sample: Sample, soft: Optics, height_m: float) -> bool:
    """Whether the one channel that there is agrees with the nominal bench, from this height and no other."""
    own = misfit(sample, soft, height_m)
    others = [misfit(sample, soft, h) for h in HEIGHTS_M if abs(h - height_m) > 0.05]
    if sample.signal.size:
        with np.errstate(invalid="ignore", divide="ignore"):
            seen, most, least = np.log(sample.signal / sample.beam), _LIT_MISFIT, _LIT_SPREAD
    else:
        seen, most, least = sample.range_m, _RANGED_MISFIT_M, _RANGED_SPREAD_M
    told = own < _ONLY_HERE * min(others) or max(others) < _ALIKE * own
    return own < most and told and float(np.std(seen[np.isfinite(seen)])) > least


def likelier(sample: Sample, soft: Optics) -> Sample:
    """A sample as it is, or less a calibration where most of its rows then agree clearly better with the bench."""
    best = min((misfit(sample, soft, height), height) for height in HEIGHTS_M)[1]
    typical = _typical(sample, soft, best)
    others = [sample.calibrated(soft, height) for height in HEIGHTS_M]
    least, calibrated = min(
        ((misfit(other, soft, height), other) for other, height in zip(others, HEIGHTS_M, strict=True)),
        key=lambda one: one[0],
    )
    if not (np.isfinite(least) and typical > _AGREED):
        return sample
    now = min(_typical(calibrated, soft, height) for height in HEIGHTS_M)
    return calibrated if now < _CLEARLY * typical else sample


def _typical(sample: Sample, soft: Optics, height_m: float) -> float:
    """Median error of light (relative, but for a gain) plus that of range (metres), which edges do not touch."""
    bright, away = sample.off(soft, height_m)
    seen = np.isfinite(bright) & np.isfinite(away)
    if seen.sum() < _FEWEST:
        return np.inf
    return float(np.median(np.abs(bright - np.median(bright[seen]))[seen]) + np.median(np.abs(away[seen])))


def height_of(sample: Sample, soft: Optics) -> float | None:
    """Height of a DUT at which the bench looks like its simulation; None where at none.

    A nominal one unless it leaves rows unequal through the nominal rays and another looks clearly better.
    """
    nominal = min((misfit(sample, soft, height), height) for height in HEIGHTS_M)
    rays = replace(soft, rays=RAYS[0], soft_rad=0.0)
    best = nominal
    if unequal(*sample.off(rays, nominal[1]), sample.pixel) > MOST_UNEQUAL:
        others = sorted((misfit(sample, soft, float(height)), float(height)) for height in _OTHER_HEIGHTS_M)
        others = [found for found in others[:_LIKELY_HEIGHTS] if found[0] < _BETTER * nominal[0]]
        # boards of circles look alike a pitch higher: sharp rays tell them apart
        best = min(others, key=lambda found: unequal(*sample.off(rays, found[1]), sample.pixel), default=nominal)
    alike = best[0] < _MOST_MISFIT or any(
        unequal(*sample.off(replace(rays, rays=count), best[1]), sample.pixel) < MOST_UNEQUAL for count in RAYS
    )
    return best[1] if alike and np.isfinite(best[0]) else None


def misfit(sample: Sample, soft: Optics, height_m: float) -> float:
    """Mean error of light (relative, but for a gain) plus that of range (metres), each limited; infinite if far."""
    bright, away = sample.off(soft, height_m)
    seen = np.isfinite(bright) & np.isfinite(away)
    if seen.sum() < _FEWEST:
        return np.inf
    uneven, away = np.abs(bright - np.median(bright[seen]))[seen], np.abs(away[seen])
    if np.median(away) > 3e-3 or np.median(uneven) > 0.03:
        return np.inf
    return float(np.mean(np.minimum(uneven, 0.5)) + np.mean(np.minimum(away, 0.05)))


def unequal(bright: FloatArray, away: FloatArray, pixel: IntArray) -> float:
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
