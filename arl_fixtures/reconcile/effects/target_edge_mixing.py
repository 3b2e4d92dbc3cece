"""A pixel that sees two surfaces reports a mixture."""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial

import numpy as np

from arl_fixtures.reconcile.effect import Effect, Stage, State, Values, Variant
from arl_fixtures.reconcile.effects_beam_borders import beam_borders, see_footprint, usual_step_deg
from arl_fixtures.reconcile.effects_bench import is_sharp
from arl_fixtures.reconcile.effects_beyond import take_beyond
from arl_fixtures.reconcile.effects_common import (
    FloatArray,
    amplitude,
    distances,
    light_channels,
    per_view,
    shape,
)
from arl_fixtures.reconcile.effects_echoes import climbed
from arl_fixtures.reconcile.effects_render import ray_echoes, see_area
from arl_fixtures.reconcile.effects_second_echo import second_echo
from arl_fixtures.reconcile.effects_surface import at_centre, beyond_border, borders, light_share
from arl_fixtures.reconcile.roles import Role, per_metre, unit_of
from arl_fixtures.reconcile.view import View

_PEAKS = ("echo", "locked")
_BEAMS = ("beam", "locked beam")
_OF_RAYS = ("first ray", "peak of rays", "peak at mean")
_SPREAD = {
    "footprint": shape("filled", "px", 0.3, 1.1, 1.0, 0.7),
    "blurred": shape("blur", "px", 0.05, 0.5, 0.3),
}
"""Means over a whole pixel: kind to how wide it is. What lies further beside it is a blur's, see `optics.defocus`."""


class EdgeMixing(Effect):
    """What a pixel at a border reports of the two surfaces in it, against what the simulation says.

    * dominant: D += share·(range of the surface that gives more light − D): the stronger echo wins.
    * nearest: D += share·(range of the nearer surface − D): the first echo wins.
    * echo, locked: D += share·(peak of both echoes − D): apart by more than the pulse one of them wins, the stronger
      or that of the pixel's centre; closer together they merge.
    * leak: D += share·w·ΔR / (1 + (ΔR / reach)²), where the simulation shows the range of one of two surfaces: w is
      the other one's part of the light, ΔR how far it lies behind; what a gate or a peak search lets through of it.
    * range: D takes a share of the other side's range, in proportion to its light (negative: gives some back).
    * both: the other side's light too: more of it is in the pixel than the simulation says.
    * first ray, peak of rays, peak at mean: the same of the rays of a bench that is known: the nearest one; the peak
      of their echoes, climbed from the brightest one, or from their mean.
    * footprint: where the simulation looks through a few sharp rays, the mean of light and range (by light) over what
      the pixel sees, `filled` pixels wide.
    * beam: where a scanner's rays lie closer than its beam is wide, light and the peak of the echoes of what a
      Gaussian footprint of `width` degrees sees on either side of the borders that it crosses along its ring.
    * blurred: the same over a whole pixel and what a lens adds about it, with the standard deviation `blur`.
    """

    id = "target.edge_mixing"
    stage = Stage.TARGET
    source = "Tuley, Vandapel, Hebert, ICRA 2005: mixed pixels at range discontinuities"
    mixes = True
    at_borders = True
    confusable = ("optics.defocus", "detector.crosstalk", "acquisition.frame_lag")

    def variants(self, view: View) -> Iterable[Variant]:
        """Which surface wins, and how much of the other is in it."""
        told = tuple(name for name in ("mixed", "surface") if view.has(name))
        if is_sharp(view):
            drivers = (*told, "pixel_u") if view.has("pixel_u") else told
            lights = light_channels(view, view.channel(Role.INTENSITY)) if view.channel(Role.INTENSITY) else ()
            for kind, width in _SPREAD.items():
                yield Variant(
                    effect=self.id,
                    options={"kind": kind},
                    parameters=(amplitude("share", "1", 0.0, 1.5, 0.5), width),
                    channels=tuple(dict.fromkeys((*distances(view), *lights))),
                    drivers=drivers,
                    rough=True,
                )
            for kind in _OF_RAYS if distances(view) and ray_echoes(view) is not None else ():
                pulse = () if kind == "first ray" else (shape("pulse", "m", 0.02, 2.0, 0.15, 0.6),)
                yield Variant(
                    effect=self.id,
                    options={"kind": kind},
                    parameters=(amplitude("share", "1", -0.9, 1.2, 0.1), *pulse),
                    channels=distances(view),
                    drivers=drivers,
                )
        if beam_borders(view) is not None and distances(view):
            step, channel = usual_step_deg(view), view.channel(Role.INTENSITY)
            for kind in _BEAMS:
                yield Variant(
                    effect=self.id,
                    options={"kind": kind},
                    parameters=(
                        amplitude("share", "1", 0.0, 1.5, 0.5),
                        shape("width", "deg", 0.3 * step, 30.0 * step, step, 3.0 * step),
                        shape("pulse", "m", 0.02, 2.0, 0.3),
                    ),
                    channels=(*distances(view), *(light_channels(view, channel) if channel else ())),
                    drivers=(*told, "azimuth_deg"),
                    rough=True,
                )
        if not borders(view).any():
            return
        if any(np.isfinite(second_echo(view, name)[0]).any() for name in distances(view)):
            yield Variant(
                effect=self.id,
                options={"kind": "leak"},
                parameters=(amplitude("share", "1", 0.0, 2.0, 0.2), shape("reach", "m", 0.1, 30.0, 1.0)),
                channels=distances(view),
                drivers=told or ("pixel_u",),
                where={"mixed": ["true"]} if view.is_category("mixed") else {},
            )
        channel = view.channel(Role.INTENSITY)
        kinds = (("dominant", "nearest", *_PEAKS, "range") if distances(view) else ()) + (
            ("both",) if channel else ()
        )
        if not told:  # ranges that jump from ray to ray tell where they meet
            told = (*(n for n in view.columns.ray_columns[:1] if view.varies(n)), f"sim_{distances(view)[0]}")
        for kind in kinds:
            lit = light_channels(view, channel) if kind == "both" else ()
            yield Variant(
                effect=self.id,
                options={"kind": kind},
                parameters=(
                    (amplitude("share", "1", -0.9, 1.2, 0.1), shape("pulse", "m", 0.02, 2.0, 0.15, 0.6))
                    if kind in _PEAKS
                    else (amplitude("share", "1", -0.9, 0.9, 0.1),)
                ),
                channels=tuple(dict.fromkeys((*distances(view), *lit))),
                drivers=told,
                where={"mixed": ["true"]} if view.is_category("mixed") else {},
            )

    def apply(self, variant: Variant, values: Values, state: State, view: View) -> None:
        """Mixes the other side in at borders."""
        share = float(values["share"])
        if variant.options["kind"] in _SPREAD:
            area = float(values.get("filled", 1.0)), float(values.get("blur", 0.0))
            see_area(view, state, view.channel(Role.INTENSITY), distances(view), share, *area)
            return
        if variant.options["kind"] in _BEAMS:
            locked = variant.options["kind"] != "beam"
            see_footprint(view, state, share, float(values["width"]), float(values["pulse"]), locked=locked)
            return
        if variant.options["kind"] == "leak":
            for name in distances(view):
                part, there = per_view(view, ("second echo", name), partial(_echo_of_rows, view, name))
                gap = there - state[name]
                moved = share * part * gap / (1.0 + (gap / (float(values["reach"]) * per_metre(unit_of(name)))) ** 2)
                state[name] = state[name] + np.where(np.isfinite(moved), moved, 0.0)
            return
        if variant.options["kind"] in _OF_RAYS:
            _picked(view, state, share, str(variant.options["kind"]), float(values.get("pulse", 0.0)))
            return
        if variant.options["kind"] in ("dominant", "nearest", *_PEAKS):
            for name in distances(view):
                kind = str(variant.options["kind"])
                if kind in _PEAKS:
                    winner = _peak(view, name, float(values["pulse"]), strongest=kind == "echo")
                else:
                    winner = _winner(view, name, kind)
                moved = share * (winner - state[name])
                state[name] = state[name] + np.where(borders(view) & np.isfinite(moved), moved, 0.0)
            return
        channel = view.channel(Role.INTENSITY)
        take_beyond(view, state, channel, share, lights=variant.options["kind"] == "both")

    def expression(self, variant: Variant) -> str:
        """The law."""
        kind = variant.options["kind"]
        if kind in _SPREAD:
            over = "`filled` pixels" if kind == "footprint" else "a pixel blurred by `blur`"
            return f"signal, distance = share * (mean by light over {over}) + (1 - share) * simulated"
        if kind in _BEAMS:
            which = "strongest echo" if kind == "beam" else "echo of the middle's surface"
            seen = f"{which} of what a Gaussian footprint of width sees, echoes of length pulse"
            return f"signal, distance = share * ({seen}) + (1 - share) * simulated"
        if kind in _OF_RAYS:
            picked = "range of the nearest ray" if kind == "first ray" else str(kind)
            law = f"where rays differ: distance += share * ({picked} - simulated distance)"
            return law if kind == "first ray" else f"{law}, echoes of length pulse"
        if kind == "leak":
            return "at borders: distance += share * w * gap / (1 + (gap / reach)^2), w the part of light from beyond"
        if kind in _PEAKS:
            return "at borders: distance += share * (peak of both surfaces' echoes of length pulse - distance)"
        if kind in ("dominant", "nearest"):
            return f"at borders: distance += share * (distance of the {kind} surface - distance)"
        text = "at borders: distance += w * (distance beyond - distance), w = the share of the light from beyond"
        return f"{text}; signal += share * (signal beyond - signal)" if variant.options["kind"] == "both" else text

    def sentence(self, variant: Variant, values: Values, view: View) -> str:
        """The share."""
        kind = variant.options["kind"]
        if kind in _SPREAD:
            wide = f"{values['filled']:.2f} pixels' width" if "filled" in values else "a blurred pixel"
            return (
                f"A pixel mixes what lies in {wide}, by {values['share'] * 100:.2g} %; the simulation looks through "
                "a few rays."
            )
        if kind in _OF_RAYS:
            picked = "nearest surface" if kind == "first ray" else "peak of their echoes"
            return (
                f"Where a pixel sees several ranges, it reports {values['share'] * 100:.0f} % of the way to the "
                f"{picked} rather than their mean."
            )
        if kind == "leak":
            return (
                f"Where a pixel sees two surfaces, {values['share'] * 100:.0f} % of the echo that the simulation "
                f"leaves out pulls the range, less from {values['reach']:.2f} m on."
            )
        if kind in _PEAKS:
            return (
                f"Where a pixel sees two surfaces, it reports {values['share'] * 100:.0f} % of the way to the peak "
                f"of their echoes, which merge below {values['pulse']:.2f} m (standard deviation of an echo)."
            )
        if kind in ("dominant", "nearest"):
            which = "surface that gives more light" if kind == "dominant" else "nearer surface"
            return (
                f"Where a pixel sees two surfaces, it reports {values['share'] * 100:.0f} % of the way to the "
                f"{which}."
            )
        what = "range" if variant.options["kind"] == "range" else "signal and range"
        return f"Where a pixel sees two surfaces, {values['share'] * 100:+.0f} % of the other one is in its {what}."

    def next_experiment(self, variant: Variant) -> str:
        """What tells it from blur."""
        return (
            "Scan an edge between two panels at equal distance, then at different distances: mixing of ranges "
            "appears "
            "only in the second, blur in both."
        )


def _picked(view: View, state: State, share: float, kind: str, pulse_m: float) -> None:
    """Move ranges of pixels whose rays see several a share of the way to the one that is picked."""
    seen = ray_echoes(view)
    if seen is None or not seen[0].size:
        return
    light, ranges, spot = seen
    for name in distances(view):
        width = pulse_m * per_metre(unit_of(name))
        moved = per_view(view, ("picked", kind, width), partial(_from_mean, light, ranges, kind, width))
        state[name] = state[name] + np.where(spot >= 0, share * moved[spot], 0.0)


def _from_mean(light: FloatArray, ranges: FloatArray, kind: str, width: float) -> FloatArray:
    """How far the picked range of each spot lies from the mean by light."""
    mean = np.sum(light * ranges, axis=1) / np.sum(light, axis=1)
    if kind == "first ray":
        return np.asarray(ranges.min(axis=1) - mean)
    start = ranges[np.arange(len(ranges)), light.argmax(axis=1)] if kind == "peak of rays" else mean
    return np.asarray(climbed(light, ranges, start, width) - mean)


def _echo_of_rows(view: View, name: str) -> tuple[FloatArray, FloatArray]:
    part, there = second_echo(view, name)
    return part[view.rows], there[view.rows]


def _winner(view: View, name: str, kind: str) -> FloatArray:
    """Range of the surface that wins a border pixel: of the pixel's centre, or beyond the border."""

    def find() -> FloatArray:
        own, beyond = view.number(f"sim_{name}"), beyond_border(view, name)
        centre = at_centre(view, name)
        if kind == "nearest":
            return np.fmin(np.fmin(centre, beyond), own)
        with np.errstate(invalid="ignore", divide="ignore"):
            here = (own - beyond) / (centre - beyond)  # share of the light that comes from the centre's surface
        return np.where(here >= 0.5, centre, beyond)

    return per_view(view, ("winner", name, kind), find)


def _peak(view: View, name: str, pulse_m: float, *, strongest: bool) -> FloatArray:
    """Peak of the centre's and the other side's Gaussian echoes: uphill from the stronger, or from the centre's."""
    centre, beyond = at_centre(view, name), beyond_border(view, name)
    width = pulse_m * per_metre(unit_of(name))
    at = np.flatnonzero(borders(view) & np.isfinite(centre) & np.isfinite(beyond))
    own = per_view(view, "own share", lambda: _own_share(view))[at]
    near, far = centre[at], beyond[at]
    start = np.where(own >= 0.5, near, far) if strongest else near
    place = climbed(np.stack([own, 1.0 - own], axis=1), np.stack([near, far], axis=1), start, width)
    peak = np.full(view.n, np.nan)
    peak[at] = place
    return peak


def _own_share(view: View) -> FloatArray:
    """Share of a pixel's light that comes from the surface at its centre; half where no signal tells."""
    channel = view.channel(Role.INTENSITY)
    if not view.labels("surface"):
        return np.full(view.n, 0.5)
    codes, labels = view.codes("surface")
    share = np.ones(view.n)
    for index, label in enumerate(labels):
        here = codes == index
        if here.any():
            share[here] = light_share(view, channel, label)[here] if channel else 0.5
    return share
