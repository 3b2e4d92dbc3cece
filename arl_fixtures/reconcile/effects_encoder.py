"""What an error of the stage shows in: the scene that rows see, or a channel that reads its angle or place itself.

Such a channel is an encoder on the shaft, an autocollimator, or the distance to what a linear stage carries.
"""

from __future__ import annotations

import numpy as np

from arl_fixtures.reconcile.effect import Option, State, Variant
from arl_fixtures.reconcile.effects_common import FloatArray, distances, per_table
from arl_fixtures.reconcile.effects_illumination import turns_round
from arl_fixtures.reconcile.effects_pointing import by_whole_pixels, scanned_channels, turn_stage, ways_of_looking
from arl_fixtures.reconcile.effects_scene import scene
from arl_fixtures.reconcile.roles import Role, unit_of
from arl_fixtures.reconcile.view import View

STAGE = "stage_angle_deg"
_LENGTHS = frozenset({"m", "cm", "mm"})
_SLIDES = frozenset({"stage", "slide", "rail", "carriage", "spindle"})
_MOVES_WITH = 0.9
"""Correlation with a linear stage's place from which a simulated distance is one to what stands on it."""
_FOLLOWS = 0.999
"""Correlation with the stage's angle from which a simulated angle is that of the stage."""


def encoders(view: View) -> tuple[str, ...]:
    """Channels in degrees whose simulation turns with the stage."""

    def make() -> tuple[str, ...]:
        turning = [channel.name for channel in view.channels(Role.OTHER) if unit_of(channel.name) == "deg"]
        return tuple(name for name in turning if _goes_along(view, name, "stage_angle_deg", _FOLLOWS))

    return per_table(view, "encoders", make) if view.varies("stage_angle_deg") else ()


def slides(view: View) -> tuple[tuple[str, str], ...]:
    """Channels in a unit of length that read where a linear stage stands, and the column of its position."""

    def make() -> tuple[tuple[str, str], ...]:
        places = [
            column for column in view.covariates()
            if _SLIDES & set(column.split("_")) and unit_of(column) in _LENGTHS and view.varies(column)
        ]  # fmt: skip
        read = [name for name in distances(view) if unit_of(name) in _LENGTHS]
        return tuple((n, column) for column in places for n in read if _goes_along(view, n, column, _MOVES_WITH))

    return per_table(view, "slides", make)


def _goes_along(view: View, channel: str, column: str, least: float) -> bool:
    """Whether a channel's simulation is a line over a column, by their correlation."""
    place, simulated = view.columns.numbers[column], view.columns.numbers[f"sim_{channel}"]
    good = np.isfinite(place) & np.isfinite(simulated)
    if good.sum() < 3 or np.ptp(simulated[good]) == 0.0 or np.ptp(place[good]) == 0.0:
        return False
    return abs(float(np.corrcoef(place[good], simulated[good])[0, 1])) > least


def turned_by(view: View) -> str:
    """Column of the angle to which something is turned: of the stage, or of a head that turns round on none."""
    if view.varies(STAGE):
        return STAGE
    return "azimuth_deg" if turns_round(view) else ""


def ways_of_turning(view: View) -> tuple[dict[str, Option], ...]:
    """Options of the ways in which the true angle may show: by the scene, and by each encoder of a stage."""
    looking = ways_of_looking(view) if scene(view) is not None else ()
    if turned_by(view) != STAGE:
        return tuple({**way, "head": turned_by(view)} for way in looking)
    return (*looking, *({"channel": name} for name in encoders(view)))


def turned_angle(variant: Variant) -> str:
    """Column of the angle that a variant of the `ways_of_turning` is about."""
    return str(variant.options.get("head", STAGE))


def turning_channels(way: dict[str, Option], view: View) -> tuple[str, ...]:
    """Channels that one of the `ways_of_turning` acts on."""
    return (str(way["channel"]),) if "channel" in way else scanned_channels(view)


def show_turn(variant: Variant, state: State, view: View, turn_deg: FloatArray | float) -> None:
    """Let the variant's encoder read, or every row see, what it would at stage angle + `turn_deg`."""
    if "channel" in variant.options:
        channel = str(variant.options["channel"])
        state[channel] = state[channel] + turn_deg
        return
    turn_stage(view, state, turn_deg, whole=by_whole_pixels(variant))
