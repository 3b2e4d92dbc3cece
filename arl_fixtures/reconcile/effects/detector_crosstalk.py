"""A pixel leaks into its neighbours."""

from __future__ import annotations

import itertools
import json
from collections.abc import Iterable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from arl_fixtures.reconcile.effect import Effect, Parameter, Stage, State, Values, Variant
from arl_fixtures.reconcile.effects_beside import seen_beside
from arl_fixtures.reconcile.effects_common import FloatArray, per_view, shape
from arl_fixtures.reconcile.effects_frame import ranged_by
from arl_fixtures.reconcile.effects_overlap import overlap_shape, within
from arl_fixtures.reconcile.effects_render import pixel_beside
from arl_fixtures.reconcile.roles import Role
from arl_fixtures.reconcile.view import View

BoolArray = NDArray[np.bool_]

_CORNERS = ((-1, -1), (-1, 1), (1, -1), (1, 1))
_NEIGHBOURS = {
    "both": ((-1, 0), (1, 0), (0, -1), (0, 1)),
    "rows": ((-1, 0), (1, 0)),
    "columns": ((0, -1), (0, 1)),
    "uneven": ((-1, 0), (1, 0), (0, -1), (0, 1)),
}


class Crosstalk(Effect):
    """I(u, v) += share·Σ(I_neighbour − I) over the neighbours along columns, rows or both that the table holds.

    Where both leak, the ones of the column may by `across` of what those of the row do.

    What leaks is charge, or the pulse itself: then the distance is the mean of all that arrives by its light; or the
    trace before the echo is found in it, to which adds what comes within the pixel's own pulse (`effects_overlap`):
    the pixels at the corners then leak `corners` of what the direct neighbours do. At the ends of the array it may
    leak into what nobody reads.
    """

    id = "detector.crosstalk"
    stage = Stage.DETECTOR
    source = "Huntington et al., Opt. Eng. 60 (2021) 083101: crosstalk of InGaAs flash cameras"
    mixes = True
    confusable = ("optics.defocus", "optics.veiling_glare")

    def variants(self, view: View) -> Iterable[Variant]:
        """One per intensity channel and direction of the leak, with the distance and without."""
        if not (view.varies("pixel_u") or view.varies("pixel_v")):
            return
        for channel in view.channels(Role.INTENSITY):
            far = ranged_by(view, channel.name)
            ways = [
                way for way in _NEIGHBOURS if way != "uneven" or (view.varies("pixel_u") and view.varies("pixel_v"))
            ]
            kinds = list(itertools.product(ways, ("charge", "pulse") if far else ("charge",)))
            if far and "uneven" in ways:
                kinds.append(("both", "trace"))
            for direction, leaks in kinds:
                share = Parameter(name="share", unit="1", low=0.0, high=0.2, null=0.0, typical=0.01)
                shapes = [shape("across", "1", 0.05, 5.0, 0.6)] if direction == "uneven" else []
                if leaks == "trace":
                    shapes = [shape("corners", "1", 0.0, 1.0, 0.2), overlap_shape(view, far[0])]
                yield Variant(
                    effect=self.id,
                    options={"channel": channel.name, "direction": direction, "leaks": leaks},
                    parameters=(share, *shapes),
                    channels=(*(far if leaks != "charge" else ()), channel.name),
                    drivers=("pixel_u", "pixel_v"),
                )

    def aside(self, variant: Variant, view: View) -> Iterable[Variant]:
        """Pixels at the ends of the array that leak into what nobody reads (dummy pixels, the substrate)."""
        if "ends" not in variant.options:
            spans = {name: view.span(name) for name in ("pixel_u", "pixel_v") if view.varies(name)}
            yield replace(variant, options={**variant.options, "ends": json.dumps(spans)})

    def apply(self, variant: Variant, values: Values, state: State, view: View) -> None:
        """Neighbours that neither the table holds nor the known scene shows give and take nothing."""
        channel, shifts = str(variant.options["channel"]), _NEIGHBOURS[str(variant.options["direction"])]
        leaks = variant.options.get("leaks")
        far = ranged_by(view, channel) if leaks in ("pulse", "trace") else ()
        own = state[channel]
        leak = np.zeros(view.n)
        moments = {distance: np.zeros(view.n) for distance in far}
        for du, dv in (*shifts, *(_CORNERS if leaks == "trace" else ())):
            other = view.neighbour(state, channel, du=du, dv=dv)
            lacking = np.isnan(other)
            unseen = _unseen(view, du, dv, lacking) if lacking.any() else None  # of a table that holds some pixels
            if unseen is not None:
                other = np.where(lacking, own * unseen[0], other)
            if "ends" in variant.options:
                other = np.where(_beyond(view, str(variant.options["ends"]), du, dv), 0.0, other)
            part = float(values["across"]) if dv and "across" in values else 1.0
            if du and dv:
                part = float(values["corners"])
            away = {name: view.neighbour(state, name, du=du, dv=dv) - state[name] for name in far}
            if unseen is not None:
                away = {name: np.where(np.isnan(there), unseen[1], there) for name, there in away.items()}
            if leaks == "trace":
                other = np.where(np.isnan(other), other, other * within(away[far[0]], float(values["overlap"])))
            leak = leak + part * np.nan_to_num(other - own)
            for distance in far:
                moments[distance] += part * np.nan_to_num(other * away[distance])
        light = own + values["share"] * leak
        for distance, moment in moments.items():
            with np.errstate(invalid="ignore", divide="ignore"):
                moved = values["share"] * moment / light
            state[distance] = state[distance] + np.where(np.isfinite(moved) & (light > 0.0), moved, 0.0)
        state[channel] = light

    def expression(self, variant: Variant) -> str:
        """The law."""
        channel = variant.options["channel"]
        beyond = f"; {channel} = 0 beyond the array" if "ends" in variant.options else ""
        if variant.options.get("leaks") == "trace":
            within_pulse = "exp(-(distance[neighbours] - distance)^2 / (2 overlap^2))"
            return (
                f"{channel} += share * sum({channel}[neighbours] * {within_pulse} - {channel}), corners * share at "
                f"corners; distance is the mean by light{beyond}"
            )
        pulled = "; distance += share * sum(" if variant.options.get("leaks") == "pulse" else ""
        pulled += f"{channel}[neighbours] * (distance[neighbours] - distance)) / {channel}" if pulled else ""
        pulled += beyond
        if variant.options["direction"] == "uneven":
            told = f"{channel}[row neighbours] + across * {channel}[column neighbours]"
            return f"{channel} += share * sum({told} - (1 + across) * {channel}){pulled}"
        return f"{channel} += share * sum({channel}[neighbours] - {channel}){pulled}"

    def sentence(self, variant: Variant, values: Values, view: View) -> str:
        """The share in percent."""
        along = {
            "both": "its four neighbours",
            "rows": "its row neighbours",
            "columns": "its column neighbours",
            "uneven": "its row neighbours",
        }
        direction = along[str(variant.options["direction"])]
        further = ""
        if "across" in values:
            further = f", {values['across'] * values['share'] * 100:.2f} % into each of its column neighbours"
        if "corners" in values:
            further = f", {values['corners'] * values['share'] * 100:.2f} % at its corners, within the pulse"
        if "ends" in variant.options:
            further += ", beyond the ends of the array as well"
        return f"A pixel leaks {values['share'] * 100:.2f} % of its signal into each of {direction}{further}."

    def next_experiment(self, variant: Variant) -> str:
        """What tells it from blur and glare."""
        return (
            "Light a single pixel through a pinhole, at two focus settings: electrical crosstalk stays with the "
            "pixel's "
            "direct neighbours, blur of the optics changes with the focus, glare reaches far."
        )


def _beyond(view: View, ends: str, du: int, dv: int) -> BoolArray:
    """Rows whose neighbour lies beyond the array, of which the first and last columns and rows are known."""
    outside = np.zeros(view.n, dtype=bool)
    step = {"pixel_u": du, "pixel_v": dv}
    for name, (first, last) in json.loads(ends).items():
        there = view.number(name) + step[name]
        outside |= (step[name] != 0) & ((there < first) | (there > last))
    return outside


def _unseen(view: View, du: int, dv: int, lacking: BoolArray) -> tuple[FloatArray, FloatArray] | None:
    """Light and range of a neighbour that the table lacks: as the known bench, else as the swept scene shows it."""

    def look() -> tuple[FloatArray, FloatArray] | None:
        rendered = pixel_beside(view, du, dv, lacking)
        return seen_beside(view, du, dv) if rendered is None else rendered

    return per_view(view, ("beside", du, dv, np.packbits(lacking).tobytes()), look)
