"""A pixel leaks into its neighbours."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from arl_fixtures.reconcile.effect import Effect, Parameter, Stage, State, Values, Variant
from arl_fixtures.reconcile.roles import Role
from arl_fixtures.reconcile.view import View


class Crosstalk(Effect):
    """I(u, v) += share·Σ(I_neighbour − I) over the neighbours along columns, rows or both that the table holds."""

    id = "detector.crosstalk"
    stage = Stage.DETECTOR
    source = "Huntington et al., Opt. Eng. 60 (2021) 083101: crosstalk of InGaAs flash cameras"
    mixes = True
    confusable = ("optics.defocus", "optics.veiling_glare")

    def variants(self, view: View) -> Iterable[Variant]:
        """One per intensity channel and direction of the leak."""
        if not (view.varies("pixel_u") or view.varies("pixel_v")):
            return
        for channel in view.channels(Role.INTENSITY):
            for direction in ("both", "rows", "columns"):
                yield Variant(
                    effect=self.id,
                    options={"channel": channel.name, "direction": direction},
                    parameters=(Parameter(name="share", unit="1", low=0.0, high=0.2, null=0.0, typical=0.01),),
                    channels=(channel.name,),
                    drivers=("pixel_u", "pixel_v", channel.name),
                )

    def apply(self, variant: Variant, values: Values, state: State, view: View) -> None:
        """Neighbours outside the table give and take nothing."""
        channel, direction = str(variant.options["channel"]), variant.options["direction"]
        shifts = {"both": ((-1, 0), (1, 0), (0, -1), (0, 1)), "rows": ((-1, 0), (1, 0)), "columns": ((0, -1), (0, 1))}
        own = state[channel]
        leak = np.zeros(view.n)
        for du, dv in shifts[str(direction)]:
            leak = leak + np.nan_to_num(view.neighbour(state, channel, du=du, dv=dv) - own)
        state[channel] = own + values["share"] * leak

    def expression(self, variant: Variant) -> str:
        """The law."""
        channel = variant.options["channel"]
        return f"{channel} += share * sum({channel}[neighbours] - {channel})"

    def sentence(self, variant: Variant, values: Values, view: View) -> str:
        """The share in percent."""
        along = {"both": "its four neighbours", "rows": "its row neighbours", "columns": "its column neighbours"}
        direction = along[str(variant.options["direction"])]
        return f"A pixel leaks {values['share'] * 100:.2f} % of its signal into each of {direction}."

    def next_experiment(self, variant: Variant) -> str:
        """What tells it from blur and glare."""
        return (
            "Light a single pixel through a pinhole, at two focus settings: electrical crosstalk stays with the "
            "pixel's "
            "direct neighbours, blur of the optics changes with the focus, glare reaches far."
        )
