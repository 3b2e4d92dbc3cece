"""The optical centre is not on the rotation axis."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import product

import numpy as np

from arl_fixtures.reconcile.effect import Effect, Stage, State, Values, Variant
from arl_fixtures.reconcile.effects_bench import is_sharp
from arl_fixtures.reconcile.effects_common import (
    FloatArray,
    amplitude,
    distances,
    in_mm,
    per_view,
    set_light,
    signals,
)
from arl_fixtures.reconcile.effects_encoder import STAGE, turned_by
from arl_fixtures.reconcile.effects_illumination import azimuth, elevation
from arl_fixtures.reconcile.effects_planes import planes, smooth_part
from arl_fixtures.reconcile.effects_pointing import (
    by_whole_pixels,
    look_from,
    point_elsewhere,
    scanned_channels,
    take_pose,
    ways_of_looking,
)
from arl_fixtures.reconcile.effects_rays import Pose
from arl_fixtures.reconcile.effects_room import room_of
from arl_fixtures.reconcile.effects_scene import scene
from arl_fixtures.reconcile.roles import per_metre, unit_of
from arl_fixtures.reconcile.view import View


class Eccentricity(Effect):
    """D −= forward·cos ψ + right·sin ψ (times cos elevation), and the bearing turns by the sideways part over D.

    ψ is the azimuth for a sensor that sits off the axis and turns with it (`frame` sensor), or the bearing for a
    scene whose centre is off the axis (`frame` bench). The signal follows 1/D². A head that turns round, on no stage,
    carries its optical centre about by its azimuth (`frame` head).
    """

    id = "stage.eccentricity"
    stage = Stage.BOOKKEEPING
    displaces = True
    source = "plane geometry: the range from a displaced point, to first order in displacement over range"
    confusable = ("stage.zero_offset", "mount.tilt", "timing.clock_scale", "timing.tdc_nonlinearity")

    def variants(self, view: View) -> Iterable[Variant]:
        """Off-centre in the sensor's frame or in the bench's; of a head, in its own."""
        found, angle = scene(view), turned_by(view)
        if found is None or not distances(view) or not angle:
            return
        if angle != STAGE and room_of(view, found.sign) is None:
            return
        frames = ("bench", "sensor") if angle == STAGE else ("head",)
        unit = unit_of(distances(view)[0])
        size = per_metre(unit)
        for frame, way in product(frames, ways_of_looking(view)):
            if frame == "sensor" and not view.varies("azimuth_deg") and room_of(view, found.sign) is None:
                continue  # only walls that lie aslant tell a beam that starts aside from one that starts nearer
            yield Variant(
                effect=self.id,
                options={"frame": frame, **way},
                parameters=tuple(amplitude(name, unit, -0.1 * size, 0.1 * size, 0.002 * size) for name in _AXES),
                channels=scanned_channels(view),
                rough=is_sharp(view) and not way,
                drivers=tuple(name for name in (STAGE, "azimuth_deg") if view.varies(name)),
            )

    def apply(self, variant: Variant, values: Values, state: State, view: View) -> None:
        """Moves the point of view."""
        forward, right = (float(values[name]) for name in _AXES)
        if take_pose(view, state, _pose(variant, view, forward, right), whole=by_whole_pixels(variant)):
            return
        planes = dict(state)
        told = look_from(view, planes, *_in_the_room(variant, view, forward, right))
        if told is None or not told.all():
            self._by_curves(variant, view, state, forward, right)
        if told is not None:
            state.update({name: np.where(told, planes[name], state[name]) for name in scanned_channels(view)})

    def _by_curves(self, variant: Variant, view: View, state: State, forward: float, right: float) -> None:
        """The same without planes: nearer by its part along the ray, which turns by the part across it."""
        cosine, sine = per_view(view, ("direction", variant.options["frame"]), lambda: _direction(view, variant))
        name = distances(view)[0]
        level = per_view(view, "level", lambda: np.cos(np.radians(elevation(view))))
        range_ = np.where(np.isfinite(state[name]) & (state[name] > 0.0), state[name], np.nan)
        near = (forward * cosine + right * sine) * level
        with np.errstate(invalid="ignore"):
            edge = per_view(view, ("nearest", name), lambda: _nearest(view, name)) * level
            turn = np.nan_to_num(np.degrees((right * cosine - forward * sine) / np.maximum(edge, 1e-9)))
            closer = np.nan_to_num(np.clip(near / range_, -0.5, 0.5))
        before = {distance: state[distance] for distance in distances(view)}
        point_elsewhere(view, state, turn=np.clip(turn, -5.0, 5.0), by_planes=False)  # they have told theirs
        part, most = _on_planes(variant, view, forward, right)
        for distance, own in before.items():
            change = state[distance] - near - own
            state[distance] = own + smooth_part(view, change, part * own, most * own, turn)
        for channel in signals(view):
            set_light(view, state, channel, state[channel] / (1.0 - closer) ** 2)

    def expression(self, variant: Variant) -> str:
        """The law."""
        if variant.options["frame"] == "head":
            return "every channel = simulation from (forward, right) off the axis, turned about it by azimuth_deg"
        angle = "azimuth_deg" if variant.options["frame"] == "sensor" else "(azimuth_deg + stage_angle_deg)"
        return (
            f"distance -= forward * cos({angle}) + right * sin({angle}), signals as 1/distance^2, bearing by parallax"
        )

    def sentence(self, variant: Variant, values: Values, view: View) -> str:
        """Displacement in millimetres."""
        forward, right = (in_mm(float(values[name]), distances(view)[0]) for name in _AXES)
        if variant.options["frame"] != "bench":
            return (
                f"The optical centre lies {forward:+.2f} mm forward and {right:+.2f} mm right of the rotation axis."
            )
        return f"The rotation axis lies {forward:+.2f} mm forward and {right:+.2f} mm right of the targets' centre."

    def next_experiment(self, variant: Variant) -> str:
        """What tells it from a stage zero."""
        return (
            "Mount the sensor turned by 180° on the stage, or measure a target at a second distance: an eccentricity "
            "of "
            "the sensor changes sign, a stage zero does not."
        )


_AXES = ("forward", "right")


def _pose(variant: Variant, view: View, forward: float, right: float) -> Pose:
    """The optical centre in the stage's frame, which turns under an axis that is off in the bench's frame."""
    size = in_mm(1.0, distances(view)[0]) * 1e-3
    forward, right = forward * size, right * size
    if variant.options["frame"] != "bench":
        return Pose(forward_m=forward, right_m=right)
    angle = np.radians(np.nan_to_num(view.number(STAGE)))
    c, s = np.cos(angle), np.sin(angle)
    return Pose(forward_m=forward * c + right * s, right_m=right * c - forward * s)


def _in_the_room(
    variant: Variant, view: View, forward: float, right: float
) -> tuple[FloatArray | float, FloatArray | float]:
    """A displacement along bearing 0 and 90 degrees: a sensor's own turns with the stage, a head's with its rays."""
    found = scene(view)
    if variant.options["frame"] == "bench" or found is None:
        return forward, right
    head = variant.options["frame"] == "head"
    turned = np.radians(azimuth(view) if head else found.sign * np.nan_to_num(view.number(STAGE)))
    c, s = np.cos(turned), np.sin(turned)
    return forward * c - right * s, forward * s + right * c


def _on_planes(variant: Variant, view: View, forward: float, right: float) -> tuple[FloatArray, FloatArray]:
    """Relative change of the range from a displaced point, on the plane that a row sees; and the most it can be."""
    found = scene(view)
    slope = planes(view, 1.0 if found is None else found.sign)[view.rows]
    size = in_mm(1e-3, distances(view)[0])
    along, across = (size * x for x in _in_the_room(variant, view, forward, right))
    part = -(slope[:, 0] * along + slope[:, 1] * across)
    return part, size * float(np.hypot(forward, right)) * np.linalg.norm(slope, axis=1)


def _direction(view: View, variant: Variant) -> tuple[FloatArray, FloatArray]:
    angle = azimuth(view)
    found = scene(view)
    if variant.options["frame"] == "bench" and found is not None:
        angle = angle + found.sign * np.nan_to_num(view.number(STAGE))
    return np.cos(np.radians(angle)), np.sin(np.radians(angle))


def _nearest(view: View, distance: str) -> FloatArray:
    """Shortest simulated distance among a row and its neighbours: an edge's parallax is of the nearer surface."""
    nearest = view.number(f"sim_{distance}")
    for steps in (-1, 1):
        nearest = np.fmin(nearest, view.take_number(f"sim_{distance}", view.sweep_place(steps)))
        if view.varies("pixel_u"):
            nearest = np.fmin(nearest, view.neighbour_number(f"sim_{distance}", du=steps, dv=0))
    return nearest
