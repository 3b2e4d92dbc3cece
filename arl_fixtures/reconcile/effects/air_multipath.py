"""Light that bounced twice lengthens the path."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from arl_fixtures.reconcile.effect import Effect, Option, Parameter, Stage, State, Values, Variant
from arl_fixtures.reconcile.effects_bounce import bounced
from arl_fixtures.reconcile.effects_common import (
    FloatArray,
    amplitude,
    distances,
    light_channels,
    per_table,
    rounded,
    set_light,
    shape,
)
from arl_fixtures.reconcile.effects_frame import add_stray_light, has_frames
from arl_fixtures.reconcile.effects_illumination import ray_column
from arl_fixtures.reconcile.effects_scene import scene
from arl_fixtures.reconcile.roles import Role, unit_of
from arl_fixtures.reconcile.view import IntArray, View

_REACH_PX = (2, 5, 9)
_PATCH_DEG = 1.0
_SAME_SURFACE, _WIDEST_GAP, _LEAST_RISE_DEG = 0.05, 4, 3.0
"""Relative step of the distance from one degree to the next up to which it is one surface, degrees that may lie
between its strips, and the least elevation that its light is taken to reach."""
_AXES = ("pixel_u", "pixel_v")


class Multipath(Effect):
    """Light that did not come straight back, by where it came from.

    * room: the target is lit by the surfaces round about too, I *= 1 + k, D += k / (1 + k)·detour; k and the detour
      at each bearing follow from the simulated scene (every surface lights every other by its brightness, both facing
      angles and the square of their distance).
    * image, near: stray light of the image, or of the columns within nine pixels, arrives over a longer way:
      I += share·S, D += detour·share·S / (I + share·S): weak pixels beside bright ones lengthen most.
    * side: a surface beside the beam (floor, housing), at `height`: detour (sqrt(R² + 4·height²) − R) / 2 with a
      share k that falls off along the longer way. Needs no image. A signal that gathers all light (`lit`) grows by k.
      Of an image k is larger towards the surface: k·(1 + across·x + along·y + sides·x²), x and y from −1 to 1 over
      columns and rows (`sides`: one surface on the left and one on the right).
    """

    id = "air.multipath"
    stage = Stage.AIR
    source = (
        "Naik, Kadambi, Rhemann, Izadi, Raskar, Kang, CVPR 2015: light transport model of multi-path interference"
    )
    confusable = ("optics.veiling_glare", "timing.range_walk", "optics.ghost")

    def variants(self, view: View) -> Iterable[Variant]:
        """Room and stray light for an imaging sensor, a surface beside the beam for any."""
        channel, far = view.channel(Role.INTENSITY), distances(view)
        if not far:
            return
        unit = unit_of(far[0])
        size = 1e3 if unit == "mm" else 1.0
        share = amplitude("share", "1", 0.0, 0.5, 0.01)
        lit = light_channels(view, channel) if channel else ()
        everything = tuple(dict.fromkeys((*far, *lit)))
        if channel and room(view) is not None:
            drivers = [name for name in ("stage_angle_deg", "azimuth_deg") if view.varies(name)]
            yield self._variant("room", (share,), everything, (*drivers, f"sim_{far[0]}"))
        if channel and has_frames(view):
            detour = shape("detour", unit, 0.15 * size, 5.0 * size, 0.4 * size)
            for source in ("image", "near") if view.varies("pixel_u") else ("image",):
                drivers = [name for name in ("azimuth_deg", "pixel_u") if view.varies(name)]
                yield self._variant(source, (share, detour), everything, (f"sim_{channel}", *drivers[:1]))
        low, high = view.span(f"sim_{far[0]}")
        if 0.0 < low < 0.8 * high:
            height = shape("height", unit, 0.02 * high, 0.35 * high, 0.05 * high, 0.15 * high)
            driver = "true_range_m" if view.varies("true_range_m") else f"sim_{far[0]}"
            yield self._variant("side", (share, height), far, (driver,))
            if channel:
                yield self._variant("side", (share, height), everything, (driver,), lit=True)
                if has_frames(view) and all(map(view.varies, _AXES)):
                    leans = (
                        shape("across", "1", -1.0, 1.0, 0.0, 0.8, -0.8),
                        shape("along", "1", -1.0, 1.0, 0.0),
                        shape("sides", "1", -0.9, 5.0, 0.0, 2.0),
                    )
                    spans = {
                        f"{part}_{axis}": rounded(value) for axis in _AXES
                        for part, value in zip(("first", "last"), view.span(axis), strict=True)
                    }  # fmt: skip
                    yield self._variant(
                        "side", (share, height, *leans), everything, (driver, *_AXES), lit=True, **spans
                    )

    def _variant(
        self,
        source: str,
        parameters: tuple[Parameter, ...],
        channels: tuple[str, ...],
        drivers: tuple[str, ...],
        **further: Option,
    ) -> Variant:
        return Variant(
            effect=self.id,
            options={"source": source, **further},
            parameters=parameters,
            channels=channels,
            drivers=drivers,
        )

    def apply(self, variant: Variant, values: Values, state: State, view: View) -> None:
        """Adds the detoured light."""
        channel, share = view.channel(Role.INTENSITY), float(values["share"])
        source = variant.options["source"]
        if source == "side":
            near = distances(view)[0]
            lean = _lean(variant, values, view)
            if variant.options.get("lit"):
                part = lean * _beside_the_beam(share, state[near], values)[0]
                set_light(view, state, channel, state[channel] * (1.0 + np.nan_to_num(part)))
            for name in distances(view):
                part, longer = _beside_the_beam(share, state[name], values)
                part = part * lean
                moved = 0.5 * part / (1.0 + part) * (longer - state[name])
                state[name] = state[name] + np.where(np.isfinite(moved), moved, 0.0)
            return
        if source == "room":
            lit = room(view)
            if lit is None:
                return
            part = share * lit[0][view.rows]
            for name in distances(view):
                state[name] = state[name] + part / (1.0 + part) * lit[1][view.rows]
            set_light(view, state, channel, state[channel] * (1.0 + part))
            return
        add_stray_light(
            view,
            state,
            channel,
            stray=share * (view.frame_mean(state, channel) if source == "image" else _beside(view, state, channel)),
            far={name: state[name] + float(values["detour"]) for name in distances(view)},
            pull=1.0,
            kept=1.0,
        )

    def expression(self, variant: Variant) -> str:
        """The law."""
        source = variant.options["source"]
        if source == "side":
            law = "distance += k / (1 + k) * (L - distance) / 2, L = sqrt(distance^2 + 4 height^2), k = share * "
            lean = ""
            if "first_pixel_u" in variant.options:
                x, y = (_relative_text(variant, axis) for axis in _AXES)
                lean = f" * max(1 + across * x + along * y + sides * x^2, 0), x = {x}, y = {y}"
            return f"{law}(distance / L)^2{lean}" + ("; signal *= 1 + k" if variant.options.get("lit") else "")
        if source == "room":
            return (
                "signal *= 1 + k; distance += k / (1 + k) * detour; k = share * (light from the other surfaces), "
                "mean 1"
            )
        around = "of the image" if source == "image" else "of the columns beside"
        return f"signal += share * S; distance += detour * share * S / (signal + share * S), S = mean signal {around}"

    def sentence(self, variant: Variant, values: Values, view: View) -> str:
        """Share and detour."""
        share, unit = f"{values['share'] * 100:.2f} %", unit_of(distances(view)[0])
        source = variant.options["source"]
        if source == "room":
            return (
                f"Targets are lit by the surfaces round about too: on average {share} of their light took that "
                "detour."
            )
        if source == "side":
            return f"{share} of the light returns over a surface {values['height']:.2f} {unit} beside the beam."
        return (
            f"{share} of the surroundings' light arrives over a detour of {values['detour']:.2f} {unit} and "
            "lengthens "
            "the distances of weak pixels."
        )

    def next_experiment(self, variant: Variant) -> str:
        """What tells it from range walk."""
        return "Cover the bright panel beside the dark one with black cloth: multipath goes, range walk stays."


def _lean(variant: Variant, values: Values, view: View) -> FloatArray | float:
    """Where in the image a surface beside it shines brightest; 1 everywhere where the variant knows no image."""
    if "first_pixel_u" not in variant.options:
        return 1.0
    x, y = (_relative(variant, axis, view) for axis in _AXES)
    law = 1.0 + float(values["across"]) * x + float(values["along"]) * y + float(values["sides"]) * x**2
    return np.maximum(law, 0.0)


def _relative(variant: Variant, axis: str, view: View) -> FloatArray:
    """Column or row from −1 to 1 over the image."""
    first, last = (float(variant.options[f"{part}_{axis}"]) for part in ("first", "last"))
    return np.nan_to_num((view.number(axis) - 0.5 * (first + last)) / (0.5 * (last - first)))


def _relative_text(variant: Variant, axis: str) -> str:
    first, last = (float(variant.options[f"{part}_{axis}"]) for part in ("first", "last"))
    return f"({axis} - {0.5 * (first + last):g}) / {0.5 * (last - first):g}"


def _beside_the_beam(share: float, away: FloatArray, values: Values) -> tuple[FloatArray, FloatArray]:
    """Share of the light that comes over a surface beside the beam, and the way that it takes there and back once."""
    longer = np.sqrt(away**2 + 4.0 * float(values["height"]) ** 2)
    return share * (away / longer) ** 2, longer


def _beside(view: View, state: State, channel: str) -> FloatArray:
    """Mean signal of the columns at 2, 5 and 9 pixels to both sides, as far as the table holds them."""
    total, count = np.zeros(view.n), np.zeros(view.n)
    for reach in _REACH_PX:
        for du in (-reach, reach):
            value = view.neighbour(state, channel, du=du, dv=0)
            good = np.isfinite(value)
            total += np.where(good, value, 0.0)
            count += good
    return np.where(count > 0, total / np.maximum(count, 1.0), np.nan)


def room(view: View) -> tuple[FloatArray, FloatArray] | None:
    """Light that each row's target gets from all others, over its mean, and that light's extra one-way path.

    Of every row of the whole table: of the rendered bench where that is known, else of what the sweep shows; None
    where the scene is not scanned over the bearing.
    """
    rendered = bounced(view)
    return per_table(view, "room", lambda: _room(view)) if rendered is None else rendered


def _room(view: View) -> tuple[FloatArray, FloatArray] | None:
    found = scene(view)
    channel, far = view.channel(Role.INTENSITY), distances(view)
    if (
        found is None
        or not view.varies("azimuth_deg")
        or not channel
        or not far
        or not view.varies("stage_angle_deg")
    ):
        return None
    table = view.columns
    light, range_ = table.numbers[f"sim_{channel}"], table.numbers[f"sim_{far[0]}"]
    rise_deg = ray_column(view, "elevation_deg")
    range_ = range_ * np.cos(np.radians(rise_deg))
    good = np.isfinite(light) & np.isfinite(range_) & (range_ > 0.0)
    bins = np.floor(found.bearing / _PATCH_DEG).astype(np.int64)
    count = np.bincount(bins[good], minlength=int(bins.max()) + 1)
    seen = np.flatnonzero(count)
    bright = np.bincount(bins[good], light[good], count.size)[seen] / count[seen]
    away = np.bincount(bins[good], range_[good], count.size)[seen] / count[seen]
    rise = float(np.quantile(np.abs(rise_deg), 0.9))
    lit, detour = _facing_each_other(seen, bright, away, max(rise, _LEAST_RISE_DEG))
    if not lit.max() > 0.0:
        return None
    place = found.bearing / _PATCH_DEG - 0.5
    strength = np.interp(place, seen, lit)
    return strength / float(strength.mean()), np.interp(place, seen, detour)


def _facing_each_other(
    seen: IntArray, bright: FloatArray, away: FloatArray, rise_deg: float
) -> tuple[FloatArray, FloatArray]:
    """Twice-bounced light of upright strips over what lights them directly, and its extra one-way path.

    A strip is as bright as it looks. It sends its light on with the cosines of both ends; over the distance of two
    far strips and their height squared, over the distance of near ones (Hottel's strips).

    Args:
        seen: number of the bearing's bin of each strip, ascending; bright: its signal; away: its level distance.
        rise_deg: half of the height that is lit, seen from the sensor.
    """
    angle = np.radians((seen + 0.5) * _PATCH_DEG)
    place = away[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    slope = np.zeros(len(seen))
    gap = np.diff(angle)
    joined = (np.diff(seen) <= _WIDEST_GAP) & (np.abs(np.diff(away)) < _SAME_SURFACE * np.diff(seen) * away[1:])
    for part in np.split(np.arange(len(seen)), np.flatnonzero(~joined) + 1):
        if len(part) > 1:
            slope[part] = _slopes(angle[part], away[part])
    # along a strip the distance grows by `slope` a radian, its normal leans by as much
    incidence = np.arctan2(slope, away)
    normal = -np.stack([np.cos(angle - incidence), np.sin(angle - incidence)], axis=1)
    across = place[None, :, :] - place[:, None, :]
    near = np.where(np.diff(seen) <= _WIDEST_GAP, gap, np.radians(_PATCH_DEG))  # a strip reaches half-way to the next
    half = 0.5 * np.concatenate([near[:1], near]), 0.5 * np.concatenate([near, near[-1:]])
    width = (half[0] + half[1]) * away / np.cos(incidence)
    apart = np.sqrt(np.sum(across**2, axis=2) + (0.5 * width[None, :]) ** 2)
    arriving = np.maximum(np.einsum("ijk,ik->ij", across, normal) / apart, 0.0)
    leaving = np.maximum(-np.einsum("ijk,jk->ij", across, normal) / apart, 0.0)
    height = away[None, :] * np.tan(np.radians(rise_deg))
    spread = apart * np.hypot(apart, height)
    weight = bright[None, :] * (width * height[0])[None, :] * arriving * leaving / spread
    light = weight.sum(axis=1) * away**2 / np.cos(incidence)
    longer = (weight * 0.5 * (away[None, :] + apart - away[:, None])).sum(axis=1)
    return light, longer / np.maximum(weight.sum(axis=1), 1e-300)


def _slopes(angle: FloatArray, away: FloatArray) -> FloatArray:
    """Slope of the distance at each strip, from the side on which it bends less: a corner is of one of its walls.

    (As essentially non-oscillatory schemes take differences: Harten and others, J. Comput. Phys. 71 (1987) 231.)
    """
    step = np.diff(away) / np.diff(angle)
    bend = np.concatenate([[np.inf], np.abs(np.diff(step)), [np.inf]])  # about each strip but the ends
    left, right = np.concatenate([step[:1], step]), np.concatenate([step, step[-1:]])
    before, after = np.concatenate([bend[:1], bend[:-1]]), np.concatenate([bend[1:], bend[-1:]])
    smooth = bend < 2.0 * np.minimum(before, after)
    return np.where(smooth, 0.5 * (left + right), np.where(before < after, left, right))
