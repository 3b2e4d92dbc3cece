"""Values scatter from step to step, or from angle to angle, more than single frames do, driven by nothing "
"recorded."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from arl_fixtures.reconcile.effect import Effect, Kind, Stage, State, Values, Variant
from arl_fixtures.reconcile.effects_common import GROUPS, amplitude
from arl_fixtures.reconcile.roles import Role
from arl_fixtures.reconcile.view import View


class Repeatability(Effect):
    """All rows of a group share an error of this standard deviation; no mean moves."""

    id = "bench.repeatability"
    stage = Stage.BOOKKEEPING
    source = "ISO 5725-2 (repeatability and intermediate precision); AIAG MSA manual (gauge studies)"
    kind = Kind.GROUP_SCATTER
    confusable = ("readout.noise_excess", "laser.pulse_energy_jitter")

    def variants(self, view: View) -> Iterable[Variant]:
        """Per channel: shared by a step, or by an angle of a step, where the table has several of them."""
        for channel in view.columns.channels:
            if channel.role is Role.SCATTER:
                continue
            scale = _scale(view, channel.name)
            for group, columns in GROUPS.items():
                groups = int(view.columns.group(*columns).max()) + 1
                if groups < _FEWEST or (group == "frame" and not view.varies("stage_angle_deg")):
                    continue
                yield Variant(
                    effect=self.id,
                    options={"channel": channel.name, "group": group},
                    parameters=(amplitude("scatter", channel.unit, 0.0, 100.0 * scale, scale),),
                    channels=(channel.name,),
                    drivers=tuple(name for name in columns if view.has(name)),
                )

    def apply(self, variant: Variant, values: Values, state: State, view: View) -> None:
        """Moves no mean."""

    def expression(self, variant: Variant) -> str:
        """The law."""
        what = "step" if variant.options["group"] == "step" else "stage angle of a step"
        return f"{variant.options['channel']} += one random value for every {what}, of standard deviation scatter"

    def sentence(self, variant: Variant, values: Values, view: View) -> str:
        """Size of the scatter."""
        channel = variant.options["channel"]
        what = "step to step" if variant.options["group"] == "step" else "angle to angle"
        return (
            f"{channel} scatters from {what} by {values['scatter']:.3g} (standard deviation) beyond the noise of "
            "single "
            "frames, and nothing that was recorded drives it."
        )

    def next_experiment(self, variant: Variant) -> str:
        """What measures it."""
        return "Run a gauge study: the same step repeated with nothing changed, and with the DUT remounted."


_FEWEST = 4


def _scale(view: View, channel: str) -> float:
    """A visible size: one frame's simulated scatter, else a hundredth of the channel's median."""
    numbers = view.columns.numbers
    values = numbers.get(f"sim_{channel}_std", numbers[f"sim_{channel}"] * 0.01)
    finite = np.abs(values[np.isfinite(values)])
    return max(float(np.median(finite)), 1e-9) if finite.size else 1.0
