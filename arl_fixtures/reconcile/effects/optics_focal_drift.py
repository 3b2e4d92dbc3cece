"""The focal length follows the temperature."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import product

import numpy as np

from arl_fixtures.reconcile.effect import Effect, Stage, State, Values, Variant
from arl_fixtures.reconcile.effects_bench import is_sharp
from arl_fixtures.reconcile.effects_common import (
    FloatArray,
    above,
    amplitude,
    distances,
    excess,
    is_of,
    per_view,
    reference,
    shape,
    span,
    temperature_drivers,
)
from arl_fixtures.reconcile.effects_illumination import azimuth, elevation, ray_column
from arl_fixtures.reconcile.effects_pointing import (
    by_whole_pixels,
    point_elsewhere,
    scanned_channels,
    take_pose,
    ways_of_looking,
)
from arl_fixtures.reconcile.effects_rays import Pose
from arl_fixtures.reconcile.effects_scene import scene
from arl_fixtures.reconcile.roles import per_metre, unit_of
from arl_fixtures.reconcile.view import View


class FocalDrift(Effect):
    """f = f0·(1 + drift·ΔT): a pixel's ray moves inwards as its offset from the axis shrinks, across a fixed beam.

    Of a single beam whose spot is triangulated, D = f0·base / offset of the spot: D /= 1 + drift·(T − nominal), since
    nobody tells at which temperature f0 was measured. Beside a logged temperature of a timing chip ranges are timed.
    """

    id = "optics.focal_drift"
    stage = Stage.OPTICS
    displaces = True
    source = "Elias, Eltner, Liebold, Maas, Sensors 20 (2020) 643: interior orientation over temperature"
    confusable = ("beam.profile_change", "optics.defocus", "mount.tilt", "timing.temperature_offset")

    def variants(self, view: View) -> Iterable[Variant]:
        """One per temperature near the optics."""
        if not view.varies("azimuth_deg") or scene(view) is None:
            yield from _triangulated(self.id, view)
            return
        columns = temperature_drivers(view, "lens_temperature_c", "housing_temperature_c", limit=2)
        for column, way in product(columns, ways_of_looking(view)):
            most = min(0.3 / span(view, column), 0.01)
            yield Variant(
                effect=self.id,
                options={"temperature": column, "reference": reference(view, column), **way},
                parameters=(amplitude("drift", "1/K", -most, most, 1e-4),),
                channels=scanned_channels(view),
                rough=is_sharp(view) and not way,
                drivers=(column, "azimuth_deg"),
            )

    def apply(self, variant: Variant, values: Values, state: State, view: View) -> None:
        """Looks the scene up along the moved rays; a triangulated distance by what the spot's offset means."""
        if variant.options.get("kind") == "triangulated":
            column, distance = str(variant.options["temperature"]), str(variant.options["channel"])
            grown = 1.0 + float(values["drift"]) * above(view, column, float(values["nominal"]))
            state[distance] = state[distance] / np.maximum(grown, 0.1)
            return
        warm = float(values["drift"]) * excess(view, variant, str(variant.options["temperature"]))
        across, along = per_view(view, "field terms", lambda: _terms(view))
        turn, lift = -warm * across, -warm * along
        whole = by_whole_pixels(variant)
        if not take_pose(view, state, Pose(focal=1.0 + warm), beam_moves=(turn, lift), whole=whole):
            point_elsewhere(view, state, turn=turn, lift=lift, beam_turns=False)

    def expression(self, variant: Variant) -> str:
        """The law."""
        column = variant.options["temperature"]
        if variant.options.get("kind") == "triangulated":
            return f"{variant.options['channel']} /= 1 + drift * ({column} - nominal)"
        return (
            f"a pixel at x looks where one at x / (1 + drift * ({column} - {variant.options['reference']})) looked, "
            "x from the optical axis"
        )

    def sentence(self, variant: Variant, values: Values, view: View) -> str:
        """Drift in ppm per kelvin, shift at the edge."""
        column = str(variant.options["temperature"])
        if variant.options.get("kind") == "triangulated":
            wide = 100.0 * float(values["drift"]) * span(view, column)
            return (
                f"The focal length drifts by {values['drift'] * 1e6:+.0f} ppm/K of {column}: triangulated distances "
                f"by {-wide:+.3f} % over the table's temperatures."
            )
        edge = float(np.nanmax(np.abs(azimuth(view)))) if view.n else 0.0
        moved = np.degrees(values["drift"] * span(view, column) * np.sin(np.radians(edge)) * np.cos(np.radians(edge)))
        return (
            f"The focal length drifts by {values['drift'] * 1e6:+.0f} ppm/K of {column}: a ray at {edge:.0f}° moves "
            "by "
            f"{moved:+.3f}° over the table's temperatures."
        )

    def says_as_well(self, variant: Variant) -> tuple[str, ...]:
        """A table does not say whether a single beam's range is triangulated or timed."""
        return ("timing.temperature_offset",) if variant.options.get("kind") == "triangulated" else ()

    def next_experiment(self, variant: Variant) -> str:
        """What shows it."""
        if variant.options.get("kind") == "triangulated":
            return "Ask for the principle: a triangulated distance follows the focal length, a timed one the clock."
        return "Compare the camera matrix from the intrinsic targets at the coldest and the hottest step."


_FURTHEST_K = 40.0
"""Kelvins beyond the table's temperatures within which a focal length was measured."""
_FARTHEST_M = 15.0
"""Range beyond which none is triangulated: a base of centimetres would tell metres there by parts of a pixel."""
_TIMED_WORDS = ("echo", "photon", "return", "pulse", "arrival")
"""Words in the name of a channel or condition that say that light's way was timed."""


def _triangulated(effect: str, view: View) -> Iterable[Variant]:
    """One per distance, of a sensor without rays or pixels whose distances differ by more than their double."""
    if any(map(view.varies, ("azimuth_deg", "elevation_deg", "pixel_u", "pixel_v"))):
        return
    if any(is_of(name, "tof", "fpga", "tdc") for name in view.temperatures()):
        return
    if any(word in name for name in (*view.covariates(), *view.sim) for word in _TIMED_WORDS):
        return
    for distance in distances(view):
        low, high = view.span(f"sim_{distance}")
        if not (low > 0.0 and 2.0 * low < high < _FARTHEST_M * per_metre(unit_of(distance))):
            continue
        for column in temperature_drivers(view, "lens_temperature_c", "housing_temperature_c", limit=1):
            cold, hot = view.span(column)
            most = min(0.3 / span(view, column), 0.01)
            first, last = cold - _FURTHEST_K, hot + _FURTHEST_K
            yield Variant(
                effect=effect,
                options={"kind": "triangulated", "channel": distance, "temperature": column},
                parameters=(
                    amplitude("drift", "1/K", -most, most, 1e-4),
                    shape("nominal", "°C", first, last, reference(view, column), cold, hot),
                ),
                channels=(distance,),
                drivers=(column, f"sim_{distance}"),
            )


def _terms(view: View) -> tuple[FloatArray, FloatArray]:
    """How far azimuth and elevation of a row's ray move, in degrees, when the image grows by its own size.

    From the table's own projection: azimuth = x·(c0 + c1 r² + c2 r⁴ + c3 r⁶) of the pixel's offset x from the axis,
    and likewise the elevation; a pinhole's sin·cos where the table has no pixels.
    """
    az, el = np.radians(azimuth(view)), np.radians(elevation(view))
    across, along = np.degrees(np.sin(az) * np.cos(az)), np.degrees(np.sin(el) * np.cos(el))
    x, y = _offset(view, "u"), _offset(view, "v")
    if x is None or y is None:
        return across, along
    radius = x**2 + y**2
    some = slice(None, None, max(1, view.columns.n // 20_000))
    terms = []
    for place, name in ((x, "azimuth_deg"), (y, "elevation_deg")):
        matrix = np.column_stack([place * radius**k for k in range(4)])
        factors = np.linalg.lstsq(matrix[some], ray_column(view, name)[some], rcond=1e-9)[0]
        grown = matrix @ (factors * (1.0 + 2.0 * np.arange(4)))
        terms.append(np.asarray(grown[view.rows], dtype=np.float64))
    return terms[0], terms[1]


def _offset(view: View, letter: str) -> FloatArray | None:
    """Pixel offset from the optical axis over 64, of the whole table; None where axis or pixels are not known."""
    name, ray = f"pixel_{letter}", "azimuth_deg" if letter == "u" else "elevation_deg"
    if not (view.varies(name) and view.varies(ray)):
        return None
    pixel, angle = np.nan_to_num(view.columns.numbers[name]), ray_column(view, ray)
    near = np.abs(angle) < max(10.0, float(np.quantile(np.abs(angle), 0.2)))
    if not near.any() or np.ptp(angle[near]) == 0.0:
        return None
    return np.asarray((pixel - np.polyfit(angle[near], pixel[near], 1)[1]) / 64.0)
