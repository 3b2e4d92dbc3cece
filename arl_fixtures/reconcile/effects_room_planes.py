"""How the surfaces about a sensor lie: a plane about every ray, from its neighbours, its incidence, its surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from arl_fixtures.reconcile.effects_still import both
from arl_fixtures.reconcile.view import View

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_ROUNDS = 5
FLAT, FLAT_IN_PIXELS = 1e-3, 0.03
"""Relative error of 1/range within which rays lie on one plane, and of means over a camera's pixels: on a floor that
goes away a mean of ranges is not the range at the middle."""
_FEWEST_ON_SURFACE, _SPREAD, _ONE_PLANE = 6, 0.03, 0.7
"""Rays that a named surface must have, the extent of their directions that tells how it lies if they are as good as
`FLAT`, and the share of them that must lie on one plane."""
_LEAST_SPREAD = 1e-3
"""Extent of directions below which even exact ranges tell nothing."""
_LEVEL = 5e-3
"""Difference of cos(incidence) and sin(elevation) up to which a ray meets a floor or a ceiling."""
_UPRIGHT_DEG = 0.05
"""Difference of incidence and elevation up to which a surface faces a ray."""
_UNIT, _AS_MET = 0.02, 0.02
"""Error of a unit normal's length up to which neighbours tell it, and by how much, against 1/range, a plane may lean
otherwise than it is met."""
_CLOSEST, _MUCH = 5, 0.3
"""Rays, itself one, that tell a plane where more of them do not, and to what share of the error they must do so."""
_ALONE = 0.02
"""Relative error of 1/range from which a ray lies on no plane."""
_RIDGE = 1e-6


@dataclass(frozen=True, slots=True)
class Rays:
    """Rays of a table, each once.

    Attributes:
        rows: of the whole table, (n,); direction: in the room, unit vectors, (n, 3).
        near: rays next to each, itself first, (n, k).
    """

    rows: IntArray
    direction: FloatArray
    near: IntArray


def sends_back(slope: FloatArray, direction: FloatArray) -> FloatArray:
    """What a ray gets of the light that a plane sends back: cos(incidence) / range², (n,).

    Args:
        slope: the vectors m of 1/range = m·direction, (n, 3); direction: of the rays, unit vectors, (n, 3).
    """
    inverse = np.sum(slope * direction, axis=1)  # cos(incidence) is this over the slope's length
    return np.asarray(inverse**3 / np.linalg.norm(slope, axis=1))


def planes_about(view: View, rays: Rays, target: FloatArray, named: FloatArray) -> FloatArray:
    """The vector m of 1/range = m·direction about every ray, (n, 3).

    Args:
        view: of a table; rays: of it; target: 1/range, NaN where not known or of more than one surface.
        named: planes of its named surfaces, see `named_planes`.
    """
    slope, wrong = _slopes(rays.direction, rays.near, target)
    closer, less = _slopes(rays.direction, rays.near, target, _CLOSEST)  # narrow boards, few rays on each
    better = (wrong > FLAT) & (less < _MUCH * wrong)
    slope, wrong = np.where(better[:, None], closer, slope), np.where(better, less, wrong)
    if np.median(wrong) < FLAT:  # a room of planes: what lies on none is a post of which nothing tells how it leans
        alone = (wrong > _ALONE) & np.isfinite(target)
        slope[alone] = target[alone, None] * rays.direction[alone]
    facing = view.columns.numbers.get("incidence_deg")
    if facing is not None:
        met_deg = facing[rays.rows]
        slope = _as_met(rays, met_deg, target, slope)
        slope = _level(rays.direction, met_deg, target, slope)
        slope = _upright(rays.direction, met_deg, target, slope)
    return np.where(np.isfinite(named), named, slope)


def _slopes(
    direction: FloatArray, near: IntArray, target: FloatArray, closest: int | None = None
) -> tuple[FloatArray, FloatArray]:
    """The vector m of 1/range = m·direction about every ray, from the neighbours that lie on the same surface.

    And the relative error of 1/range with which they and the ray do so. Of all neighbours the flattest plane is taken
    that holds for the ray; the planes are those of the `closest` ones.
    """
    about, near = near, near[:, :closest]
    rays, values = direction[near], target[near]
    own = np.where(np.isfinite(target), target, 0.0)
    size = np.maximum(np.abs(own), 1e-12)
    good = np.isfinite(values)
    along = np.ones(near.shape)
    if closest is not None:  # few rays tell how it leans across the own one only: that one's range holds in any case
        along = np.einsum("nki,ni->nk", rays, direction)
    off = np.where(good, values, own[:, None] * along) - own[:, None] * along
    lean = rays - along[..., None] * direction[:, None, :]
    weight = good.astype(np.float64)
    slope, rest = np.zeros(direction.shape), np.zeros(own.size)
    for _ in range(_ROUNDS):
        gram = np.einsum("nk,nki,nkj->nij", weight, lean, lean)
        scale = np.einsum("nii->n", gram) + 1e-30
        gram = gram + (_RIDGE * scale)[:, None, None] * np.eye(3)
        slope = np.linalg.solve(gram, np.einsum("nk,nki,nk->ni", weight, lean, off)[..., None])[..., 0]
        left = np.abs(off - np.einsum("nki,ni->nk", lean, slope)) / size[:, None]
        rest = np.median(np.where(good, left, 0.0), axis=1)
        weight = good / (1.0 + (left / np.maximum(2.0 * rest, FLAT)[:, None]) ** 2) ** 2
    across = np.sum(slope * direction, axis=1)
    whole = slope + (own - across)[:, None] * direction  # m·d is the own value, the rest of m the slope across
    flattest, wrong = _flattest(whole, direction, rest, own, size, about)
    return np.asarray(whole[flattest]), wrong


def _as_met(rays: Rays, met_deg: FloatArray, target: FloatArray, slope: FloatArray) -> FloatArray:
    """Planes of rays, no steeper than these meet their surfaces: on rough ones neighbours lean by their bumps.

    cos(incidence) = n·d is linear in the ray's direction wherever the unit normal n is the same, however far shelves
    and bumps stand back: where neighbours tell such a normal, m = n / (R cos(incidence)). Else the part of m across a
    ray is at most tan(incidence) times that along it.
    """
    cosine = np.cos(np.radians(met_deg))
    along = np.where(np.isfinite(target), target, 0.0)[:, None] * rays.direction
    across = slope - along
    normal, _ = _slopes(rays.direction, rays.near, cosine)
    with np.errstate(invalid="ignore", divide="ignore"):
        lean, most = np.linalg.norm(across, axis=1), np.abs(target * np.tan(np.radians(met_deg)))
        by_normal = normal * (target / cosine)[:, None]
        sure = np.abs(np.linalg.norm(normal, axis=1) - 1.0) < _UNIT
        share = np.minimum(most / lean, 1.0)
        wrong = np.abs(lean - most) > _AS_MET * np.hypot(most, target)
    capped = along + np.where(np.isfinite(share), share, 1.0)[:, None] * across
    told = (sure & wrong & np.isfinite(by_normal).all(axis=1))[:, None]
    return np.asarray(np.where(told, by_normal, capped))


def _level(direction: FloatArray, met_deg: FloatArray, target: FloatArray, slope: FloatArray) -> FloatArray:
    """Planes of rays, level where a ray is told to meet its surface as it would a floor: one ray alone tells that."""
    up = direction[:, 2]
    with np.errstate(invalid="ignore"):
        level = np.abs(np.cos(np.radians(met_deg)) - np.abs(up)) < np.minimum(_LEVEL, 0.1 * np.abs(up))
    level &= np.isfinite(target)
    found = slope.copy()
    found[level] = 0.0
    found[level, 2] = target[level] / up[level]
    return found


def _upright(direction: FloatArray, met_deg: FloatArray, target: FloatArray, slope: FloatArray) -> FloatArray:
    """Planes of rays that meet their surface at their own elevation: it stands upright and faces them."""
    level = np.hypot(direction[:, 0], direction[:, 1])
    with np.errstate(invalid="ignore"):
        upright = np.abs(met_deg - np.degrees(np.arccos(np.minimum(level, 1.0)))) < _UPRIGHT_DEG
    upright &= np.isfinite(target)
    found = slope.copy()
    found[upright] = 0.0
    found[upright, :2] = direction[upright, :2] * (target / level**2)[upright, None]
    return found


def named_planes(
    view: View, rows: IntArray, direction: FloatArray, place: IntArray, target: FloatArray, flat: float
) -> FloatArray:
    """The vector m about rays of named surfaces that are one plane, (n, 3); NaN about others.

    Two rays in a corner of the floor tell nothing of how it lies; those in the other corners do.

    Args:
        view: of a table; rows, direction: of its rays, see `Rays`; place: where the sensor stands, (n,).
        target: as of `planes_about`.
        flat: relative error of 1/range within which rays lie on one plane.
    """
    table, found = view.columns, np.full(direction.shape, np.nan)
    if "surface" not in table.categories:
        return found
    code = both(place, table.group("surface")[rows])
    for surface in np.unique(code):
        of_it = np.flatnonzero((code == surface) & np.isfinite(target))
        rays, values = direction[of_it], target[of_it]
        if of_it.size < _FEWEST_ON_SURFACE:
            continue
        spread = float(np.linalg.svd(rays, compute_uv=False)[-1])
        weight = 1.0 / np.maximum(np.abs(values), 1e-12)
        left = np.zeros(of_it.size)
        for _ in range(_ROUNDS):
            root = weight / (1.0 + (left / flat) ** 2)
            plane = np.linalg.lstsq(rays * root[:, None], values * root, rcond=None)[0]
            left = np.abs(rays @ plane - values) * weight
        on_it = left < flat
        if np.mean(on_it) <= _ONE_PLANE or spread < _LEAST_SPREAD:
            continue
        if spread > _SPREAD or float(np.sqrt(np.mean(left[on_it] ** 2))) < FLAT * spread / _SPREAD:
            found[of_it[on_it]] = plane
    return found


def _flattest(
    whole: FloatArray, direction: FloatArray, rest: FloatArray, own: FloatArray, size: FloatArray, near: IntArray
) -> tuple[IntArray, FloatArray]:
    """Of each ray's neighbours the one whose plane is the flattest of those that hold for it, too: beside an edge.

    And by how much it does not hold.
    """
    said = np.einsum("nki,ni->nk", whole[near], direction)
    wrong = np.abs(said - own[:, None]) / size[:, None] + rest[near]
    best = np.argmin(wrong, axis=1)
    rows = np.arange(own.size)
    return np.asarray(near[rows, best], dtype=np.int64), np.asarray(wrong[rows, best])
