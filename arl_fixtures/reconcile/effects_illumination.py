"""Where pixels look, and the smooth profile, fitted to the simulation, with which beam and receiver light a scene."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from arl_fixtures.reconcile.effect import Option, Values
from arl_fixtures.reconcile.effects_common import per_table, per_view, pure_rows, rounded, span
from arl_fixtures.reconcile.effects_scenery import powers_of_a_line, robust, sceneries
from arl_fixtures.reconcile.roles import HALF_TURN_DEG
from arl_fixtures.reconcile.view import View

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_SAMPLE = 30_000
_DEGREE = 4
_GOOD_REST, _EXACT_REST = 0.03, 2e-3
_PLAIN = ({(4, 0), (0, 4)}, {(2, 0), (0, 2)}, {(2, 0), (0, 2), (4, 0), (0, 4)})
"""Powers of simpler profiles, which are taken where they fit exactly: few pixels do not tell of all the others."""
_STEEPEST = 8.0
"""Logarithm by which no beam falls to the edge of an image."""
_DEEPEST = 12.0
"""Logarithm by which none falls to a corner of it."""
_KNOWN_TO, _BEYOND = 1.1, 1.6
"""Times the field of view up to which a profile is known, and a simple one that fits exactly."""
_AS_GOOD = 1.1
"""Times what the best profile leaves, up to which a simpler one is taken: where the scene leaves much more than any
profile's shape, that of many powers is the scene's."""
FEWEST_PX = 7.0
"""Columns or rows of pixels that an image must span for a smooth profile over it."""
_RAYS = ("azimuth_deg", "elevation_deg")
_PIXEL = {"azimuth_deg": "pixel_u", "elevation_deg": "pixel_v"}


@dataclass(frozen=True, slots=True)
class Illumination:
    """ln of the simulated beam and receiver profile as a polynomial of scaled azimuth and elevation."""

    terms: tuple[tuple[int, int], ...]
    coefficients: FloatArray
    reach_az: float
    reach_el: float
    known_to: float = _KNOWN_TO

    def log(self, azimuth: FloatArray, elevation: FloatArray) -> FloatArray:
        """ln of the profile, held beyond `known_to` times the field of view."""
        x = np.clip(azimuth / self.reach_az, -self.known_to, self.known_to)
        y = np.clip(elevation / self.reach_el, -self.known_to, self.known_to)
        size = 1 + max(_DEGREE, *(max(term) for term in self.terms))
        grid = np.zeros((size, size))
        for (i, j), coefficient in zip(self.terms, self.coefficients, strict=True):
            grid[j, i] = coefficient
        total = np.zeros(np.broadcast(x, y).shape)
        for row in grid[::-1]:  # Horner in y of Horner in x
            part = np.full(x.shape, row[-1])
            for coefficient in row[-2::-1]:
                part *= x
                part += coefficient
            total *= y
            total += part
        return total

    def curvature(self, azimuth: FloatArray, elevation: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Second derivative of the profile over itself, along azimuth and along elevation."""
        x = np.clip(azimuth / self.reach_az, -self.known_to, self.known_to)
        y = np.clip(elevation / self.reach_el, -self.known_to, self.known_to)
        slopes, bends = np.zeros((2, *x.shape)), np.zeros((2, *x.shape))
        for (i, j), c in zip(self.terms, self.coefficients, strict=True):
            for axis, (n, own, other) in enumerate(((i, x, y**j), (j, y, x**i))):
                slopes[axis] += c * n * own ** max(n - 1, 0) * other
                bends[axis] += c * n * (n - 1) * own ** max(n - 2, 0) * other
        across, along = (
            (bend + slope**2) / reach**2
            for bend, slope, reach in zip(bends, slopes, (self.reach_az, self.reach_el), strict=True)
        )
        return across, along


def has_rays(view: View) -> bool:
    """Whether the table says where its pixels look."""
    return view.varies("azimuth_deg") or view.varies("elevation_deg")


def turns_round(view: View) -> bool:
    """Whether rays look all around, a scanner's beams, numbered as pixels or not.

    A head turns by their azimuths, and these are no angles in a field of view.
    """
    return view.varies("azimuth_deg") and float(np.subtract(*view.span("azimuth_deg")[::-1])) > HALF_TURN_DEG


def field_rays(view: View) -> tuple[str, ...]:
    """Columns of the angles under which a sensor's optics sees."""
    return tuple(n for n in _RAYS if view.varies(n) and not (n == "azimuth_deg" and turns_round(view)))


def field_cosine(view: View) -> FloatArray:
    """Cosine of the angle to the optical axis of every row under work; 1 without rays."""
    around = np.ones(view.n) if turns_round(view) else np.cos(np.radians(azimuth(view)))
    return np.asarray(around * np.cos(np.radians(elevation(view))))


def ray_column(view: View, name: str) -> FloatArray:
    """Azimuth or elevation of every row of the whole table, zeros where it has none; degrees."""
    numbers, derived = view.columns.numbers, view.columns.derived
    values = numbers.get(name, derived.get(name))
    return np.zeros(view.columns.n) if values is None else np.nan_to_num(values)


def azimuth(view: View) -> FloatArray:
    """Azimuth of every row under work, zeros where the table has none; degrees."""
    return per_view(view, "azimuth", lambda: ray_column(view, "azimuth_deg")[view.rows])


def elevation(view: View) -> FloatArray:
    """Elevation of every row under work, zeros where the table has none; degrees."""
    return per_view(view, "elevation", lambda: ray_column(view, "elevation_deg")[view.rows])


def _fall(terms: tuple[tuple[int, int], ...], coefficients: FloatArray) -> float:
    """Logarithm by which a profile of even powers differs between the axis and the edge of the image."""
    ends = [sum(c for term, c in zip(terms, coefficients, strict=True) if term[other] == 0) for other in (0, 1)]
    return float(np.max(np.abs(ends)))


def illumination(view: View, channel: str) -> Illumination | None:
    """Smooth profile of a simulated signal over azimuth and elevation (degrees); None without rays."""
    if not has_rays(view):
        return None
    return _profile(view, channel, (Across(column="azimuth_deg"), Across(column="elevation_deg")))


def _profile(view: View, channel: str, axes: tuple[Across, Across]) -> Illumination | None:
    """Smooth profile of a simulated signal over two coordinates of the field of view.

    First with the textbook law for the scene (reflectance · cos(incidence) / range²); where that does not fit, with
    free exponents and a level for every surface, so that another simulator is taken apart as well.
    """

    def make() -> Illumination | None:
        table = view.columns
        signal = table.numbers[f"sim_{channel}"]
        usable = np.isfinite(signal) & pure_rows(view)
        if table.found_on is not None:
            usable &= table.found_on
        if not usable.any():
            return None
        usable &= signal > 0.02 * np.quantile(signal[usable], 0.99)
        rows = np.flatnonzero(usable)
        rows = rows[:: max(1, rows.size // _SAMPLE)]
        if rows.size < 30:
            return None
        az, el = (axis.of(view) for axis in axes)
        reach_az, reach_el = max(float(np.abs(az).max()), 1e-6), max(float(np.abs(el).max()), 1e-6)
        every = tuple((i, j) for i in range(_DEGREE + 1) for j in range(_DEGREE + 1 - i) if i + j > 0)
        x, y = az[rows] / reach_az, el[rows] / reach_el
        target = np.log(signal[rows])
        powers = np.column_stack([np.ones(rows.size), *(x**i * y**j for i, j in every)])
        for known, scenery in sceneries(view, rows, powers):
            tried: list[tuple[float, FloatArray, tuple[tuple[int, int], ...]]] = []
            for plain in (*_PLAIN, *powers_of_a_line(x, y), set(every)):
                terms = tuple(sorted(plain))
                basis = [np.ones(rows.size), *(x**i * y**j for i, j in terms)]
                solution, rest = robust(np.column_stack([*basis, *scenery]), target - known)
                if set(terms) in _PLAIN and _fall(terms, solution[1 : len(terms) + 1]) > _STEEPEST:
                    continue  # two angles that the scene's own laws go along with
                tried.append((rest, solution, terms))
                if rest < _EXACT_REST:
                    break
            else:
                least = min(rest for rest, _, _ in tried)
                rest, solution, terms = next(t for t in tried if t[0] <= _AS_GOOD * least)
            if rest < _GOOD_REST:
                break
        known_to = _BEYOND if rest < _EXACT_REST and set(terms) in _PLAIN else _KNOWN_TO
        found = Illumination(terms, solution[1 : len(terms) + 1], reach_az, reach_el, known_to)
        return found if np.abs(found.log(az, el)).max() < _DEEPEST else None  # what few rows left free

    return per_table(view, ("illumination", channel, axes), make)


def log_profile(view: View, channel: str) -> FloatArray:
    """ln of the fitted illumination along every row's own ray, zeros without rays."""

    def make() -> FloatArray:
        profile = illumination(view, channel)
        return np.zeros(view.n) if profile is None else profile.log(azimuth(view), elevation(view))

    return per_view(view, ("log profile", channel), make)


@dataclass(frozen=True, slots=True, kw_only=True)
class Across:
    """One coordinate of the field of view: a ray's angle, or a pixel's place.

    Attributes:
        column: `azimuth_deg`, `elevation_deg`, `pixel_u` or `pixel_v`; zero where the table has it not.
        middle: where the coordinate is zero, in the column's unit.
        half: what makes one of it: 1 for rays, which stay in degrees; half the image's width for pixels.
    """

    column: str
    middle: float = 0.0
    half: float = 1.0

    @property
    def is_pixel(self) -> bool:
        """Whether it stands for a ray that the table does not give."""
        return self.column in _PIXEL.values()

    @property
    def short(self) -> str:
        """What parameters along it end in."""
        return {"azimuth_deg": "az", "elevation_deg": "el"}.get(self.column, self.column[-1])

    def of(self, view: View) -> FloatArray:
        """The coordinate of every row of the whole table; zero where it was not recorded."""
        if not self.is_pixel:
            return ray_column(view, self.column)
        return np.nan_to_num((view.columns.numbers[self.column] - self.middle) / self.half)

    def on_rows(self, view: View) -> FloatArray:
        """The coordinate of the rows under work."""
        return per_view(view, ("across", self), lambda: self.of(view)[view.rows])


class Field:
    """Where a beam's profile lies: over azimuth and elevation, or over the image where rays are not given.

    The axes stand in a variant's options (`middle_u`, `half_v` …), as rows to predict may be a part of the image.

    Args:
        options: of a variant, or of `field_options`.
    """

    def __init__(self, options: Mapping[str, Option]) -> None:
        across, along = (
            Across(
                column=pixel, middle=float(options[f"middle_{pixel[-1]}"]), half=float(options[f"half_{pixel[-1]}"])
            )
            if f"half_{pixel[-1]}" in options
            else Across(column=ray)
            for ray, pixel in _PIXEL.items()
        )
        self.axes = across, along

    def varying(self, view: View) -> tuple[Across, ...]:
        """The axes that vary in the table."""
        return tuple(axis for axis in self.axes if view.varies(axis.column))

    def along(self, values: Values, name: str) -> tuple[float, float]:
        """The parameters `name`_az and `name`_el of values, or `name`_u and `name`_v; zero where there are none."""
        first, second = (float(values.get(f"{name}_{axis.short}", 0.0)) for axis in self.axes)
        return first, second

    def profile(self, view: View, channel: str) -> Illumination | None:
        """Smooth profile of a simulated signal over the axes; None where none of them varies."""
        return _profile(view, channel, self.axes) if self.varying(view) else None

    def places(self, view: View) -> tuple[FloatArray, FloatArray]:
        """Both coordinates of the rows under work."""
        across, along = (axis.on_rows(view) for axis in self.axes)
        return across, along

    def log_profile(self, view: View, channel: str) -> FloatArray:
        """ln of the fitted profile at the rows under work, zeros without one."""

        def make() -> FloatArray:
            profile = self.profile(view, channel)
            return np.zeros(view.n) if profile is None else profile.log(*self.places(view))

        return per_view(view, ("log profile", channel, self.axes), make)

    def curvature(self, view: View, channel: str) -> tuple[FloatArray, FloatArray]:
        """Second derivative of the fitted profile over itself at the rows under work, along both axes."""

        def make() -> tuple[FloatArray, FloatArray]:
            profile = self.profile(view, channel)
            none = np.zeros(view.n)
            return (none, none) if profile is None else profile.curvature(*self.places(view))

        return per_view(view, ("profile curvature", channel, self.axes), make)


def field_options(view: View) -> dict[str, Option]:
    """Options of a `Field`: which axes are the image's, as the table gives no ray along them."""
    options: dict[str, Option] = {}
    for ray, pixel in _PIXEL.items():
        if not view.varies(ray) and view.varies(pixel) and span(view, pixel) >= FEWEST_PX:
            low, high = view.span(pixel)
            options |= {f"middle_{pixel[-1]}": rounded(0.5 * (low + high)), f"half_{pixel[-1]}": 0.5 * (high - low)}
    return options
