"""Melting or freezing water holds a temperature near 0 °C."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import product

import numpy as np
from scipy.signal import lfilter

from arl_fixtures.reconcile.effect import Effect, Option, Stage, State, Values, Variant
from arl_fixtures.reconcile.effects_common import FloatArray, amplitude, is_of, shape
from arl_fixtures.reconcile.effects_history import History, history, low_pass, on_rows, rate
from arl_fixtures.reconcile.roles import Role
from arl_fixtures.reconcile.view import View


class LatentHeat(Effect):
    """Enthalpy method: dH/dt = (T_drive − T) / τ, with T = H, then held while `latent` K melt, then T = H − latent.

    T_drive = T_sim + τ dT_sim/dt is what drives the simulated node; `latent` is the latent heat over the node's heat
    capacity. Water on a plate holds the nodes on it too: they follow its deviation within `follow`. Where the
    simulation of the nodes was given the plate as it was recorded, they have the plateau already (option `alone`).
    Water that touches the node through a `film` gives and takes (melting_point − T) / film instead of holding it.
    """

    id = "thermal.latent_heat"
    stage = Stage.BOOKKEEPING
    source = "Voller, Int. J. Numer. Methods Eng. 24 (1987): enthalpy formulation; ice 334 kJ/kg"
    confusable = ("thermal.contact_resistance", "thermal.sensor_offset")

    def variants(self, view: View) -> Iterable[Variant]:
        """One per temperature channel that passes 0 °C in time; of a plate with and without the nodes on it."""
        for channel in view.channels(Role.TEMPERATURE):
            low, high = view.span(f"sim_{channel.name}")
            record = history(view, f"sim_{channel.name}")
            if record is None or low > -0.5 or high < 0.5:
                continue
            duration = record.interval * record.values.shape[1]
            carried = _carried(view, channel.name)
            film = shape("film", record.unit, record.interval, duration, 0.01 * duration, 0.1 * duration)
            for others, through in product(((), carried) if carried else ((),), ((), (film,))):
                follow = (
                    (shape("follow", record.unit, 0.2 * record.interval, 0.1 * duration, 40.0),) if others else ()
                )
                options: dict[str, Option] = {"alone": True} if carried and not others else {}
                tau = (record.interval, 0.3 * duration, 0.005 * duration, 0.05 * duration)
                yield Variant(
                    effect=self.id,
                    options={"channel": channel.name, **options, **({"through": "film"} if through else {})},
                    parameters=(
                        amplitude("latent", "K", 0.0, 200.0, 30.0),
                        shape("time_constant", record.unit, *tau),
                        shape("melting_point", "°C", -4.0, 4.0, 0.0),
                        *follow,
                        *through,
                    ),
                    channels=(channel.name, *others),
                    drivers=(f"sim_{channel.name}", "time_s" if view.varies("time_s") else "step"),
                )

    def apply(self, variant: Variant, values: Values, state: State, view: View) -> None:
        """Solves the node again with the plateau."""
        name = str(variant.options["channel"])
        record = history(view, f"sim_{name}")
        if record is None or float(values["latent"]) == 0.0:
            return
        tau, point, latent = (float(values[key]) for key in ("time_constant", "melting_point", "latent"))
        held = _plateau(record, tau, point, latent, float(values.get("film", 0.0)))
        deviation = held - _plateau(record, tau, point, 0.0)
        state[name] = state[name] + on_rows(view, deviation)
        if "follow" in values:
            late = low_pass(deviation, record.interval / float(values["follow"]))
            for other in variant.channels[1:]:
                state[other] = state[other] + on_rows(view, late)

    def where(self, variant: Variant, values: Values, view: View) -> dict[str, list[str] | list[float]]:
        """About the melting point."""
        point = float(values["melting_point"])
        return {f"sim_{variant.options['channel']}": [point - 5.0, point + 15.0]}

    def expression(self, variant: Variant) -> str:
        """The law."""
        name = variant.options["channel"]
        if "through" in variant.options:
            return (
                f"d{name}/dt = dsim_{name}/dt + (sim_{name} - {name}) / time_constant + (melting_point - {name}) / "
                "film while 0 to latent K of water are molten"
            )
        return (
            f"time_constant * dH/dt = sim_{name} + time_constant * dsim_{name}/dt - {name}; {name} = H below "
            "melting_point, melting_point while latent melts, H - latent above"
        )

    def sentence(self, variant: Variant, values: Values, view: View) -> str:
        """Size of the plateau."""
        return (
            f"{variant.options['channel']} is held at {values['melting_point']:.1f} °C by melting or freezing water "
            f"({values['latent']:.2g} K worth of its heat capacity)."
        )

    def next_experiment(self, variant: Variant) -> str:
        """What confirms it."""
        return "Repeat the ramp through 0 °C after an hour at 60 °C in dry air: without water the plateau is gone."


def _carried(view: View, channel: str) -> tuple[str, ...]:
    """Temperature channels of the nodes that stand on a plate; none for another node."""
    if not is_of(channel, "plate"):
        return ()
    others = (entry.name for entry in view.channels(Role.TEMPERATURE))
    return tuple(name for name in others if name != channel and not is_of(name, "coolant", "ambient", "chamber"))


def _plateau(record: History, tau: float, point: float, latent: float, film: float = 0.0) -> FloatArray:
    """Temperature of the node with `latent` kelvin to melt at `point`; implicit, so stable at any step."""
    drive = record.values + tau * rate(record)
    gain = 1.0 - float(np.exp(-record.interval / tau))
    pushed = 0.5 * (drive[:, :-1] + drive[:, 1:])
    if latent == 0.0:  # nothing to melt: the same recursion, at once
        first = record.values[:, :1]
        later, _ = lfilter([gain], [1.0, gain - 1.0], pushed - first, axis=1, zi=np.zeros((len(first), 1)))
        return np.concatenate([first, first + later], axis=1)
    result = np.empty_like(record.values)
    for row, (now, pushes) in enumerate(zip(record.values[:, 0].tolist(), pushed.tolist(), strict=True)):
        if film > 0.0:
            result[row] = _wetted(now, pushes, gain, point, latent, record.interval / film)
        else:
            result[row] = _melted(now, pushes, gain, point, latent)
    return result


def _melted(now: float, pushes: list[float], gain: float, point: float, latent: float) -> list[float]:
    """One record; plain numbers, for each needs the one before."""
    heat = now + latent if now > point else now
    held = [now]
    for push in pushes:
        heat += gain * (push - now)
        now = heat if heat < point else heat - latent
        if heat >= point > now:
            now = point
        held.append(now)
    return held


def _wetted(now: float, pushes: list[float], gain: float, point: float, latent: float, share: float) -> list[float]:
    """The same where the water lies behind a film, through which a share of the difference passes in an interval."""
    molten = latent if now > point else 0.0
    share = share / (1.0 + share)  # implicit
    held = [now]
    for push in pushes:
        now += gain * (push - now)
        before = molten
        molten = min(max(molten + share * (now - point), 0.0), latent)
        now -= molten - before
        held.append(now)
    return held
