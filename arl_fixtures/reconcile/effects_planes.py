"""How surfaces with a name lie, found from a table's own ranges: what a range becomes when its ray starts elsewhere.

1/range is linear in a ray's direction on a plane: 1/R = m·d, m the plane's normal over its distance. Seen from a
point that is displaced by δ the same ray meets the plane at R·(1 − m·δ), however far its neighbours look away. A
surface that is bent over the bearing has such a plane at every place. Curves over the bearing tell the same only
where pixels and angles lie close.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from arl_fixtures.reconcile.effects_common import distances, per_table, per_view, pure_rows, simulated_range_m
from arl_fixtures.reconcile.effects_illumination import ray_column
from arl_fixtures.reconcile.effects_scene import pixel_width
from arl_fixtures.reconcile.view import View

FloatArray = NDArray[np.float64]

_SAME_RAY = 1e-3
"""Radians within which rays are one for this."""
_FEWEST_RAYS, _LEAST_ANGLE = 12, 0.03
"""Directions of a surface, and how far they must part, radians, to tell how it lies."""
_FLAT, _FLAT_SHARE = 5e-3, 0.9
"""Relative error of the range within which nearly all rays must lie on one plane, or else on a bent surface."""
_INSIDE = 0.25
"""Share of a pixel's width by which a ray may turn and still see the one surface that its pixel is said to see."""
_RIDGE = 1e-6
_ORDER, _BEARINGS = 4, 15
"""Order of the polynomial of a bent surface, and bearings that tell it."""
_EDGE = 4.0
"""Times what a plane can do to a range from which a change is that of an edge that the ray has crossed."""


def planes(view: View, sign: float) -> FloatArray:
    """Normal over distance (1/m) of the plane that each row of the table touches, (n, 3); NaN where it is not known.

    Args:
        view: of a table; sign: +1 where a ray's bearing is azimuth + stage angle, −1 where it is the difference.
    """
    return per_table(view, ("planes", sign), lambda: _make(view, sign))


def directions(
    view: View, sign: float, *, turn: FloatArray | float | None = None, lift: FloatArray | float = 0.0
) -> FloatArray:
    """Unit vectors in the room, (n, 3): of every row of the whole table, or of the rows under work, turned (degrees).

    Args:
        view: of a table; sign: see `planes`; turn, lift: in bearing and elevation.
    """
    stage = view.columns.numbers["stage_angle_deg"] if view.varies("stage_angle_deg") else np.zeros(view.columns.n)
    bearing = ray_column(view, "azimuth_deg") + sign * np.nan_to_num(stage)
    height = ray_column(view, "elevation_deg")
    if turn is not None:
        bearing, height = bearing[view.rows] + turn, height[view.rows] + lift
    az, el = np.radians(bearing), np.radians(height)
    return np.stack([np.cos(el) * np.cos(az), np.cos(el) * np.sin(az), np.sin(el)], axis=1)


def rays_of(view: View, sign: float) -> FloatArray:
    """`directions` of the rows under work, (n, 3): looked up in every trial of a fit."""
    return per_view(view, ("rays", sign), lambda: directions(view, sign)[view.rows])


def smooth_part(
    view: View, change: FloatArray, on_plane: FloatArray, reach: FloatArray, turn: FloatArray | float
) -> FloatArray:
    """The plane's change of a range where it is known, but for rays that have come to another surface.

    Args:
        view: rows under work; change: by the scene's curves; on_plane: by the planes, NaN where there is none.
        reach: what a displacement of this size can do to a range at most, all in the range's unit.
        turn: by how much the ray is turned, degrees.
    """
    inside = per_view(view, "turns inside", lambda: _inside(view)[view.rows])
    with np.errstate(invalid="ignore"):
        crossed = (np.abs(change - on_plane) > _EDGE * reach) & (np.abs(turn) > inside)
    return np.where(np.isfinite(on_plane) & ~crossed, on_plane, change)


def _inside(view: View) -> FloatArray:
    """Turn, degrees, up to which a ray stays on its surface: of pixels that see one only, where others see two."""
    pure, columns = pure_rows(view), view.columns
    if pure.all() or "pixel_u" not in columns.numbers:
        return np.zeros(columns.n)
    return np.where(pure, _INSIDE * pixel_width(view), 0.0)


def _make(view: View, sign: float) -> FloatArray:
    table = view.columns
    found = np.full((table.n, 3), np.nan)
    names = distances(view)
    if "surface" not in table.categories or not names or not view.varies("azimuth_deg"):
        return found
    far = simulated_range_m(view)
    codes, _ = table.categories["surface"]
    seen = np.isfinite(far) & (far > 0.0) & (codes >= 0)
    pure = seen & pure_rows(view)
    rays = directions(view, sign)
    for code in np.unique(codes[pure]):
        rows = np.flatnonzero(seen & (codes == code))
        d, inverse = rays[rows], 1.0 / far[rows]
        slope = _tangents(d, inverse, pure[rows])
        # what two stripes of one board share lies on it as well
        found[rows] = np.where(np.abs(np.sum(slope * d, axis=1) / inverse - 1.0) < _FLAT, slope.T, np.nan).T
    return found


def _tangents(d: FloatArray, inverse: FloatArray, pure: NDArray[np.bool_]) -> FloatArray:
    """Planes that the rays `d` of one surface touch, (n, 3), of what its `pure` ones tell; NaN where they do not."""
    one = np.flatnonzero(pure)[np.unique(np.rint(d[pure] / _SAME_RAY), axis=0, return_index=True)[1]]
    if one.size < _FEWEST_RAYS or float(np.linalg.norm(np.std(d[one], axis=0))) < _LEAST_ANGLE:
        return np.full(d.shape, np.nan)
    gram = d[one].T @ d[one]
    slope = np.linalg.solve(gram + _RIDGE * np.trace(gram) * np.eye(3), d[one].T @ inverse[one])
    if _fits(d[one] @ slope, inverse[one]):
        return np.broadcast_to(slope, d.shape)
    return _bent(d, inverse, one)


def _fits(told: FloatArray, inverse: FloatArray) -> bool:
    return bool(np.mean(np.abs(told / inverse - 1.0) < _FLAT) > _FLAT_SHARE)


def _bent(d: FloatArray, inverse: FloatArray, one: NDArray[np.intp]) -> FloatArray:
    """Tangent planes, (n, 3), of an upright surface whose 1/range over the ground is a polynomial of the bearing."""
    level = np.hypot(d[:, 0], d[:, 1])
    middle = np.arctan2(np.mean(d[one, 1]), np.mean(d[one, 0]))
    turned = np.angle(np.exp(1j * (np.arctan2(d[:, 1], d[:, 0]) - middle)))
    if np.unique(np.rint(turned[one] / _SAME_RAY)).size < _BEARINGS:
        return np.full(d.shape, np.nan)
    shape = np.polynomial.Polynomial.fit(turned[one], (inverse / level)[one], _ORDER)
    if not _fits((shape(turned) * level)[one], inverse[one]):
        return np.full(d.shape, np.nan)
    facing, along = shape(turned)[:, None], shape.deriv()(turned)[:, None]
    c, s = np.cos(turned + middle)[:, None], np.sin(turned + middle)[:, None]
    return np.concatenate([facing * c - along * s, facing * s + along * c, np.zeros_like(c)], axis=1)
