"""The point-spread function widens."""

from __future__ import annotations

import itertools
from collections.abc import Iterable

import numpy as np
from scipy.special import ive

from arl_fixtures.reconcile.effect import Effect, Option, Parameter, Stage, State, Values, Variant
from arl_fixtures.reconcile.effects_bench import bench_of, is_sharp
from arl_fixtures.reconcile.effects_beyond import blur_borders
from arl_fixtures.reconcile.effects_common import (
    FloatArray,
    above,
    amplitude,
    light_channels,
    set_light,
    shape,
    signals,
    span,
    temperature_drivers,
)
from arl_fixtures.reconcile.effects_frame import has_frames, ranged_by
from arl_fixtures.reconcile.effects_pointing import spread_rays
from arl_fixtures.reconcile.effects_pulled import pulled_channels
from arl_fixtures.reconcile.effects_rays import Pose
from arl_fixtures.reconcile.effects_render import as_simulated, convolved, rendered, see_area
from arl_fixtures.reconcile.effects_scene import pixel_width, scene, sweeps_pixels
from arl_fixtures.reconcile.effects_sides import sides_of
from arl_fixtures.reconcile.view import View


class Defocus(Effect):
    """The image is blurred by a Gaussian of `width` pixels, or of width·|T − sharpest| / range of the temperature.

    Where the scene can be rendered, two ways: the rays spread before they meet the scene, or the finished image is
    convolved. They part where pixels sample an edge by few rays. Where a sweep shows the scene finer than its pixels,
    the rays spread over that; where neither samples edges, a pixel that sees two surfaces shows by its light how much
    of either, and so what a blur changes. And where the simulation looks through a few sharp rays, as what it cannot
    show: a share of the light comes from an area `wide` pixels across.
    Light and range mix: the distance becomes the mean of what the blurred pixel sees, weighted by its light.
    """

    id = "optics.defocus"
    stage = Stage.OPTICS
    displaces = True
    source = "Born, Wolf, Principles of Optics, sec. 8.8: blur disc grows with |defocus|; Gaussian approximation"
    mixes = True
    confusable = ("detector.crosstalk", "target.edge_mixing", "optics.focal_drift", "optics.veiling_glare")

    def variants(self, view: View) -> Iterable[Variant]:
        """Constant, and with the distance of a temperature from that of best focus."""
        if not has_frames(view):
            return
        columns = temperature_drivers(view, "lens_temperature_c", "housing_temperature_c", limit=1)
        kinds: tuple[str, ...] = ("image",)
        if bench_of(view) is not None:
            kinds = ("rays", "image", "halo") if is_sharp(view) else ("rays", "image")
        elif scene(view) is not None and sweeps_pixels(view):
            kinds = ("scene", "image")
        if bench_of(view) is None and sides_of(view) is not None:
            kinds = (*kinds, "border", *(("border, ranges stay",) if pulled_channels(view) else ()))
        for channel in signals(view):
            for column, kind in itertools.product(("", *columns), kinds):
                typical = _WIDE if kind == "scene" else 0.3
                parameters: tuple[Parameter, ...] = (amplitude("width", "px", 0.0, 1.2, typical),)
                if kind == "halo":
                    parameters = (amplitude("share", "1", 0.0, 0.9, 0.05), shape("wide", "px", 1.1, 3.0, 1.5))
                scale = 1.0
                if column:
                    low, high = view.span(column)
                    scale = span(view, column)
                    parameters += (shape("sharpest", "°C", low, high, min(max(25.0, low), high), low),)
                yield Variant(
                    effect=self.id,
                    options={"channel": channel, "temperature": column, "range": scale, "kind": kind},
                    parameters=parameters,
                    channels=tuple(dict.fromkeys((
                        *(_followers(view, kind) if kind in _AT_BORDERS else ranged_by(view, channel)),
                        *light_channels(view, channel),
                    ))),
                    rough=kind in ("rays", "halo") and is_sharp(view),
                    drivers=(*((column,) if column else ()), "pixel_u", "pixel_v"),
                )

    def apply(self, variant: Variant, values: Values, state: State, view: View) -> None:
        """Blurs the rendered scene where it is known, else the pixels that the table holds."""
        channel, column = str(variant.options["channel"]), str(variant.options["temperature"])
        size = "share" if variant.options["kind"] == "halo" else "width"
        width: FloatArray = np.full(view.n, float(values[size]))
        if column:
            width = width * np.abs(above(view, column, float(values["sharpest"]))) / float(variant.options["range"])
        far = ranged_by(view, channel)
        variance = np.minimum(width, _WIDEST) ** 2
        if variant.options["kind"] == "scene":
            found = scene(view)
            spread = np.sqrt(variance)
            if found is not None:
                spread_rays(view, state, spread * pixel_width(view)[view.rows], spread * found.pitch_deg)
            return
        if variant.options["kind"] in _AT_BORDERS:
            blur_borders(view, state, channel, width, _followers(view, variant.options["kind"]))
            return
        if variant.options["kind"] == "halo":
            see_area(view, state, channel, ranged_by(view, channel), width, float(values["wide"]))
            return
        if variant.options["kind"] == "rays":
            seen = rendered(view, Pose(blur_px=np.sqrt(variance)))
        else:
            seen = convolved(view, variance)
        clear = rendered(view)
        if seen is not None and clear is not None:
            known = as_simulated(view)
            for distance in far:
                state[distance] = state[distance] + np.where(known, seen[distance] - clear[distance], 0.0)
            ratio = np.where(known, seen[channel] / clear[channel], 1.0)
            set_light(view, state, channel, state[channel] * ratio)
            return
        light, ranges = _blurred(view, state, channel, far, variance)
        for distance, mean in ranges.items():
            state[distance] = np.where(np.isfinite(mean), mean, state[distance])
        set_light(view, state, channel, light)

    def expression(self, variant: Variant) -> str:
        """The law."""
        channel, column = variant.options["channel"], variant.options["temperature"]
        grown = f" * |{column} - sharpest| / {variant.options['range']}" if column else ""
        if variant.options["kind"] == "halo":
            return f"{channel} += share{grown} * (mean over an area `wide` pixels across - {channel})"
        return f"{channel} = {channel} blurred over pixels by a Gaussian of standard deviation width{grown}"

    def sentence(self, variant: Variant, values: Values, view: View) -> str:
        """Width of the blur."""
        column = variant.options["temperature"]
        if "share" in values:
            when = f" at the ends of {column}" if column else ""
            part, wide = f"{values['share'] * 100:.2g} %", f"{values['wide']:.1f}"
            return f"The image is blurred{when}: {part} of a pixel's light comes from an area {wide} pixels across."
        if not column:
            return f"The image is blurred by {values['width']:.2f} pixels (standard deviation)."
        return (
            f"The image is sharpest at {values['sharpest']:.0f} °C of {column} and blurs by "
            f"{float(values['width']) / float(variant.options['range']) * 50.0:.3f} pixels per 50 K away from it."
        )

    def next_experiment(self, variant: Variant) -> str:
        """What tells it from crosstalk."""
        return (
            "Scan a straight edge at the coldest and the hottest step: blur of the optics grows symmetrically with "
            "the "
            "distance from best focus, electrical crosstalk does not change."
        )


def _followers(view: View, kind: Option) -> tuple[str, ...]:
    """Distances that follow the light at borders: a leading edge, say, stays with the nearer surface."""
    return pulled_channels(view) if kind == "border" else ()


_WIDE = 2.0
"""Blur whose tenth, by which a search feels its way, already reaches over edges from the rays beside them, pixels."""
_AT_BORDERS = ("border", "border, ranges stay")
_WIDEST = 1.2
_VARIANCES = np.linspace(0.0, _WIDEST**2, 500)
_KERNEL = [np.asarray(ive(n, _VARIANCES), dtype=np.float64) for n in range(3)]
_TAPS = tuple((du, dv) for du in range(-2, 3) for dv in range(-2, 3) if 0 < abs(du) + abs(dv) <= 2)


def _blurred(
    view: View, state: State, channel: str, far: tuple[str, ...], variance: FloatArray
) -> tuple[FloatArray, dict[str, FloatArray]]:
    """Blurred light, and light-weighted distances.

    The kernel is the discrete Gaussian exp(−t)·I_n(t) with t the variance in pixels squared, whose variance is exact
    at any width; its far corners (below a hundredth) stay with the pixel itself. A neighbour that the table does not
    hold counts as the pixel itself.
    """
    taps = [np.interp(variance, _VARIANCES, tap) for tap in _KERNEL]
    own = state[channel]
    light = own.copy()
    base = np.nan_to_num(own)
    moments = {distance: base * np.nan_to_num(state[distance]) for distance in far}
    totals = {distance: moment.copy() for distance, moment in moments.items()}
    for du, dv in _TAPS:
        share = taps[abs(du)] * taps[abs(dv)]
        other = view.neighbour(state, channel, du=du, dv=dv)
        there = np.isfinite(other)
        light = light + share * np.where(there, other - own, 0.0)
        for distance in far:
            range_ = view.neighbour(state, distance, du=du, dv=dv)
            seen = there & np.isfinite(range_)
            totals[distance] += share * np.where(seen, other * range_ - moments[distance], 0.0)
    ranges = {}
    for distance, total in totals.items():
        with np.errstate(invalid="ignore", divide="ignore"):
            mean = total / light
        kept = np.isfinite(state[distance]) & np.isfinite(mean) & (light > 0.0) & (variance > 0.0)
        ranges[distance] = np.where(kept, mean, state[distance])
    return light, ranges
