"""The stage angle is off by a constant, or by the direction of travel."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from itertools import product

import numpy as np

from arl_fixtures.reconcile.effect import Effect, Option, Stage, State, Values, Variant
from arl_fixtures.reconcile.effects_bench import is_sharp
from arl_fixtures.reconcile.effects_common import FloatArray, amplitude, per_table
from arl_fixtures.reconcile.effects_encoder import (
    STAGE,
    show_turn,
    turned_angle,
    turned_by,
    turning_channels,
    ways_of_turning,
)
from arl_fixtures.reconcile.effects_way_back import logged_direction
from arl_fixtures.reconcile.view import View


class ZeroOffset(Effect):
    """Every row sees the scene at stage angle + zero, or + backlash · ½·sign of travel, or both.

    Where the angle is right for one direction, the other alone is off: + backlash where the stage came upwards, or
    where it came downwards (`side`). A head that turns round, on no stage, has its azimuths in the stage's place.
    Where every angle is approached from one side, what heats and cools may still turn what holds the stage, and some
    benches sweep one way in either (`by` the ramp).
    """

    id = "stage.zero_offset"
    stage = Stage.BOOKKEEPING
    displaces = True
    shared = True
    source = "geometry: dR/dθ = R·tan(incidence), and the step of the signal at an edge; ISO 230-2 (backlash)"
    confusable = ("mount.tilt", "acquisition.frame_lag", "stage.eccentricity", "stage.periodic_error")

    def variants(self, view: View) -> Iterable[Variant]:
        """A constant; a backlash, alone or beside it, where angles are approached from both sides."""
        angle = turned_by(view)
        if not angle:
            return
        both = angle == STAGE and np.unique(travel(view)[travel(view) != 0.0]).size > 1
        kinds: list[dict[str, Option]] = [{"kind": "constant"}]
        kinds += [{"kind": "backlash", **side} for side in ({}, {"side": "up"}, {"side": "down"})] if both else []
        kinds += [{"kind": "both"}] if both else []
        if angle == STAGE and not both and _heats_and_cools(view):
            kinds.append({"kind": "backlash", "by": "ramp"})
        for told, way in product(kinds, ways_of_turning(view)):
            kind = str(told["kind"])
            yield Variant(
                effect=self.id,
                options={**told, **way},
                parameters=tuple(amplitude(name, "deg", -20.0, 20.0, 0.05) for name in _AMPLITUDES[kind]),
                channels=turning_channels(way, view),
                rough=not way and is_sharp(view),
                drivers=(angle,) if kind == "constant" else (*_direction(told, view), angle),
            )

    def apply(self, variant: Variant, values: Values, state: State, view: View) -> None:
        """Looks the scene up at the true angle."""
        turn: FloatArray | float = float(values.get("zero", 0.0))
        if "backlash" in values:
            way = _way(variant, view)[view.rows]
            turn = turn + float(values["backlash"]) * _part(variant) * _counted(variant, way)
        show_turn(variant, state, view, turn)

    def expression(self, variant: Variant) -> str:
        """The law."""
        side = variant.options.get("side")
        backlash = f"backlash * [came {side}wards]" if side else f"backlash / 2 * {_sign(variant)}"
        added = " + ".join(backlash if p.name == "backlash" else p.name for p in variant.parameters)
        if "channel" in variant.options:
            return f"{variant.options['channel']} += {added}"
        return f"every channel = simulation at {turned_angle(variant)} + {added}"

    def sentence(self, variant: Variant, values: Values, view: View) -> str:
        """The offset."""
        if "backlash" not in values:
            return f"The stage stands {values['zero']:+.3f}° from where its angle says."
        off = f", and stands {values['zero']:+.3f}° off on their average" if "zero" in values else ""
        between = "heating and cooling" if "by" in variant.options else "the two directions of travel (backlash)"
        return f"The stage's angle differs by {values['backlash']:.3f}° between {between}{off}."

    def next_experiment(self, variant: Variant) -> str:
        """What tells zero, tilt and lag apart."""
        return (
            "Sweep the same angles in both directions and home the stage in between: a zero offset stays, a lag "
            "changes "
            "sign, a mounting error differs from DUT to DUT."
        )


_AMPLITUDES = {"constant": ("zero",), "backlash": ("backlash",), "both": ("zero", "backlash")}


def _part(variant: Variant) -> float:
    """Share of the backlash that a direction of travel has."""
    return 1.0 if "side" in variant.options else 0.5


def _counted(variant: Variant, way: FloatArray) -> FloatArray:
    """Sign of travel where both directions are off, else 1 for the one that is."""
    side = variant.options.get("side")
    return way if side is None else np.asarray(way == (1.0 if side == "up" else -1.0), dtype=np.float64)


def _heats_and_cools(view: View) -> bool:
    """Whether a table holds heating and cooling."""
    ramp = view.columns.numbers.get("ramp", np.zeros(0))
    return bool(np.any(ramp > 0.0) and np.any(ramp < 0.0))


def _way(variant: Variant, view: View) -> FloatArray:
    """Direction by which the angle of each row of the whole table is off: ±1, or 0."""
    if "by" in variant.options:
        return np.sign(np.nan_to_num(view.columns.numbers["ramp"]))
    return travel(view)


def _sign(variant: Variant) -> str:
    return f"sign of {variant.options['by']}" if "by" in variant.options else "sign of travel"


def _direction(told: Mapping[str, Option], view: View) -> tuple[str, ...]:
    if "by" in told:
        return (str(told["by"]),)
    found = logged_direction(view)
    return (found[0],) if found else (("time_s",) if view.varies("time_s") else ())


def travel(view: View) -> FloatArray:
    """Direction in which each row of the whole table came to its stage angle: ±1, 0 for the first of a sweep."""

    def make() -> FloatArray:
        logged = logged_direction(view)
        if logged:
            return logged[1]
        place = View(view.columns).acquired_place(1)
        angle = view.columns.numbers["stage_angle_deg"]
        came = np.where(place >= 0, np.sign(angle - angle[place]), 0.0)
        return np.nan_to_num(came)

    return per_table(view, "travel", make)
