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

from arl_fixtures.reconcile.effects_bench_sample import (
    HARDLY_UNEQUAL,
    HEIGHTS_M,
    MOST_UNEQUAL,
    RAYS,
    Sample,
    height_of,
    likelier,
    misfit,
    only_from,
    shows_its_edges,
    unequal,
)
from arl_fixtures.reconcile.effects_bench_scene import scenes_of
from arl_fixtures.reconcile.effects_camera import Camera, cameras_of, places_in_image
from arl_fixtures.reconcile.effects_common import distances, per_table, signals
from arl_fixtures.reconcile.effects_rays import Optics, Spots
from arl_fixtures.reconcile.roles import per_metre, unit_of
from arl_fixtures.reconcile.view import View
from arl_fixtures.twin.scene import SceneSettings

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

BENCH = "bench"
"""Under which a table keeps its bench."""

_SOFT_RAYS = 3
_SPREAD_PX, _SPREAD_ERROR_PX = (0.05, 0.8), 0.01
"""Standard deviations between which the simulation's own point spread is looked for, and to what error."""
_CLEARLY_SOFTER = 0.6
"""Share of the misfit that a point spread must leave at most: what lies beside an edge otherwise is no softness."""
_CHECKED = 2000
_SOFT_MISFIT = 0.01
"""Mean error of light and range from which soft edges of a bench that is not the nominal one lie elsewhere."""


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
        complete: whether the table holds every pixel of its images.
    """

    index: IntArray
    spots: Spots
    frame: IntArray
    unit: float
    optics: Optics
    pedestal: FloatArray
    ahead_m: FloatArray
    complete: bool = False

    @property
    def sharp(self) -> bool:
        """Whether edges jump from ray to ray."""
        return self.optics.soft_rad == 0.0

    @property
    def is_other(self) -> bool:
        """Whether surfaces lie elsewhere than on the nominal bench: some of them may be cut otherwise, too."""
        return self.optics.scene != SceneSettings()


# ---- is the table's simulation that bench? -------------------------------------------------------------------


def bench_of(view: View) -> Bench | None:
    """The bench of a table; None where its simulation is not the nominal scene."""
    return per_table(view, BENCH, lambda: _recognise(view))


def is_sharp(view: View) -> bool:
    """Whether the simulation jumps where a ray crosses an edge: a fit's derivatives then need finite steps."""
    found = bench_of(view)
    return found is not None and found.sharp


def is_zero_fitted(view: View) -> bool:
    """Whether the simulation shows that its user has fitted a zero to the signal, beside the gain."""
    found = bench_of(view)
    return found is not None and bool(np.any(found.pedestal != 0.0))


def _recognise(view: View) -> Bench | None:
    table = view.columns
    needed = ("pixel_u", "pixel_v", "stage_angle_deg")
    if any(name not in table.numbers for name in needed) or not (distances(view) or signals(view)):
        return None
    placed = np.all([np.isfinite(table.numbers[name]) for name in needed], axis=0)  # no row of a log among images
    if not placed.any():
        return None
    _, seen, spot = np.unique(table.group("dut", *needed)[placed], return_index=True, return_inverse=True)
    code, first = np.zeros(table.n, dtype=np.int64), np.flatnonzero(placed)[seen]
    code[placed] = spot
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
    u, v = places_in_image(view, camera, first)
    stage = table.numbers["stage_angle_deg"][first]
    lit, ranged = next(iter(signals(view)), ""), next(iter(distances(view)), "")
    unit = per_metre(unit_of(ranged))
    device = np.unique(table.group("dut")[first], return_inverse=True)[1]
    soft = Optics(camera=camera, rays=_SOFT_RAYS, soft_rad=1.0 / (_SOFT_RAYS * camera.fx), scene=scene)
    beam, nothing = np.exp(camera.log_beam(u, v)), np.zeros(0)
    signal = table.numbers[f"sim_{lit}"][first] if lit else nothing
    range_m = table.numbers[f"sim_{ranged}"][first] / unit if ranged else nothing
    heights, pedestal, ahead = np.zeros(first.size), np.zeros(first.size), np.zeros(first.size)
    seen_by: list[Sample] = []
    places = [np.flatnonzero(device == dut) for dut in range(int(device.max()) + 1)]
    for mine in places:
        some = mine[np.unique(np.linspace(0, mine.size - 1, min(_CHECKED, mine.size)).astype(np.int64))]
        spots = Spots(u=u, v=v, stage_deg=stage, height_m=heights).take(some)
        pixel = np.unique(spots.u * 4096.0 + spots.v, return_inverse=True)[1]
        seen_by.append(
            Sample(
                spots=spots, signal=signal[some] if lit else nothing, beam=beam[some],
                range_m=range_m[some] if ranged else nothing, pixel=pixel,
            )
        )  # fmt: skip
    soft, samples = _softened(soft, seen_by), []
    for mine, seen in zip(places, seen_by, strict=True):
        sample = likelier(seen, soft)
        height = height_of(sample, soft)
        if height is None:
            return None
        heights[mine] = height
        pedestal[mine] = sample.pedestal / sample.gain / beam[mine]
        ahead[mine] = sample.ahead_m
        samples.append((sample, height))
    # what one channel, or surfaces elsewhere, nearly agree with may be another bench
    usual = bool(lit and ranged and scene == SceneSettings())
    most = MOST_UNEQUAL if usual else HARDLY_UNEQUAL
    optics = next(
        (
            sharp
            for sharp in (Optics(camera=camera, rays=rays, soft_rad=0.0, scene=soft.scene) for rays in RAYS)
            if all(unequal(*sample.off(sharp, height), sample.pixel) < most for sample, height in samples)
            and not _is_softer(samples, soft, sharp)
        ),
        soft,
    )
    if lit and ranged:
        alike = all(misfit(sample, soft, h) < _SOFT_MISFIT for sample, h in samples)
        alike = alike or shows_its_edges(samples, soft)
    else:
        alike = scene == SceneSettings() and all(only_from(sample, soft, h) for sample, h in samples)
    if optics is soft and not (usual or alike):
        return None
    if optics is not soft:  # sharp rays tell heights apart that look alike through soft ones: circles repeat
        for mine, (sample, height) in zip(places, samples, strict=True):
            off = {h: unequal(*sample.off(optics, h), sample.pixel) for h in (height, *HEIGHTS_M)}
            heights[mine] = min(off, key=lambda h: off[h])
    frame = np.unique(device * 1_000_000 + np.round(stage * 100.0), return_inverse=True)[1]
    spots = Spots(u=u, v=v, stage_deg=stage, height_m=heights)
    return Bench(
        index=code, spots=spots, frame=frame, unit=unit, optics=optics, pedestal=pedestal, ahead_m=ahead
    )  # fmt: skip


def _is_softer(samples: list[tuple[Sample, float]], soft: Optics, sharp: Optics) -> bool:
    """Whether a point spread of the simulation clearly shows, though few rows see enough of an edge to tell."""
    if soft.spread_px == 0.0:
        return False
    left, jumps = (sum(misfit(sample, optics, height) for sample, height in samples) for optics in (soft, sharp))
    return left < _CLEARLY_SOFTER * jumps


def _softened(soft: Optics, samples: list[Sample]) -> Optics:
    """Pixels with as wide a point spread as the simulation's edges show, of the first device."""
    least, height = min((misfit(likelier(samples[0], soft), soft, height), height) for height in HEIGHTS_M)
    if not np.isfinite(least):
        return soft

    def spread(px: float) -> float:
        optics = replace(soft, spread_px=px)
        return min(misfit(likelier(samples[0], optics), optics, height), 1.0)

    found = minimize_scalar(spread, bounds=_SPREAD_PX, method="bounded", options={"xatol": _SPREAD_ERROR_PX})
    return replace(soft, spread_px=float(found.x)) if found.fun < _CLEARLY_SOFTER * least else soft
