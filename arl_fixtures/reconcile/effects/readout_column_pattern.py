"""A periodic pattern along columns or rows."""

from __future__ import annotations

import json
from collections.abc import Iterable

import numpy as np

from arl_fixtures.reconcile.columns import FloatArray, IntArray
from arl_fixtures.reconcile.effect import Effect, Stage, State, Values, Variant
from arl_fixtures.reconcile.effects_common import (
    amplitude,
    distances,
    excess,
    per_table,
    per_view,
    period_starts,
    reference,
    set_response,
    shape,
    signals,
    span,
    temperature_drivers,
    top_signal,
    with_scatter,
)
from arl_fixtures.reconcile.roles import per_metre, unit_of
from arl_fixtures.reconcile.view import View


class ColumnPattern(Effect):
    """X += offset·w and, for signals, X *= 1 + gain·w; w a wave over columns or rows, with a cosine and a sine part.

    A wave is taken less its mean over the columns that the table holds: on a few columns strewn over the image a wave
    may be (nearly) the same on all of them, and that is no pattern but the level.
    Blocks of columns that are alike, every other one as much above as the next is below: w is nearly the sign of that
    wave, either added or multiplied. Period 2 is odd against even (one part only). Of four, six, eight or sixteen
    interleaved converters each has an offset (or gain, or both) of its own against the first: X += tap_k, or
    X *= 1 + tap_k (beside offsets gain_k), at pixels k modulo their number; their mean is nil.
    Where the table holds pixels of some of them only, the mean of these need not be, as far as their spread allows.
    """

    id = "readout.column_pattern"
    stage = Stage.READOUT
    source = "EMVA 1288 (2021), sec. 8.2: column and row non-uniformity; interleaved converters (parity)"
    confusable = ("timing.row_skew", "detector.pixel_response")

    def variants(self, view: View) -> Iterable[Variant]:
        """Odd against even (fixed, and growing with a temperature), and a free period; per channel and axis."""
        warm = temperature_drivers(view, "tof_temperature_c", "fpga_temperature_c", limit=1)
        for channel in (*signals(view)[:1], *distances(view)[:1]):
            for axis in ("pixel_u", "pixel_v"):
                if not view.varies(axis) or span(view, axis) < 3.0:
                    continue
                if len(_converters_seen(view, axis, 2)) == 2:
                    # odd and even columns that part in time with temperature are a fault of the timing
                    for column in ("", *warm) if channel in signals(view) else ("",):
                        yield self._variant(view, channel, axis, "parity", column)
                if span(view, axis) >= 7.0:
                    yield self._variant(view, channel, axis, "periodic", "")
                    if channel in signals(view) and span(view, axis) >= 2.0 * _SHORTEST_BLOCKS:
                        yield self._variant(view, channel, axis, "blocks", "")
                    for count in (n for n in _CONVERTERS if span(view, axis) >= 2 * n - 1):
                        if len(_converters_seen(view, axis, count)) < 2:
                            continue
                        for kind in ("taps", "gains", "both") if channel in signals(view) else ("taps",):
                            yield self._taps(view, channel, axis, kind, count)

    def _variant(self, view: View, channel: str, axis: str, kind: str, column: str) -> Variant:
        unit = unit_of(channel)
        size = 0.002 * per_metre(unit)
        size = 0.01 * top_signal(view, channel) if channel in signals(view) else size
        scale = span(view, column) if column else 1.0
        per = f"{unit}/K" if column else unit
        most = 50.0 * size / scale
        parts = ("cosine",) if kind == "parity" else ("cosine", "sine")
        parameters = tuple(amplitude(part, per, -most, most, 0.02 * most) for part in parts)
        if channel in signals(view):
            each = "1/K" if column else "1"
            parameters += tuple(
                amplitude(f"gain_{part}", each, -0.9 / scale, 0.9 / scale, 0.01 / scale) for part in parts
            )
        if kind in _FREE_PERIOD:
            longest, reach = min(span(view, axis), 64.0), span(view, axis)
            shortest = _SHORTEST if kind == "periodic" else _SHORTEST_BLOCKS
            known = (3.0, 4.0, 5.0, 6.0, 8.0, 16.0) if kind == "periodic" else ()
            whole = tuple(period for period in known if period < longest)
            starts = tuple(
                start
                for start in period_starts(shortest, longest, reach, most=_MOST_STARTS)
                if all(abs(1.0 / start - 1.0 / period) * reach > _SAME_START for period in whole)
            )
            parameters += (shape("period", "px", shortest, longest, *whole, *starts),)
        return Variant(
            effect=self.id,
            options={
                "channel": channel,
                "axis": axis,
                "kind": kind,
                "temperature": column,
                "reference": reference(view, column) if column else 0.0,
                "over": _columns_held(view, axis),
            },
            parameters=parameters,
            channels=with_scatter(view, channel) if channel in signals(view) else (channel,),
            drivers=(axis, *((column,) if column else ())),
        )

    def _taps(self, view: View, channel: str, axis: str, kind: str, count: int) -> Variant:
        unit = unit_of(channel)
        size = (0.01 * top_signal(view, channel)) if channel in signals(view) else (0.002 * per_metre(unit))
        added, times = (unit, size), ("1", 0.01)
        parts = {"taps": {"tap": added}, "gains": {"tap": times}, "both": {"tap": added, "gain": times}}
        return Variant(
            effect=self.id,
            options={
                "channel": channel,
                "axis": axis,
                "kind": kind,
                "converters": count,
                "seen": "all" if len(_converters_seen(view, axis, count)) == count else "some",
                "temperature": "",
                "reference": 0.0,
            },
            parameters=tuple(
                amplitude(f"{name}_{k}", of, -50.0 * typical, 50.0 * typical, typical)
                for name, (of, typical) in parts[kind].items() for k in _converters_told(view, axis, count)
            ),
            channels=(channel,) if kind == "taps" else with_scatter(view, channel),
            drivers=(axis,),
        )

    def apply(self, variant: Variant, values: Values, state: State, view: View) -> None:
        """Adds the pattern."""
        channel, column = str(variant.options["channel"]), str(variant.options["temperature"])
        axis = str(variant.options["axis"])
        place, at = per_view(view, ("places along", axis), lambda: _places(view, axis))
        if "converters" in variant.options:
            for name in _kinds_of(variant):
                taps = _taps_of(variant, values, name)
                own = taps[np.rint(place).astype(np.int64) % taps.size][at]
                if _is_gain(variant, name):
                    factor = np.maximum(1.0 + own, 0.02)
                    set_response(state, channel, state[channel] * factor, factor)
                else:
                    state[channel] = state[channel] + own
            return
        held = np.array(json.loads(str(variant.options["over"])))
        if variant.options["kind"] in _FREE_PERIOD and _looks_level(float(values["period"]), held):
            return
        grown = excess(view, variant, column) if column else 1.0
        if "gain_cosine" in values:
            gain = _pattern(variant, values, "gain_", place, held)[at] * grown
            gain = np.asarray(np.maximum(1.0 + gain, 0.02))
            set_response(state, channel, state[channel] * gain, gain)
        added = _pattern(variant, values, "", place, held)[at] * grown
        state[channel] = state[channel] + added

    def expression(self, variant: Variant) -> str:
        """The law."""
        channel, axis = variant.options["channel"], variant.options["axis"]
        column = variant.options["temperature"]
        grown = f" * ({column} - {variant.options['reference']})" if column else ""
        names = [parameter.name for parameter in variant.parameters]
        if "converters" in variant.options:
            laws = {False: f"{channel} +=", True: f"{channel} *= 1 +"}
            law = "; ".join(f"{laws[_is_gain(variant, name)]} {name}_k" for name in _kinds_of(variant))
            count = variant.options["converters"]
            of_all = "0 where there is none, less their mean"
            if not _are_all_seen(variant):
                of_all = f"of those that are seen, their mean as far as {_FREE_MEAN:g} standard errors of it"
            return f"{law}, k = {axis} modulo {count}, {of_all}"
        waves = {"cosine": f"cos(2 pi {axis} / period)", "sine": f"sin(2 pi {axis} / period)"}
        if variant.options["kind"] == "parity":
            waves = {"cosine": f"(-1)^{axis}"}
        added = " + ".join(f"{part} * {wave}" for part, wave in waves.items())
        gain = " + ".join(f"gain_{part} * {wave}" for part, wave in waves.items())
        if variant.options["kind"] == "blocks":
            sizes = ("hypot(cosine, sine)", "hypot(gain_cosine, gain_sine)")
            added, gain = (
                f"{size} * tanh({_STEEP:g} * ({wave}) / {size})"
                for size, wave in zip(sizes, (added, gain), strict=True)
            )
        if "gain_cosine" not in names:
            return f"{channel} += ({added}){grown}"
        return f"{channel} = {channel} * (1 + ({gain}){grown}) + ({added}){grown}"

    def sentence(self, variant: Variant, values: Values, view: View) -> str:
        """Amplitude and period."""
        channel, column = str(variant.options["channel"]), str(variant.options["temperature"])
        if "converters" in variant.options:
            sizes = []
            for name in _kinds_of(variant):
                seen = [float(x) for key, x in values.items() if key.startswith(f"{name}_")]
                seen += [0.0] if _are_all_seen(variant) else []
                apart = max(seen) - min(seen)
                is_gain = _is_gain(variant, name)
                sizes.append(f"{100 * apart:.3g} %" if is_gain else f"{apart:.3g} {unit_of(channel)}")
            size_of, count = " and ".join(sizes), variant.options["converters"]
            side = "Columns" if variant.options["axis"] == "pixel_u" else "Rows"
            return f"{side} read by {count} converters in turn differ: {channel} by up to {size_of}."
        scale = span(view, column) if column else 1.0
        size = float(np.hypot(values["cosine"], values.get("sine", 0.0))) * scale
        gain = float(np.hypot(values.get("gain_cosine", 0.0), values.get("gain_sine", 0.0))) * scale
        along = "columns" if variant.options["axis"] == "pixel_u" else "rows"
        what = f"±{size:.3g} {unit_of(channel)}" + (f" and ±{gain * 100:.2f} %" if gain else "")
        when = f" over the range of {column}" if column else ""
        if variant.options["kind"] == "parity":
            return f"Odd and even {along} differ: {channel} by {what}{when}."
        period = f"{values['period']:.2f} pixels"
        if variant.options["kind"] == "blocks":
            return f"{along.capitalize()} differ in blocks, every other one: {channel} by {what}, every {period}."
        return f"{channel} carries a pattern of {what} along the {along} with a period of {period}."

    def next_experiment(self, variant: Variant) -> str:
        """What shows its origin."""
        return "Record dark frames and frames at another frame rate: a pattern from interference changes its period."


_FREE_PERIOD = ("periodic", "blocks")
_STEEP = 4.0
"""How steep the borders of blocks are: to nine tenths within 0.06 of a period, or the fit would not find them."""
_SHORTEST, _SHORTEST_BLOCKS, _MOST_STARTS = 2.1, 5.0, 80
_SAME_START = 0.1  # cycles over the image: two starts closer than this are one
_MOST_HELD = 256
_OFF_GRID = 0.01
_FEWEST_SWINGS = 1.5
"""Swings over the image by which a pattern is one, and no smooth profile."""


def _pattern(variant: Variant, values: Values, prefix: str, place: FloatArray, held: FloatArray) -> FloatArray:
    """What a pattern adds (`gain_`: multiplies by, less one) at columns or rows; nil in the mean of those held."""
    parts = {part: float(values[prefix + part]) for part in ("cosine", "sine") if prefix + part in values}
    size = float(np.hypot(parts["cosine"], parts.get("sine", 0.0)))

    def at(where: FloatArray) -> FloatArray:
        waves = _waves(variant, values, where)
        wave = np.asarray(sum(amount * waves[part] for part, amount in parts.items()))
        if variant.options["kind"] != "blocks" or size == 0.0:
            return wave
        return np.asarray(size * np.tanh(_STEEP * wave / size))

    return at(place) - float(np.mean(at(held)))


def _waves(variant: Variant, values: Values, place: FloatArray) -> dict[str, FloatArray]:
    """A pattern's waves at columns (or rows)."""
    if variant.options["kind"] == "parity":
        return {"cosine": np.where(np.rint(place) % 2.0 == 0.0, 1.0, -1.0)}
    phase = 2.0 * np.pi / float(values["period"]) * place
    return {"cosine": np.cos(phase), "sine": np.sin(phase)}


def _looks_level(period: float, held: FloatArray) -> bool:
    """Whether the columns that the table holds see too little of a wave's swing, be it short: of 2.99 every third.

    Such a wave would stand for whatever changes slowly over the image.
    """
    strides = np.diff(held)
    stride = float(np.min(strides)) if strides.size else 0.0
    if stride <= 0.0 or np.any(np.abs(strides / stride - np.rint(strides / stride)) > _OFF_GRID):
        return False
    seen = abs(stride / period - np.rint(stride / period)) / stride  # cycles a column, as they show at these
    return bool(seen * float(np.ptp(held)) < _FEWEST_SWINGS)


def _columns_held(view: View, axis: str) -> str:
    """Columns (or rows) of which the whole table holds pixels, as JSON; of very many an even choice."""

    def make() -> str:
        place = view.columns.numbers[axis]
        found = np.unique(place[np.isfinite(place)])
        some = found[np.unique(np.linspace(0, found.size - 1, min(found.size, _MOST_HELD)).astype(np.int64))]
        return json.dumps([round(float(x), 3) for x in some])

    return per_table(view, ("columns held", axis), make)


_CONVERTERS = (4, 6, 8, 16)
_FREE_MEAN = 3.0
"""Standard errors of the mean of the converters that are seen, by which it may be off that of all."""


def _places(view: View, axis: str) -> tuple[FloatArray, IntArray]:
    """Different columns (or rows) of the image and which of them each row has: a pattern is worked out on these."""
    found, at = np.unique(np.nan_to_num(view.number(axis)), return_inverse=True)
    return found, at.astype(np.int64)


def _converters_seen(view: View, axis: str, count: int) -> list[int]:
    """Which of so many converters that read in turn have a pixel in the table (every second pixel: half of them)."""
    place = view.number(axis)
    return [int(k) for k in np.unique(np.rint(place[np.isfinite(place)]) % count)]


def _converters_told(view: View, axis: str, count: int) -> list[int]:
    """Which have a parameter: all but the first, which stands for the level; where not all are seen, each that is."""
    seen = _converters_seen(view, axis, count)
    return seen[1:] if len(seen) == count else seen


def _kinds_of(variant: Variant) -> tuple[str, ...]:
    """Names of what converters have of their own, gains first: what is added is added behind them."""
    return ("gain", "tap") if variant.options["kind"] == "both" else ("tap",)


def _is_gain(variant: Variant, name: str) -> bool:
    return name == "gain" or variant.options["kind"] == "gains"


def _taps_of(variant: Variant, values: Values, name: str) -> FloatArray:
    """What each converter adds; where all are seen, less the mean of all: that is the level's."""
    own = {int(key.removeprefix(f"{name}_")): float(x) for key, x in values.items() if key.startswith(f"{name}_")}
    taps = np.zeros(int(str(variant.options["converters"])))
    taps[list(own)] = list(own.values())
    if _are_all_seen(variant):
        return taps - np.mean(taps)
    # of a few drawn from a lot that sums to nothing; more than that is the level's, and no pattern
    few, mean = len(own), float(np.mean(list(own.values())))
    free = _FREE_MEAN * float(np.std(list(own.values()), ddof=1)) * np.sqrt((taps.size - few) / (few * taps.size))
    taps[list(own)] += float(np.clip(mean, -free, free)) - mean
    return taps


def _are_all_seen(variant: Variant) -> bool:
    return bool(variant.options["seen"] == "all")
