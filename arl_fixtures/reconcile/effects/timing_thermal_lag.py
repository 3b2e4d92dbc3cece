"""The die follows the housing late: the error depends on the temperature's history."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable

import numpy as np
from scipy.optimize import minimize_scalar

from arl_fixtures.reconcile.effect import Effect, Option, Stage, State, Values, Variant
from arl_fixtures.reconcile.effects_common import (
    FloatArray,
    amplitude,
    distances,
    in_mm,
    reference,
    rounded,
    shape,
    span,
    temperature_drivers,
    unit_per,
)
from arl_fixtures.reconcile.effects_history import History, history, lagged, on_rows, time_column
from arl_fixtures.reconcile.roles import per_metre, unit_of
from arl_fixtures.reconcile.view import View

_LONGEST = 0.25
"""Share of what was recorded that a time constant may take: a later node stands still, and its lag is an offset."""


_JUMPS, _FARTHEST = (0.25, 0.75), 4.0
_AT_START, _MOVED = 0.05, 0.02
"""Share of a record that is its start, and of all temperatures by which a change there is one."""


def _outside(view: View) -> tuple[str, ...]:
    """Temperatures that a die inside may follow: the housing's, by whatever name; of names unheard of two."""
    known = ("housing_temperature_c", "plate_temperature_c")
    cases = [
        name for name in view.temperatures() if any(word in name for word in ("case", "housing", "body", "shell"))
    ]
    told = bool(cases) or any(name in view.temperatures() for name in known)
    return temperature_drivers(view, *known, *cases, limit=1 if told else 2)


class ThermalLag(Effect):
    """D += slope·(T_late − T) or slope·(T_late − reference); T_late follows T with a first-order time constant.

    The first where the simulation knows the offset but not the lag, the second where it knows neither and no chip's
    own temperature was logged: what follows that one is an offset, and only what comes later still is a lag.
    A record that begins amid a change of temperature (kind "moving") adds at_start·exp(−t / time constant): what
    the node was behind by then.
    """

    id = "timing.thermal_lag"
    stage = Stage.TIMING
    source = "lumped heat balance of a die on its housing: C dT/dt = (T_housing − T) / R"
    confusable = ("timing.temperature_offset", "laser.power_decay")

    def variants(self, view: View) -> Iterable[Variant]:
        """One per temperature that has a history, the housing's first."""
        if not time_column(view):
            return
        for distance in distances(view):
            size = per_metre(unit_of(distance))
            for column in _outside(view):
                record = history(view, column)
                if record is None:
                    continue
                wide = span(view, column)
                duration = record.interval * record.values.shape[1]
                # a quicker die cannot be told from one without lag
                shortest = max(2.0 * record.interval, min(100.0 if record.unit == "s" else 0.3, 0.05 * duration))
                chips = [name for name in ("tof_temperature_c", "fpga_temperature_c") if view.varies(name)]
                longest = max(_LONGEST * duration, 4.0 * shortest)
                kinds = ["difference", *(["moving"] if _begins_moving(view, column, record) else [])]
                for kind in kinds if chips else [*kinds, "whole"]:
                    options: dict[str, Option] = {"channel": distance, "temperature": column, "kind": kind}
                    late = unit_per(column, unit_of(distance))
                    most = 4.0 * size / wide
                    amplitudes = [amplitude("slope", late, -most, most, 1e-3 * most)]
                    if kind == "whole":
                        options["reference"] = reference(view, column)
                    if kind == "moving":
                        options["starts"] = json.dumps([rounded(float(t)) for t in record.start])
                        amplitudes.append(
                            amplitude("at_start", unit_of(distance), -4.0 * size, 4.0 * size, 4e-3 * size)
                        )
                    starts = (0.02 * duration, 0.1 * duration)
                    yield Variant(
                        effect=self.id,
                        options=options,
                        parameters=(
                            *amplitudes,
                            shape("time_constant", record.unit, shortest, longest, *starts),
                        ),
                        channels=(distance,),
                        drivers=(column, *(("ramp",) if view.varies("ramp") else ()), time_column(view)),
                    )

    def apply(self, variant: Variant, values: Values, state: State, view: View) -> None:
        """Adds the error of the late temperature."""
        distance, column = str(variant.options["channel"]), str(variant.options["temperature"])
        record = history(view, column)
        if record is None:
            return
        late = lagged(record, float(values["time_constant"]))
        if variant.options["kind"] == "whole":
            acting = on_rows(view, late) - float(variant.options["reference"])
        else:
            acting = on_rows(view, late - record.values)
        moved = float(values["slope"]) * np.nan_to_num(acting)
        if "at_start" in values:
            moved = moved + float(values["at_start"]) * on_rows(view, _fading(record, variant, values))
        state[distance] = state[distance] + moved

    def unknown_history(self, variant: Variant, values: Values, view: View) -> dict[str, float]:
        """What slope and time constant would be had the temperature changed early or late between two readings.

        The same errors of the distance then need other values; how far these lie off is what nobody knows of them.
        """
        column, kind = str(variant.options["temperature"]), variant.options["kind"]
        record = history(view, column)
        parameter = next(p for p in variant.parameters if p.name == "time_constant")
        found, slope = float(values["time_constant"]), float(values["slope"])
        if record is None or kind != "difference":
            return {}
        seen = np.nan_to_num(on_rows(view, lagged(record, found) - record.values))
        off = {"time_constant": 0.0, "slope": 0.0}
        for jump in _JUMPS:
            other = history(view, column, jump)
            if other is None:
                continue

            def acting_of(late: float, other: History = other) -> FloatArray:
                return np.nan_to_num(on_rows(view, lagged(other, late) - other.values))

            def factor_of(acting: FloatArray) -> float:
                return float(acting @ seen) / max(float(acting @ acting), 1e-300)

            def rest_of(late: float, acting_of: Callable[[float], FloatArray] = acting_of) -> float:
                acting = acting_of(late)
                return float(np.sum((seen - factor_of(acting) * acting) ** 2))

            low, high = max(found / _FARTHEST, parameter.low), min(found * _FARTHEST, parameter.high)
            best = float(minimize_scalar(rest_of, bounds=(low, high), method="bounded").x)
            off["time_constant"] = max(off["time_constant"], abs(best - found))
            off["slope"] = max(off["slope"], abs(factor_of(acting_of(best)) - 1.0) * abs(slope))
        return {name: size / np.sqrt(3.0) for name, size in off.items()}

    def says_as_well(self, variant: Variant) -> tuple[str, ...]:
        """An offset that follows a late temperature is one that follows a chip's own, which was not logged."""
        return ("timing.temperature_offset",) if variant.options["kind"] == "whole" else ()

    def expression(self, variant: Variant) -> str:
        """The law."""
        distance, column = variant.options["channel"], variant.options["temperature"]
        against = variant.options["reference"] if variant.options["kind"] == "whole" else column
        start = " + at_start * exp(-(t - start) / time_constant)" if variant.options["kind"] == "moving" else ""
        return f"{distance} += slope * (L - {against}){start}, time_constant * dL/dt = {column} - L"

    def sentence(self, variant: Variant, values: Values, view: View) -> str:
        """Slope and time constant."""
        distance, column = str(variant.options["channel"]), str(variant.options["temperature"])
        record = history(view, column)
        unit = record.unit if record is not None else "s"
        late = float(f"{values['time_constant']:.3g}")  # three digits, but 1270 and not 1.27e+03
        return (
            f"The timing follows {column} {late:g} {unit} late, with "
            f"{in_mm(float(values['slope']), distance):+.3f} mm per kelvin: heating and cooling differ."
        )

    def next_experiment(self, variant: Variant) -> str:
        """What tells lag from hysteresis and ageing."""
        return "Repeat one temperature step at half the ramp rate and with a long soak: a lag halves, then dies out."


def _begins_moving(view: View, column: str, record: History) -> bool:
    """Whether the temperature changes where a record begins: only then is something behind that nobody saw."""
    table = view.columns
    time, readings, group = table.numbers[time_column(view)], table.numbers[column], table.group("dut", "cycle")
    early = time - record.start[group] < _AT_START * record.interval * record.values.shape[1]
    early &= np.isfinite(readings)
    low, high = np.full(record.start.size, np.inf), np.full(record.start.size, -np.inf)
    np.minimum.at(low, group[early], readings[early])
    np.maximum.at(high, group[early], readings[early])
    return bool(np.any(high - low > _MOVED * float(np.ptp(readings[np.isfinite(readings)]))))


def _fading(record: History, variant: Variant, values: Values) -> FloatArray:
    """What is left of the lag at the start of each record, of 1; nothing in records that begin at other times.

    A table to be predicted may hold what came before: its own history then tells the lag.
    """
    starts = np.array(json.loads(str(variant.options["starts"])), dtype=float)
    known = np.abs(record.start[:, None] - starts[None, :]).min(axis=1) <= record.interval
    ticks = np.arange(record.values.shape[1]) * record.interval
    return np.asarray(known[:, None] * np.exp(-ticks / max(float(values["time_constant"]), 1e-9)))
