"""What rows see when their rays point elsewhere: rendered where the bench is known, else from the scene's curves."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from arl_fixtures.reconcile.effect import State, Variant
from arl_fixtures.reconcile.effects_bench import is_sharp
from arl_fixtures.reconcile.effects_common import (
    FloatArray,
    distances,
    light_channels,
    per_table,
    per_view,
    set_light,
    signals,
)
from arl_fixtures.reconcile.effects_first_echo import held_at_first_echoes
from arl_fixtures.reconcile.effects_footprint import COARSE
from arl_fixtures.reconcile.effects_illumination import azimuth, elevation, illumination, log_profile
from arl_fixtures.reconcile.effects_image_borders import ImageBorders, borders_in_images
from arl_fixtures.reconcile.effects_rays import Pose
from arl_fixtures.reconcile.effects_render import as_simulated, rendered
from arl_fixtures.reconcile.effects_room import changes_in_room, looks_down, on_planes, room_of
from arl_fixtures.reconcile.effects_room_beams import borders_in_line
from arl_fixtures.reconcile.effects_room_borders import Borders
from arl_fixtures.reconcile.effects_scene import Scene, gap_of, gaps_of, pixel_width, scene
from arl_fixtures.reconcile.effects_scenes import scenes_shown
from arl_fixtures.reconcile.effects_still import both
from arl_fixtures.reconcile.effects_sweep import along_sweep
from arl_fixtures.reconcile.view import IntArray, View


def _look(found: Scene, line: IntArray, bearing: FloatArray) -> dict[str, FloatArray]:
    """All curves at the rows' line and bearing; beyond a curve's ends its last value."""
    width = next(iter(found.curves.values())).shape[1]
    place = np.clip(bearing * (1.0 / found.step_deg), 0.0, width - 1.001)
    low: IntArray = place.astype(np.int64)
    part = place - low
    low += line * width
    seen = {}
    for name, grid in found.curves.items():
        values = grid.ravel()
        left = values[low]
        seen[name] = left + part * (values[low + 1] - left)
    return seen


def _at(found: Scene, view: View, turn: FloatArray | float, lift: FloatArray | float) -> dict[str, FloatArray]:
    """Flattened channels at the rows' bearing + turn and elevation + lift (degrees)."""
    line, bearing = per_view(view, "scene place", lambda: (found.line[view.rows], found.bearing[view.rows]))
    seen = _turned(found, view, line, bearing, turn)
    if found.pitch_deg > 0.0 and np.any(lift):
        rows = np.broadcast_to(np.asarray(lift) / found.pitch_deg, bearing.shape)
        if found.still:
            return _by_light(view, _lifted(found, view, line, bearing, turn, rows, seen))
        other = np.where(rows > 0.0, found.above[line], found.below[line])
        beyond = _turned(found, view, np.where(other < 0, line, other), bearing, turn)
        share = np.minimum(np.abs(rows), 2.0)
        for name, values in seen.items():
            mixed = values + share * (beyond[name] - values)
            seen[name] = np.where(np.isfinite(mixed), mixed, values)
    return _by_light(view, seen)


def _lifted(
    found: Scene, view: View, line: IntArray, bearing: FloatArray, turn: FloatArray | float, rows: FloatArray,
    seen: dict[str, FloatArray],
) -> dict[str, FloatArray]:  # fmt: skip
    """What rays see that point higher by a share of image rows: a parabola through three, a line at an end."""
    sides = [np.where(other < 0, line, other) for other in (found.above[line], found.below[line])]
    upper, lower = (_turned(found, view, side, bearing, turn) for side in sides)
    up, down = sides[0] != line, sides[1] != line
    share, lifted = np.clip(rows, -2.0, 2.0), {}
    for name, here in seen.items():
        rise, fall = upper[name] - here, here - lower[name]
        slope = np.where(up & down, 0.5 * (rise + fall), np.where(up, rise, fall))
        bend = np.where(up & down, rise - fall, 0.0)
        mixed = here + share * slope + 0.5 * share**2 * bend
        lifted[name] = np.where(np.isfinite(mixed), mixed, here)
    return lifted


def _by_light(view: View, seen: dict[str, FloatArray]) -> dict[str, FloatArray]:
    """Distances of curves of light times distance."""
    light = next((seen[name] for name in signals(view) if name in seen), None)
    if light is not None:
        with np.errstate(invalid="ignore", divide="ignore"):
            seen |= {name: seen[name] / light for name in distances(view) if name in seen}
    return seen


_NEAREST, _NEAR, _DENSE = 0.03, 0.35, 0.2
"""Shares of a pixel's width: over what a slope is told at least and at most, for a curve is a mean over the whole
width, and gaps between samples below which half of one will do."""


def _turned(
    found: Scene, view: View, line: IntArray, bearing: FloatArray, turn: FloatArray | float
) -> dict[str, FloatArray]:
    """Curves at bearing + turn: what a small turn changes is told over more than the gap of two samples.

    Neighbouring samples are of different pixels, whose own errors would pass for a slope.
    """
    if not np.any(turn) or not view.varies("pixel_u") or not view.varies("azimuth_deg"):
        return _look(found, line, bearing + turn)
    near = per_view(view, "near", lambda: per_table(view, "near", lambda: _near(found, view))[view.rows])
    part = np.clip(turn / np.maximum(near, 1e-9), -1.0, 1.0)

    def about() -> list[dict[str, FloatArray]]:
        return [_look(found, line, bearing + way * near) for way in (0.0, -1.0, 1.0)]

    own = line is per_view(view, "scene place", lambda: (line, bearing))[0]  # the same in every trial of a fit
    here, left, right = per_view(view, "seen about", about) if own else about()
    far = np.abs(turn) > near
    beyond = _look(found, line, bearing + turn) if np.any(far) else here
    seen = {}
    for name, values in here.items():
        slope = 0.5 * part * (right[name] - left[name])
        rest = np.where(far, beyond[name] - np.where(part > 0.0, right[name], left[name]), 0.0)
        seen[name] = values + slope + rest
    return seen


def _near(found: Scene, view: View) -> FloatArray:
    """How far to either side of a bearing a slope is told, degrees, of every row: as far as the next sample lies."""
    gap, width = gaps_of(found.line, found.bearing)[found.line], pixel_width(view)
    return np.asarray(np.clip(np.where(gap < _DENSE * width, 0.5 * gap, gap), _NEAREST * width, _NEAR * width))


def _here(found: Scene, view: View) -> dict[str, FloatArray]:
    return per_view(view, "scene here", lambda: _at(found, view, 0.0, 0.0))


def scanned_channels(view: View) -> tuple[str, ...]:
    """Channels that move when a ray points elsewhere."""
    lit = [name for channel in signals(view) for name in light_channels(view, channel)]
    return tuple(dict.fromkeys([*distances(view), *lit]))


WHOLE_PIXELS = {"rays": "whole pixels"}
"""Option of a displacement that pixels see by their whole areas, though the simulation looks through sharp rays."""


def ways_of_looking(view: View) -> tuple[dict[str, Any], ...]:
    """Options of the ways in which a displacement may show: through the simulation's rays, and by whole pixels.

    A simulation through a few sharp rays changes only where one crosses an edge. In a recording every pixel at an
    edge changes, by the share of its area that the edge passes over, however little the sensor has moved.
    """
    return ({}, WHOLE_PIXELS) if is_sharp(view) else ({},)


def by_whole_pixels(variant: Variant) -> bool:
    """Whether a displacement is tried as the pixels' whole areas would see it."""
    return variant.options.get("rays") == WHOLE_PIXELS["rays"]


def turn_stage(view: View, state: State, turn_deg: FloatArray | float, *, whole: bool = False) -> None:
    """Let every row see what it would at stage angle + `turn_deg`; see `take_pose` for `whole`."""
    if not take_pose(view, state, Pose(turn_deg=turn_deg), whole=whole):
        found = scene(view)
        point_elsewhere(view, state, turn=(1.0 if found is None else found.sign) * turn_deg)


def take_pose(
    view: View,
    state: State,
    pose: Pose,
    *,
    beam_moves: tuple[FloatArray | float, FloatArray | float] = (0.0, 0.0),
    whole: bool = False,
) -> bool:
    """Let every row see the bench in another pose, where the table's simulation is a bench that can be rendered.

    Args:
        view: rows under work.
        state: its signals and distances are replaced.
        pose: arrays by row.
        beam_moves: how the rays' azimuth and elevation move within the illumination (a changed lens), degrees.
        whole: whether pixels see by their whole area what moves; what the simulation's rays miss of it stays missed.

    Returns:
        Whether it was rendered; where not, nothing has changed.
    """
    there, here, simulated = rendered(view, pose, whole=whole), rendered(view, whole=whole), rendered(view)
    if there is None or here is None or simulated is None:
        return False
    changes = {
        name: seen - here[name] if name in distances(view) else 1.0 + (seen - here[name]) / simulated[name]
        for name, seen in there.items()
    }
    known = as_simulated(view)
    _set_seen(view, state, {name: np.where(known, change, np.nan) for name, change in changes.items()}, *beam_moves)
    return True


def point_elsewhere(
    view: View,
    state: State,
    *,
    turn: FloatArray | float = 0.0,
    lift: FloatArray | float = 0.0,
    beam_turns: bool = True,
    by_planes: bool = True,
) -> None:
    """Let every row see what lies `turn` degrees further in bearing and `lift` degrees higher.

    Args:
        view: rows under work.
        state: its signals and distances are replaced.
        turn, lift: change of the ray's direction, degrees; positive along azimuth and elevation.
        beam_turns: whether the illumination goes with the ray (a turned sensor) or stays (a changed lens).
        by_planes: whether planes tell what they can (see `changes_elsewhere`).
    """
    moves = (0.0, 0.0) if beam_turns else (turn, lift)
    changes = held_at_first_echoes(view, changes_elsewhere(view, turn, lift, by_planes=by_planes), turn)
    _set_seen(view, state, changes, *moves)


def look_from(
    view: View, state: State, forward: FloatArray | float, right: FloatArray | float
) -> NDArray[np.bool_] | None:
    """Let every row see the room from another place, where a scanner's table tells the planes about it.

    Args:
        view: rows under work; state: its signals and distances are replaced.
        forward, right: of the ray's start along bearing 0 and 90 degrees, in the unit of the first distance.

    Returns:
        Rows of which planes and borders tell all; None where no planes are known, and nothing has changed.
    """
    found = scene(view)
    room = None if found is None else room_of(view, found.sign)
    if room is None:
        return None
    shift = np.stack(np.broadcast_arrays(forward, right, np.zeros(view.n)), axis=1)
    changes, told = changes_in_room(view, room, 0.0, 0.0, shift), on_planes(view, room)
    if room.borders is not None:
        known, shared = room.borders.known[view.rows], room.borders.changes_beside(view, room.sign, shift)
        changes = {name: np.where(known, shared.get(name, change), change) for name, change in changes.items()}
        told = told | known
    _set_seen(view, state, changes, 0.0, 0.0)
    return told


def spread_rays(view: View, state: State, turn: FloatArray, lift: FloatArray) -> None:
    """Let every row see a Gaussian's neighbourhood of its ray, `turn` and `lift` its standard deviations in degrees.

    Five points with the weights of Gauss and Hermite, exact to third order; light adds up, and distances by light.
    """
    light, moments = np.full(view.n, 1.0 / 3.0), dict.fromkeys(distances(view), np.zeros(view.n))
    channel = next(iter(signals(view)), "")
    for sign in (-1.0, 1.0):
        for far_turn, far_lift in ((sign * np.sqrt(3.0) * turn, 0.0), (0.0, sign * np.sqrt(3.0) * lift)):
            changes = changes_elsewhere(view, far_turn, far_lift, over_borders=False)
            ratio = changes.get(channel, np.ones(view.n))
            ratio = np.clip(np.where(np.isfinite(ratio), ratio, 1.0), 0.01, 100.0) / 6.0
            light = light + ratio
            for name in moments:
                change = changes.get(name, np.zeros(view.n))
                moments[name] = moments[name] + ratio * np.where(np.isfinite(change), change, 0.0)
    _set_seen(view, state, dict.fromkeys(signals(view), light), 0.0, 0.0)
    _set_seen(view, state, {name: moment / light for name, moment in moments.items()}, 0.0, 0.0)


def _set_seen(
    view: View, state: State, changes: dict[str, FloatArray], turn: FloatArray | float, lift: FloatArray | float
) -> None:
    """Put ratios of signals and differences of distances into the state; the illumination moved by turn and lift."""
    beam_moves = bool(np.any(turn) or np.any(lift))
    for name, change in changes.items():
        if name not in state:
            continue
        if name in distances(view):
            state[name] = state[name] + np.where(np.isfinite(change), change, 0.0)
            continue
        ratio = change
        profile = illumination(view, name) if beam_moves else None
        if profile is not None:
            az, el = azimuth(view), elevation(view)
            ratio = ratio * np.exp(profile.log(az + turn, el + lift) - log_profile(view, name))
        set_light(view, state, name, state[name] * np.clip(np.where(np.isfinite(ratio), ratio, 1.0), 0.01, 100.0))


def changes_elsewhere(
    view: View,
    turn: FloatArray | float,
    lift: FloatArray | float,
    *,
    by_planes: bool = True,
    over_borders: bool = True,
) -> dict[str, FloatArray]:
    """Ratio of each signal and difference of each distance between the turned ray and the row's own.

    Args:
        view: rows under work; turn, lift: of their rays, degrees.
        by_planes: whether planes tell it of the rows that lie on some; else the scene's curves tell all.
        over_borders: whether what a border in a pixel is known to share moves as well: a blur does not move it.
    """
    found = scene(view)
    if found is None or not found.curves:
        return {}
    room = room_of(view, found.sign) if by_planes else None
    if room is None or looks_down(view):
        changes = _along_curves(found, view, turn, lift if room is None else 0.0)
        if room is not None:  # a line's curve tells what lies beside a ray, planes what lies above it
            above = changes_in_room(view, room, 0.0, lift)
            changes = {
                name: change + above[name] if name in distances(view) else change * above.get(name, 1.0)
                for name, change in changes.items()
            }
        borders = per_table(view, "borders on curves", lambda: _coarsely_seen(view, found))
    else:
        told, changes, borders = on_planes(view, room), changes_in_room(view, room, turn, lift), room.borders
        if not told.all():
            curves = _along_curves(found, view, turn, lift)
            changes = {name: np.where(told, change, curves.get(name, change)) for name, change in changes.items()}
    if not over_borders:
        return changes
    if borders is not None:
        changes = _at_borders(view, borders, turn, lift, changes)
    image = per_table(view, "borders in images", lambda: _coarse_images(view, found))
    if image is None:
        return changes
    if room is None:
        return image.changes(view, turn, lift, changes)
    return _at_borders(view, image.borders, turn, lift, changes)  # planes tell the rest


def _at_borders(
    view: View, borders: Borders, turn: FloatArray | float, lift: FloatArray | float, changes: dict[str, FloatArray]
) -> dict[str, FloatArray]:
    """Changes, in the pixels that see two surfaces those that their borders make."""
    known, shared = borders.known[view.rows], borders.changes(view, turn, lift)
    return {name: np.where(known, shared.get(name, change), change) for name, change in changes.items()}


_FINE = 0.2
"""Share of a pixel's width between the samples of a curve up to which it tells how borders cross a pixel."""


def _coarse_images(view: View, found: Scene) -> ImageBorders | None:
    """The borders in images of which too few show a place for a curve to tell how borders cross their pixels."""
    if "pixel_u" not in view.columns.numbers:
        return None
    if gap_of(found.line, found.bearing, 0.5) < COARSE * float(np.median(pixel_width(view))):
        return None
    return borders_in_images(view)


def _coarsely_seen(view: View, found: Scene) -> Borders | None:
    """The borders in pixels and beams, where the positions of a stage do not sample a curve finely enough.

    And where it is said which surfaces they see: a curve holds edges of a surface's paint as well, jumps of ranges do
    not tell these.
    """
    if not {"mixed", "surface"} & set(view.columns.categories):
        return None
    if "pixel_u" in view.columns.numbers:
        fine = _FINE * float(np.median(pixel_width(view)))
        if gap_of(found.line, found.bearing) < fine:
            return None
    return borders_in_line(view, both(view.columns.group("dut"), scenes_shown(view)))


def _along_curves(
    found: Scene, view: View, turn: FloatArray | float, lift: FloatArray | float
) -> dict[str, FloatArray]:  # fmt: skip
    """The same from the scene's curves over the bearing."""
    el = elevation(view)
    before, after = dict(_here(found, view)), _at(found, view, turn, lift)
    patchy = found.patchy[view.rows]
    if patchy.any() and np.any(turn):
        own_before = per_view(view, "sweep here", lambda: along_sweep(view, 0.0))
        own_after = along_sweep(view, found.sign * turn)
        lifted = _at(found, view, 0.0, lift) if np.any(lift) else _here(found, view)
        for name, there in own_after.items():
            swap = patchy & np.isfinite(there) & np.isfinite(own_before[name])
            scale = 1.0 if name in signals(view) else np.cos(np.radians(el))  # as flattened as the scene's
            with np.errstate(divide="ignore", invalid="ignore"):
                higher = lifted[name] / _here(found, view)[name]  # a sweep tells nothing of what lies above it
            before[name] = np.where(swap, own_before[name] * scale, before[name])
            after[name] = np.where(swap, there * scale * np.where(np.isfinite(higher), higher, 1.0), after[name])
    changed = np.cos(np.radians(el + lift)) / np.cos(np.radians(el))
    changes = {}
    for name in found.curves:
        with np.errstate(divide="ignore", invalid="ignore"):
            if name in distances(view):
                changes[name] = (after[name] / changed - before[name]) / np.cos(np.radians(el))
            else:
                changes[name] = after[name] / before[name] * changed**3
    return changes
