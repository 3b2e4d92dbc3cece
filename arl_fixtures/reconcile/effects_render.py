"""The nominal bench rendered in another pose, where the table's simulation is seen to be that bench.

A table of a few scattered pixels does not hold what a ray sees that points a little elsewhere. Where pixels, stage
angles and simulated channels agree with the nominal scene (checked on the table, nothing is assumed), it is rendered:
through sharp rays where the simulation jumps at edges as those do, else through soft beamlets. DUT heights, the
camera and the number of rays are read from the table.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import ive

from arl_fixtures.reconcile.calibrated import apart, uneven
from arl_fixtures.reconcile.effects_camera import camera_of
from arl_fixtures.reconcile.effects_common import distances, per_table, per_view, signals
from arl_fixtures.reconcile.effects_rays import NOMINAL, Optics, Pose, Spots, look, rays_of
from arl_fixtures.reconcile.view import View
from arl_fixtures.twin.scene import SceneSettings

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_RAYS = (3, 1, 2, 4, 5, 7)
_SOFT_RAYS = 3
_HEIGHTS_M = (0.10, 0.0, -0.10)
_OTHER_HEIGHTS_M = np.round(np.arange(-0.40, 0.401, 0.01), 2)
_MOST_MISFIT, _BETTER = 0.05, 0.8
_LIKELY_HEIGHTS = 8
_CHECKED = 2000
_FEWEST = 20
_SHARP_LIGHT, _SHARP_RANGE_M = 4e-3, 2e-3
_MOST_UNEQUAL = 0.03
_FEWEST_OF_PIXEL = 5
_MOST_KEPT = 12_000_000  # numbers: 100 MB
_WIDEST_PX = 2
_TAPS = tuple((du, dv) for du in range(-_WIDEST_PX, _WIDEST_PX + 1) for dv in range(-_WIDEST_PX, _WIDEST_PX + 1))


@dataclass(frozen=True, slots=True, kw_only=True)
class Bench:
    """The bench that a table's simulation shows.

    Attributes:
        index: spot of every row of the whole table.
        spots: what the table looks at: every pixel of a DUT at every stage angle.
        frame: image of each spot.
        unit: distance unit over a metre.
        optics: camera, rays and surfaces.
    """

    index: IntArray
    spots: Spots
    frame: IntArray
    unit: float
    optics: Optics

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


@dataclass(frozen=True, slots=True, kw_only=True)
class _Sample:
    """Spots of one DUT with their simulated light, the beam's light on them, and their simulated range."""

    spots: Spots
    light: FloatArray
    beam: FloatArray
    range_m: FloatArray
    pixel: IntArray

    def off(self, optics: Optics, height_m: float) -> tuple[FloatArray, FloatArray]:
        """Logarithm of light and range that a bench leaves after a calibration; NaN where not seen."""
        spots = self.spots
        placed = Spots(
            u=spots.u, v=spots.v, stage_deg=spots.stage_deg, height_m=np.full(spots.u.size, height_m)
        )  # fmt: skip
        light, moment = look(optics, placed)
        return uneven(self.light, self.beam * light), apart(self.range_m, moment / light)


def _recognise(view: View) -> Bench | None:
    table = view.columns
    needed = ("pixel_u", "pixel_v", "stage_angle_deg")
    if any(name not in table.numbers for name in needed) or not distances(view) or not signals(view):
        return None
    code = table.group("dut", *needed)
    first = np.zeros(int(code.max()) + 1, dtype=np.int64)
    first[code] = np.arange(table.n)
    u, v, stage = (table.numbers[name][first] for name in needed)
    camera = camera_of(view) if (np.isfinite(u) & np.isfinite(v) & np.isfinite(stage)).all() else None
    if camera is None:
        return None
    unit = 1e3 if distances(view)[0].endswith("_mm") else 1.0
    device = table.group("dut")[first]
    soft = Optics(camera=camera, rays=_SOFT_RAYS, soft_rad=1.0 / (_SOFT_RAYS * camera.fx), scene=SceneSettings())
    light, beam = table.numbers[f"sim_{signals(view)[0]}"][first], np.exp(camera.log_beam(u, v))
    range_m = table.numbers[f"sim_{distances(view)[0]}"][first] / unit
    heights, samples = np.zeros(first.size), []
    for dut in range(int(device.max()) + 1):
        mine = np.flatnonzero(device == dut)
        some = mine[np.unique(np.linspace(0, mine.size - 1, min(_CHECKED, mine.size)).astype(np.int64))]
        spots = Spots(u=u, v=v, stage_deg=stage, height_m=heights).take(some)
        pixel = np.unique(spots.u * 4096.0 + spots.v, return_inverse=True)[1]
        sample = _Sample(
            spots=spots, light=light[some], beam=beam[some], range_m=range_m[some], pixel=pixel
        )  # fmt: skip
        height = _height(sample, soft)
        if height is None:
            return None
        heights[mine] = height
        samples.append((sample, height))
    optics = next(
        (
            sharp
            for sharp in (Optics(camera=camera, rays=rays, soft_rad=0.0, scene=soft.scene) for rays in _RAYS)
            if all(_unequal(*sample.off(sharp, height), sample.pixel) < _MOST_UNEQUAL for sample, height in samples)
        ),
        soft,
    )
    frame = np.unique(device * 1_000_000 + np.round(stage * 100.0), return_inverse=True)[1]
    return Bench(
        index=code, spots=Spots(u=u, v=v, stage_deg=stage, height_m=heights), frame=frame, unit=unit, optics=optics
    )


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
    alike = best[0] < _MOST_MISFIT or _unequal(*sample.off(rays, best[1]), sample.pixel) < _MOST_UNEQUAL
    return best[1] if alike and np.isfinite(best[0]) else None


def _misfit(sample: _Sample, soft: Optics, height_m: float) -> float:
    bright, away = sample.off(soft, height_m)
    seen = np.isfinite(bright) & np.isfinite(away)
    if seen.sum() < _FEWEST:
        return np.inf
    dim, away = np.abs(bright[seen]), np.abs(away[seen])
    if np.median(away) > 3e-3 or np.median(dim) > 0.03:
        return np.inf
    return float(np.mean(np.minimum(dim, 0.5)) + np.mean(np.minimum(away, 0.05)))


def _unequal(bright: FloatArray, away: FloatArray, pixel: IntArray) -> float:
    """Share of rows in which light or range differ by more than rounding, but for a calibration."""
    seen = np.isfinite(bright) & np.isfinite(away)
    whole = [np.abs(bright), np.abs(away)]
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


# ---- what rows see -------------------------------------------------------------------------------------------


def rendered(view: View, pose: Pose = NOMINAL) -> dict[str, FloatArray] | None:
    """Relative light and range of the rows under work in a pose (its arrays given by row), by channel.

    Returns:
        Signals in a unit of their own, distances in theirs; None where nothing can be rendered.
    """
    bench = bench_of(view)
    if bench is None:
        return None
    if pose is NOMINAL:
        return per_view(view, "rendered here", lambda: _by_channel(view, bench, *_kept(view, bench, NOMINAL)))
    return _by_channel(view, bench, *_kept(view, bench, pose))


def _kept(view: View, bench: Bench, pose: Pose) -> tuple[FloatArray, FloatArray]:
    """Light and moment of the rows in a pose; a search tries the same poses again beside other effects.

    What is kept is one number per different sight, not per row: steps and cycles repeat the spots, so that all poses
    of a search find room.
    """
    kept = per_view(view, "looks kept", dict[bytes, _Seen])
    key = pose.digest()
    found = kept.get(key)
    if found is None:
        found = _rendered(view, bench, pose)
        size = found.size if found.back is _distinct(view, bench)[2] else found.size + view.n
        room = per_view(view, "room for looks", lambda: [_MOST_KEPT])
        if size <= room[0]:
            room[0] -= size
            kept[key] = found
    return found.light[found.back], found.moment[found.back]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Seen:
    """Light and moment of different sights, and which of them each row has."""

    light: FloatArray
    moment: FloatArray
    back: IntArray

    @property
    def size(self) -> int:
        """Numbers that it holds."""
        return 2 * self.light.size


def _rendered(view: View, bench: Bench, pose: Pose) -> _Seen:
    numbers, first, back = _distinct(view, bench)
    arrays = pose.arrays()
    if all(np.array_equal(value[first][back], value) for value in arrays):
        spots = per_view(view, "seen spots", lambda: bench.spots.take(numbers))
        usual = isinstance(pose.focal, float) and pose.focal == 1.0
        rays = per_view(view, "seen rays", lambda: rays_of(bench.optics, spots)) if usual else None
        light, moment = look(bench.optics, spots, pose.on(first), rays)
        return _Seen(light=light, moment=moment, back=back)
    first, back = _sights(back, arrays)
    light, moment = look(bench.optics, bench.spots.take(bench.index[view.rows[first]]), pose.on(first))
    return _Seen(light=light, moment=moment, back=back)


def _sights(spot: IntArray, arrays: list[FloatArray]) -> tuple[IntArray, IntArray]:
    """A row of each different spot in a different pose, and which of them every row is."""
    for value in arrays:
        levels, code = np.unique(value, return_inverse=True)
        first, spot = np.unique(spot * levels.size + code, return_index=True, return_inverse=True)[1:]
    return first.astype(np.int64), spot.astype(np.int64)


def _distinct(view: View, bench: Bench) -> tuple[IntArray, IntArray, IntArray]:
    """Different spots of a view's rows: their numbers, a row of each, and which of them every row is."""

    def make() -> tuple[IntArray, IntArray, IntArray]:
        found, first, back = np.unique(bench.index[view.rows], return_index=True, return_inverse=True)
        return found, first.astype(np.int64), back.astype(np.int64)

    return per_view(view, "distinct spots", make)


def _by_channel(view: View, bench: Bench, light: FloatArray, moment: FloatArray) -> dict[str, FloatArray]:
    light = np.maximum(light, 1e-9)
    return dict.fromkeys(signals(view), light) | dict.fromkeys(distances(view), moment / light * bench.unit)


def convolved(view: View, variance_px2: FloatArray) -> dict[str, FloatArray] | None:
    """Relative light and range of the rows' pixels after the image was convolved with a Gaussian.

    The kernel is the discrete Gaussian exp(−t)·I_n(t) with t the variance in pixels squared, cut at two pixels.

    Args:
        view: rows under work.
        variance_px2: of every row.

    Returns:
        As `rendered`; None where nothing can be rendered.
    """
    bench = bench_of(view)
    if bench is None:
        return None
    numbers, _, back = _distinct(view, bench)
    images = per_view(view, "images beside", lambda: _beside(bench, numbers))
    line = np.stack([ive(n, variance_px2) for n in range(_WIDEST_PX + 1)])
    line = line / (line[0] + 2.0 * line[1:].sum(axis=0))
    light, moment = np.zeros(view.n), np.zeros(view.n)
    for (du, dv), (seen, far) in zip(_TAPS, images, strict=True):
        share = line[abs(du)] * line[abs(dv)]
        light += share * seen[back]
        moment += share * far[back]
    return _by_channel(view, bench, light, moment)


def _beside(bench: Bench, numbers: IntArray) -> list[tuple[FloatArray, FloatArray]]:
    """Light and moment of the pixels about each spot, in units of its own illumination."""
    spots, camera = bench.spots.take(numbers), bench.optics.camera
    own = camera.log_beam(spots.u, spots.v)
    found = []
    for du, dv in _TAPS:
        other = spots.beside(du, dv)
        beam = np.exp(camera.log_beam(other.u, other.v) - own)
        light, moment = look(bench.optics, other)
        found.append((beam * light, beam * moment))
    return found


def whole_image(view: View) -> FloatArray | float:
    """Mean light of each row's whole image over that of the pixels that the table holds of it; 1 where not known."""
    bench = bench_of(view)
    if bench is None:
        return 1.0
    fullness = per_table(view, "fullness", lambda: _fullness(bench))
    return fullness[bench.index[view.rows]]


def _fullness(bench: Bench) -> FloatArray:
    """Mean light of the nominal image (every fourth pixel) over the mean of the spots of the same image."""
    spots, camera = bench.spots, bench.optics.camera
    light, _ = look(bench.optics, spots)
    held = np.bincount(bench.frame, light * np.exp(camera.log_beam(spots.u, spots.v))) / np.bincount(bench.frame)
    across, along = (
        part.ravel() for part in np.meshgrid(np.arange(1.5, 128, 4), np.arange(1.5, 32, 4), indexing="ij")
    )
    beam = np.exp(camera.log_beam(across, along))
    coarse = Optics(camera=camera, rays=1, soft_rad=4.0 / camera.fx, scene=bench.optics.scene)
    whole = np.zeros(held.size)
    for index, one in enumerate(np.unique(bench.frame, return_index=True)[1]):
        image = Spots(
            u=across, v=along, stage_deg=np.full(across.size, spots.stage_deg[one]),
            height_m=np.full(across.size, spots.height_m[one]),
        )  # fmt: skip
        whole[index] = float(np.mean(look(coarse, image)[0] * beam))
    return np.asarray((whole / np.maximum(held, 1e-300))[bench.frame])
