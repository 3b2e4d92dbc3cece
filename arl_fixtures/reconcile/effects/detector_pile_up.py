"""Dead time of a photon-counting detector: counts stop following the light, early photons win and pull the range."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from scipy.special import erfc

from arl_fixtures.reconcile.effect import Effect, Option, Parameter, Stage, State, Values, Variant
from arl_fixtures.reconcile.effects_common import (
    FloatArray,
    amplitude,
    exposure_column,
    in_mm,
    per_table,
    rounded,
    set_response,
    shape,
    signals,
    top_signal,
    with_scatter,
)
from arl_fixtures.reconcile.effects_counting import counts_photons
from arl_fixtures.reconcile.effects_frame import ranged_by
from arl_fixtures.reconcile.effects_histogram import counted, window_parameters
from arl_fixtures.reconcile.roles import per_metre, unit_of
from arl_fixtures.reconcile.view import View


class PileUp(Effect):
    """Counts I·q(x) for x = load·I/I_top photons per dead time; the distance is pulled by −width·early(x).

    * dead time: q(x) = exp(−paralysis·x) / (1 + (1 − paralysis)·x), a detector that recovers on its own (0) or starts
      its dead time anew with every photon (1).
    * pulse: q(x) = (1 − exp(−x)) / x, a detector that fires once a laser pulse, x photons per pulse; of what counts
      photons for sure also without a pull.

    Where exposures vary, x goes with the light that comes in a second: I over the exposure.
    Where the background's light varies, also with exp(−blocked·b / b_top): what it has fired is blind to the pulse.

    * histogram: as pulse, but the background fires detectors, too, and a histogram's floor is taken away
      (`effects_histogram`).

    early(x, tail): how much earlier than its mean a pulse's first photon comes, in standard deviations. A Gaussian
    pulse has no tail (0); one that decays from a sharp edge (1) has no photon before that edge.
    """

    id = "detector.pile_up"
    stage = Stage.DETECTOR
    source = (
        "Lee, Gardner, Nucl. Instrum. Methods A 441 (2000) 502 (hybrid dead time); Coates, J. Phys. E 1 (1968) 878"
    )
    confusable = ("detector.compression", "timing.range_walk")
    essential = "load"  # a signal that only falls with the background may as well lose its gain to it

    def variants(self, view: View) -> Iterable[Variant]:
        """One per intensity channel."""
        background, floor = _background(view), _floor(view)
        for channel in signals(view):
            moved = ranged_by(view, channel)[:1]
            if not moved and unit_of(channel) not in _COUNTED:
                continue  # a current or a voltage is not counted
            widths: list[Parameter] = []
            if moved:
                size = per_metre(unit_of(moved[0]))
                widths.append(shape("width", unit_of(moved[0]), 0.005 * size, 2.0 * size, 0.05 * size))
            tails = [shape("tail", "1", 0.0, 1.0, 0.5)] if moved else []
            lean = [("pulse", "", widths)] if moved else []  # a pulse without a tail: one number less to earn
            recovery = shape("paralysis", "1", 0.0, 1.0, 0.0, 0.8)
            spent = exposure_column(view)
            window = window_parameters(moved[0]) if floor and moved else []
            for kind, exposure, further in (
                ("dead time", "", [recovery, *widths]), ("pulse", "", [*widths, *tails]), *lean,
                *([("background", "", [*widths, *tails])] if background else []),
                *([("dead time", spent, [recovery, *widths]), ("pulse", spent, [*widths, *tails])] if spent else []),
                *([("pulse", "", [])] if moved and counts_photons(view, channel) else []),
                *([("histogram", "", [*widths, *tails, *window])] if window else []),
            ):  # fmt: skip
                pulled = moved if further else []
                blocked = [amplitude("blocked", "1", 0.0, 20.0, 0.1)] if kind == "background" else []
                column = floor if kind == "histogram" else background if blocked else ""
                behind: dict[str, Option] = (
                    {"background": column, "brightest": rounded(view.span(column)[1])} if column else {}
                )
                if kind == "histogram":
                    behind["farthest"] = rounded(view.span(f"sim_{moved[0]}")[1])
                yield Variant(
                    effect=self.id,
                    options={
                        "channel": channel,
                        "distance": pulled[0] if pulled else "",
                        "top": rounded(top_signal(view, channel)),
                        "kind": kind,
                        **({"tail": 0.0} if kind == "pulse" and pulled and not _has_tail(further) else {}),
                        **({"exposure": exposure, "brightest_rate": _top_rate(view, channel, exposure)}
                           if exposure else {}),
                        **behind,
                    },
                    parameters=(amplitude("load", "1", 0.0, 50.0, 0.2), *blocked, *further),
                    channels=_moved_by(view, channel, pulled, kind),
                    drivers=(f"sim_{channel}", *filter(None, (exposure, column))),
                )

    def apply(self, variant: Variant, values: Values, state: State, view: View) -> None:
        """Loses counts, and pulls the distance to the early photons."""
        channel, distance = str(variant.options["channel"]), str(variant.options["distance"])
        light = state[channel]
        with np.errstate(invalid="ignore", divide="ignore"):
            rate, most = light, float(variant.options["top"])
            if "exposure" in variant.options:
                rate, most = light / view.number(str(variant.options["exposure"])), _brightest(variant)
            load = np.clip(float(values["load"]) * rate / most, 0.0, 200.0)
        kept = _kept(load, values)
        if "farthest" in variant.options:
            far = float(variant.options["farthest"])
            place = np.clip(np.nan_to_num(state[distance] / far), 0.0, 3.0)
            echo = counted(light, kept, _behind(variant, view), float(variant.options["top"]), far, place, values)
            light = echo.light / kept
            state[distance] = state[distance] + echo.pull
            if f"{distance}_std" in state:
                state[f"{distance}_std"] = state[f"{distance}_std"] * echo.scatter
        elif "background" in variant.options:
            light = light * np.exp(-float(values["blocked"]) * _behind(variant, view))
        if "paralysis" in values:
            paralysis = float(values["paralysis"])
            alive = 1.0 + (1.0 - paralysis) * load
            change = np.maximum(kept * (1.0 - paralysis * load - (1.0 - paralysis) * load / alive), 0.02 * kept)
        else:
            change = np.sqrt(kept * np.exp(-np.minimum(load, 50.0)))  # a binomial count: fired or not
        set_response(state, channel, light * kept, np.nan_to_num(change, nan=1.0))
        if distance:
            lead = early(np.nan_to_num(load), float(values.get("tail", 0.0)))
            state[distance] = state[distance] - float(values["width"]) * lead

    def expression(self, variant: Variant) -> str:
        """The law."""
        channel, distance = variant.options["channel"], variant.options["distance"]
        loss = "(1 - exp(-x)) / x" if _is_pulsed(variant) else "exp(-paralysis * x) / (1 + (1 - paralysis) * x)"
        rate, most = f"{channel}", variant.options["top"]
        if "exposure" in variant.options:
            rate, most = f"{channel} / {variant.options['exposure']}", variant.options["brightest_rate"]
        text = f"{channel} *= {loss}, x = load * {rate} / {most}"
        if "farthest" in variant.options:
            behind = f"{variant.options['background']} / {variant.options['brightest']}"
            text += (
                f"; exp(-load * ambient * {behind} * {distance} / {variant.options['farthest']}) of the detectors "
                "are awake, and the floor under an echo is not the one before it"
            )
        elif "background" in variant.options:
            text += f", times exp(-blocked * {variant.options['background']} / {variant.options['brightest']})"
        tail = "tail" if _has_tail(variant.parameters) else "0"
        return f"{text}; {distance} -= width * early(x, {tail})" if distance else text

    def sentence(self, variant: Variant, values: Values, view: View) -> str:
        """Loss of counts and pull at the strongest signal."""
        channel, distance = str(variant.options["channel"]), str(variant.options["distance"])
        load = float(values["load"])
        lost = 1.0 - float(_kept(np.array([load]), values)[0])
        cause = "Several photons arrive per pulse" if _is_pulsed(variant) else "Photons arrive within the dead time"
        text = f"{cause}: {lost * 100:.1f} % of the counts are lost at the strongest {channel}"
        if not distance:
            return f"{text}."
        lead = float(early(np.array([load]), float(values.get("tail", 0.0)))[0])
        pulled = in_mm(float(values["width"]) * lead, distance)
        return f"{text}, and early photons shorten the distance by {pulled:.2f} mm there."

    def next_experiment(self, variant: Variant) -> str:
        """What tells it from analog compression."""
        return (
            "Put neutral-density filters in front of the window: with few photons per pulse counts and range come "
            "back; "
            "look at the histogram's floor before the pulse, which sinks with pile-up."
        )


def _top_rate(view: View, channel: str, exposure: str) -> float:
    """Strongest simulated signal over its exposure but for outliers."""

    def measure() -> float:
        rate = view.columns.numbers[f"sim_{channel}"] / view.columns.numbers[exposure]
        finite = rate[np.isfinite(rate)]
        return rounded(max(float(np.quantile(finite, 0.999)), 1e-300)) if finite.size else 1.0

    return per_table(view, ("top rate", channel, exposure), measure)


def _brightest(variant: Variant) -> float:
    return float(variant.options["brightest_rate"])


def _has_tail(parameters: Sequence[Parameter]) -> bool:
    return any(p.name == "tail" for p in parameters)


def _is_pulsed(variant: Variant) -> bool:
    return variant.options.get("kind") in {"pulse", "background", "histogram"}


def _kept(load: FloatArray, values: Values) -> FloatArray:
    """Share of the photons that are counted at a load."""
    if "paralysis" not in values:
        return np.asarray(-np.expm1(-load) / np.maximum(load, 1e-12) + (load <= 1e-12))
    paralysis = float(values["paralysis"])
    return np.asarray(np.exp(-np.minimum(paralysis * load, 50.0)) / (1.0 + (1.0 - paralysis) * load))


_COUNTED = ("counts", "1/s", "1")
_LOADS = np.concatenate([[0.0], np.logspace(-4.0, 2.4, 400)])
_TAILS = np.array([0.0, 0.3, 0.5, 0.65, 0.8, 0.9, 1.0])
_FINE = 0.01


def _pulse(t: FloatArray, tail: float) -> FloatArray:
    """A Gaussian plus an exponential delay, `tail` to (1 − tail) in their widths; mean 0, standard deviation 1."""
    size = float(np.hypot(1.0 - tail, tail))
    spread, delay = (1.0 - tail) / size, tail / size
    if delay == 0.0:
        return np.asarray(np.exp(-0.5 * t**2))
    late = t + delay
    if spread == 0.0:
        return np.where(late >= 0.0, np.exp(-np.maximum(late, 0.0) / delay), 0.0)
    rate = spread / delay
    return np.asarray(np.exp(0.5 * rate**2 - late / delay) * erfc((rate - late / spread) / np.sqrt(2.0)))


def _first_photon(tail: float) -> FloatArray:
    """Mean lead of the detected photon over the pulse's mean, per pulse standard deviation, at each of `_LOADS`.

    Photons of a pulse arrive as a Poisson process of `load` in all; the first within a period is timed. Its density
    is load·p(t)·exp(−load·P(t)), normalised by 1 − exp(−load).
    """
    t = np.arange(-8.0, 16.0, _FINE)
    p = _pulse(t, tail)
    p = p / p.sum()
    passed = np.cumsum(p) - 0.5 * p
    weight = p * np.exp(-_LOADS[:, None] * passed)
    return np.asarray(p @ t - (weight @ t) / weight.sum(axis=1))


_LEAD = np.stack([_first_photon(float(tail)) for tail in _TAILS])


def early(load: FloatArray, tail: float = 0.0) -> FloatArray:
    """Lead of the first photon in standard deviations of the pulse, for photons per pulse."""
    place = float(np.interp(tail, _TAILS, np.arange(len(_TAILS))))
    low = min(int(place), len(_TAILS) - 2)
    part = place - low
    return np.asarray(np.interp(load, _LOADS, (1.0 - part) * _LEAD[low] + part * _LEAD[low + 1]))


def _behind(variant: Variant, view: View) -> FloatArray:
    """The background over its brightest."""
    light = view.number(str(variant.options["background"])) / float(variant.options["brightest"])
    return np.clip(np.nan_to_num(light), 0.0, 10.0)


def _moved_by(view: View, channel: str, pulled: Sequence[str], kind: str) -> tuple[str, ...]:
    more = [f"{name}_std" for name in pulled if kind == "histogram"]
    known = {entry.name for entry in view.columns.channels}
    return tuple(dict.fromkeys((*pulled, *with_scatter(view, channel), *(name for name in more if name in known))))


_WORDS = ("ambient", "background", "sunlight")


def _floor(view: View) -> str:
    """The column that tells the histogram's floor: of a channel its simulated one; empty where none does."""
    told = [n for n in view.sim if any(word in n for word in _WORDS) and not n.endswith("_std")]
    return next((f"sim_{n}" for n in told if view.varies(f"sim_{n}")), _background(view))


def _background(view: View) -> str:
    """The varying column that tells how bright the background is; none where none does."""
    told = [n for n in view.covariates() if any(word in n for word in _WORDS)]
    return next((n for n in told if unit_of(n) in {*_COUNTED, "1", "lx", "W"} and view.span(n)[0] >= 0.0), "")
