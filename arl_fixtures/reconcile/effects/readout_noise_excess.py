"""More scatter than the noise model says, everywhere or under a condition."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from arl_fixtures.reconcile.effect import Effect, Option, Parameter, Stage, State, Values, Variant
from arl_fixtures.reconcile.effects_common import amplitude, rounded, shape, temperature_drivers
from arl_fixtures.reconcile.roles import Role
from arl_fixtures.reconcile.view import View


class NoiseExcess(Effect):
    """σ² = (σ·(1 + factor·c))² + (added·c)², with a condition c between 0 and 1.

    c is 1 everywhere; or 2^((T − highest)/doubling) of a temperature; or a smooth step above or below a knee; or one
    direction of the ramp.
    """

    id = "readout.noise_excess"
    stage = Stage.READOUT
    source = "EMVA 1288 (2021): temporal dark noise and total SNR of image sensors"
    confusable = ("laser.pulse_energy_jitter", "detector.dark_offset", "bench.repeatability")

    def variants(self, view: View) -> Iterable[Variant]:
        """Per scatter channel: everywhere, with a temperature, beyond a knee of it, on one ramp."""
        columns = temperature_drivers(
            view, "tof_temperature_c", "fpga_temperature_c", "housing_temperature_c", limit=1
        )
        for channel in view.channels(Role.SCATTER):
            yield self._variant(view, channel.name, {"condition": "everywhere"}, (), ())
            for column in columns:
                low, high = view.span(column)
                growth = shape("doubling", "K", 3.0, 200.0, 20.0)
                options: dict[str, Option] = {"temperature": column, "highest": rounded(high)}
                yield self._variant(view, channel.name, {"condition": "growing", **options}, (growth,), (column,))
                knee = shape("knee", "°C", low, high, low + 0.75 * (high - low), low + 0.25 * (high - low))
                for side in ("above", "below"):
                    start = Parameter(
                        name="knee",
                        unit="°C",
                        low=low,
                        high=high,
                        starts=(knee.starts[0 if side == "above" else -1],),
                    )
                    options = {"condition": side, "temperature": column, "width": rounded(0.01 * (high - low))}
                    yield self._variant(view, channel.name, options, (start,), (column,))
            if view.varies("ramp"):
                for label, sign in (("heating", 1.0), ("cooling", -1.0)):
                    yield self._variant(view, channel.name, {"condition": label, "ramp": sign}, (), ("ramp",))

    def _variant(
        self,
        view: View,
        name: str,
        options: dict[str, Option],
        shapes: tuple[Parameter, ...],
        drivers: tuple[str, ...],
    ) -> Variant:
        values = view.columns.numbers[f"sim_{name}"]
        finite = values[np.isfinite(values)]
        usual = max(float(np.median(finite)), 1e-12) if finite.size else 1.0
        unit = next(channel.unit for channel in view.columns.channels if channel.name == name)
        return Variant(
            effect=self.id,
            options={"channel": name, **options},
            parameters=(
                amplitude("factor", "1", 0.0, 20.0, 0.1),
                amplitude("added", unit, 0.0, 50.0 * usual, 0.3 * usual),
                *shapes,
            ),
            channels=(name,),
            drivers=drivers or (f"sim_{name}",),
        )

    def apply(self, variant: Variant, values: Values, state: State, view: View) -> None:
        """Widens the scatter."""
        name = str(variant.options["channel"])
        under = _condition(variant, values, view)
        scaled = state[name] * (1.0 + float(values["factor"]) * under)
        state[name] = np.sqrt(scaled**2 + (float(values["added"]) * under) ** 2)

    def where(self, variant: Variant, values: Values, view: View) -> dict[str, list[str] | list[float]]:
        """Beyond the knee, or on the ramp."""
        condition = variant.options["condition"]
        if condition in ("above", "below"):
            column = str(variant.options["temperature"])
            low, high = view.span(column)
            return {column: [float(values["knee"]), high] if condition == "above" else [low, float(values["knee"])]}
        if "ramp" in variant.options:
            return {"ramp": [float(variant.options["ramp"]), float(variant.options["ramp"])]}
        return {}

    def expression(self, variant: Variant) -> str:
        """The law."""
        name = variant.options["channel"]
        column = variant.options.get("temperature", "")
        condition = {
            "everywhere": "1",
            "growing": f"2^(({column} - {variant.options.get('highest', 0.0)}) / doubling)",
            "above": f"({column} > knee)",
            "below": f"({column} < knee)",
            "heating": "(ramp > 0)",
            "cooling": "(ramp < 0)",
        }[str(variant.options["condition"])]
        return f"{name}^2 = ({name} * (1 + factor * c))^2 + (added * c)^2, c = {condition}"

    def sentence(self, variant: Variant, values: Values, view: View) -> str:
        """Factor and condition."""
        name, column = str(variant.options["channel"]), variant.options.get("temperature", "")
        state = {name: view.sim[name]}
        self.apply(variant, values, state, view)
        ratio = float(np.nanquantile(state[name] / view.sim[name], 0.95)) if view.n else 1.0
        condition = {
            "everywhere": "everywhere",
            "growing": f"at the highest {column}, less below",
            "above": f"above {values.get('knee', 0.0):.1f} °C of {column}",
            "below": f"below {values.get('knee', 0.0):.1f} °C of {column}",
            "heating": "while heating",
            "cooling": "while cooling",
        }[str(variant.options["condition"])]
        return f"{name} is up to {ratio:.2f} times what the noise model says, {condition}."

    def next_experiment(self, variant: Variant) -> str:
        """What shows its origin."""
        return "Record dark frames (window covered) and frames of one bright target: read-out noise is in both alike."


def _condition(variant: Variant, values: Values, view: View) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    condition = variant.options["condition"]
    if condition == "everywhere":
        return np.ones(view.n)
    if "ramp" in variant.options:
        return np.where(view.number("ramp") * float(variant.options["ramp"]) > 0.0, 1.0, 0.0)
    warm = np.nan_to_num(view.number(str(variant.options["temperature"])))
    if condition == "growing":
        return np.exp2(np.clip((warm - float(variant.options["highest"])) / float(values["doubling"]), -60.0, 4.0))
    side = 1.0 if condition == "above" else -1.0
    return 0.5 + 0.5 * np.tanh(side * (warm - float(values["knee"])) / float(variant.options["width"]))
