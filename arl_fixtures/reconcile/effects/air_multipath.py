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
    rounded,
    set_light,
    shape,
)
from arl_fixtures.reconcile.effects_frame import add_stray_light, has_frames
from arl_fixtures.reconcile.effects_phasor import ambiguity_shape
from arl_fixtures.reconcile.effects_strips import room
from arl_fixtures.reconcile.effects_wall import by_the_wall, law_by_the_wall, logged_walls
from arl_fixtures.reconcile.roles import Role, per_metre, unit_of
from arl_fixtures.reconcile.view import View

_REACH_PX = (2, 5, 9)
_AXES = ("pixel_u", "pixel_v")


class Multipath(Effect):
    """Light that did not come straight back, by where it came from.

    * room: the target is lit by the surfaces round about too, I *= 1 + k, D += k / (1 + k)·detour; k and the detour
      at each bearing follow from the simulated scene (every surface lights every other by its brightness, both facing
      angles and the square of their distance). A camera that measures phases (`phase`) adds phasors instead, of a
      phase of 2π·detour/ambiguity: D += ambiguity/2π·arg z, I *= |z|, z = 1 + k·exp(j·phase).
      `beyond`: what an image shows goes on about it, and lights it, too.
    * lamps (of the nominal bench): the same by panels that shine alike to all sides.
    * image, near: stray light of the image, or of the columns within nine pixels, arrives over a longer way:
      I += share·S, D += detour·share·S / (I + share·S): weak pixels beside bright ones lengthen most.
    * side: a surface beside the beam (floor, housing), at `height`: detour (sqrt(R² + 4·height²) − R) / 2 with a
      share k that falls off along the longer way. Needs no image. A signal that gathers all light (`lit`) grows by k.
      Of an image k is larger towards the surface: k·(1 + across·x + along·y + sides·x²), x and y from −1 to 1 over
      columns and rows (`sides`: one surface on the left and one on the right).
    * wall: a surface whose distance from the target is logged, or the floor below a beam of logged height, see
      `effects_wall`.
    """

    id = "air.multipath"
    stage = Stage.AIR
    shown_by = Role.DISTANCE
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
        size = per_metre(unit)
        share = amplitude("share", "1", 0.0, 0.5, 0.01)
        lit = light_channels(view, channel) if channel else ()
        everything = tuple(dict.fromkeys((*far, *lit)))
        if room(view) is not None:
            seen = [name for name in ("stage_angle_deg", "azimuth_deg") if view.varies(name)]
            weak = ["reflectance"] if view.varies("reflectance") else []  # the less it shines, the more that weighs
            of_room = (*seen, f"sim_{far[0]}", *weak)
            ambiguity = ambiguity_shape(view, far[0])
            for source in ("room", "lamps") if bounced(view) is not None else ("room",):
                yield self._variant(source, (share,), everything, of_room)
                yield self._variant(source, (share, ambiguity), everything, of_room, phase=True)
            if room(view, beyond=True) is not None:
                yield self._variant("room", (share,), everything, of_room, beyond=True)
                yield self._variant("room", (share, ambiguity), everything, of_room, phase=True, beyond=True)
        if channel and has_frames(view):
            detour = shape("detour", unit, 0.15 * size, 5.0 * size, 0.4 * size)
            for source in ("image", "near") if view.varies("pixel_u") else ("image",):
                drivers = [name for name in ("azimuth_deg", "pixel_u") if view.varies(name)]
                yield self._variant(source, (share, detour), everything, (f"sim_{channel}", *drivers[:1]))
        for wall, shapes in logged_walls(view, unit):
            seen_in = tuple(dict.fromkeys(str(wall[key]) for key in ("wall", "white", "aside") if key in wall))
            if wall["wall"] == wall.get("aside"):  # a floor: how far away the target is matters as much
                seen_in += ("true_range_m" if view.varies("true_range_m") else f"sim_{far[0]}",)
            share_of = share if wall["way"] == "corner" else amplitude("share", "1", 0.0, 2.0, 0.1)  # of its light
            yield self._variant("wall", (share_of, *shapes), far, seen_in, **wall)
            if channel:
                stretch = [shape("stretch", "1", 0.2, 3.0, 1.0)] if wall["way"] == "corner" else []
                yield self._variant("wall", (share_of, *shapes, *stretch), everything, seen_in, lit=True, **wall)
        low, high = view.span(f"sim_{far[0]}")
        if 0.0 < low < 0.8 * high:
            height = shape("height", unit, 0.005 * high, 0.35 * high, 0.05 * high, 0.15 * high, 0.015 * high)
            fewer = shape("height", unit, 0.02 * high, 0.35 * high, 0.05 * high, 0.15 * high)  # beside other shapes
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
                        "side", (share, fewer, *leans), everything, (driver, *_AXES), lit=True, **spans
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
        if source in ("room", "lamps", "wall"):
            if source == "wall":
                part, detour = by_the_wall(variant, values, state, view)
            else:
                beyond = bool(variant.options.get("beyond"))
                lit = room(view, beyond=beyond) if source == "room" else bounced(view, plain=True)
                if lit is None:
                    return
                part, detour = share * lit[0][view.rows], lit[1][view.rows]
            if variant.options.get("phase"):
                _add_phasors(view, state, channel, part, detour, float(values["ambiguity"]))
                return
            for name in distances(view):
                state[name] = state[name] + part / (1.0 + part) * detour
            if channel and (source != "wall" or variant.options.get("lit")):
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
        if source in ("room", "lamps"):
            if variant.options.get("phase"):
                law = "z = 1 + k exp(2j pi detour / ambiguity); light *= |z|; distance += ambiguity arg(z) / (2 pi)"
                return f"{law}; k = share * (light from the surfaces round about), mean 1"
            of = "the other surfaces), mean 1" if source == "room" else "the panels as lamps), mean 1"
            return f"light *= 1 + k; distance += k / (1 + k) * detour; k = share * (light from {of}"
        if source == "wall":
            return law_by_the_wall(variant)
        around = "of the image" if source == "image" else "of the columns beside"
        return f"signal += share * S; distance += detour * share * S / (signal + share * S), S = mean signal {around}"

    def sentence(self, variant: Variant, values: Values, view: View) -> str:
        """Share and detour."""
        share, unit = f"{values['share'] * 100:.2f} %", unit_of(distances(view)[0])
        source = variant.options["source"]
        if source in ("room", "lamps"):
            return (
                f"Targets are lit by the surfaces round about too: on average {share} of their light took that "
                "detour."
            )
        if source == "side":
            return f"{share} of the light returns over a surface {values['height']:.2f} {unit} beside the beam."
        if source == "wall":
            if "lobe" in values:
                return f"The floor adds light on a longer way, {share} of what a white one seen whole would add."
            return f"A surface beside the target adds up to {share} of light on a longer way, most where it is near."
        return (
            f"{share} of the surroundings' light arrives over a detour of {values['detour']:.2f} {unit} and "
            "lengthens "
            "the distances of weak pixels."
        )

    def next_experiment(self, variant: Variant) -> str:
        """What tells it from range walk."""
        return "Cover the bright panel beside the dark one with black cloth: multipath goes, range walk stays."


def _add_phasors(
    view: View, state: State, channel: str | None, part: FloatArray, detour: FloatArray, ambiguity: float
) -> None:
    """Add a part of light that took a detour as a camera sees it that measures phases."""
    turn = 2.0 * np.pi / ambiguity
    phasor = 1.0 + part * np.exp(1j * turn * detour)
    for name in distances(view):
        state[name] = state[name] + np.angle(phasor) / turn
    if channel:
        set_light(view, state, channel, state[channel] * np.abs(phasor))


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
