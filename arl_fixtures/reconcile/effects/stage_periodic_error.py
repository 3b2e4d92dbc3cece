"""The stage angle has an error periodic in angle."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from arl_fixtures.reconcile.effect import Effect, Stage, State, Values, Variant
from arl_fixtures.reconcile.effects_bench import is_sharp
from arl_fixtures.reconcile.effects_common import amplitude, period_starts, shape
from arl_fixtures.reconcile.effects_encoder import (
    show_turn,
    slides,
    turned_angle,
    turned_by,
    turning_channels,
    ways_of_turning,
)
from arl_fixtures.reconcile.roles import per_metre, unit_of
from arl_fixtures.reconcile.view import View

MANY_PERIODS = 300
_FEW_PERIODS, _LOOKS = 24, 600_000
"""Periods from which a search starts at least, and at how many rows in all it may look up what they see."""
_APART = 0.25
"""Part of a cycle between them: a few edges, at the ends of a sweep, say more than all the rest of it."""
FEWEST_PLACES = 8
FEWEST_STEPS, MOST_STEPS, OF_STEPS = 2.5, 4.0, (12, 40)
"""Steps to the shortest period looked for, and to that of sweeps whose places are too few to tell so short a one from
chance, or so many (readings at random places) that there are too many such periods to look for."""


class PeriodicError(Effect):
    """True angle = stage angle + sine·sin(2πθ/period) + cosine·cos(2πθ/period); an encoder reads it.

    Of a linear stage the same of its place, by the pitch of its screw: the distance to what it carries reads it.
    """

    id = "stage.periodic_error"
    stage = Stage.BOOKKEEPING
    displaces = True
    shared = True
    source = "worm and gear errors repeat with every turn of the worm, e.g. 360°/n; ISO 230-2"
    confusable = ("stage.zero_offset", "stage.eccentricity", "timing.tdc_nonlinearity")

    def variants(self, view: View) -> Iterable[Variant]:
        """One, one for each encoder and linear stage; periods from a few steps to one and a half sweeps."""
        yield from self._along(view)
        ways, angle = ways_of_turning(view), turned_by(view)
        if not angle or not ways:
            return
        low, high = view.span(angle)
        angles = np.unique(np.round(view.columns.numbers[angle], 4))
        angles = angles[np.isfinite(angles)]
        if angles.size < FEWEST_PLACES:
            return
        few, many = OF_STEPS
        steps = FEWEST_STEPS if few <= angles.size <= many else MOST_STEPS
        shortest, longest = steps * float(np.median(np.diff(angles))), 1.5 * (high - low)
        if shortest >= 0.8 * longest:
            return
        for way in ways:
            most, apart = MANY_PERIODS, 0.75  # without a scene to look up, a period costs nothing
            if "channel" not in way:
                most, apart = int(np.clip(_LOOKS / view.columns.n, _FEW_PERIODS, MANY_PERIODS)), _APART
            starts = period_starts(shortest, longest, high - low, most=most, apart=apart)
            yield Variant(
                effect=self.id,
                options=way,
                parameters=(
                    amplitude("sine", "deg", -3.0, 3.0, 0.05),
                    amplitude("cosine", "deg", -3.0, 3.0, 0.05),
                    shape("period", "deg", shortest, longest, *starts),
                ),
                channels=turning_channels(way, view),
                rough=not way and is_sharp(view),
                drivers=(angle,),
            )

    def _along(self, view: View) -> Iterable[Variant]:
        """One for each distance to what a linear stage carries."""
        for channel, column in slides(view):
            low, high = view.span(column)
            places = np.unique(np.round(view.columns.numbers[column] / (high - low), 5)) * (high - low)
            shortest, longest = MOST_STEPS * float(np.nanmedian(np.diff(places))), 1.5 * (high - low)
            if places.size < FEWEST_PLACES or shortest >= 0.8 * longest:
                continue
            unit, size = unit_of(channel), per_metre(unit_of(channel)) / per_metre(unit_of(column)) * (high - low)
            yield Variant(
                effect=self.id,
                options={"channel": channel, "along": column},
                parameters=(
                    amplitude("sine", unit, -0.05 * size, 0.05 * size, 1e-3 * size),
                    amplitude("cosine", unit, -0.05 * size, 0.05 * size, 1e-3 * size),
                    shape("period", unit_of(column), shortest, longest,
                          *period_starts(shortest, longest, high - low, most=24)),
                ),
                channels=(channel,),
                drivers=(column,),
                wider=True,  # a rail's place is no stage's angle
            )  # fmt: skip

    def apply(self, variant: Variant, values: Values, state: State, view: View) -> None:
        """Looks the scene up at the true angle."""
        place = view.number(_place(variant))
        phase = 2.0 * np.pi / float(values["period"]) * np.nan_to_num(place)
        error = float(values["sine"]) * np.sin(phase) + float(values["cosine"]) * np.cos(phase)
        show_turn(variant, state, view, error)

    def expression(self, variant: Variant) -> str:
        """The law."""
        phase = f"(2 pi {_place(variant)} / period)"
        if "channel" in variant.options:
            return f"{variant.options['channel']} += sine * sin{phase} + cosine * cos{phase}"
        return f"every channel = simulation at {_place(variant)} + sine * sin{phase} + cosine * cos{phase}"

    def sentence(self, variant: Variant, values: Values, view: View) -> str:
        """Amplitude and period."""
        size = float(np.hypot(values["sine"], values["cosine"]))
        if "along" in variant.options:
            unit, pitch = unit_of(str(variant.options["channel"])), unit_of(str(variant.options["along"]))
            return f"The stage's place swings by ±{size:.3g} {unit} with a period of {values['period']:.4g} {pitch}."
        return f"The stage's angle swings by ±{size:.3f}° with a period of {values['period']:.2f}°."

    def next_experiment(self, variant: Variant) -> str:
        """What shows it."""
        return "Log an encoder or an autocollimator on the table over two periods, in steps of a tenth of one."


def _place(variant: Variant) -> str:
    """Column of the place or angle that is off."""
    return str(variant.options.get("along", turned_angle(variant)))
