"""The nominal bench rendered in another pose, where the table's simulation is seen to be that bench.

A table of a few scattered pixels does not hold what a ray sees that points a little elsewhere. Where pixels, stage
angles and simulated channels agree with the nominal scene, it is rendered: through sharp rays where the simulation
jumps at edges as those do, else through soft beamlets.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import ive

from arl_fixtures.reconcile.effect import State
from arl_fixtures.reconcile.effects_bench import Bench, bench_of
from arl_fixtures.reconcile.effects_common import distances, per_view, set_light, signals
from arl_fixtures.reconcile.effects_rays import NOMINAL, Pose, echoes, look, rays_of
from arl_fixtures.reconcile.view import View

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

_MOST_KEPT = 30_000_000  # numbers: 240 MB
_SOFT, _FINE, _MOST_FOOTPRINTS = 3, 5, 20
_WIDEST_PX = 2
_TAPS = tuple((du, dv) for du in range(-_WIDEST_PX, _WIDEST_PX + 1) for dv in range(-_WIDEST_PX, _WIDEST_PX + 1))


def rendered(view: View, pose: Pose = NOMINAL, *, whole: bool = False) -> dict[str, FloatArray] | None:
    """Relative light and range of the rows under work in a pose (its arrays given by row), by channel.

    Args:
        view: rows under work.
        pose: of the sensor.
        whole: whether a pixel sees the mean over all of its area, though the simulation looks through sharp rays.

    Returns:
        Signals in a unit of their own, distances in theirs; None where nothing can be rendered.
    """
    bench = _softened(view) if whole else bench_of(view)
    if bench is None:
        return None
    if pose is NOMINAL:
        here = ("rendered here", whole)
        return per_view(view, here, lambda: _by_channel(view, bench, *_kept(view, bench, NOMINAL)))
    return _by_channel(view, bench, *_kept(view, bench, pose))


def ray_echoes(view: View) -> tuple[FloatArray, FloatArray, IntArray] | None:
    """Light and range (in the table's unit) of the rays of pixels that see several ranges, (spots, rays) each.

    And the rows' spots among these, −1 where a pixel sees one range only, or is simulated otherwise than the bench
    would show it; None where nothing can be rendered.
    """
    bench = bench_of(view)
    if bench is None:
        return None

    def make() -> tuple[FloatArray, FloatArray, IntArray]:
        numbers, _, back = distinct_spots(view, bench)
        light, metres = echoes(bench.optics, bench.spots.take(numbers))
        several = np.ptp(metres, axis=1) > _SEVERAL_M
        place = np.where(several, np.cumsum(several) - 1, -1)[back]
        return light[several], metres[several] * bench.unit, np.where(as_simulated(view), place, -1)

    return per_view(view, "ray echoes", make)


_SEVERAL_M = 0.02
"""Spread of the rays' ranges from which a pixel holds more than one surface: slanted ones spread less."""
_SAME_LIGHT, _SAME_RANGE_M = 0.2, 0.03
"""Differences of light (natural logarithm) and range up to which a row is simulated as the bench would show it."""


def as_simulated(view: View) -> NDArray[np.bool_]:
    """Whether the rendered bench shows the rows under work as the table simulates them.

    A sharp ray that ends on an edge may be on either side of it: of what else such a pixel sees nothing is known.
    """

    def make() -> NDArray[np.bool_]:
        bench, seen = bench_of(view), rendered(view)
        same = np.ones(view.n, dtype=bool)
        if bench is None or seen is None or not (bench.sharp or bench.is_other):
            return same
        spot, camera = bench.index[view.rows], bench.optics.camera
        unit = view.columns.group("dut")[view.rows]
        beam = camera.log_beam(bench.spots.u[spot], bench.spots.v[spot])
        for name in signals(view)[:1]:
            with np.errstate(invalid="ignore", divide="ignore"):
                off = np.log(view.sim[name] / seen[name]) - beam
            for one in np.unique(unit[np.isfinite(off)]):
                mine = unit == one
                same[mine] &= np.abs(off - np.nanmedian(off[mine & np.isfinite(off)]))[mine] < _SAME_LIGHT
        for name in distances(view)[:1]:
            off = view.sim[name] / bench.unit - seen[name] / bench.unit - bench.ahead_m[spot]
            same &= ~(np.abs(off) > _SAME_RANGE_M)
        return same

    return per_view(view, "as simulated", make)


def _softened(view: View) -> Bench | None:
    """The bench seen through beamlets that fill the pixels between them."""
    bench = bench_of(view)
    if bench is None or not bench.sharp:
        return bench
    soft = replace(bench.optics, rays=_SOFT, soft_rad=1.0 / (_SOFT * bench.optics.camera.fx))
    return per_view(view, "softened bench", lambda: replace(bench, optics=soft))


def _kept(view: View, bench: Bench, pose: Pose) -> tuple[FloatArray, FloatArray]:
    """Light and moment of the rows in a pose; a search tries the same poses again beside other effects.

    What is kept is one number per different sight, not per row: steps and cycles repeat the spots, so that all poses
    of a search find room.
    """
    kept = per_view(view, "looks kept", dict[bytes, _Seen])
    key = pose.digest() + repr(bench.optics.soft_rad).encode()
    found = kept.get(key)
    if found is None:
        found = _rendered(view, bench, pose)
        size = found.size if found.back is distinct_spots(view, bench)[2] else found.size + view.n
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
    numbers, first, back = distinct_spots(view, bench)
    arrays = pose.arrays()
    if all(np.array_equal(value[first][back], value) for value in arrays):
        spots = per_view(view, "seen spots", lambda: bench.spots.take(numbers))
        usual = isinstance(pose.focal, float) and pose.focal == 1.0
        through = ("seen rays", bench.optics.rays)
        rays = per_view(view, through, lambda: rays_of(bench.optics, spots)) if usual else None
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


def distinct_spots(view: View, bench: Bench) -> tuple[IntArray, IntArray, IntArray]:
    """Different spots of a view's rows: their numbers, a row of each, and which of them every row is."""

    def make() -> tuple[IntArray, IntArray, IntArray]:
        found, first, back = np.unique(bench.index[view.rows], return_index=True, return_inverse=True)
        return found, first.astype(np.int64), back.astype(np.int64)

    return per_view(view, "distinct spots", make)


def _by_channel(view: View, bench: Bench, light: FloatArray, moment: FloatArray) -> dict[str, FloatArray]:
    light = np.maximum(light, 1e-9)
    signal = light + bench.pedestal[bench.index[view.rows]]
    return dict.fromkeys(signals(view), signal) | dict.fromkeys(distances(view), moment / light * bench.unit)


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
    numbers, _, back = distinct_spots(view, bench)
    images = per_view(view, "images beside", lambda: _beside(bench, numbers))
    line = np.stack([ive(n, variance_px2) for n in range(_WIDEST_PX + 1)])
    line = line / (line[0] + 2.0 * line[1:].sum(axis=0))
    light, moment = np.zeros(view.n), np.zeros(view.n)
    for (du, dv), (seen, far) in zip(_TAPS, images, strict=True):
        share = line[abs(du)] * line[abs(dv)]
        light += share * seen[back]
        moment += share * far[back]
    return _by_channel(view, bench, light, moment)


def pixel_beside(view: View, du: int, dv: int, lacking: BoolArray) -> tuple[FloatArray, FloatArray] | None:
    """Light of the pixel `du` columns and `dv` rows further in units of the row's own, and how much farther it sees.

    Args:
        view: rows under work.
        du: columns.
        dv: rows.
        lacking: rows of the view of which it is asked.

    Returns:
        In the table's distance unit, NaN beyond the sensor's edge and where it is not asked; None where nothing can
        be rendered.
    """
    bench = bench_of(view)
    if bench is None:
        return None
    ratio, farther = np.full((2, view.n), np.nan)
    if bench.complete:
        return ratio, farther
    found, back = np.unique(bench.index[view.rows[lacking]], return_inverse=True)
    spots, camera = bench.spots.take(found), bench.optics.camera
    beside = spots.beside(du, dv)
    within = (np.abs(beside.u - camera.cx) < camera.cx + 1.0) & (np.abs(beside.v - camera.cy) < camera.cy + 1.0)
    there = np.flatnonzero(within)
    found, spots, beside = found[there], spots.take(there), beside.take(there)
    own, own_far = look(bench.optics, spots)
    other, far = look(bench.optics, beside)
    beam = np.exp(camera.log_beam(beside.u, beside.v) - camera.log_beam(spots.u, spots.v))
    told = np.full((2, within.size), np.nan)
    with np.errstate(invalid="ignore", divide="ignore"):
        told[0, there] = (other * beam + bench.pedestal[found]) / (own + bench.pedestal[found])
        told[1, there] = (far / other - own_far / own) * bench.unit
    ratio[lacking], farther[lacking] = told[:, back]
    return ratio, farther


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


def footprint(view: View, filled: float, blur_px: float = 0.0) -> dict[str, FloatArray] | None:
    """Relative light and range of the rows' pixels if each sees the mean over its area, not some sharp rays.

    Args:
        view: rows under work.
        filled: width of the area that a pixel sees, in pixels.
        blur_px: standard deviation of a point spread about it.

    Returns:
        As `rendered`; None where nothing can be rendered.
    """
    bench = bench_of(view)
    if bench is None:
        return None
    numbers, _, back = distinct_spots(view, bench)
    kept = per_view(view, "footprints", dict[tuple[float, float], tuple[FloatArray, FloatArray]])
    key = filled, blur_px
    if key not in kept:
        if len(kept) >= _MOST_FOOTPRINTS:
            kept.clear()
        soft = replace(
            bench.optics, rays=_FINE, soft_rad=filled / (_FINE * bench.optics.camera.fx), filled=filled,
            spread_px=blur_px,
        )  # fmt: skip
        kept[key] = look(soft, bench.spots.take(numbers))
    light, moment = kept[key]
    return _by_channel(view, bench, light[back], moment[back])


def see_area(
    view: View,
    state: State,
    channel: str,
    moved: tuple[str, ...],
    share: FloatArray | float,
    wide_px: float,
    blur_px: float = 0.0,
) -> None:
    """Replace a share of what the simulation's rays see by the mean over an area about each pixel.

    Args:
        view: rows under work.
        state: the signal and the distances are replaced.
        channel: the signal, empty where there is none; moved: distances that follow, by light.
        share: of the light, a number or one by row.
        wide_px: width of the area in pixels; blur_px: standard deviation of a point spread about it.
    """
    mean, rays = footprint(view, wide_px, blur_px), rendered(view)
    if mean is None or rays is None:
        return
    known = as_simulated(view)
    if not channel:
        for name in moved:
            state[name] = state[name] + np.where(known, share * (mean[name] - rays[name]), 0.0)
        return
    ratio = np.where(known, np.maximum(1.0 + share * (mean[channel] / rays[channel] - 1.0), 0.01), 1.0)
    part = np.where(known, np.clip(share * mean[channel] / rays[channel] / ratio, -2.0, 2.0), 0.0)
    for name in moved:
        state[name] = state[name] + part * (mean[name] - rays[name])
    set_light(view, state, channel, state[channel] * ratio)
