"""A periodic pattern along columns or rows."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from arl_fixtures.reconcile.effect import Effect, Parameter, Stage, State, Values, Variant
from arl_fixtures.reconcile.effects_common import (
    amplitude,
    distances,
    excess,
    period_starts,
    reference,
    shape,
    signals,
    span,
    temperature_drivers,
    top_signal,
)
from arl_fixtures.reconcile.roles import unit_of
from arl_fixtures.reconcile.view import View


class ColumnPattern(Effect):
    """X += cosine·cos(2πp/period) + sine·sin(2πp/period), p the column or row; period 2 is odd against even."""

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
                for column in ("", *warm):
                    yield self._variant(view, channel, axis, "parity", column)
                if span(view, axis) >= 7.0:
                    yield self._variant(view, channel, axis, "periodic", "")

    def _variant(self, view: View, channel: str, axis: str, kind: str, column: str) -> Variant:
        unit = unit_of(channel)
        size = 2.0 if unit == "mm" else 0.002
        size = 0.01 * top_signal(view, channel) if channel in signals(view) else size
        scale = span(view, column) if column else 1.0
        per = f"{unit}/K" if column else unit
        parameters: tuple[Parameter, ...] = (
            amplitude("cosine", per, -50 * size / scale, 50 * size / scale, size / scale),
        )
        if kind == "periodic":
            longest = min(span(view, axis), 64.0)
            starts = period_starts(_SHORTEST, longest, span(view, axis), most=40)
            whole = tuple(period for period in (3.0, 4.0, 5.0, 6.0, 8.0, 16.0) if period < longest)
            parameters += (
                amplitude("sine", per, -50 * size / scale, 50 * size / scale, size / scale),
                shape("period", "px", _SHORTEST, longest, *whole, *starts),
            )
        return Variant(
            effect=self.id,
            options={
                "channel": channel,
                "axis": axis,
                "kind": kind,
                "temperature": column,
                "reference": reference(view, column) if column else 0.0,
            },
            parameters=parameters,
            channels=(channel,),
            drivers=(axis, *((column,) if column else ())),
        )

    def apply(self, variant: Variant, values: Values, state: State, view: View) -> None:
        """Adds the pattern."""
        channel, column = str(variant.options["channel"]), str(variant.options["temperature"])
        place = np.nan_to_num(view.number(str(variant.options["axis"])))
        if variant.options["kind"] == "parity":
            pattern = float(values["cosine"]) * np.where(np.rint(place) % 2.0 == 0.0, 1.0, -1.0)
        else:
            phase = 2.0 * np.pi / float(values["period"]) * place
            pattern = float(values["cosine"]) * np.cos(phase) + float(values["sine"]) * np.sin(phase)
        if column:
            pattern = pattern * excess(view, variant, column)
        state[channel] = state[channel] + pattern

    def expression(self, variant: Variant) -> str:
        """The law."""
        channel, axis = variant.options["channel"], variant.options["axis"]
        column = variant.options["temperature"]
        grown = f" * ({column} - {variant.options['reference']})" if column else ""
        if variant.options["kind"] == "parity":
            return f"{channel} += cosine * (-1)^{axis}{grown}"
        return f"{channel} += cosine * cos(2 pi {axis} / period) + sine * sin(2 pi {axis} / period)"

    def sentence(self, variant: Variant, values: Values, view: View) -> str:
        """Amplitude and period."""
        channel, column = variant.options["channel"], str(variant.options["temperature"])
        size = float(np.hypot(values["cosine"], values.get("sine", 0.0)))
        along = "columns" if variant.options["axis"] == "pixel_u" else "rows"
        if variant.options["kind"] == "parity":
            when = f" per kelvin of {column}" if column else ""
            return f"Odd and even {along} differ: {channel} by ±{size:.3g}{when}."
        return (
            f"{channel} carries a pattern of ±{size:.3g} along the {along} with a period of {values['period']:.2f} "
            "pixels."
        )

    def next_experiment(self, variant: Variant) -> str:
        """What shows its origin."""
        return "Record dark frames and frames at another frame rate: a pattern from interference changes its period."


_SHORTEST = 2.1
