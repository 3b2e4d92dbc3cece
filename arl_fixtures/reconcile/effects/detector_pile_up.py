"""Dead time of a photon-counting detector: counts stop following the light, early photons win and pull the range."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from arl_fixtures.reconcile.effect import Effect, Parameter, Stage, State, Values, Variant
from arl_fixtures.reconcile.effects_common import (
    FloatArray,
    amplitude,
    in_mm,
    rounded,
    set_response,
    shape,
    signals,
    top_signal,
    with_scatter,
)
from arl_fixtures.reconcile.effects_frame import ranged_by
from arl_fixtures.reconcile.roles import unit_of
from arl_fixtures.reconcile.view import View


class PileUp(Effect):
    """Counts I·q(x) for x = load·I/I_top photons per dead time; the distance is pulled by −width·early(x).

    q(x) = exp(−paralysis·x) / (1 + (1 − paralysis)·x): a detector that recovers on its own (0) or starts its dead
    time anew with every photon (1). early(x): how much earlier than its mean a Gaussian pulse's first photon comes,
    in standard deviations.
    """

    id = "detector.pile_up"
    stage = Stage.DETECTOR
    source = (
        "Lee, Gardner, Nucl. Instrum. Methods A 441 (2000) 502 (hybrid dead time); Coates, J. Phys. E 1 (1968) 878"
    )
    confusable = ("detector.compression", "timing.range_walk")

    def variants(self, view: View) -> Iterable[Variant]:
        """One per intensity channel."""
        for channel in signals(view):
            moved = ranged_by(view, channel)[:1]
            if not moved and unit_of(channel) not in _COUNTED:
                continue  # a current or a voltage is not counted
            parameters: list[Parameter] = [
                amplitude("load", "1", 0.0, 50.0, 0.2),
                shape("paralysis", "1", 0.0, 1.0, 0.0, 0.8),
            ]
            if moved:
                size = 1e3 if unit_of(moved[0]) == "mm" else 1.0
                parameters.append(shape("width", unit_of(moved[0]), 0.005 * size, 2.0 * size, 0.05 * size))
            yield Variant(
                effect=self.id,
                options={
                    "channel": channel,
                    "distance": moved[0] if moved else "",
                    "top": rounded(top_signal(view, channel)),
                },
                parameters=tuple(parameters),
                channels=tuple(dict.fromkeys((*moved, *with_scatter(view, channel)))),
                drivers=(f"sim_{channel}",),
            )

    def apply(self, variant: Variant, values: Values, state: State, view: View) -> None:
        """Loses counts, and pulls the distance to the early photons."""
        channel, distance = str(variant.options["channel"]), str(variant.options["distance"])
        light = state[channel]
        with np.errstate(invalid="ignore"):
            load = np.clip(float(values["load"]) * light / float(variant.options["top"]), 0.0, 200.0)
        paralysis = float(values["paralysis"])
        alive = 1.0 + (1.0 - paralysis) * load
        kept = np.exp(-np.minimum(paralysis * load, 50.0)) / alive
        slope = np.maximum(kept * (1.0 - paralysis * load - (1.0 - paralysis) * load / alive), 0.02 * kept)
        set_response(state, channel, light * kept, np.nan_to_num(slope, nan=1.0))
        if distance:
            state[distance] = state[distance] - float(values["width"]) * early(np.nan_to_num(load))

    def expression(self, variant: Variant) -> str:
        """The law."""
        channel, distance = variant.options["channel"], variant.options["distance"]
        text = (
            f"{channel} *= exp(-paralysis * x) / (1 + (1 - paralysis) * x), x = load * {channel} / "
            f"{variant.options['top']}"
        )
        return f"{text}; {distance} -= width * early(x)" if distance else text

    def sentence(self, variant: Variant, values: Values, view: View) -> str:
        """Loss of counts and pull at the strongest signal."""
        channel, distance = str(variant.options["channel"]), str(variant.options["distance"])
        load, paralysis = float(values["load"]), float(values["paralysis"])
        lost = 1.0 - np.exp(-paralysis * load) / (1.0 + (1.0 - paralysis) * load)
        text = (
            f"Photons arrive within the dead time: {lost * 100:.1f} % of the counts are lost at the strongest "
            f"{channel}"
        )
        if not distance:
            return f"{text}."
        pulled = in_mm(float(values["width"]) * float(early(np.array([load]))[0]), distance)
        return f"{text}, and early photons shorten the distance by {pulled:.2f} mm there."

    def next_experiment(self, variant: Variant) -> str:
        """What tells it from analog compression."""
        return (
            "Put neutral-density filters in front of the window: with few photons per pulse counts and range come "
            "back; "
            "look at the histogram's floor before the pulse, which sinks with pile-up."
        )


_COUNTED = ("counts", "1/s", "1")
_LOADS = np.concatenate([[0.0], np.logspace(-4.0, 2.4, 400)])


def _first_photon() -> FloatArray:
    """Mean lead of the detected photon over the pulse's mean, per pulse standard deviation, at each of `_LOADS`.

    Photons of a Gaussian pulse arrive as a Poisson process of `load` in all; the first within a period is timed.
    Density of the first photon: load·p(t)·exp(−load·P(t)), normalised by 1 − exp(−load).
    """
    t = np.linspace(-8.0, 8.0, 3201)
    p = np.exp(-0.5 * t**2) / np.sqrt(2.0 * np.pi)
    total = np.cumsum(p) * (t[1] - t[0])
    lead = np.zeros_like(_LOADS)
    for index, load in enumerate(_LOADS[1:], start=1):
        weight = p * np.exp(-load * total)
        lead[index] = -np.sum(t * weight) / np.sum(weight)
    return lead


_LEAD = _first_photon()


def early(load: FloatArray) -> FloatArray:
    """Lead of the first photon in standard deviations of the pulse, for photons per pulse."""
    return np.interp(load, _LOADS, _LEAD)
