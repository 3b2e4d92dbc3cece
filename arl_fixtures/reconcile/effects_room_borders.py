"""What pixels of two surfaces see when their rays turn, where no neighbour lies close enough to tell.

The light of such a pixel is f·A + (1 − f)·B, A and B what it would be of one surface alone, and its range their mean
by light. Rays beside it tell both surfaces: their planes, and what they send back. So the simulated light tells f,
and a turn by δ across the border changes f by δ over the pixel's width. Where the border runs is not in a table of
few pixels: it is taken to stand or to lie, as most other borders of its surface do.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from arl_fixtures.reconcile.effects_common import pure_rows
from arl_fixtures.reconcile.effects_illumination import illumination, ray_column
from arl_fixtures.reconcile.effects_planes import rays_of
from arl_fixtures.reconcile.effects_room_planes import sends_back
from arl_fixtures.reconcile.effects_scene import pixel_width
from arl_fixtures.reconcile.view import View

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_FARTHEST = 16.0
"""Widths of a pixel within which rays of a surface must lie for it to be one of the two."""
_CONTRAST = 0.05
"""Share of the light by which two surfaces must differ to tell how much a pixel sees of either."""
_SURE = 0.1
"""Relative error up to which light and range must be those of both surfaces together."""


@dataclass(frozen=True, slots=True)
class Borders:
    """Rows of the whole table that see two surfaces of which all is known; arrays of all rows.

    Attributes:
        known: which these are.
        across: degrees of turn and of lift that move the border over all of the pixel, inverse, signed: by which
            share more the own surface fills it for a degree, (n, 2).
        share: of the pixel that the own surface fills.
        own, other: the light of either surface alone, in units of the row's own, by signal.
        own_far, other_far: their ranges in units of the row's own, by distance.
    """

    known: NDArray[np.bool_]
    across: FloatArray
    share: FloatArray
    own: dict[str, FloatArray]
    other: dict[str, FloatArray]
    own_far: dict[str, FloatArray]
    other_far: dict[str, FloatArray]

    def changes(self, view: View, turn: FloatArray | float, lift: FloatArray | float) -> dict[str, FloatArray]:
        """Ratio of each signal and difference of each distance of the rows under work; of no meaning elsewhere."""
        rows = view.rows
        moved = self.across[rows, 0] * turn + self.across[rows, 1] * lift
        share = np.clip(self.share[rows] + moved, 0.0, 1.0)
        changes: dict[str, FloatArray] = {}
        for name in self.own:
            own, other = self.own[name][rows], self.other[name][rows]
            changes[name] = 1.0 + (share - self.share[rows]) * (own - other)
        own, other = (_first(side)[rows] for side in (self.own, self.other))
        for name in self.own_far:
            near, far = self.own_far[name][rows], self.other_far[name][rows]
            with np.errstate(invalid="ignore"):
                before, after = (
                    (part * own * near + (1.0 - part) * other * far) / (part * own + (1.0 - part) * other)
                    for part in (self.share[rows], share)
                )
            changes[name] = view.sim[name] * (after - before)
        return changes

    def changes_beside(self, view: View, sign: float, shift: FloatArray) -> dict[str, FloatArray]:
        """The same for rays that start elsewhere.

        A border is that of the surface in front: it moves as by a turn of shift / range. Both surfaces come
        nearer by what the ray's start moves along it, however they lean: that is little beside the border.

        Args:
            view: rows under work; sign: of the room; shift: in it, (n, 3) in the unit of the first distance.
        """
        rows, name = view.rows, next(iter(self.own_far))
        range_ = view.sim[name] * np.minimum(self.own_far[name][rows], self.other_far[name][rows])
        ray = rays_of(view, sign)
        x, y, z = ray.T
        level = np.maximum(np.hypot(x, y), 1e-9)
        along = np.sum(shift * ray, axis=1)
        with np.errstate(invalid="ignore", divide="ignore"):
            turn = np.degrees((shift[:, 1] * x - shift[:, 0] * y) / (level**2 * range_))
            lift = np.degrees((shift[:, 2] - along * z) / (level * range_))
            nearer = (1.0 - along / view.sim[name]) ** 2
        changes = self.changes(view, np.nan_to_num(turn), np.nan_to_num(lift))
        for one, change in changes.items():
            changes[one] = change - along if one in self.own_far else change / nearer
        return changes


def borders_between(
    view: View,
    rows: IntArray,
    direction: FloatArray,
    station: IntArray,
    slopes: dict[str, FloatArray],
    sent: dict[str, FloatArray],
    ray: IntArray,
) -> Borders | None:
    """The borders in a camera's pixels that are said to see two surfaces with names.

    Args:
        view: of a table.
        rows: of the whole table, one of each different ray, (k,); direction: of these rays, unit vectors, (k, 3).
        station: of the device that looks along it, (k,).
        slopes: planes about each ray, by distance, (k, 3); sent: what its surface sends back, by signal, (k,).
        ray: which of these each row of the whole table is, −1 where none, (n,).
    """
    table = view.columns
    if not sent or "surface" not in table.categories or not all(map(view.varies, ("pixel_u", "pixel_v"))):
        return None
    pure, surface = pure_rows(view)[rows], table.categories["surface"][0][rows]
    plain, mixed = pure & (surface >= 0), np.flatnonzero(~pure & (surface >= 0))
    if not (plain.any() and mixed.size):
        return None
    wide = np.array([float(np.median(pixel_width(view))), _pitch(view)])
    if not np.all(wide > 0.0):  # no column tells how high, or how far aside, pixels look
        return None
    place = np.column_stack([
        np.degrees(np.arctan2(direction[:, 1], direction[:, 0])), np.degrees(np.arcsin(direction[:, 2]))
    ]) / wide  # in pixels  # fmt: skip
    there = np.column_stack([place, 1e6 * station])
    alone = _Alone(view, rows[mixed], direction[mixed], slopes, sent)
    sides, middle = {}, {}
    for one in np.unique(surface[plain]).tolist():
        members = np.flatnonzero(plain & (surface == one))
        far, nearest = cKDTree(there[members]).query(there[mixed])
        sides[one] = alone.side(members[nearest], np.asarray(far))
        middle[one] = np.mean(place[members], axis=0)
    own = _Side.chosen(sides, surface[mixed])
    best, error = np.full(mixed.size, -1), np.full(mixed.size, _SURE)
    for one, other in sides.items():
        wrong = np.where(surface[mixed] == one, np.inf, own.mismatch(other))
        best, error = np.where(wrong < error, one, best), np.minimum(error, wrong)
    other = _Side.chosen(sides, best)
    near = _first(own.far) < _first(other.far)
    bounded = np.where(near, surface[mixed], best)  # the border is that of what stands in front
    lies = _lies(place[mixed], bounded, station[mixed])
    about = np.array([middle.get(one, np.zeros(2)) for one in bounded.tolist()])
    towards = np.sign(about - place[mixed]) * np.where(near, 1.0, -1.0)[:, None]
    across = np.where(np.column_stack([~lies, lies]), towards, 0.0) / wide
    back = np.full(rows.size, -1)
    back[mixed] = np.where(best >= 0, np.arange(mixed.size), -1)
    of_row = np.where(ray >= 0, back[ray], -1)
    known = of_row >= 0

    def spread(values: FloatArray) -> FloatArray:
        return np.asarray(np.where(known, np.nan_to_num(values)[of_row], 0.0))

    return Borders(
        known, np.column_stack([spread(column) for column in across.T]), spread(own.share(other)),
        *({name: spread(one) for name, one in kind.items()} for kind in (own.light, other.light, own.far, other.far)),
    )  # fmt: skip


def _lies(place: FloatArray, bounded: IntArray, station: IntArray) -> NDArray[np.bool_]:
    """Whether a border runs level: more rays on borders of the same surface share its height than its bearing."""
    level = np.zeros(len(place), dtype=bool)
    for one in np.unique(np.column_stack([bounded, station]), axis=0):
        here = np.flatnonzero((bounded == one[0]) & (station == one[1]))
        upright, lying = (_close(along) for along in place[here].T)
        level[here] = lying > upright
    return level


def _close(along: FloatArray) -> IntArray:
    """How many of some places lie within a pixel of each."""
    ranked = np.sort(along)
    return np.asarray(np.searchsorted(ranked, along + 1.0) - np.searchsorted(ranked, along - 1.0), dtype=np.int64)


@dataclass(frozen=True, slots=True)
class _Side:
    """What rays would see of one surface alone, in units of what they see; (k,) each.

    Attributes:
        rays: the nearest that see it; pixels: how far these lie.
        light, far: by signal and distance.
    """

    rays: IntArray
    pixels: FloatArray
    light: dict[str, FloatArray]
    far: dict[str, FloatArray]

    @classmethod
    def chosen(cls, sides: dict[int, _Side], which: IntArray) -> _Side:
        """Of each ray the side that is chosen for it; NaN where it is none of them."""
        every, numbers = list(sides.values()), np.array(list(sides))
        index = np.argmax(numbers[:, None] == which, axis=0)
        rows, there = np.arange(index.size), numbers[index] == which
        some = every[0]

        def pick(values: list[FloatArray]) -> FloatArray:
            return np.asarray(np.where(there, np.stack(values)[index, rows], np.nan))

        return cls(
            np.stack([side.rays for side in every])[index, rows], pick([side.pixels for side in every]),
            {name: pick([side.light[name] for side in every]) for name in some.light},
            {name: pick([side.far[name] for side in every]) for name in some.far},
        )  # fmt: skip

    def share(self, other: _Side) -> FloatArray:
        """Share of the pixel that this side fills beside another one, by the first signal."""
        mine, theirs = _first(self.light), _first(other.light)
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.asarray(np.clip((1.0 - theirs) / (mine - theirs), 0.0, 1.0))

    def mismatch(self, other: _Side) -> FloatArray:
        """Relative error of the light and the ranges of both together; infinite where they cannot be told."""
        part = self.share(other)
        mine, theirs = _first(self.light), _first(other.light)
        wrong = np.abs(part * mine + (1.0 - part) * theirs - 1.0)
        for near, far in zip(self.far.values(), other.far.values(), strict=True):
            wrong = np.maximum(wrong, np.abs(part * mine * near + (1.0 - part) * theirs * far - 1.0))
        told = (np.abs(mine - theirs) > _CONTRAST) & (self.pixels < _FARTHEST) & (other.pixels < _FARTHEST)
        return np.asarray(np.where(told & np.isfinite(wrong), wrong, np.inf))


class _Alone:
    """What rays would see of surfaces that others see."""

    def __init__(
        self, view: View, rows: IntArray, direction: FloatArray, slopes: dict[str, FloatArray],
        sent: dict[str, FloatArray],
    ) -> None:  # fmt: skip
        self.direction, self.slopes, self.sent = direction, slopes, sent
        self.seen = {name: view.columns.numbers[f"sim_{name}"][rows] for name in (*slopes, *sent)}
        angles = [ray_column(view, name)[rows] for name in ("azimuth_deg", "elevation_deg")]
        for name in sent:
            profile = illumination(view, name)
            if profile is not None:
                self.seen[name] = self.seen[name] / np.exp(profile.log(*angles))

    def side(self, rays: IntArray, pixels: FloatArray) -> _Side:
        """Of the surface that some rays see."""
        with np.errstate(invalid="ignore", divide="ignore"):
            inverse = {name: np.sum(slope[rays] * self.direction, axis=1) for name, slope in self.slopes.items()}
            faced = sends_back(_first(self.slopes)[rays], self.direction)
            light = {name: sent[rays] * faced / self.seen[name] for name, sent in self.sent.items()}
            far = {name: 1.0 / (one * self.seen[name]) for name, one in inverse.items()}
        return _Side(rays, pixels, light, {name: np.where(one > 0.0, one, np.nan) for name, one in far.items()})


def _first(kind: dict[str, FloatArray]) -> FloatArray:
    """Of the first signal or distance, by which all others go."""
    return next(iter(kind.values()))


def _pitch(view: View) -> float:
    """Elevation from one image row to the next, degrees."""
    row, height = view.columns.numbers["pixel_v"], ray_column(view, "elevation_deg")
    good = np.isfinite(row) & np.isfinite(height)
    return float(np.abs(np.polyfit(row[good], height[good], 1)[0]))
