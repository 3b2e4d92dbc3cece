"""The focal length follows the temperature."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from arl_fixtures.reconcile.effect import Effect, Stage, State, Values, Variant
from arl_fixtures.reconcile.effects_common import (
    FloatArray,
    amplitude,
    excess,
    per_view,
    reference,
    span,
    temperature_drivers,
)
from arl_fixtures.reconcile.effects_illumination import azimuth, elevation
from arl_fixtures.reconcile.effects_scene import point_elsewhere, scanned_channels, scene
from arl_fixtures.reconcile.view import View


class FocalDrift(Effect):
    """f = f0·(1 + drift·ΔT): a pixel's ray moves inwards by drift·ΔT·sin·cos of its angle, across a fixed beam."""

    id = "optics.focal_drift"
    stage = Stage.OPTICS
    source = "Elias, Eltner, Liebold, Maas, Sensors 20 (2020) 643: interior orientation over temperature"
    confusable = ("beam.profile_change", "optics.defocus", "mount.tilt")

    def variants(self, view: View) -> Iterable[Variant]:
        """One per temperature near the optics."""
        if not view.varies("azimuth_deg") or scene(view) is None:
            return
        for column in temperature_drivers(view, "lens_temperature_c", "housing_temperature_c", limit=2):
            most = min(0.3 / span(view, column), 0.01)
            yield Variant(
                effect=self.id,
                options={"temperature": column, "reference": reference(view, column)},
                parameters=(amplitude("drift", "1/K", -most, most, 1e-4),),
                channels=scanned_channels(view),
                drivers=(column, "azimuth_deg"),
            )

    def apply(self, variant: Variant, values: Values, state: State, view: View) -> None:
        """Looks the scene up along the moved rays."""
        warm = float(values["drift"]) * excess(view, variant, str(variant.options["temperature"]))
        across, along = per_view(view, "field terms", lambda: _terms(view))
        point_elsewhere(view, state, turn=-warm * across, lift=-warm * along, beam_turns=False)

    def expression(self, variant: Variant) -> str:
        """The law."""
        column = variant.options["temperature"]
        return (
            f"rays scale by 1 / (1 + drift * ({column} - {variant.options['reference']})) in tan(azimuth), "
            "tan(elevation)"
        )

    def sentence(self, variant: Variant, values: Values, view: View) -> str:
        """Drift in ppm per kelvin, shift at the edge."""
        column = str(variant.options["temperature"])
        edge = float(np.nanmax(np.abs(azimuth(view)))) if view.n else 0.0
        moved = np.degrees(values["drift"] * span(view, column) * np.sin(np.radians(edge)) * np.cos(np.radians(edge)))
        return (
            f"The focal length drifts by {values['drift'] * 1e6:+.0f} ppm/K of {column}: a ray at {edge:.0f}° moves "
            "by "
            f"{moved:+.3f}° over the table's temperatures."
        )

    def next_experiment(self, variant: Variant) -> str:
        """What shows it."""
        return "Compare the camera matrix from the intrinsic targets at the coldest and the hottest step."


def _terms(view: View) -> tuple[FloatArray, FloatArray]:
    az, el = np.radians(azimuth(view)), np.radians(elevation(view))
    return np.degrees(np.sin(az) * np.cos(az)), np.degrees(np.sin(el) * np.cos(el))
