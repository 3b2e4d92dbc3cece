"""Frames belong to an earlier stage angle, or are taken while the stage still settles."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from arl_fixtures.reconcile.effect import Effect, Option, Parameter, Stage, State, Values, Variant
from arl_fixtures.reconcile.effects_bench import is_sharp
from arl_fixtures.reconcile.effects_common import (
    GROUPS,
    FloatArray,
    amplitude,
    distances,
    per_table,
    per_view,
    rounded,
    set_light,
    shape,
    signals,
)
from arl_fixtures.reconcile.effects_encoder import encoders, show_turn
from arl_fixtures.reconcile.effects_pointing import scanned_channels, turn_stage
from arl_fixtures.reconcile.effects_scene import scene
from arl_fixtures.reconcile.grouping import GAP_SHARE
from arl_fixtures.reconcile.view import IntArray, View

_PLACES = np.linspace(0.0, 1.0, 6)
"""Shares of the way back to the stage position before at which the scene is looked up."""
_SAME_DEG = 1e-3
"""Readings of one stage position agree this closely."""
_SINGLE = 0.7
"""Share of a table's rows that places make of which several rows are frames."""
_MOST_LACKING = 3.0
"""Positions that a hole of a sweep may be back to the next one known."""
_LONGEST_DELAY_S, _SPEED_UNIT = 2.0, "_deg_s"
_UNEVEN = 0.25
"""Relative scatter of a sweep's steps from which a lag is told from a constant angle."""


class FrameLag(Effect):
    """The frames of a row do not all show its stage position.

    * late: X' = (1 − share)·X + share·X at the stage position `frames` earlier in time.
    * settling: frame k (from 0) is taken at `creep`·exp(−k / decay) of the way back to the position before.
    * on the way: where rows are single frames, each shows one place, at `creep`·exp(−t / decay) of that way, t since
      the first frame at its stage angle; t = 0 where an angle has one frame only.
    * delay: frames are taken on the run, and each shows the angle of `delay` seconds before, at the recorded speed.
    * reading: what an autocollimator or an encoder reads holds `share` of the position before, in whatever order
      positions were visited; of an even sweep that is a constant or a backlash.

    A mixture widens the scatter.
    """

    id = "acquisition.frame_lag"
    stage = Stage.BOOKKEEPING
    displaces = True
    source = (
        "book-keeping: a frame buffer of n frames read n frames late (share 1: all frames of an angle are stale); "
        "settling of a first-order drive"
    )
    mixes = True
    confusable = ("stage.zero_offset", "mount.tilt", "target.edge_mixing")

    def variants(self, view: View) -> Iterable[Variant]:
        """One and two positions late; settling where the scene is scanned, in one of its two forms.

        Single frames of an even sweep, one an angle, are all displaced alike: that is a stage's zero or its backlash.
        """
        if not view.varies("stage_angle_deg"):
            return
        yield from _of_readings(view)
        if not (signals(view) or distances(view)):
            return
        drivers = ("stage_angle_deg", "time_s") if view.varies("time_s") else ("stage_angle_deg",)
        for frames in (1, 2):
            yield Variant(
                effect=self.id,
                options={"frames": frames},
                parameters=(amplitude("share", "1", 0.0, 1.0, 0.2),),
                channels=scanned_channels(view),
                drivers=drivers,
            )
        if scene(view) is None:
            return
        for speed in _speeds(view):
            yield Variant(
                effect=self.id,
                options={"frames": 0, "kind": "delay", "speed": speed},
                parameters=(amplitude("delay", "s", 0.0, _LONGEST_DELAY_S, 0.05),),
                channels=scanned_channels(view),
                drivers=(speed, *drivers),
                rough=is_sharp(view),
            )
        creep, several = (
            amplitude("creep", "1", 0.0, 1.0, 0.2),
            view.has("n_frames") and view.middle("n_frames") >= 2.0,
        )
        longest = _longest_s(view)
        way = _way_back(view, longest)
        if way.since_s.any() and _repeats(view):
            waits = np.unique(way.since_s)
            options: dict[str, Option] = {"frames": 1, "kind": "on the way", "longest_s": longest}
            low, high = float(waits[1]), float(waits[-1])
            parameters: tuple[Parameter, ...] = creep, shape("decay", "s", 0.3 * low, 5.0 * high, 0.5 * high, low)
        elif several:
            count = int(view.middle("n_frames"))
            options = {"frames": 1, "kind": "settling", "averaged": count}
            parameters = creep, shape("decay", "frames", 0.3, 5.0 * count, 0.3 * count)
        elif way.is_uneven:
            options, parameters = {"frames": 1, "kind": "on the way", "longest_s": longest}, (creep,)
        else:
            return
        yield Variant(
            effect=self.id,
            options=options,
            parameters=parameters,
            channels=scanned_channels(view),
            drivers=drivers,
            rough=options["kind"] == "on the way" and is_sharp(view),
        )

    def apply(self, variant: Variant, values: Values, state: State, view: View) -> None:
        """Mixes in what the same pixel saw before, or on the way."""
        if variant.options.get("kind") == "delay":
            speed = np.nan_to_num(view.number(str(variant.options["speed"])))
            turn_stage(view, state, -float(values["delay"]) * speed)
            return
        if variant.options.get("kind") == "on the way":
            way = _way_back(view, float(variant.options["longest_s"]))
            left = np.exp(-way.since_s[view.rows] / float(values["decay"])) if "decay" in values else 1.0
            turn_stage(view, state, float(values["creep"]) * left * way.back_deg[view.rows])
            return
        if "creep" in values:
            _settle(variant, values, state, view)
            return
        if "channel" in variant.options:
            back = _way_back(view, float(variant.options["longest_s"])).back_deg[view.rows]
            show_turn(variant, state, view, float(values["share"]) * back)
            return
        share, frames = float(values["share"]), int(variant.options["frames"])
        missing = _missing_before(view) if frames == 1 else np.zeros(0)
        there = dict(state)
        if missing.any():
            turn_stage(view, there, missing)
        for name in (*signals(view), *distances(view)):
            own = state[name]
            before = view.acquired_before(state, name, frames=frames)
            if missing.any():
                before = np.where(missing != 0.0, there[name], before)
            apart: FloatArray = np.where(np.isfinite(before), before - own, 0.0)
            state[name] = own + share * apart
            scatter = f"{name}_std"
            if scatter in state:
                state[scatter] = np.sqrt(state[scatter] ** 2 + share * (1.0 - share) * np.nan_to_num(apart) ** 2)

    def expression(self, variant: Variant) -> str:
        """The law."""
        if variant.options.get("kind") == "delay":
            return f"X = X at stage_angle_deg - delay * {variant.options['speed']}"
        if variant.options.get("kind") == "settling":
            return "X = mean over frames k of X at stage_angle_deg + creep * exp(-k / decay) * (angle before - angle)"
        if variant.options.get("kind") == "on the way":
            wait = " * exp(-t / decay)" if any(p.name == "decay" for p in variant.parameters) else ""
            return f"X = X at stage_angle_deg + creep{wait} * (angle before - angle)"
        if "channel" in variant.options:
            return f"{variant.options['channel']} += share * (stage angle before - stage_angle_deg)"
        return f"X = (1 - share) * X + share * X[{variant.options['frames']} stage position(s) earlier]"

    def sentence(self, variant: Variant, values: Values, view: View) -> str:
        """Share of stale frames, or how far the stage was from its place."""
        if "delay" in values:
            return f"Frames show where the running stage was {1e3 * float(values['delay']):.1f} ms before."
        if variant.options.get("kind") == "on the way":
            then = f", {values['decay']:.3g} s later a third of that" if "decay" in values else ""
            return (
                f"Frames are taken while the stage still moves: {values['creep'] * 100:.0f} % of the way back to the "
                f"position before{then}."
            )
        if "creep" in values:
            return (
                f"The stage still settles while frames are taken: at the first it is {values['creep'] * 100:.0f} % "
                f"of the way back to the position before, {values['decay']:.1f} frames later a third of that."
            )
        return (
            f"{values['share'] * 100:.0f} % of the frames of an angle still belong to the stage position "
            f"{variant.options['frames']} earlier."
        )

    def next_experiment(self, variant: Variant) -> str:
        """What tells it from a stage zero."""
        return (
            "Sweep the angles in the other direction, or wait longer before each frame set: a lag turns round or "
            "goes."
        )


def _of_readings(view: View) -> Iterable[Variant]:
    """Readings of the stage's angle that lag, where it came from nearer or farther by turns."""
    longest = _longest_s(view)
    if not (encoders(view) and _way_back(view, longest).is_uneven):
        return
    for channel in encoders(view):
        yield Variant(
            effect=FrameLag.id,
            options={"kind": "reading", "channel": channel, "frames": 1, "longest_s": longest},
            parameters=(amplitude("share", "1", 0.0, 1.0, 0.01),),
            channels=(channel,),
            drivers=("stage_angle_deg", "time_s") if view.varies("time_s") else ("stage_angle_deg",),
        )


def _speeds(view: View) -> list[str]:
    """Columns of the stage's speed, positive where its angle grows."""
    return [name for name in view.columns.numbers if name.endswith(_SPEED_UNIT) and view.varies(name)][:1]


@dataclass(frozen=True, slots=True)
class _Way:
    """How each row of the whole table came to its stage angle.

    Attributes:
        back_deg: stage angle before less its own; zero for the first of a sweep, and where the table has a hole.
        since_s: since the first row at this stay; zero without times.
    """

    back_deg: FloatArray
    since_s: FloatArray

    @property
    def is_uneven(self) -> bool:
        """Whether the stage came from nearer or farther by turns."""
        size = np.abs(self.back_deg[self.back_deg != 0.0])
        return bool(size.size) and float(np.std(size)) > _UNEVEN * float(np.mean(size))


def _repeats(view: View) -> bool:
    """Whether rows are single frames: a ray stands at its stage angle several times."""
    same = view.columns.group(*GROUPS["frame"], "ramp", "pixel_u", "pixel_v", "azimuth_deg", "elevation_deg")
    return int(same.max()) + 1 < _SINGLE * view.columns.n


def _stays(view: View) -> tuple[IntArray, IntArray, IntArray]:
    """Rows of the whole table as the stage swept, their stay, and each stay's first row."""
    table = view.columns
    angle, cell = table.numbers["stage_angle_deg"], table.group(*table.sweep_columns)
    order = np.lexsort((angle, table.sweep_order, cell))
    fresh = np.ones(table.n, dtype=bool)
    fresh[1:] = (np.abs(np.diff(angle[order])) > _SAME_DEG) | (np.diff(cell[order]) != 0)
    return order, np.cumsum(fresh) - 1, order[fresh]


def _between(view: View, first: IntArray) -> FloatArray:
    """From the stay before to each stay, in seconds, without times in degrees; infinite for the first of a step."""
    table = view.columns
    time = table.sweep_order[first]
    same = np.diff(table.group(*table.sweep_columns)[first]) == 0
    return np.concatenate([[np.inf], np.where(same, np.diff(time), np.inf)])


def _longest_s(view: View) -> float:
    """What a move takes at most, 1.7 of the usual; farther apart lie stays of which one between is missing."""
    taken = _between(view, _stays(view)[2])
    usual = taken[np.isfinite(taken)]
    return rounded(1.7 * float(np.median(usual))) if usual.size else 0.0


def _way_back(view: View, longest: float) -> _Way:
    def make() -> _Way:
        table = view.columns
        angle = table.numbers["stage_angle_deg"]
        order, stay, first = _stays(view)
        before = np.where(_between(view, first) <= longest, np.roll(angle[first], 1), np.nan)
        back, since = np.zeros(table.n), np.zeros(table.n)
        back[order] = np.nan_to_num(before[stay] - angle[order])
        if view.varies("time_s"):
            time = table.numbers["time_s"]
            since[order] = np.nan_to_num(time[order] - time[first[stay]])
        return _Way(back, since)

    return per_table(view, ("way back", longest), make)


def _settle(variant: Variant, values: Values, state: State, view: View) -> None:
    """Mean over the frames of what is seen on the way, straight lines between the places looked up."""
    frame = np.arange(float(variant.options["averaged"]))
    way = float(values["creep"]) * np.exp(-frame / float(values["decay"]))
    near = np.stack([np.interp(way, _PLACES, corner) for corner in np.eye(len(_PLACES))])  # of each frame, each place
    shares, pairs = near.mean(axis=1), near @ near.T / len(frame)
    seen = per_view(view, "on the way", lambda: _on_the_way(view))
    for name in (*distances(view), *signals(view)):
        own = state[name]
        light = name in signals(view)
        places = [own * change if light else own + change for change in seen[name]]
        mean = own + sum(share * (place - own) for share, place in zip(shares, places, strict=True))
        if light:
            set_light(view, state, name, mean)
        else:
            state[name] = mean
        scatter = f"{name}_std"
        if scatter in state:
            off = [place - mean for place in places]
            wide = sum(pairs[i, j] * off[i] * off[j] for i, j in np.argwhere(pairs > 0.0))
            state[scatter] = np.sqrt(state[scatter] ** 2 + np.maximum(np.nan_to_num(wide), 0.0))


def _logged_before(view: View) -> FloatArray:
    """Stage angle before each row of the whole table, where a column says it; not finite where none does."""
    for name, values in sorted(view.columns.numbers.items()):
        if "stage_angle" in name and any(word in name for word in ("prev", "last", "before", "earlier")):
            return values
    return np.full(view.columns.n, np.nan)


def _missing_before(view: View) -> FloatArray:
    """Way back to the stage position before, degrees, where the table lacks what the same ray saw there; else zero.

    Other rays may have been there, or a column says where the stage was. Where neither tells, it lies a half or a
    third of the way to the one before it, by the time that passed.
    """

    def make() -> FloatArray:
        table = view.columns
        order, longest = table.sweep_order, table.frame_gap_s if view.varies("time_s") else table.sweep_gap_deg
        cell = table.group(*table.sweep_columns, *table.ray_columns)
        place = table.following(("acquired", 1), cell, order, -1)[view.rows]
        far = np.where(place >= 0, np.abs(order[place] - order[view.rows]) * GAP_SHARE / longest, 0.0)
        steps = np.rint(far)  # of the usual size
        lacking = (view.acquired_place(1) < 0) & (steps > 1.0) & (steps <= _MOST_LACKING)
        angle = view.number("stage_angle_deg")
        back = view.take_number("stage_angle_deg", place) - angle
        guessed = np.where(lacking, np.nan_to_num(back) / np.maximum(steps, 1.0), 0.0)
        told = _logged_before(view)[view.rows] - angle
        if not np.isfinite(told).any():
            told = _way_back(view, _longest_s(view)).back_deg[view.rows]
        told = np.nan_to_num(told)
        own = view.take_number("stage_angle_deg", view.acquired_place(1)) - angle
        return np.asarray(np.where(told == 0.0, guessed, np.where(np.abs(own - told) <= _SAME_DEG, 0.0, told)))

    return per_view(view, "missing before", make)


def _on_the_way(view: View) -> dict[str, list[FloatArray]]:
    """By channel, at each of `_PLACES`: ratio of a signal and difference of a distance to the row's own position."""
    place = view.acquired_place(1)
    before = view.take_number("stage_angle_deg", place)
    missing = _missing_before(view)
    back = np.where(missing != 0.0, missing, np.nan_to_num(before - view.number("stage_angle_deg")))
    names = (*signals(view), *distances(view))
    seen: dict[str, list[FloatArray]] = {name: [] for name in names}
    for share in _PLACES:
        there = {name: view.sim[name] for name in names}
        if share > 0.0:
            turn_stage(view, there, share * back)
        for name in names:
            with np.errstate(invalid="ignore", divide="ignore"):
                change = there[name] / view.sim[name] if name in signals(view) else there[name] - view.sim[name]
            seen[name].append(np.where(np.isfinite(change), change, 1.0 if name in signals(view) else 0.0))
    return seen
