"""The surfaces about a scanner without a grid of pixels, found from its own table: a plane for every ray.

Rays of a scanner lie on rings that are far apart, or anywhere: no curve over the bearing joins them. But rooms are
made of planes, and 1/range is linear in a ray's direction on one: 1/R = m·d, m the plane's normal over its distance.
A ray that is turned then sees R·(m·d)/(m·d'), however its neighbours lie.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from arl_fixtures.reconcile.effects_common import distances, per_table, per_view, signals
from arl_fixtures.reconcile.effects_illumination import ray_column
from arl_fixtures.reconcile.roles import HALF_TURN_DEG
from arl_fixtures.reconcile.view import View

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_NEIGHBOURS = 12
_SAME_RAY = 1e-4
"""Radians within which rays are one: a hundredth of a degree is finer than scanners point."""
_FEWEST_RAYS = 60
_MOST_RAYS = 60_000
_MOST_RINGS = 200
_ROUNDS = 5
_FLAT = 1e-3
"""Relative error of 1/range within which rays lie on one plane."""
_RIDGE = 1e-6
_FARTHEST, _MOST_LOG = 2.0, 4.0
"""Factor by which a turned ray's range may change, and the logarithm of that of its light."""


@dataclass(frozen=True, slots=True)
class Room:
    """What each ray of a table sees, beyond it.

    Attributes:
        sign: +1 where a ray's bearing is azimuth + stage angle, −1 where it is azimuth − stage angle.
        slopes: channel to a vector for every row of the whole table: of 1/range for distances, of ln(light) for
            signals; to be multiplied with the ray's direction in the room.
        beyond: the same of the next plane that a ray would come to.
        fold: +1 where that plane comes in front beyond an edge (a corner of the room), −1 where the own one ends (a
            corner that stands out), 0 where there is none near.
    """

    sign: float
    slopes: dict[str, FloatArray]
    beyond: dict[str, FloatArray]
    fold: FloatArray


def room_of(view: View, sign: float) -> Room | None:
    """The planes about a scanner; None where the table has a camera's pixels, or no rays in two directions."""
    return per_table(view, ("room", sign), lambda: _make(view, sign))


def changes_in_room(
    view: View, room: Room, turn: FloatArray | float, lift: FloatArray | float
) -> dict[str, FloatArray]:
    """Ratio of each signal and difference of each distance for rays turned in azimuth and elevation, degrees."""
    here = per_view(view, "room rays", lambda: _directions(view, room.sign)[view.rows])
    there = _directions(view, room.sign, turn=turn, lift=lift)
    first = distances(view)[0]
    fold = room.fold[view.rows]
    over = np.sum((room.beyond[first] - room.slopes[first])[view.rows] * there, axis=1) * fold > 0.0
    found = {}
    for name, own in room.slopes.items():
        slope = own[view.rows]
        before = np.sum(slope * here, axis=1)
        after = np.sum(np.where(over[:, None], room.beyond[name][view.rows], slope) * there, axis=1)
        if name in distances(view):
            with np.errstate(invalid="ignore", divide="ignore"):
                ratio = before / after
            ratio = np.where(np.isfinite(ratio), np.clip(ratio, 1.0 / _FARTHEST, _FARTHEST), 1.0)
            found[name] = view.sim[name] * (ratio - 1.0)
        else:
            found[name] = np.exp(np.clip(np.nan_to_num(after - before), -_MOST_LOG, _MOST_LOG))
    return found


def _directions(
    view: View, sign: float, *, turn: FloatArray | float | None = None, lift: FloatArray | float = 0.0
) -> FloatArray:
    """Unit vectors in the room: of every row of the whole table, or of the rows under work where they are turned."""
    stage = view.columns.numbers["stage_angle_deg"] if view.varies("stage_angle_deg") else np.zeros(view.columns.n)
    bearing = ray_column(view, "azimuth_deg") + sign * np.nan_to_num(stage)
    height = ray_column(view, "elevation_deg")
    if turn is not None:
        bearing, height = bearing[view.rows] + turn, height[view.rows] + lift
    az, el = np.radians(bearing), np.radians(height)
    return np.stack([np.cos(el) * np.cos(az), np.cos(el) * np.sin(az), np.sin(el)], axis=1)


def _make(view: View, sign: float) -> Room | None:
    table = view.columns
    if not (view.varies("azimuth_deg") and view.varies("elevation_deg") and distances(view)):
        return None
    if (view.varies("pixel_u") or view.varies("pixel_v")) and not _looks_around(view):
        return None
    everywhere = _directions(view, sign)  # a stage turns rays to where others looked before
    seen = np.column_stack([table.group("dut"), np.rint(everywhere / _SAME_RAY)])
    code = np.unique(seen, axis=0, return_inverse=True)[1].ravel()
    far = table.numbers[f"sim_{distances(view)[0]}"]
    rays = np.unique(np.where(np.isfinite(far) & (far > 0.0), code, -1), return_index=True)
    first = rays[1][rays[0] >= 0]
    if not _FEWEST_RAYS <= first.size <= _MOST_RAYS:
        return None
    direction = everywhere[first]
    near = _nearest(view, first, direction, table.group("dut")[first])
    of_code = np.zeros(int(code.max()) + 1, dtype=np.int64)
    of_code[code[first]] = np.arange(first.size)
    known = np.zeros(of_code.size, dtype=bool)
    known[code[first]] = True
    slopes: dict[str, FloatArray] = {}
    beyond: dict[str, FloatArray] = {}
    rival, fold = np.arange(first.size), np.zeros(first.size)
    for name in (*distances(view), *signals(view)):
        values = table.numbers[f"sim_{name}"][first]
        with np.errstate(invalid="ignore", divide="ignore"):
            target = 1.0 / values if name in distances(view) else np.log(values)
        slope = _slopes(direction, near, np.where(np.isfinite(target), target, np.nan), name in distances(view))
        if not slopes:
            rival, fold = _edges(slope, direction, near)
        for into, some in ((slopes, slope), (beyond, slope[rival])):
            into[name] = np.where(known[code][:, None], some[of_code[code]], 0.0)
    return Room(sign, slopes, beyond, np.where(known[code], fold[of_code[code]], 0.0))


def _looks_around(view: View) -> bool:
    """Whether rays go in more directions than a camera's field has: a scanner's beams, numbered as pixels or not."""
    low, high = view.span("azimuth_deg")
    return high - low > HALF_TURN_DEG


def _edges(slope: FloatArray, direction: FloatArray, near: IntArray) -> tuple[IntArray, FloatArray]:
    """For each ray the neighbour whose plane it comes to first, and how the two planes meet (see `Room.fold`)."""
    own = np.sum(slope * direction, axis=1)[:, None]
    theirs = np.einsum("nki,ni->nk", slope[near], direction)  # the neighbour's plane where the own ray goes
    there = np.sum(slope[near] * direction[near], axis=2)
    mine = np.einsum("ni,nki->nk", slope, direction[near])  # the own plane where the neighbour's ray goes
    front = (there > mine * (1.0 + _FLAT)) & (theirs < own * (1.0 - _FLAT))
    behind = (there < mine * (1.0 - _FLAT)) & (theirs > own * (1.0 + _FLAT))
    away = np.where(front | behind, np.abs(theirs / own - 1.0), np.inf)
    place = np.argmin(away, axis=1)
    rows = np.arange(own.size)
    fold = np.where(np.isfinite(away[rows, place]), np.where(front[rows, place], 1.0, -1.0), 0.0)
    return np.asarray(near[rows, place], dtype=np.int64), np.asarray(fold)


def _nearest(view: View, rows: IntArray, direction: FloatArray, device: IntArray) -> IntArray:
    """Rays next to each ray, itself first; a ring counts as near as the next ray on the own ring."""
    height = np.degrees(np.arcsin(np.clip(direction[:, 2], -1.0, 1.0)))
    rings = np.unique(np.round(height, 2))
    stretch = 1.0
    if rings.size <= _MOST_RINGS:
        around = ray_column(view, "azimuth_deg")[rows]
        along = max(float(np.ptp(around)) * rings.size / rows.size, 1e-6)
        stretch = float(np.clip(along / np.median(np.diff(rings)), 0.02, 1.0))
    level = direction[:, :2] / np.maximum(np.hypot(*direction[:, :2].T), 1e-9)[:, None]
    place = np.column_stack([level, stretch * np.radians(height), 100.0 * device])
    return np.asarray(cKDTree(place).query(place, k=min(_NEIGHBOURS, rows.size))[1], dtype=np.int64)


def _slopes(direction: FloatArray, near: IntArray, target: FloatArray, is_range: bool) -> FloatArray:
    """The vector m of target = m·direction about every ray, from the neighbours that lie on the same surface."""
    rays, values = direction[near], target[near]
    own = np.where(np.isfinite(target), target, 0.0)
    size = np.maximum(np.abs(own), 1e-12) if is_range else np.ones(own.size)
    good = np.isfinite(values)
    off = np.where(good, values, own[:, None]) - own[:, None]
    lean = rays - direction[:, None, :]
    weight = good.astype(np.float64)
    slope, rest = np.zeros(direction.shape), np.zeros(own.size)
    for _ in range(_ROUNDS):
        gram = np.einsum("nk,nki,nkj->nij", weight, lean, lean)
        scale = np.einsum("nii->n", gram) + 1e-30
        gram = gram + (_RIDGE * scale)[:, None, None] * np.eye(3)
        slope = np.linalg.solve(gram, np.einsum("nk,nki,nk->ni", weight, lean, off)[..., None])[..., 0]
        left = np.abs(off - np.einsum("nki,ni->nk", lean, slope)) / size[:, None]
        rest = np.median(np.where(good, left, 0.0), axis=1)
        weight = good / (1.0 + (left / np.maximum(2.0 * rest, _FLAT)[:, None]) ** 2) ** 2
    across = np.sum(slope * direction, axis=1)
    whole = slope + (own - across)[:, None] * direction  # m·d is the own value, the rest of m the slope across
    flattest = _flattest(whole, rays, rest, own, size, near)
    return np.asarray(whole[flattest] if is_range else whole)


def _flattest(
    whole: FloatArray, rays: FloatArray, rest: FloatArray, own: FloatArray, size: FloatArray, near: IntArray
) -> IntArray:
    """Of each ray's neighbours the one whose plane is the flattest of those that hold for it, too: beside an edge."""
    said = np.einsum("nki,ni->nk", whole[near], rays[:, 0])
    wrong = np.abs(said - own[:, None]) / size[:, None] + rest[near]
    best = np.argmin(wrong, axis=1)
    return np.asarray(near[np.arange(own.size), best], dtype=np.int64)
