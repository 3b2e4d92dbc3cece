"""Common-mode scatter of the intensity from pulse to pulse."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from arl_fixtures.reconcile.effect import Effect, Stage, State, Values, Variant
from arl_fixtures.reconcile.effects_common import (
    amplitude,
    lit_signals,
    rounded,
    shape,
    temperature_drivers,
)
from arl_fixtures.reconcile.roles import counts_visits, unit_of
from arl_fixtures.reconcile.view import View

_NUMBERS = ("frame", "shot", "pulse", "frame_number", "shot_number", "pulse_number", "frame_index", "shot_index")
"""Columns that number single frames."""
_PULSES = frozenset({"shot", "pulse"})


class PulseEnergyJitter(Effect):
    """σ_I² += (jitter · I)²: the pulse's energy scatters, so every pixel scatters in proportion to its signal.

    It may be worst at one end of the laser's current (the threshold) or of its temperature, at `worst`, and fade from
    there: jitter · exp(−|x − worst| / fade).
    Where rows are single frames nothing tells their scatter, but all rows of a frame are off together ("pulses").
    """

    id = "laser.pulse_energy_jitter"
    stage = Stage.LASER
    source = "ISO 11554 (laser pulse energy and its stability); diode-pumped Q-switched lasers: 0.5 to 3 %"
    common = True
    confusable = ("readout.noise_excess", "bench.repeatability")

    def variants(self, view: View) -> Iterable[Variant]:
        """One per intensity whose scatter was measured, or of which every frame is told apart."""
        known = {channel.name for channel in view.columns.channels}
        for channel in lit_signals(view):
            if f"{channel}_std" in known:
                yield Variant(
                    effect=self.id,
                    options={"channel": channel},
                    parameters=(amplitude("jitter", "1", 0.0, 0.5, 0.01),),
                    channels=(f"{channel}_std",),
                    drivers=(f"sim_{channel}",),
                )
                for column, end in _ends(view):
                    low, high = view.span(column)
                    fade = shape("fade", unit_of(column), 0.05 * (high - low), 3.0 * (high - low), 0.5 * (high - low))
                    yield Variant(
                        effect=self.id,
                        options={"channel": channel, "column": column, "worst": rounded((low, high)[end])},
                        parameters=(amplitude("jitter", "1", 0.0, 0.5, 0.01), fade),
                        channels=(f"{channel}_std",),
                        drivers=(column, f"sim_{channel}"),
                    )
                continue
            number = next((name for name in (*_NUMBERS, *_numbered(view)) if view.varies(name)), "")
            if number and (not view.has("n_frames") or view.middle("n_frames") <= 1.0):
                yield Variant(
                    effect=self.id,
                    options={"channel": channel, "group": "step" if _stands_for_steps(view, number) else "frame"},
                    parameters=(amplitude("jitter", "1", 0.0, 0.5, 0.01),),
                    channels=(channel,),
                    drivers=(number,),
                )

    def apply(self, variant: Variant, values: Values, state: State, view: View) -> None:
        """Widens the scatter in proportion to the light."""
        channel = str(variant.options["channel"])
        if "group" in variant.options:
            return  # no mean moves
        light = np.nan_to_num(state[channel])
        if "column" in variant.options:
            away = np.abs(view.number(str(variant.options["column"])) - float(variant.options["worst"]))
            light = light * np.nan_to_num(np.exp(-away / float(values["fade"])))
        state[f"{channel}_std"] = np.sqrt(state[f"{channel}_std"] ** 2 + (float(values["jitter"]) * light) ** 2)

    def expression(self, variant: Variant) -> str:
        """The law."""
        channel = variant.options["channel"]
        if "group" in variant.options:
            return f"{channel} *= 1 + one random value for every frame, of standard deviation jitter"
        if "column" in variant.options:
            faded = f"exp(-|{variant.options['column']} - {variant.options['worst']}| / fade)"
            return f"{channel}_std^2 += (jitter * {channel} * {faded})^2"
        return f"{channel}_std^2 += (jitter * {channel})^2"

    def sentence(self, variant: Variant, values: Values, view: View) -> str:
        """Jitter in percent."""
        where = ""
        if "column" in variant.options:
            where = f" where {variant.options['column']} is {variant.options['worst']}, less elsewhere"
        return (
            f"The laser's pulse energy scatters by {values['jitter'] * 100:.2f} % from pulse to pulse (all pixels at "
            f"once){where}."
        )

    def next_experiment(self, variant: Variant) -> str:
        """What tells it from pixel noise."""
        return (
            "Correlate pixels over the single frames of one angle: pulse energy moves all of them together, read-out "
            "noise each for itself."
        )


def _ends(view: View) -> list[tuple[str, int]]:
    """Columns at one end of which a laser runs worst, and which: its current 0 (low), its temperature 1."""
    currents = [(name, 0) for name in view.currents()]
    warm = [(name, 1) for name in temperature_drivers(view, "laser_temperature_c", limit=1)]
    return [*currents[:1], *warm]


def _stands_for_steps(view: View, number: str) -> bool:
    """Whether a column that numbers pulses is what a table without steps is grouped by."""
    return not view.has("step") and counts_visits(number)


def _numbered(view: View) -> list[str]:
    """Further columns that number pulses: those that stand for steps."""
    return [n for n in view.covariates() if _stands_for_steps(view, n) and not _PULSES.isdisjoint(n.split("_"))]
