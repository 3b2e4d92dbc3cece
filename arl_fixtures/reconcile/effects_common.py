"""What many effects share: parameter shorthands, channels and drivers by meaning, light that carries its noise along.

A change of light changes its noise. How much is read from the table itself: the simulation's own scatter against its
own signal (`sigma² = a + b·I + c·I²`), and the scatter of a distance against the relative scatter of the signal.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from arl_fixtures.reconcile.effect import Effect, Parameter, State, Values, Variant
from arl_fixtures.reconcile.pixel_calibration import is_calibrated_by_pixel
from arl_fixtures.reconcile.roles import Role, is_other_light, per_metre, suffix, unit_of
from arl_fixtures.reconcile.view import View

FloatArray = NDArray[np.float64]
Cached = TypeVar("Cached")

GROUPS: dict[str, tuple[str, ...]] = {
    "step": ("dut", "cycle", "step"),
    "frame": ("dut", "cycle", "step", "stage_angle_deg"),
}
"""Name of a grouping (an option of group-scatter variants) to the columns whose combination makes a group."""

_DARK = 1e-6
"""Share of the largest signal below which a row sees nothing that would tell of the noise."""
_SAMPLE = 20_000
_ROOM_C = 25.0
_BENCH = ("plate", "coolant", "ambient", "chamber", "oil", "bath", "room", "lab", "hall", "air", "dew", "frost")
_ELSEWHERE = (
    "cable", "fibre", "fiber", "target", "panel", "lamp", "tripod", "rail", "granite", "carriage", "motor", "bearing",
    "encoder", "gas", "water", "liquid", "soil", "ground", "road", "floor", "snow",
)
"""Parts beside the sensor: what follows their temperatures is not the sensor's."""
_BEFORE = ("window",)
"""Parts before the sensor: only what asks for them follows their temperature rather than the sensor's."""
_AGES = frozenset({"hours", "shots", "cycles"})
_CALENDAR = ("cycle", "operating_time_h", "operating_hours_h", "shots")


def amplitude(name: str, unit: str, low: float, high: float, typical: float) -> Parameter:
    """A parameter that switches its effect off at zero."""
    return Parameter(name=name, unit=unit, low=low, high=high, null=0.0, typical=typical)


def shape(name: str, unit: str, low: float, high: float, *starts: float) -> Parameter:
    """A parameter that matters only while an amplitude is not zero; the first start is its default."""
    inside = tuple(dict.fromkeys(min(max(start, low), high) for start in starts))
    return Parameter(name=name, unit=unit, low=low, high=high, starts=inside)


def period_starts(
    shortest: float, longest: float, reach: float, *, most: int, apart: float = 0.75
) -> tuple[float, ...]:
    """Periods to start a search from: neighbours differ by part of a cycle over `reach`."""
    low, high = 1.0 / longest, 1.0 / shortest
    count = int(np.clip(np.ceil((high - low) * reach / apart) + 1, 3, most))
    return tuple(float(period) for period in 1.0 / np.linspace(low, high, count))


def pure_rows(view: View) -> NDArray[np.bool_]:
    """Rows of the whole table that are not said to see more than one surface, shape (n,)."""
    table = view.columns
    if "mixed" not in table.categories:
        return np.ones(table.n, dtype=bool)
    mixed, labels = table.categories["mixed"]
    return np.asarray(mixed != (labels.index("true") if "true" in labels else -2))


def simulated_range_m(view: View) -> FloatArray:
    """True range of every row of a table that has distances, shape (n,); the simulated one where it is not given."""
    numbers, name = view.columns.numbers, distances(view)[0]
    if "true_range_m" in numbers:
        return numbers["true_range_m"]
    return np.asarray(numbers[f"sim_{name}"] / per_metre(unit_of(name)))


def per_table(view: View, key: object, make: Callable[[], Cached]) -> Cached:
    """Result of `make`, computed once for a table; `key` must name everything that it depends on."""
    memo: dict[object, Any] = view.columns.memo
    if key not in memo:
        memo[key] = make()
    found: Cached = memo[key]
    return found


def per_view(view: View, key: object, make: Callable[[], Cached]) -> Cached:
    """Result of `make`, computed once for a view's rows."""
    memo: dict[object, Any] = view.memo
    if key not in memo:
        memo[key] = make()
    found: Cached = memo[key]
    return found


# ---- channels and drivers -----------------------------------------------------------------------------------


def signals(view: View) -> tuple[str, ...]:
    """Names of the intensity channels, three at most."""
    return tuple(channel.name for channel in view.channels(Role.INTENSITY))[:3]


def lit_signals(view: View) -> tuple[str, ...]:
    """Signals that see the laser's light, three at most; all of them where their names say that none does.

    What the laser, its beam or a narrow passband about its line do, sunlight and dark frames do not show.
    """
    lit = tuple(c.name for c in view.channels(Role.INTENSITY) if not is_other_light(c.name))
    return lit[:3] or signals(view)


def distances(view: View) -> tuple[str, ...]:
    """Names of the distance channels, three at most (a dual-return sensor has two)."""
    return tuple(channel.name for channel in view.channels(Role.DISTANCE))[:3]


def with_scatter(view: View, *names: str) -> tuple[str, ...]:
    """The channels and those of their scatters that are channels themselves; unknown names are left out."""
    known = {channel.name for channel in view.columns.channels}
    wanted = [name for name in names if name in known]
    return tuple(wanted + [f"{name}_std" for name in wanted if f"{name}_std" in known])


def temperature_drivers(view: View, *first: str, limit: int = 3, never: tuple[str, ...] = ()) -> tuple[str, ...]:
    """Varying logged temperatures that may drive an effect, preferred ones first.

    A preferred one may lack its middle word (`laser_c`) or have another. Temperatures of the bench (plate, coolant,
    ambient, set-point), and of what stands before the sensor, come in only where no other is left; those of what the
    sensor stands on or looks at never do.
    """
    parts = [name.removesuffix("_temperature_c") for name in first]
    alike = [n for part in parts for n in view.temperatures() if is_of(n, part)]
    preferred = dict.fromkeys([*first, *alike])
    names = [n for n in view.temperatures(*preferred) if not (n.startswith(never or ("~",)) or is_of(n, *_ELSEWHERE))]
    near = [n for n in names if not is_of_bench(n)]
    if first:
        near = [n for n in near if n in preferred or not is_of(n, *_BEFORE)] or near
    return tuple((near or list(names))[:limit])


def is_of(column: str, *parts: str) -> bool:
    """Whether a column's name says that it is of one of these parts, first or last: another bench's words.

    >>> is_of("plate_temperature_c", "plate"), is_of("sim_temperature_plate_c", "plate"), is_of("setup_c", "set")
    (True, True, False)
    """
    return not set(parts).isdisjoint(column.split("_"))


def is_of_bench(column: str) -> bool:
    """Whether a temperature is the bench's: one physical thing for all DUTs that are measured in one cycle."""
    return is_of(column, *_BENCH) or column.removeprefix("sim_").startswith("set_")


def counts_age(column: str) -> bool:
    """Whether a column counts cycles, operating hours or shots."""
    return column in _CALENDAR or suffix(column) == "h" or not _AGES.isdisjoint(column.split("_"))


def exposure_column(view: View) -> str:
    """The varying column that tells for how long the detector gathered charge; none where none does."""
    words = ("exposure", "integration_time", "gate_width", "shutter")
    names = (n for n in view.covariates() if any(word in n for word in words))
    return next((n for n in names if unit_of(n) in {"s", "ms", "us", "µs", "ns"}), "")


def reference(view: View, column: str) -> float:
    """Value of a driver at which its effect is nil.

    25 °C where the table's temperatures hold it; the start for a column that counts age; else the median. The mean
    where the simulation was calibrated pixel by pixel on this recording: there each pixel agrees on average.

    To be kept in a variant's options: the model must predict tables whose statistics differ.
    """
    low, high = view.span(column)
    if is_calibrated_by_pixel(view.columns):
        return rounded(float(np.nanmean(view.columns.numbers[column])))
    if column == "time_s" or counts_age(column):
        return float(low)
    return _ROOM_C if unit_of(column) == "°C" and low <= _ROOM_C <= high else rounded(view.middle(column))


def rounded(value: float) -> float:
    """Six significant digits, for references that stand in options."""
    return float(f"{value:.6g}")


def span(view: View, column: str) -> float:
    """Range of a driver over the table, 1 where it does not vary."""
    low, high = view.span(column)
    return rounded(high - low) if high > low else 1.0


def above(view: View, column: str, origin: float) -> FloatArray:
    """Driver minus `origin`, zero where it was not logged."""
    return per_view(view, ("above", column, origin), lambda: np.nan_to_num(view.number(column) - origin))


def excess(view: View, variant: Variant, column: str) -> FloatArray:
    """Driver minus the reference in the variant's options, zero where it was not logged."""
    return above(view, column, float(variant.options["reference"]))


def unit_per(column: str, unit: str = "1") -> str:
    """Unit of a slope: `unit` per unit of the column, kelvin for temperatures."""
    below = unit_of(column)
    return f"{unit}/{'K' if below == '°C' else below if below != '1' else column}"


def top_signal(view: View, channel: str) -> float:
    """Strongest simulated signal of the table but for outliers: the 99.9 % quantile."""

    def measure() -> float:
        values = view.columns.numbers[f"sim_{channel}"]
        finite = values[np.isfinite(values)]
        return max(float(np.quantile(finite, 0.999)), 1e-30) if finite.size else 1.0

    return per_table(view, ("top", channel), measure)


# ---- noise that goes with the light -------------------------------------------------------------------------


def noise_law(view: View, channel: str) -> tuple[float, float, float]:
    """(a, b, c) of the simulation's one-frame variance a + b·I + c·I²; (1, 0, 0) where it is not given."""

    def fit() -> tuple[float, float, float]:
        numbers = view.columns.numbers
        if f"sim_{channel}_std" not in numbers:
            return 1.0, 0.0, 0.0
        signal, sigma = numbers[f"sim_{channel}"], numbers[f"sim_{channel}_std"]
        good = np.flatnonzero(np.isfinite(signal) & (signal >= 0.0) & np.isfinite(sigma) & (sigma > 0.0))
        good = good[:: max(1, good.size // _SAMPLE)]
        if good.size < 3:
            return 1.0, 0.0, 0.0
        scale = float(np.max(signal[good])) or 1.0  # a dark simulation's variance is all constant
        x, variance = signal[good] / scale, sigma[good] ** 2
        coefficients = nnls(np.column_stack([np.ones_like(x), x, x * x]) / variance[:, None], np.ones_like(x))[0]
        a, b, c = coefficients / np.array([1.0, scale, scale**2])
        return (float(a), float(b), float(c)) if a + b + c > 0.0 else (1.0, 0.0, 0.0)

    return per_table(view, ("noise law", channel), fit)


def _distance_noise_law(view: View, distance: str, signal: str) -> tuple[float, float]:
    """(a, b) of the simulation's one-frame variance of a distance a + b·(sigma_I / I)²."""

    def fit() -> tuple[float, float]:
        numbers = view.columns.numbers
        needed = [f"sim_{distance}_std", f"sim_{signal}_std", f"sim_{signal}"]
        if any(name not in numbers for name in needed):
            return 1.0, 0.0
        spread, sigma, light = (numbers[name] for name in needed)
        lit = light > _DARK * float(np.nanmax(light, initial=0.0))
        good = np.isfinite(spread) & (spread > 0.0) & np.isfinite(sigma) & lit
        rows = np.flatnonzero(good)[:: max(1, int(good.sum()) // _SAMPLE)]
        if rows.size < 3:
            return 1.0, 0.0
        relative, variance = (sigma[rows] / light[rows]) ** 2, spread[rows] ** 2
        a, b = nnls(np.column_stack([np.ones_like(relative), relative]) / variance[:, None], np.ones(rows.size))[0]
        return (float(a), float(b)) if a + b > 0.0 else (1.0, 0.0)

    return per_table(view, ("distance noise law", distance, signal), fit)


def variance_at(view: View, channel: str, signal: FloatArray) -> FloatArray:
    """One-frame variance that the simulation's noise law gives for a signal."""
    a, b, c = noise_law(view, channel)
    light = np.maximum(np.nan_to_num(signal), 0.0)
    return a + b * light + c * light**2


def set_light(view: View, state: State, channel: str, light: FloatArray) -> None:
    """Put a new signal into the state; its scatter and that of the distance follow the table's noise laws."""
    before = state[channel]
    state[channel] = light
    scatter = f"{channel}_std"
    if scatter not in state:
        return
    old, new = variance_at(view, channel, before), variance_at(view, channel, light)
    growth = new / np.maximum(old, 1e-300)
    state[scatter] = state[scatter] * np.sqrt(growth)
    _spread_ranges(view, state, channel, (before, old), (light, new))


def add_noise(view: View, state: State, channel: str, variance: FloatArray) -> None:
    """Add one-frame variance to a signal's scatter; that of the distance follows the table's noise laws."""
    scatter = f"{channel}_std"
    if scatter in state:
        state[scatter] = np.sqrt(state[scatter] ** 2 + variance)
    light, old = state[channel], variance_at(view, channel, state[channel])
    _spread_ranges(view, state, channel, (light, old), (light, old + variance))


def _spread_ranges(
    view: View, state: State, channel: str, was: tuple[FloatArray, FloatArray], now: tuple[FloatArray, FloatArray]
) -> None:
    """Scatter of distances when light and variance of the signal that they are timed by change."""
    if channel != view.channel(Role.INTENSITY):
        return
    for distance in distances(view):
        a, b = _distance_noise_law(view, distance, channel)
        if f"{distance}_std" not in state or b == 0.0:
            continue
        with np.errstate(divide="ignore", invalid="ignore"):
            before, after = (
                a + b * spread / np.where(light > 0.0, light, np.nan) ** 2 for light, spread in (was, now)
            )
            ratio = np.sqrt(np.clip(after / before, 1e-4, 1e4))
        state[f"{distance}_std"] = state[f"{distance}_std"] * np.where(np.isfinite(ratio), ratio, 1.0)


def set_response(state: State, channel: str, signal: FloatArray, slope: FloatArray) -> None:
    """Put a signal that electronics bent into the state; its scatter is multiplied by the local slope."""
    state[channel] = signal
    if f"{channel}_std" in state:
        state[f"{channel}_std"] = state[f"{channel}_std"] * slope


def light_channels(view: View, channel: str) -> tuple[str, ...]:
    """Channels that move with a signal: itself, its scatter, and the distance's scatter, as far as measured."""
    spreads = [f"{name}_std" for name in distances(view)] if channel == view.channel(Role.INTENSITY) else []
    known = {entry.name for entry in view.columns.channels}
    return with_scatter(view, channel) + tuple(name for name in spreads if name in known)


class LightFactor(Effect):
    """An effect that multiplies one signal, named by the option `channel`, by a factor (1 where absent)."""

    @abstractmethod
    def factor(self, variant: Variant, values: Values, view: View) -> FloatArray:
        """Factor of the light on every row, positive and finite."""

    def apply(self, variant: Variant, values: Values, state: State, view: View) -> None:
        """Multiplies the light; noise goes with it."""
        channel = str(variant.options["channel"])
        set_light(view, state, channel, state[channel] * self.factor(variant, values, view))

    def change(self, variant: Variant, values: Values, view: View) -> tuple[float, float]:
        """Lowest and highest change in percent over the middle 98 % of the rows."""
        if view.n == 0:
            return 0.0, 0.0
        low, high = np.quantile(self.factor(variant, values, view), [0.01, 0.99])
        return float(low - 1.0) * 100.0, float(high - 1.0) * 100.0


def percent(low: float, high: float) -> str:
    """Two changes in percent as words for a sentence."""
    return f"between {low:+.1f} and {high:+.1f} %"


def in_mm(length: float, channel: str) -> float:
    """A length in the unit of a distance channel, in millimetres."""
    return length / per_metre(unit_of(channel)) * 1e3
