"""Light that bounced twice before an image: every part of what it sees lights the others, each where it lies.

Directions and simulated ranges place each part of the scene in the room, neighbours tell how its surface lies there.
A part is as bright as it looks, for a Lambertian surface whose range is known: it sends that light on with the
cosines of both ends and its area over the square of the distance (two-bounce radiosity of diffuse surfaces; Immel,
Cohen, Greenberg, SIGGRAPH 1986), and what it lights sends a share back over half of the whole way.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from arl_fixtures.reconcile.effects_common import distances, per_table
from arl_fixtures.reconcile.effects_illumination import ray_column
from arl_fixtures.reconcile.effects_planes import directions
from arl_fixtures.reconcile.effects_scene import scene
from arl_fixtures.reconcile.effects_scenes import scenes_shown
from arl_fixtures.reconcile.effects_still import both
from arl_fixtures.reconcile.roles import Role
from arl_fixtures.reconcile.view import IntArray, View

FloatArray = NDArray[np.float64]

_MOST_PARTS, _FEWEST_PARTS = 1000, 30
"""Parts into which a scene is cut, and the fewest that make one."""
_LEAST_ROWS = 4
"""Rows of an image over which elevations must vary."""
_NEIGHBOURS, _SAME_SURFACE, _RIDGE = 25, 0.15, 1e-9
"""Parts that tell how a surface lies at one of them, and the relative step of the range up to which they may."""
_FEWEST_NEAR, _LEAST_COSINE = 5, 0.25
"""Parts that at least tell it, and the cosine of an incidence from which they tell of an edge, not of a surface."""
_FLAT, _FLATTER = 1e-4, 0.5
"""Relative distance from a plane that says nothing, and the share of it at which one side tells better than all."""
_ON_LINE = 1e-6
_NEAR_PART = (0.8, 1.25)
"""Of a part's range: what the ranges of its quarters are held to."""
_CHUNK = 100
_MARGIN, _COARSER, _LEAST_BEYOND = 0.6, 3.0, 0.15
"""Radians about an image over which its surfaces go on, times coarser parts there, and their least cosine."""


class Parts(NamedTuple):
    """Parts of a scene: unit vectors to them and normals towards the sensor, (n, 3); signals, ranges, steradians."""

    ray: FloatArray
    normal: FloatArray
    bright: FloatArray
    away: FloatArray
    solid: FloatArray


def cloud(view: View, *, beyond: bool = False) -> tuple[FloatArray, FloatArray] | None:
    """Twice-bounced light of every row of the whole table over its own, and its extra one-way path.

    The light is over its mean: how much of it comes back remains to be fitted. The path is in the unit of the table's
    first distance. None where no image tells directions in both axes, or where nothing in it faces anything else.

    Args:
        view: rows under work.
        beyond: surfaces at the image's rim go on beyond it, in the same light.
    """
    return per_table(view, ("cloud", beyond), lambda: _make(view, beyond))


def _make(view: View, beyond: bool) -> tuple[FloatArray, FloatArray] | None:
    found, channel, far = scene(view), view.channel(Role.INTENSITY), distances(view)
    if found is None or not channel or not far or not all(map(view.varies, ("azimuth_deg", "elevation_deg"))):
        return None
    table = view.columns
    if np.unique(ray_column(view, "elevation_deg")).size < _LEAST_ROWS or "pixel_v" not in table.numbers:
        return None
    light, range_ = table.numbers[f"sim_{channel}"], table.numbers[f"sim_{far[0]}"]
    rays, shown = directions(view, found.sign), scenes_shown(view)
    surface = table.categories["surface"][0] + 1 if "surface" in table.categories else np.zeros_like(shown)
    good = np.isfinite(light) & (light > 0.0) & np.isfinite(range_) & (range_ > 0.0)
    strength, detour, means = np.full(table.n, np.nan), np.full(table.n, np.nan), []
    for code in np.unique(shown):
        rows = np.flatnonzero(good & (shown == code))
        part = both(_parts(rays[rows]), surface[rows])
        if part.max(initial=-1) + 1 < _FEWEST_PARTS:
            return None
        count = np.bincount(part)
        ray = np.stack([np.bincount(part, rays[rows, k]) / count for k in range(3)], axis=1)
        ray /= np.linalg.norm(ray, axis=1, keepdims=True)
        bright, away = (np.bincount(part, values[rows]) / count for values in (light, range_))
        named = np.zeros(len(count), dtype=np.int64)
        named[part] = surface[rows]
        parts = Parts(ray, _normals(ray, away, named), bright, away, _solid_angle(ray))
        lit, longer = _facing_each_other(parts, _beyond_view(parts) if beyond else None)
        means.append(lit.mean())
        strength[rows], detour[rows] = lit[part], longer[part]
    mean = float(np.mean(means))
    return (np.nan_to_num(strength) / mean, np.nan_to_num(detour)) if mean > 0.0 else None


def _parts(rays: FloatArray) -> IntArray:
    """Part of the scene that each ray belongs to, 0…k−1: cells of bearing and elevation, no more than are handled."""
    angles = _angles(rays)
    size = np.sqrt(float(np.prod(np.ptp(angles, axis=0) + 1e-3)) / _MOST_PARTS)
    cells = np.floor((angles - angles.min(axis=0)) / size + 1e-6).astype(np.int64)
    width = int(cells[:, 1].max()) + 1
    return np.asarray(np.unique(cells[:, 0] * width + cells[:, 1], return_inverse=True)[1], dtype=np.int64)


def _angles(rays: FloatArray) -> FloatArray:
    """Bearing and elevation of unit vectors in radians, (n, 2)."""
    return np.stack([np.arctan2(rays[:, 1], rays[:, 0]), np.arcsin(np.clip(rays[:, 2], -1.0, 1.0))], axis=1)


def _solid_angle(ray: FloatArray) -> FloatArray:
    """What each part takes of the view, steradians: by the distance of the four parts next to it."""
    near = np.asarray(cKDTree(ray).query(ray, k=5)[0])[:, 1:]
    return np.asarray(np.mean(near, axis=1) ** 2)


def _normals(ray: FloatArray, away: FloatArray, named: IntArray) -> FloatArray:
    """Unit normals of the surfaces at the parts, towards the sensor: 1/range is linear in a plane's directions.

    NaN at edges, where neighbours tell of no surface. Where surfaces meet, those of one side tell: of all and of the
    four sides the neighbours that lie most nearly on a plane.

    Args:
        ray: unit vectors, (n, 3); away: ranges; named: codes of the surfaces, (n,) each.
    """
    near = np.asarray(cKDTree(ray).query(ray, k=min(_NEIGHBOURS, len(ray)))[1], dtype=np.int64)
    same = (np.abs(away[near] / away[:, None] - 1.0) < _SAME_SURFACE) & (named[near] == named[:, None])
    along, up = np.arctan2(ray[:, 1], ray[:, 0]), ray[:, 2]
    beside = [np.angle(np.exp(1j * (along[near] - along[:, None]))), up[near] - up[:, None]]
    normal, least = np.full(ray.shape, np.nan), np.full(len(ray), np.inf)
    for side in (same, *(same & (way * off > -_ON_LINE) for off in beside for way in (1.0, -1.0))):
        told, left = _plane(ray, away, near, side)
        better = (side.sum(axis=1) >= _FEWEST_NEAR) & (left < _FLATTER * least)
        normal, least = np.where(better[:, None], told, normal), np.where(better, left, least)
    with np.errstate(invalid="ignore"):
        unsure = ~(-np.sum(normal * ray, axis=1) > _LEAST_COSINE)
    return np.where(unsure[:, None], np.nan, normal)


def _plane(
    ray: FloatArray, away: FloatArray, near: IntArray, chosen: NDArray[np.bool_]
) -> tuple[FloatArray, FloatArray]:
    """Normal of the plane nearest to some neighbours of each part, (n, 3), and how far they lie off it (a share)."""
    d, inverse = ray[near] * chosen[:, :, None], chosen / away[near]
    gram = np.einsum("nki,nkj->nij", d, d) + _RIDGE * np.eye(3)
    slope = np.linalg.solve(gram, np.einsum("nki,nk->ni", d, inverse)[:, :, None])[:, :, 0]
    off = (np.einsum("nki,ni->nk", d, slope) - inverse) * away[:, None]
    left = np.sqrt(np.sum(off**2, axis=1) / np.maximum(chosen.sum(axis=1), 1))
    left = np.maximum(left, np.abs(off[:, 0])) + _FLAT  # the nearest of all is the part itself
    return -slope / np.maximum(np.linalg.norm(slope, axis=1, keepdims=True), 1e-300), left


def _beyond_view(parts: Parts) -> Parts:
    """What lies about an image: of each direction the plane of the sure part that is next to it, with its paint."""
    sure = np.isfinite(parts.normal[:, 0])
    ray, normal, bright, away, _ = (values[sure] for values in parts)
    if not len(ray):
        return Parts(ray, normal, bright, away, away)
    angles, cell = _angles(ray), _COARSER * np.sqrt(float(np.median(parts.solid)))
    low, high = angles.min(axis=0), angles.max(axis=0)
    axes = [np.arange(a - _MARGIN, b + _MARGIN, cell) for a, b in zip(low, high, strict=True)]
    place = np.stack([x.ravel() for x in np.meshgrid(*axes, indexing="ij")], axis=1)
    place = place[np.any((place < low - 0.5 * cell) | (place > high + 0.5 * cell), axis=1)]
    place = place[np.abs(place[:, 1]) < 0.5 * np.pi]
    bearing, rise = place.T
    there = np.stack([np.cos(bearing) * np.cos(rise), np.sin(bearing) * np.cos(rise), np.sin(rise)], axis=1)
    own = np.asarray(cKDTree(angles).query(place)[1])
    level, facing = away[own] * np.sum(normal[own] * ray[own], axis=1), np.sum(normal[own] * there, axis=1)
    seen = facing < -_LEAST_BEYOND
    there, own, level, facing = there[seen], own[seen], level[seen], facing[seen]
    far = level / facing
    paint = bright[own] * away[own] / -level * away[own] ** 2
    return Parts(there, normal[own], -paint * facing / far**2, far, cell**2 * np.cos(rise[seen]))


def _facing_each_other(parts: Parts, beyond: Parts | None = None) -> tuple[FloatArray, FloatArray]:
    """Twice-bounced light of each part over what lights it directly, and its extra one-way path.

    Args:
        parts: those without a normal send no light, and get what the nearest one gets that has one.
        beyond: further ones that light these.
    """
    sure = np.asarray(np.isfinite(parts.normal[:, 0]))
    normal, bright = np.where(sure[:, None], parts.normal, -parts.ray), np.where(sure, parts.bright, 0.0)
    ray, away = parts.ray, parts.away
    place, facing = away[:, None] * ray, -np.sum(normal * ray, axis=1)
    senders = [_lamps(Parts(ray, normal, bright, away, parts.solid))]
    senders += [_lamps(beyond)] if beyond is not None else []
    lamps, sender, sent, area = (np.concatenate(values) for values in zip(*senders, strict=True))
    there = np.linalg.norm(lamps, axis=1)
    light, longer = np.zeros(len(ray)), np.zeros(len(ray))
    for start in range(0, len(ray), _CHUNK):
        here = slice(start, start + _CHUNK)
        across = lamps[None, :, :] - place[here, None, :]
        apart = np.linalg.norm(across, axis=2)
        unit = across / np.maximum(apart, 1e-9)[:, :, None]
        arriving = np.maximum(np.einsum("ijk,ik->ij", unit, normal[here]), 0.0)
        leaving = np.maximum(-np.einsum("ijk,jk->ij", unit, sender), 0.0)
        weight = sent * arriving * leaving / (apart**2 + 0.25 * area)
        total = weight.sum(axis=1)
        way = (weight * 0.5 * (there[None, :] + apart - away[here, None])).sum(axis=1)
        light[here], longer[here] = total * away[here] ** 2 / facing[here], way / np.maximum(total, 1e-300)
    if not sure.any():
        return np.zeros(len(ray)), longer
    nearest = np.flatnonzero(sure)[cKDTree(place[sure]).query(place)[1]]
    return light[nearest], longer[nearest]


def _lamps(parts: Parts) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Quarters of parts: where they are, (4 n, 3), their normals, what they send, and their areas, (4 n,)."""
    facing = -np.sum(parts.normal * parts.ray, axis=1)
    area = np.tile(parts.solid * parts.away**2 / facing, 4) / 4.0
    place = _quarters(parts.ray, parts.away, parts.normal, 0.25 * np.sqrt(parts.solid))
    return place, np.tile(parts.normal, (4, 1)), np.tile(parts.bright, 4) * area, area


def _quarters(ray: FloatArray, away: FloatArray, normal: FloatArray, off: FloatArray) -> FloatArray:
    """Middles of the four quarters of each part, on its plane, (4 n, 3): a part next to another is no point.

    Args:
        ray, normal: unit vectors, (n, 3) each; away: ranges; off: radians from a part's middle to its quarters'.
    """
    aside = np.stack([-ray[:, 1], ray[:, 0], np.zeros(len(ray))], axis=1)
    aside /= np.maximum(np.linalg.norm(aside, axis=1, keepdims=True), 1e-9)
    upward = np.cross(ray, aside)
    level = away * np.sum(normal * ray, axis=1)
    found = []
    for x, y in ((1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)):
        bent = ray + off[:, None] * (x * aside + y * upward)
        reach = np.clip(level / np.sum(normal * bent, axis=1), *(np.array(_NEAR_PART)[:, None] * away))
        found.append(bent * reach[:, None])
    return np.concatenate(found)
