"""Pixels that stopped answering."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from arl_fixtures.reconcile.effect import Effect, Parameter, Stage, State, Values, Variant
from arl_fixtures.reconcile.effects_common import signals
from arl_fixtures.reconcile.roles import Role
from arl_fixtures.reconcile.view import View


class DeadPixels(Effect):
    """valid_fraction *= 1 − dead (or, where it is no channel, I *= 1 − dead), `dead` from 0 to 1 for every pixel.

    A pixel that never answers gives no signal either.
    """

    id = "detector.dead_pixels"
    stage = Stage.READOUT
    source = "EMVA 1288 (2021), sec. 8.8 (defect pixels); solder and bump failures cluster along rows"
    sparse = True
    confusable = ("detector.pixel_response", "optics.window_contamination")

    def variants(self, view: View) -> Iterable[Variant]:
        """One, per DUT and pixel; per cycle and per step too where pixels may die on the way."""
        pixels = tuple(name for name in ("pixel_u", "pixel_v") if view.varies(name))
        if not pixels:
            return
        given = tuple(channel.name for channel in view.channels(Role.FRACTION))
        lit = signals(view)[:1]
        where = (*(("dut",) if view.labels("dut") else ()), *pixels)
        moments: list[tuple[str, ...]] = [(), *([("cycle",)] if view.varies("cycle") else [])]
        if view.varies("step"):
            moments.append((*(("cycle",) if "cycle" in view.columns.numbers else ()), "step"))
        for moment in moments:
            for channel in given or lit:
                levels = (*moment, *where)
                yield Variant(
                    effect=self.id,
                    options={"channel": channel, "since": moment[-1] if moment else "always"},
                    parameters=(
                        Parameter(name="dead", unit="1", low=0.0, high=1.0, null=0.0, typical=1.0, per=levels),
                    ),
                    channels=tuple(dict.fromkeys((channel, *lit))),
                    drivers=(*pixels, *moment),
                )

    def apply(self, variant: Variant, values: Values, state: State, view: View) -> None:
        """Takes the pixel's answers away."""
        alive = 1.0 - np.clip(np.nan_to_num(np.asarray(values["dead"], dtype=np.float64)), 0.0, 1.0)
        channel = str(variant.options["channel"])
        state[channel] = state[channel] * alive
        for lit in signals(view)[:1]:
            if lit != channel and np.any(alive < _SILENT):
                state[lit] = np.where(alive < _SILENT, 0.0, state[lit])

    def expression(self, variant: Variant) -> str:
        """The law."""
        return f"{variant.options['channel']} *= 1 - dead[pixel]"

    def sentence(self, variant: Variant, values: Values, view: View) -> str:
        """How many."""
        dead = np.broadcast_to(np.asarray(values["dead"], dtype=np.float64), (view.n,)) > 0.5
        pixel = view.group("dut", "pixel_u", "pixel_v")
        count, total = np.unique(pixel[dead]).size, np.unique(pixel).size
        return f"{count} of {total} pixels no longer answer."

    def next_experiment(self, variant: Variant) -> str:
        """What confirms it."""
        return "Repeat one step at room temperature: a broken pixel stays dead, a pixel below threshold comes back."


_SILENT = 0.05
"""Share of frames with an answer below which a pixel's signal is none."""
