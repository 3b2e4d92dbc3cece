"""Range walk: a weak return crosses a threshold later, so the measured distance depends on the signal's strength."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from arl_fixtures.reconcile.effect import Effect, Stage, State, Values, Variant
from arl_fixtures.reconcile.effects_common import (
    FloatArray,
    amplitude,
    distances,
    in_mm,
    per_table,
    rounded,
    shape,
    signals,
)
from arl_fixtures.reconcile.roles import per_metre, unit_of
from arl_fixtures.reconcile.view import View

_STEEPEST = 1.5
"""Largest exponent of a walk: a straight edge has 1, and one that starts flat less (t^n crosses at I^(-1/n))."""
RETURN = "expected return"
"""What stands for the signal where none was recorded."""


class RangeWalk(Effect):
    """D += walk·(w(I / reference) − w(1)), I the signal as earlier stages left it, reference the table's median.

    * edge: w(x) = x^(−exponent) / exponent. 1 is a linear edge (1/I), 0 an exponential one (−ln I), negative
      exponents flatten towards weak returns.
    * pulse: w(x) = −sqrt(2·ln(x / threshold)), the crossing of a Gaussian pulse's leading edge; `walk` is then the
      pulse's standard deviation as a range. It runs away near the threshold as no power does.

    In a table whose signal is not compared stands for it what was read of it, if a column tells (the peak's voltage),
    or what a surface returns: reflectance·cos(incidence) / distance².
    """

    id = "timing.range_walk"
    stage = Stage.TIMING
    floating = True  # nil at the table's median signal, for want of a better one
    source = "Kilpelä et al., Rev. Sci. Instrum. 72 (2001) 13: timing discriminators, walk error of leading edges"
    confusable = ("detector.pile_up", "air.multipath", "optics.veiling_glare")

    def variants(self, view: View) -> Iterable[Variant]:
        """Edge and pulse for every pair of a distance and an intensity channel."""
        for distance in distances(view):
            size = per_metre(unit_of(distance))
            for signal in signals(view) or (*_read(view), RETURN):
                simulated = view.varies("reflectance") if signal == RETURN else view.varies(f"sim_{signal}")
                if not simulated and signal not in _read(view):
                    continue
                for kind in ("edge", "pulse"):
                    yield Variant(
                        effect=self.id,
                        options={
                            "distance": distance,
                            "signal": signal,
                            "kind": kind,
                            "reference": _reference(view, signal, distance),
                        },
                        parameters=(
                            amplitude("walk", unit_of(distance), -2.0 * size, 2.0 * size, 0.005 * size),
                            shape("exponent", "1", -2.5, _STEEPEST, 0.5, 1.2)
                            if kind == "edge"
                            else shape("threshold", "1", 1e-4, 0.9, 0.02),
                        ),
                        channels=(distance,),
                        drivers=_drivers(view, signal),
                    )

    def apply(self, variant: Variant, values: Values, state: State, view: View) -> None:
        """Shifts the distance by the walk of the signal."""
        distance, signal = str(variant.options["distance"]), str(variant.options["signal"])
        light = state[signal] if signal in state else _strength(view, signal, distance)
        ratio = np.clip(np.nan_to_num(light / float(variant.options["reference"]), nan=1.0), 1e-3, 1e4)
        state[distance] = state[distance] + float(values["walk"]) * _walk(ratio, values)

    def expression(self, variant: Variant) -> str:
        """The law."""
        distance, signal, origin = (variant.options[key] for key in ("distance", "signal", "reference"))
        if signal == RETURN:
            signal = f"(reflectance * cos(incidence_deg) / {distance}^2)"
        if variant.options["kind"] == "edge":
            return f"{distance} += walk * (({signal} / {origin})^(-exponent) - 1) / exponent"
        crossing = f"sqrt(2 ln({signal} / ({origin} * threshold)))"
        return f"{distance} += walk * (sqrt(2 ln(1 / threshold)) - {crossing})"

    def sentence(self, variant: Variant, values: Values, view: View) -> str:
        """Size over the middle 90 % of the signal."""
        signal, distance = str(variant.options["signal"]), str(variant.options["distance"])
        light = view.sim[signal] if signal in view.sim else _strength(view, signal, distance)
        low, high = np.nanquantile(light, [0.05, 0.95])
        ends = np.clip(np.array([low, high]) / float(variant.options["reference"]), 1e-3, 1e4)
        change = float(values["walk"]) * float(-np.diff(_walk(ends, values))[0])
        digits = ".3g" if signal == RETURN else ".0f"
        return (
            f"Weak returns ({signal} {low:{digits}}) are ranged {in_mm(change, distance):+.2f} mm against strong "
            f"ones ({high:{digits}})."
        )

    def next_experiment(self, variant: Variant) -> str:
        """What tells it from glare and pile-up."""
        return (
            "Repeat with a neutral-density filter in front of the window: range walk follows the attenuated signal."
        )


_STRENGTHS = ("peak", "amplitude", "signal", "intensity", "echo", "strength", "pulse_height")
_SEEN = 0.95


def _read(view: View) -> tuple[str, ...]:
    """Logged columns that tell the strength of a return, positive on nearly all rows."""
    told = [
        n for n in view.covariates() if any(w in n for w in _STRENGTHS) and unit_of(n) in {"V", "mV", "counts", "1"}
    ]
    return tuple(n for n in told if float(np.mean(view.columns.numbers[n] > 0.0)) > _SEEN)[:2]


def _strength(view: View, signal: str, distance: str) -> FloatArray:
    """The strength of the rows' returns where no channel is, as logged or as a surface sends back."""
    return _returned(view, distance) if signal == RETURN else np.maximum(view.number(signal), 0.0)


def _drivers(view: View, signal: str) -> tuple[str, ...]:
    """The simulated signal, as it is where rows are predicted; a logged one; or what makes up a return's strength."""
    if signal != RETURN:
        return (f"sim_{signal}" if f"sim_{signal}" in view.columns.numbers else signal,)
    return tuple(name for name in ("reflectance", "true_range_m", "incidence_deg") if view.varies(name))


def _returned(view: View, distance: str) -> FloatArray:
    """What a surface sends back by its reflectance, incidence and simulated distance, in units of their own."""

    def make() -> FloatArray:
        numbers = view.columns.numbers
        light = numbers["reflectance"] / np.maximum(np.abs(numbers[f"sim_{distance}"]), 1e-9) ** 2
        if "incidence_deg" in numbers:
            light = light * np.nan_to_num(np.cos(np.radians(numbers["incidence_deg"])), nan=1.0)
        return np.asarray(np.maximum(light, 0.0))

    whole: FloatArray = per_table(view, ("returned", distance), make)
    return whole[view.rows]


def _reference(view: View, signal: str, distance: str) -> float:
    """Median signal of the table."""
    if f"sim_{signal}" in view.columns.numbers:
        return rounded(view.middle(f"sim_{signal}"))
    light = _strength(View(view.columns), signal, distance)
    return rounded(float(np.median(light[np.isfinite(light) & (light > 0.0)])))


def _walk(ratio: FloatArray, values: Values) -> FloatArray:
    """w(ratio) − w(1) for a signal over its reference."""
    if "exponent" in values:
        power = float(values["exponent"])
        if abs(power) < 1e-6:
            return np.asarray(-np.log(ratio))
        return np.asarray(-np.expm1(-power * np.log(ratio)) / -power)
    height = -np.log(float(values["threshold"]))
    crossing = np.sqrt(2.0 * np.maximum(np.log(ratio) + height, 1e-3))
    return np.asarray(np.sqrt(2.0 * height) - crossing)
