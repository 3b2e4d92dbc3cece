"""A dark signal adds counts and noise, growing with temperature."""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from arl_fixtures.reconcile.effect import Effect, Option, Parameter, Stage, State, Values, Variant
from arl_fixtures.reconcile.effects_avalanche import bias_column, breakdown, light_column, multiplication
from arl_fixtures.reconcile.effects_common import (
    FloatArray,
    above,
    add_noise,
    amplitude,
    distances,
    exposure_column,
    in_mm,
    light_channels,
    noise_law,
    rounded,
    shape,
    signals,
    temperature_drivers,
    top_signal,
)
from arl_fixtures.reconcile.effects_counting import counts_photons
from arl_fixtures.reconcile.roles import per_metre, unit_of
from arl_fixtures.reconcile.view import View

MOST_DARK = 20.0
"""Times the brightest light: behind a narrow filter a channel may hold next to no other counts than dark ones."""
CELLS = (1.05, 20.0, 1.5)
"""Fewest, most and usual cells of a counter, times the brightest light; of more it is as good as never full."""


class DarkOffset(Effect):
    """I += dark · 2^((T − T_top) / doubling), with its shot noise; T_top is the table's highest temperature.

    Without a temperature in the table the offset is constant. Where the bias of an avalanche detector is swept, also
    as what is multiplied with the light: the more, the nearer the bias V to breakdown, by (1 − V_top²/V_b²) /
    (1 − V²/V_b²), or by what the simulated signal is of the light that was logged. Where exposures or an amplifier's
    gain vary, also in proportion to them. Of what counts photons for sure also as what fires cells that light would
    have fired: I += (cells − I) · (1 − exp(−dark / cells)), for cells · (1 − exp(−light / cells)) counts of light.
    Where a distance is a mean of times, dark counts pull it by their part of all, to where their own mean lies.
    """

    id = "detector.dark_offset"
    stage = Stage.DETECTOR
    source = (
        "Sze, Ng, Physics of Semiconductor Devices (2007), sec. 2.4: generation current, doubling every 8 to 10 K"
    )
    confusable = ("optics.veiling_glare", "detector.gain_temperature", "readout.noise_excess")

    def variants(self, view: View) -> Iterable[Variant]:
        """One per intensity channel and temperature near the detector."""
        columns = temperature_drivers(
            view, "tof_temperature_c", "fpga_temperature_c", "housing_temperature_c", limit=2, never=("laser_",)
        )
        bias = bias_column(view)
        spent, amplified = exposure_column(view), _gain_column(view)
        lit = light_column(view) if bias else ""
        ways = [("", ""), *([(bias, "")] if bias else []), *([(bias, lit)] if lit else [])]
        for channel, (multiplied, light), exposure, gain, fills in itertools.product(
            signals(view), ways, ("", spent) if spent else ("",),
            ("", amplified) if amplified else ("",), (False, True),
        ):  # fmt: skip
            if fills and (multiplied or exposure or gain or not counts_photons(view, channel)):
                continue
            unit, top = unit_of(channel), top_signal(view, channel)
            for column in columns or ("",):
                parameters = [amplitude("dark", unit, 0.0, MOST_DARK * top, 0.01 * top)]
                if column:
                    parameters.append(shape("doubling", "K", 4.0, 40.0, 9.0))
                highest = _highest(view, column)
                options: dict[str, Option] = {"channel": channel, "temperature": column, "highest": highest}
                if light:
                    ratio = _own_gain(view, channel, light)
                    options |= {"bias": multiplied, "light": light, "most": rounded(float(np.nanmax(ratio)))}
                elif multiplied:
                    parameters.append(breakdown(view, multiplied))
                    options |= {"bias": multiplied, "highest_bias": view.span(multiplied)[1]}
                if exposure:
                    options |= {"exposure": exposure, "longest": rounded(view.span(exposure)[1])}
                if gain:
                    options |= {"gain": gain, "highest_gain": rounded(view.span(gain)[1])}
                if fills:
                    parameters.append(shape("cells", unit, *(rounded(times * top) for times in CELLS)))
                    options["counter"] = "fills"
                shot, seen = noise_law(view, channel)[1], light_channels(view, channel)
                if len(seen) > 1:  # only a scatter that was measured can tell
                    start = shot if shot > 0.0 else 1e-3 * top
                    parameters.append(shape("shot", f"{unit}^2/{unit}", 0.0, 20.0 * start, start))
                else:
                    options["shot"] = rounded(shot)
                yield Variant(
                    effect=self.id,
                    options=options,
                    parameters=tuple(parameters),
                    channels=seen,
                    drivers=(
                        column or exposure or f"sim_{channel}",
                        *filter(None, (multiplied, column and exposure, gain)),
                    ),
                )

    def aside(self, variant: Variant, view: View) -> Iterable[Variant]:
        """Dark counts about the pulse, which a centroid counts in: their mean and their width are not its own."""
        for name in distances(view) if "pulls" not in variant.options else ():
            metre, unit, scatter = per_metre(unit_of(name)), unit_of(name), f"{name}_std"
            behind = amplitude("behind", unit, -20.0 * metre, 20.0 * metre, 0.05 * metre)
            about = amplitude("about", f"{unit}^2", 0.0, 400.0 * metre**2, 0.01 * metre**2)
            first = sum(p.is_amplitude for p in variant.parameters)
            ways: tuple[tuple[Parameter, ...], ...] = ((behind,), (behind, about))
            for own in ways if view.has(f"sim_{scatter}") else ways[:1]:
                channels = (*variant.channels, name, *((scatter,) if about in own else ()))
                yield replace(
                    variant, options={**variant.options, "pulls": name}, channels=tuple(dict.fromkeys(channels)),
                    parameters=(*variant.parameters[:first], *own, *variant.parameters[first:]),
                )  # fmt: skip

    def apply(self, variant: Variant, values: Values, state: State, view: View) -> None:
        """Adds counts, and their shot noise to the scatter."""
        channel, column = str(variant.options["channel"]), str(variant.options["temperature"])
        added = np.full(view.n, float(values["dark"]))
        if column:
            colder = above(view, column, float(variant.options["highest"]))
            added = added * np.exp2(np.clip(colder / float(values["doubling"]), -200.0, 8.0))
        if "light" in variant.options:
            most = float(variant.options["most"])
            added = added * np.nan_to_num(_own_gain(view, channel, str(variant.options["light"]))) / most
        elif "bias" in variant.options:
            bias, at = view.number(str(variant.options["bias"])), float(values["breakdown"])
            highest = multiplication(np.full(1, float(variant.options["highest_bias"])), at, _ORDER)
            added = added * multiplication(bias, at, _ORDER) / highest
        if "exposure" in variant.options:
            added = added * view.number(str(variant.options["exposure"])) / float(variant.options["longest"])
        if "gain" in variant.options:
            added = added * view.number(str(variant.options["gain"])) / float(variant.options["highest_gain"])
        if "counter" in variant.options:
            cells = float(values["cells"])
            added = np.maximum(cells - state[channel], 0.0) * -np.expm1(-added / cells)
        shot = float(values.get("shot", variant.options.get("shot", 0.0)))
        add_noise(view, state, channel, shot * added)  # before the counts: they time nothing
        state[channel] = state[channel] + added
        if "pulls" in variant.options:
            name = str(variant.options["pulls"])
            with np.errstate(invalid="ignore", divide="ignore"):
                part = np.clip(added / state[channel], 0.0, 1.0)
                wider = float(values.get("about", 0.0)) * part / state[channel]
            state[name] = state[name] + np.nan_to_num(part) * float(values["behind"])
            if "about" in values and f"{name}_std" in state:
                state[f"{name}_std"] = np.sqrt(state[f"{name}_std"] ** 2 + np.nan_to_num(wider))

    def expression(self, variant: Variant) -> str:
        """The law."""
        channel, column = variant.options["channel"], variant.options["temperature"]
        grown = f" * 2^(({column} - {variant.options['highest']}) / doubling)" if column else ""
        for factor, most in (("exposure", "longest"), ("gain", "highest_gain")):
            if factor in variant.options:
                grown += f" * {variant.options[factor]} / {variant.options[most]}"
        law = f"{channel} += dark{grown}"
        if "light" in variant.options:
            law += f" * sim_{channel} / {variant.options['light']} / {variant.options['most']}"
        elif "bias" in variant.options:
            gain = f"1 / (1 - ({variant.options['bias']} / breakdown)^2)"
            law += f" * {gain}, over that at {variant.options['highest_bias']} V"
        elif "counter" in variant.options:
            law = f"{channel} += (cells - {channel}) * (1 - exp(-dark{grown} / cells))"
        if "pulls" in variant.options:
            law += f"; {variant.options['pulls']} += behind * (added / {channel}), its variance by about"
        return f"{law}; {channel}_std^2 += shot * added"

    def sentence(self, variant: Variant, values: Values, view: View) -> str:
        """Counts at the hottest, doubling."""
        channel, column = str(variant.options["channel"]), str(variant.options["temperature"])
        pulled = ""
        if "pulls" in variant.options:
            name = str(variant.options["pulls"])
            pulled = f" Its mean time is {in_mm(float(values['behind']), name):.3g} mm behind the pulse's in {name}."
        if not column:
            return f"A dark signal adds {values['dark']:.3g} {unit_of(channel)} everywhere.{pulled}"
        return (
            f"A dark signal adds {values['dark']:.3g} {unit_of(channel)} at {variant.options['highest']:.0f} °C of "
            f"{column}, doubling every {values['doubling']:.1f} K.{pulled}"
        )

    def next_experiment(self, variant: Variant) -> str:
        """What tells it from glare."""
        return "Cover the window and repeat the hottest step: a dark signal stays, glare and gain errors vanish."


_ORDER = 2.0
"""Of Miller's law for a dark signal, whose shape over the bias tells little beside the breakdown voltage."""


def _own_gain(view: View, channel: str, light: str) -> FloatArray:
    """The simulated signal over the logged light that makes it."""
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(view.sim[channel] / view.number(light))


def _gain_column(view: View) -> str:
    """The varying column that tells by how much an amplifier multiplies the signal; none where none does."""
    names = (n for n in view.covariates() if n.startswith("gain") or n.endswith("_gain") or "_gain_" in n)
    return next((n for n in names if unit_of(n) == "1" and view.span(n)[0] > 0.0), "")


def _highest(view: View, column: str) -> float:
    return rounded(view.span(column)[1]) if column else 0.0
