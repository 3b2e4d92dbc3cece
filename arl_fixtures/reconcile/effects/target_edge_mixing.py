"""A pixel that sees two surfaces reports a mixture."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from arl_fixtures.reconcile.effect import Effect, Stage, State, Values, Variant
from arl_fixtures.reconcile.effects_common import (
    FloatArray,
    amplitude,
    distances,
    light_channels,
    per_view,
    set_light,
)
from arl_fixtures.reconcile.effects_surface import borders, neighbours
from arl_fixtures.reconcile.roles import Role
from arl_fixtures.reconcile.view import View


class EdgeMixing(Effect):
    """At borders D and I take a share of the other side: of its light, and of its range in proportion to that light.

    `kind` range: the light is right, but the sensor reports the mixture's range (or the simulation one surface's).
    `kind` both: more of the other surface is in the pixel than the simulation says. A negative share: less.
    """

    id = "target.edge_mixing"
    stage = Stage.TARGET
    source = "Tuley, Vandapel, Hebert, ICRA 2005: mixed pixels at range discontinuities"
    confusable = ("optics.defocus", "detector.crosstalk", "acquisition.frame_lag")

    def variants(self, view: View) -> Iterable[Variant]:
        """Range alone, and light with range."""
        if not view.labels("surface") or not borders(view).any():
            return
        channel = view.channel(Role.INTENSITY)
        kinds = (("range",) if distances(view) else ()) + (("both",) if channel else ())
        for kind in kinds:
            lit = light_channels(view, channel) if kind == "both" else ()
            yield Variant(
                effect=self.id,
                options={"kind": kind},
                parameters=(amplitude("share", "1", -0.9, 0.9, 0.1),),
                channels=tuple(dict.fromkeys((*distances(view), *lit))),
                drivers=tuple(name for name in ("mixed", "surface") if view.has(name)),
                where={"mixed": ["true"]} if view.is_category("mixed") else {},
            )

    def apply(self, variant: Variant, values: Values, state: State, view: View) -> None:
        """Mixes the other side in at borders."""
        share = float(values["share"])
        channel = view.channel(Role.INTENSITY)
        far = {name: _across(view, name) for name in distances(view)}
        bright = _across(view, channel) if channel else np.ones(view.n)
        own = state[channel] if channel else np.ones(view.n)
        at = borders(view) & np.isfinite(bright)
        with np.errstate(invalid="ignore", divide="ignore"):
            weight = share * bright / ((1.0 - abs(share)) * own + abs(share) * bright)
        for name, other in far.items():
            moved = np.clip(weight, -1.0, 1.0) * (other - state[name])
            state[name] = state[name] + np.where(at & np.isfinite(moved), moved, 0.0)
        if variant.options["kind"] == "both" and channel:
            light = own + np.where(at, share * (bright - own), 0.0)
            set_light(view, state, channel, np.where(light > 0.0, light, own))

    def expression(self, variant: Variant) -> str:
        """The law."""
        text = "at borders: distance += w * (distance beyond - distance), w = the share of the light from beyond"
        return f"{text}; signal += share * (signal beyond - signal)" if variant.options["kind"] == "both" else text

    def sentence(self, variant: Variant, values: Values, view: View) -> str:
        """The share."""
        what = "range" if variant.options["kind"] == "range" else "signal and range"
        return f"Where a pixel sees two surfaces, {values['share'] * 100:+.0f} % of the other one is in its {what}."

    def next_experiment(self, variant: Variant) -> str:
        """What tells it from blur."""
        return (
            "Scan an edge between two panels at equal distance, then at different distances: mixing of ranges "
            "appears "
            "only in the second, blur in both."
        )


def _across(view: View, name: str) -> FloatArray:
    """Simulated value beyond a border: of the neighbour with another surface that differs most from the row."""

    def find() -> FloatArray:
        own_code = view.codes("surface")[0]
        own = view.number(f"sim_{name}")
        best = np.full(view.n, np.nan)
        for codes, values in neighbours(view, f"sim_{name}"):
            candidate = np.where((codes >= 0) & (codes != own_code), values, np.nan)
            further = np.abs(candidate - own) > np.abs(best - own)
            best = np.where(np.isnan(best) | further, candidate, best)
        return best

    return per_view(view, ("across", name), find)
