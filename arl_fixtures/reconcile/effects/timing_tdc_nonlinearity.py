"""A time-to-digital converter's error, periodic in distance."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from arl_fixtures.reconcile.columns import IntArray
from arl_fixtures.reconcile.effect import Effect, Parameter, Stage, State, Values, Variant
from arl_fixtures.reconcile.effects_common import (
    FloatArray,
    amplitude,
    distances,
    in_mm,
    light_channels,
    per_table,
    period_starts,
    rounded,
    set_light,
    shape,
)
from arl_fixtures.reconcile.effects_phase import ComplexArray, Phase, waves_turned
from arl_fixtures.reconcile.roles import LIGHT_SPEED_M_S, Role, per_metre, unit_of
from arl_fixtures.reconcile.view import View

USUAL_M, LONGEST_M = 4.0, 20.0
"""Periods, as distances: of clocks from some 40 MHz; of slower ones from 7.5 MHz, where two and a half are swept."""
FASTEST_M, MOST_PERIODS = 0.15, 120
"""Period of a clock of 1 GHz, down to which a long sweep is searched where its distances lie close enough."""
ALIASED, PLACE, OFF_GRID, MOST_STRIDES = 2.05, 0.004, 0.05, 200
"""Strides of an even grid of distances to the shortest period that these tell apart; share of their spread by which
rows of one place differ at most; share of a stride by which places may miss the grid; strides of one at most."""
DISTINCT = 4
"""Distances for each parameter: as many waves as there are targets draw anything."""
_HERTZ = {"Hz": 1.0, "kHz": 1e3, "MHz": 1e6}
SHORTEST_M = 0.2
"""Period of the error of a phase meter, a quarter of its ambiguity range, whose light is modulated at 190 MHz."""
_QUARTERS = 4.0
"""Periods of the third and fifth harmonic's error in the ambiguity range."""
_STEEPEST = 5.0
"""Of the ratio of both harmonics' sum to their difference: the third is by far the larger one."""
_LIGHT = tuple(shape(name, "1", -_STEEPEST, _STEEPEST, 0.0) for name in ("ratio", "skew"))
_PARTS = (1, 2, 4, 8)
"""Of a phase meter's ambiguity range, in which waves come again: cross-talk, channels of unlike gain, samples taken
at four phases of a wave that has a third harmonic, and the next."""
PHASES, FEWEST_MET, AGAIN = 12, 0.05, 0.4
"""Parts of a period; share of an even part's distances from which one is seen in a turn; share of the parts that are
seen which must be so in several turns."""
GRAINS = 20_000
HARMONICS = 3
"""Waves in a period by which cells of unequal length are told: their error, a sum of many, has little above."""


class TdcNonlinearity(Effect):
    """D += a·sin(2πD/period) + b·cos(2πD/period): the interpolator's cells are not equally long.

    * wave: one wave in a period, as of a delay line that is bent.
    * cells: the same with its second and third harmonic, as of cells whose lengths are random.
    * light: one wave in a period, and a signal that waves with it. Harmonics of a phase meter's wave turn against the
      wave itself, forwards and backwards: c₃ and c₅ at a quarter of the ambiguity range A give an error of phase of
      (c₅ − c₃)·sin and of the amplitude of (c₃ + c₅)·cos, so that I *= 1 + ratio·2π/A·(a·cos(2πD/period)
      − b·sin(2πD/period)), A = 4·period, and `skew` times the error itself where harmonics have phases of their own.
    * cyclic (where a modulation frequency f varies): one wave in a period of phase, a part of half the wavelength of
      the modulation. Both the period and the waves' height go with 1 / f and are given for the fastest.

    A cell has a length: later is never read as nearer, so that 2πa/period stays below 1.
    """

    id = "timing.tdc_nonlinearity"
    stage = Stage.TIMING
    source = (
        "Fishburn et al., IEEE Trans. Nucl. Sci. 60 (2013) 2203: FPGA TDC, 10 ps cells, integral nonlinearity 3.9 "
        "cells; Rüeger, Electronic Distance Measurement (4th ed. 1996), section 8.3: cyclic error of phase meters"
    )
    confusable = ("stage.periodic_error", "timing.clock_scale", "stage.eccentricity")

    def variants(self, view: View) -> Iterable[Variant]:
        """One per distance channel; periods from where the table's distances resolve them to twice their range."""
        for distance in distances(view):
            spread, reach = _spread(view, distance)
            if not spread > 0.0:
                continue
            yield from _cyclic(view, distance)
            size, distinct = per_metre(unit_of(distance)), _distinct(view, distance, spread)
            longest = max(min(0.7 * spread, USUAL_M * size), min(0.4 * spread, LONGEST_M * size))
            shortest = max(spread / 30.0, 0.01 * size)
            shortest = min(shortest, max(FASTEST_M * size, spread / MOST_PERIODS, 2.0 * spread / max(distinct, 1)))
            # on an even grid a period of less than two strides is one of more
            least = max(0.5 * shortest, ALIASED * _stride(view, distance, spread))
            shortest = max(shortest, least)
            if longest <= 1.05 * shortest:
                continue
            starts = period_starts(shortest, longest, spread, most=MOST_PERIODS)
            for harmonics in (1, HARMONICS):
                if distinct < DISTINCT * (2 * harmonics + 1):
                    continue
                most = 1.15 * longest if harmonics == 1 else 0.5 * spread  # a shape is one when it comes again
                told = [start for start in starts if start < most]
                if harmonics > 1:
                    told = [start for start in told if _comes_again(view, distance, start)]
                if not told:
                    continue
                period = shape("period", unit_of(distance), least, most, *told)
                plain = Variant(
                    effect=self.id,
                    options={"channel": distance, **({"harmonics": harmonics} if harmonics > 1 else {})},
                    parameters=(*_waves(distance, reach, harmonics), period),
                    channels=(distance,),
                    drivers=(f"sim_{distance}",),
                )
                yield plain
                signal, waves = view.channel(Role.INTENSITY), [start for start in told if start > SHORTEST_M * size]
                if harmonics == 1 and signal and waves and distinct > DISTINCT * 5:
                    period = shape("period", unit_of(distance), max(least, SHORTEST_M * size), most, *waves)
                    yield replace(
                        plain,
                        options={"channel": distance, "light": signal},
                        parameters=(*_waves(distance, reach, 1), period, *_LIGHT),
                        channels=(distance, *light_channels(view, signal)),
                    )

    def apply(self, variant: Variant, values: Values, state: State, view: View) -> None:
        """Adds the error at the distance that came so far."""
        distance = str(variant.options["channel"])
        slower = _slower(variant, view)
        phase = 2.0 * np.pi / values["period"] * state[distance] / slower
        if "light" in variant.options:
            _turn_waves(variant, values, state, view)
            return
        state[distance] = state[distance] + np.nan_to_num(_error(phase, values) * slower)

    def expression(self, variant: Variant) -> str:
        """The law."""
        distance, modulation = variant.options["channel"], variant.options.get("modulation")
        at = f"{distance} / slower" if modulation else str(distance)
        terms = []
        for order in range(1, int(variant.options.get("harmonics", 1)) + 1):
            sine, cosine = _names(order)
            turn = f"2 pi {f'{order} ' if order > 1 else ''}{at} / period"
            terms += [f"{sine} * sin({turn})", f"{cosine} * cos({turn})"]
        error = " + ".join(terms)
        light = variant.options.get("light")
        if light:
            turn = f"2 pi {distance} / period"
            across = f"(sine * cos({turn}) - cosine * sin({turn}))"
            also = f"{light} *= 1 + pi / (2 period) * (ratio * {across} + skew * error)"
            return f"{distance} += error, error = {error}; {also}"
        if modulation:
            return f"{distance} += slower * ({error}), slower = {variant.options['fastest']} / {modulation}"
        return f"{distance} += {error}"

    def sentence(self, variant: Variant, values: Values, view: View) -> str:
        """Amplitude and period."""
        distance = str(variant.options["channel"])
        size = in_mm(float(np.ptp(_error(np.linspace(0.0, 2.0 * np.pi, 200), values))) / 2.0, distance)
        period = f"{in_mm(values['period'], distance):.1f} mm"
        if _is_cyclic(variant):
            period += f" at {variant.options['modulation']} = {variant.options['fastest']}, both as 1 / modulation"
        swings = f"The distance swings by ±{size:.2f} mm with a period of {period}"
        if "light" not in variant.options:
            return f"{swings}."
        share = 0.5 * np.pi / float(values["period"]) * float(np.hypot(values["sine"], values["cosine"]))
        part = 100.0 * share * float(np.hypot(values["ratio"], values["skew"]))
        return f"{swings}, and the signal by ±{part:.2g} % with it."

    def next_experiment(self, variant: Variant) -> str:
        """What shows the period."""
        return (
            "Move a flat target through two periods in steps of a tenth of one, at constant temperature and signal."
        )


def _cyclic(view: View, distance: str) -> Iterable[Variant]:
    """What a phase meter's waves do whose modulation varies: a whole, a half, a quarter of its ambiguity range."""
    spread, reach = _spread(view, distance)
    size, distinct = per_metre(unit_of(distance)), _distinct(view, distance, spread)
    for column in [n for n in view.covariates() if "modulation" in n and unit_of(n) in _HERTZ][:1]:
        low, fastest = view.span(column)
        whole = LIGHT_SPEED_M_S / (2.0 * fastest * _HERTZ[unit_of(column)]) * size if low > 0.0 else np.inf
        told = [whole / part for part in _PARTS if whole / part < 0.7 * spread]
        if not told or distinct < DISTINCT * 3:
            continue
        period = shape("period", unit_of(distance), 0.9 * told[-1], 1.1 * told[0], *told)
        yield Variant(
            effect=TdcNonlinearity.id,
            options={"channel": distance, "modulation": column, "fastest": rounded(fastest)},
            parameters=(*_waves(distance, reach, 1), period),
            channels=(distance,),
            drivers=(f"sim_{distance}", column),
        )


def _turn_waves(variant: Variant, values: Values, state: State, view: View) -> None:
    """Turn the wave that a phase meter reads as its harmonics do."""
    distance, channel = str(variant.options["channel"]), str(variant.options["light"])
    turn, ratio, skew = 2.0 * np.pi / float(values["period"]), float(values["ratio"]), float(values["skew"])

    def turned(at: FloatArray) -> ComplexArray:
        along, across = (_error(turn * at + ahead, values) for ahead in (0.0, 0.5 * np.pi))
        return np.asarray(1.0 + turn / _QUARTERS * (ratio * across + skew * along + 1j * along), dtype=np.complex128)

    change = waves_turned(view, state, Phase(distance, channel, turn / _QUARTERS), turned)
    state[distance] = state[distance] + np.nan_to_num(np.angle(change) * _QUARTERS / turn)
    light = np.abs(change)
    set_light(view, state, channel, state[channel] * np.where(np.isfinite(light), np.maximum(light, 0.01), 1.0))


def _is_cyclic(variant: Variant) -> bool:
    return "modulation" in variant.options


def _slower(variant: Variant, view: View) -> FloatArray | float:
    """How many times slower than the fastest each row's modulation is; NaN where no reading says it."""
    if not _is_cyclic(variant):
        return 1.0
    frequency = view.number(str(variant.options["modulation"]))
    return float(variant.options["fastest"]) / np.where(frequency > 0.0, frequency, np.nan)


def _waves(distance: str, reach: float, harmonics: int) -> list[Parameter]:
    """Amplitudes of so many waves; `reach` is the largest distance."""
    unit, typical = unit_of(distance), 0.002 * per_metre(unit_of(distance))
    names = [name for order in range(1, harmonics + 1) for name in _names(order)]
    return [amplitude(name, unit, -0.1 * reach, 0.1 * reach, typical) for name in names]


def _distinct(view: View, distance: str, spread: float) -> int:
    """Different simulated distances of the table, to a thousandth of their spread."""
    values = view.columns.numbers[f"sim_{distance}"]
    return len(np.unique(np.round(values[np.isfinite(values)] / spread, 3)))


def _stride(view: View, distance: str, spread: float) -> float:
    """Stride of an even grid on which all simulated distances lie (a target on a rail); 0 where they lie anywhere."""
    levels, rows = _levels(view, distance)
    place = np.cumsum(np.diff(levels, prepend=levels[0]) > PLACE * spread)
    middle = np.bincount(place, levels * rows) / np.bincount(place, rows)
    steps = np.diff(middle)
    if not steps.size:
        return 0.0
    stride = float(steps.min())
    if float(steps.sum()) > MOST_STRIDES * stride:
        return 0.0
    for _ in range(2):  # the shortest step, and what all of them make of it
        number = np.rint((middle - middle[0]) / stride)
        stride = float(number @ (middle - middle[0]) / (number @ number))
    off = np.abs(levels - middle[0] - number[place] * stride)
    return stride if float(off.max()) < OFF_GRID * stride else 0.0


def _comes_again(view: View, distance: str, period: float) -> bool:
    """Whether enough of the distances lie where others lie whole periods away: else any curve is such a shape."""
    levels, rows = _levels(view, distance)
    part = np.floor(PHASES * levels / period).astype(np.int64)
    turn = part // PHASES - int(part.min()) // PHASES
    met = np.bincount(PHASES * turn + part % PHASES, rows, minlength=PHASES * (int(turn.max()) + 1))
    visits = np.sum(met.reshape(-1, PHASES) > FEWEST_MET * rows.sum() / PHASES, axis=0)
    return int(np.sum(visits > 1)) >= AGAIN * max(int(np.sum(visits > 0)), 1)


def _levels(view: View, distance: str) -> tuple[FloatArray, IntArray]:
    """Different simulated distances of the table, to a twenty-thousandth of their spread, and the rows of each."""

    def count() -> tuple[FloatArray, IntArray]:
        values = view.columns.numbers[f"sim_{distance}"]
        grain = _spread(view, distance)[0] / GRAINS
        levels, rows = np.unique(np.round(values[np.isfinite(values)] / grain), return_counts=True)
        return levels * grain, rows

    return per_table(view, ("levels", distance), count)


def _names(order: int) -> tuple[str, str]:
    """Names of the two amplitudes of a harmonic."""
    return ("sine", "cosine") if order == 1 else (f"sine_{order}", f"cosine_{order}")


def _error(phase: FloatArray, values: Values) -> FloatArray:
    """Error at a phase, with as many harmonics as there are values of; no larger than cells of no length make it."""
    total: FloatArray = np.zeros(np.shape(phase))
    steepest = 0.0
    for order in range(1, HARMONICS + 1):
        sine, cosine = _names(order)
        if sine in values:
            total = total + values[sine] * np.sin(order * phase) + values[cosine] * np.cos(order * phase)
            steepest += order * float(np.hypot(values[sine], values[cosine]))
    return total / max(2.0 * np.pi * steepest / float(values["period"]), 1.0)


def _spread(view: View, distance: str) -> tuple[float, float]:
    """Range of the middle 99 % of the simulated distances, and the largest of them."""

    def measure() -> FloatArray:
        values = view.columns.numbers[f"sim_{distance}"]
        finite = values[np.isfinite(values)]
        return np.quantile(finite, [0.005, 0.995]) if finite.size else np.zeros(2)

    low, high = per_table(view, ("spread", distance), measure)
    return float(high - low), float(abs(high))
