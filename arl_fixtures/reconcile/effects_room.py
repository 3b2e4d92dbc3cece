"""The surfaces about a scanner or a few pixels of a camera, found from their own table: a plane for every ray.

Rays of a scanner lie on rings that are far apart, or anywhere: no curve over the bearing joins them. But rooms are
made of planes, and 1/range is linear in a ray's direction on one: 1/R = m·d, m the plane's normal over its distance.
A ray that is turned then sees R·(m·d)/(m·d'), however its neighbours lie.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from arl_fixtures.reconcile.effects_common import distances, per_table, per_view, pure_rows, signals
from arl_fixtures.reconcile.effects_illumination import illumination, ray_column, turns_round
from arl_fixtures.reconcile.effects_planes import directions, rays_of
from arl_fixtures.reconcile.effects_room_beams import borders_in_line, is_one_beam, sees_one
from arl_fixtures.reconcile.effects_room_borders import Borders, borders_between
from arl_fixtures.reconcile.effects_room_places import places_and_rays
from arl_fixtures.reconcile.effects_room_planes import (
    FLAT,
    FLAT_IN_PIXELS,
    Rays,
    named_planes,
    planes_about,
    sends_back,
)
from arl_fixtures.reconcile.effects_scene import gap_of, joins_unlike_rows, pixel_width, scene
from arl_fixtures.reconcile.view import View

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_NEIGHBOURS = 12
_FEWEST_RAYS = 60
_MOST_RAYS = 60_000
_MOST_RINGS = 200
_SPARSE = 1.5
"""Pixels' widths between rays of a camera from which what lies between two of them is not seen."""
_LEANING, _ON_PLANES, _SOME_LEAN = 0.2, 0.7, 0.01
"""Sine from which a plane leans, and the shares of a camera's rays that lie on planes, and on those that lean, from
which planes tell more than curves over the bearing."""
_FARTHEST, _MOST_LOG = 2.0, 4.0
"""Factor by which a turned ray's range may change, and the logarithm of that of its light."""


@dataclass(frozen=True, slots=True)
class Room:
    """What each ray of a table sees, beyond it.

    Attributes:
        sign: +1 where a ray's bearing is azimuth + stage angle, −1 where it is azimuth − stage angle.
        slopes: distance to a vector for every row of the whole table, of 1/range; to be multiplied with the ray's
            direction in the room.
        beyond: the same of the next plane that a ray would come to.
        brighter: signal to how much more of the light the surface beyond sends back than the own one.
        fold: +1 where that plane comes in front beyond an edge (a corner of the room), −1 where the own one ends (a
            corner that stands out), 0 where there is none near.
        told: rows of the whole table of which planes tell all: of a camera's pixels those that see one surface each.
        borders: of beams, and of a camera's pixels, that see two, where the curves do not tell what they see.
    """

    sign: float
    slopes: dict[str, FloatArray]
    beyond: dict[str, FloatArray]
    brighter: dict[str, FloatArray]
    fold: FloatArray
    told: NDArray[np.bool_]
    borders: Borders | None = None


def room_of(view: View, sign: float) -> Room | None:
    """The planes about a scanner, a beam that a stage turns, or a camera whose curves do not tell them; else None."""
    return per_table(view, ("room", sign), lambda: _make(view, sign))


def changes_in_room(
    view: View,
    room: Room,
    turn: FloatArray | float,
    lift: FloatArray | float,
    shift: FloatArray | None = None,
) -> dict[str, FloatArray]:
    """Ratio of each signal and difference of each distance for other rays.

    Args:
        view: rows under work; room: of their table.
        turn, lift: of the rays in azimuth and elevation, degrees.
        shift: of where they start in the room, (n, 3) in the unit of the first distance: on a plane m the range from
            there is (1 − m·shift) / m·d.

    The light of a plane goes with cos(incidence) / range², which the plane tells: a signal's own slope over rays is
    that of the sensor's profile as well, which turns with it.
    """
    here = rays_of(view, room.sign)
    there = directions(view, room.sign, turn=turn, lift=lift)
    found: dict[str, FloatArray] = {}
    for name, slopes in room.slopes.items():
        own, other = slopes[view.rows], room.beyond[name][view.rows]
        nearer = [1.0 if shift is None else 1.0 - np.sum(m * shift, axis=1) for m in (own, other)]
        with np.errstate(invalid="ignore", divide="ignore"):
            facing, facing_other = np.sum(own * there, axis=1), np.sum(other * there, axis=1)
            mine, theirs = facing / nearer[0], facing_other / nearer[1]
            over = (theirs - mine) * room.fold[view.rows] > 0.0
            before = np.sum(own * here, axis=1)
            ratio = before / np.where(over, theirs, mine)
            ratio = np.where(np.isfinite(ratio), np.clip(ratio, 1.0 / _FARTHEST, _FARTHEST), 1.0)
            if not found:  # the light goes by the first distance
                leaning = np.linalg.norm(own, axis=1) / np.linalg.norm(other, axis=1)
                faced = np.where(over, leaning * facing_other, facing) / before
                for signal, brighter in room.brighter.items():
                    light = np.where(over, brighter[view.rows], 1.0) * faced / ratio**2
                    low, high = np.exp(-_MOST_LOG), np.exp(_MOST_LOG)
                    found[signal] = np.clip(np.where(np.isfinite(light), light, 1.0), low, high)
        found[name] = view.sim[name] * (ratio - 1.0)
    return found


def _make(view: View, sign: float) -> Room | None:
    table = view.columns
    if not (distances(view) and (view.varies("azimuth_deg") or view.varies("stage_angle_deg"))):
        return None
    dense = _has_grid(view) and not _is_sparse(view) and not looks_down(view)
    if dense and (scene(view) is None or "surface" not in table.categories):
        return None
    everywhere = directions(view, sign)  # a stage turns rays to where others looked before
    far = table.numbers[f"sim_{distances(view)[0]}"]
    place, code, unseen = places_and_rays(view, everywhere, far)
    rays = np.unique(np.where(np.isfinite(far) & (far > 0.0), code, -1), return_index=True)
    first = rays[1][rays[0] >= 0]
    if not _FEWEST_RAYS <= first.size <= _MOST_RAYS:
        return None
    borders = None if _has_grid(view) else borders_in_line(view, place)
    direction, whole = everywhere[first], _of_one_surface(view, place, borders)
    targets, named = {}, {}
    for name in distances(view):
        with np.errstate(invalid="ignore", divide="ignore"):
            target = 1.0 / table.numbers[f"sim_{name}"][first]
        targets[name] = np.where(np.isfinite(target) & whole[first], target, np.nan)
        flat = FLAT_IN_PIXELS if dense else FLAT
        named[name] = named_planes(view, first, direction, place[first], targets[name], flat)
    on_named = named[distances(view)[0]]
    if dense and not (unseen or _leans(on_named)):
        return None
    near = _nearest(view, first, direction, place[first])
    of_code = np.zeros(int(code.max()) + 1, dtype=np.int64)
    of_code[code[first]] = np.arange(first.size)
    known = np.zeros(of_code.size, dtype=bool)
    known[code[first]] = True
    slopes: dict[str, FloatArray] = {}
    beyond: dict[str, FloatArray] = {}
    sent: dict[str, FloatArray] = {}
    rival, fold = np.arange(first.size), np.zeros(first.size)
    for name, target in targets.items():
        slope = planes_about(view, Rays(first, direction, near), target, named[name])
        if not slopes:
            rival, fold = _edges(slope, direction, near, np.isfinite(target))
            if _has_grid(view) and "mixed" in table.categories:
                inside = _corner(slope, slope[rival], direction) < 0.5 * np.radians(pixel_width(view)[first])
                fold = np.where(whole[first] & inside, 0.0, fold)  # it would see two surfaces, and sees one
            sent = {signal: _sent_back(view, signal, first, slope, direction) for signal in signals(view)}
        for into, some in ((slopes, slope), (beyond, slope[rival])):
            into[name] = np.where(known[code][:, None], some[of_code[code]], 0.0)
    with np.errstate(invalid="ignore", divide="ignore"):
        brighter = {signal: (of_ray[rival] / of_ray)[of_code[code]] for signal, of_ray in sent.items()}
    told = whole & known[code] & np.isfinite(on_named[:, 0])[of_code[code]] if dense else whole
    if _has_grid(view) and not dense:
        about = {name: slope[first] for name, slope in slopes.items()}
        borders = borders_between(
            view, first, direction, place[first], about, sent, np.where(known[code], of_code[code], -1)
        )
    fold = np.where(known[code], fold[of_code[code]], 0.0)
    if borders is not None:
        fold = np.where(borders.known, 0.0, fold)
    return Room(sign, slopes, beyond, brighter, fold, told, borders)


def _leans(named: FloatArray) -> bool:
    """Whether rays lie on planes and some of these are no upright walls: curves over bearings tell them worse."""
    leaning = np.abs(named[:, 2]) > _LEANING * np.linalg.norm(named, axis=1)  # of none where there is no plane
    return bool(np.mean(np.isfinite(named[:, 0])) > _ON_PLANES and np.mean(leaning) > _SOME_LEAN)


def on_planes(view: View, room: Room) -> NDArray[np.bool_]:
    """Rows under work of which the planes of a room tell all."""
    return per_view(view, ("on planes", room.sign), lambda: room.told[view.rows])


def looks_down(view: View) -> bool:
    """Whether a line of pixels looks down at a floor that shows how steeply."""
    return "elevation_deg" in view.columns.derived and "pixel_v" not in view.columns.numbers


def _of_one_surface(view: View, place: IntArray, borders: Borders | None) -> NDArray[np.bool_]:
    if is_one_beam(view):
        alone = sees_one(view, place)
        return alone if borders is None else alone & ~borders.known
    return pure_rows(view) if _has_grid(view) else np.ones(view.columns.n, dtype=bool)


def _has_grid(view: View) -> bool:
    """Whether pixels lie side by side: a column of beams that a stage turns is a scanner's."""
    turned = view.varies("stage_angle_deg") and not (view.varies("pixel_u") or view.varies("azimuth_deg"))
    return (view.varies("pixel_u") or view.varies("pixel_v")) and not (turned or turns_round(view))


def _is_sparse(view: View) -> bool:
    """Whether no curve over the bearing joins a camera's rays that see one surface each: few pixels, rows, angles.

    Without it being said which see two, a curve is all there is: it tells what lies at edges better than none.
    """
    found, table = scene(view), view.columns
    if found is None or not view.varies("azimuth_deg") or "pixel_u" not in table.numbers:
        return False
    if "mixed" not in table.categories:
        return False
    far_apart = gap_of(found.line, found.bearing) > _SPARSE * float(np.median(pixel_width(view)))
    return far_apart or joins_unlike_rows(view, found)


def _sent_back(view: View, signal: str, rows: IntArray, slope: FloatArray, direction: FloatArray) -> FloatArray:
    """Simulated light of rays over their profile, cos(incidence) and 1/range²: what the surface sends back."""
    light = view.columns.numbers[f"sim_{signal}"][rows]
    profile = illumination(view, signal)
    if profile is not None:
        rays = (ray_column(view, name)[rows] for name in ("azimuth_deg", "elevation_deg"))
        light = light / np.exp(profile.log(*rays))
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(light / sends_back(slope, direction))


def _edges(
    slope: FloatArray, direction: FloatArray, near: IntArray, known: NDArray[np.bool_]
) -> tuple[IntArray, FloatArray]:
    """For each ray the neighbour whose plane it comes to first, and how the two planes meet (see `Room.fold`).

    What a ray of two surfaces sees lies on no plane: of those that are not `known` none meets any.
    """
    own = np.sum(slope * direction, axis=1)[:, None]
    theirs = np.einsum("nki,ni->nk", slope[near], direction)  # the neighbour's plane where the own ray goes
    there = np.sum(slope[near] * direction[near], axis=2)
    mine = np.einsum("ni,nki->nk", slope, direction[near])  # the own plane where the neighbour's ray goes
    front = (there > mine * (1.0 + FLAT)) & (theirs < own * (1.0 - FLAT))
    behind = (there < mine * (1.0 - FLAT)) & (theirs > own * (1.0 + FLAT))
    meets = (front | behind) & (own > 0.0) & known[near]
    away = np.where(meets, np.abs(theirs / np.where(own > 0.0, own, 1.0) - 1.0), np.inf)
    place = np.argmin(away, axis=1)
    rows = np.arange(own.size)
    fold = np.where(np.isfinite(away[rows, place]), np.where(front[rows, place], 1.0, -1.0), 0.0)
    return np.asarray(near[rows, place], dtype=np.int64), np.asarray(fold)


def _corner(own: FloatArray, other: FloatArray, direction: FloatArray) -> FloatArray:
    """Angle of rays to where their plane and another one meet, radians, (n,)."""
    with np.errstate(invalid="ignore", divide="ignore"):
        apart = np.abs(np.sum((other - own) * direction, axis=1)) / np.linalg.norm(other - own, axis=1)
    return np.asarray(np.where(np.isfinite(apart), apart, np.inf))


def _nearest(view: View, rows: IntArray, direction: FloatArray, device: IntArray) -> IntArray:
    """Rays next to each ray, itself first; a ring counts as near as the next ray on the own ring."""
    height = np.degrees(np.arcsin(np.clip(direction[:, 2], -1.0, 1.0)))
    rings = np.unique(np.round(height, 2))
    stretch = 1.0
    if 1 < rings.size <= _MOST_RINGS:
        around = np.degrees(np.arctan2(direction[:, 1], direction[:, 0]))  # a stage turns rays of one azimuth
        along = max(float(np.ptp(around)) * rings.size / rows.size, 1e-6)
        stretch = float(np.clip(along / np.median(np.diff(rings)), 0.02, 1.0))
    level = direction[:, :2] / np.maximum(np.hypot(*direction[:, :2].T), 1e-9)[:, None]
    place = np.column_stack([level, stretch * np.radians(height), 100.0 * device])
    return np.asarray(cKDTree(place).query(place, k=min(_NEIGHBOURS, rows.size))[1], dtype=np.int64)
