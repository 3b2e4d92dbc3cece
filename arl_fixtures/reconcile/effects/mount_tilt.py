"""A DUT is mounted tilted or turned."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from arl_fixtures.reconcile.effect import Effect, Stage, State, Values, Variant
from arl_fixtures.reconcile.effects_bench import bench_of, is_sharp
from arl_fixtures.reconcile.effects_common import FloatArray, amplitude, per_view
from arl_fixtures.reconcile.effects_illumination import azimuth, elevation
from arl_fixtures.reconcile.effects_pointing import (
    by_whole_pixels,
    point_elsewhere,
    scanned_channels,
    take_pose,
    ways_of_looking,
)
from arl_fixtures.reconcile.effects_rays import Pose
from arl_fixtures.reconcile.effects_room import looks_down, room_of
from arl_fixtures.reconcile.effects_scene import scene
from arl_fixtures.reconcile.view import View

_TURNS = ("yaw", "pitch", "roll")


class Tilt(Effect):
    """The sensor's rays are rotated: yaw about the vertical, pitch about the lateral, roll about the optical axis.

    To first order the ray (azimuth, elevation) turns by yaw + pitch·tan(el)·sin(az) + roll·tan(el)·cos(az) and rises
    by pitch·cos(az) − roll·sin(az). The sensor's own illumination turns with it.
    """

    id = "mount.tilt"
    stage = Stage.BOOKKEEPING
    displaces = True
    source = "infinitesimal rotation in spherical coordinates"
    confusable = ("stage.zero_offset", "stage.eccentricity", "optics.focal_drift", "beam.profile_shift")

    def variants(self, view: View) -> Iterable[Variant]:
        """One: all three turns, as far as the table's rays show them (the engine tries single DUTs)."""
        found = scene(view)
        if found is None or not view.varies("azimuth_deg"):
            return
        known = (
            found.pitch_deg > 0.0
            or found.upright
            or bench_of(view) is not None
            or ((view.varies("elevation_deg") or looks_down(view)) and room_of(view, found.sign) is not None)
        )
        turns = _TURNS if known else _TURNS[:1]
        for way in ways_of_looking(view):
            yield Variant(
                effect=self.id,
                options=way,
                parameters=tuple(amplitude(name, "deg", -20.0, 20.0, 0.1) for name in turns),
                channels=scanned_channels(view),
                rough=is_sharp(view) and not way,
                drivers=tuple(name for name in ("azimuth_deg", "elevation_deg") if view.varies(name)),
            )

    def apply(self, variant: Variant, values: Values, state: State, view: View) -> None:
        """Looks the scene up along the turned rays."""
        yaw, pitch, roll = (float(values.get(name, 0.0)) for name in _TURNS)
        if take_pose(view, state, Pose(tilt_deg=(yaw, pitch, roll)), whole=by_whole_pixels(variant)):
            return
        if pitch == 0.0 and roll == 0.0:
            point_elsewhere(view, state, turn=yaw)
            return
        sine, cosine, slope = per_view(view, "tilt terms", lambda: _terms(view))
        turn = yaw + slope * (pitch * sine + roll * cosine)
        point_elsewhere(view, state, turn=turn, lift=pitch * cosine - roll * sine)

    def expression(self, variant: Variant) -> str:
        """The law."""
        return (
            "every channel = simulation along the ray turned by yaw + tan(el) * (pitch * sin(az) + roll * cos(az)) "
            "and "
            "raised by pitch * cos(az) - roll * sin(az)"
        )

    def sentence(self, variant: Variant, values: Values, view: View) -> str:
        """The turns in degrees."""
        parts = ", ".join(f"{name} {values[name]:+.3f}°" for name in _TURNS if name in values)
        return f"The sensor is mounted turned against the simulation: {parts}."

    def next_experiment(self, variant: Variant) -> str:
        """What tells it from the stage."""
        return (
            "Unmount and remount the DUT, and compare DUTs: a tilt changes and differs, an error of the stage stays."
        )


def _terms(view: View) -> tuple[FloatArray, FloatArray, FloatArray]:
    az, el = np.radians(azimuth(view)), np.radians(elevation(view))
    return np.sin(az), np.cos(az), np.tan(el)
