"""Frames belong to an earlier stage angle, or are taken while the stage still settles."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from arl_fixtures.reconcile.columns import BoolArray, IntArray
from arl_fixtures.reconcile.effect import Effect, Option, Parameter, Stage, State, Values, Variant
from arl_fixtures.reconcile.effects_bench import is_sharp
from arl_fixtures.reconcile.effects_common import (
    GROUPS,
    FloatArray,
    amplitude,
    distances,
    per_view,
    set_light,
    shape,
    signals,
)
from arl_fixtures.reconcile.effects_encoder import encoders, show_turn
from arl_fixtures.reconcile.effects_pointing import scanned_channels, turn_stage
from arl_fixtures.reconcile.effects_scene import scene
from arl_fixtures.reconcile.effects_way_back import (
    logged_direction,
    longest_s,
    missing_before,
    stride_back,
    stride_of,
    thinned_by,
    way_back,
)
from arl_fixtures.reconcile.still_scene import is_still
from arl_fixtures.reconcile.view import View

_PLACES = np.array([0.0, 0.003, 0.01, 0.04, 0.1, 0.2, 0.4, 0.6, 0.8, 1.0])
"""Shares of the way back to the stage position before at which the scene is looked up: close where little is left."""
_SINGLE = 0.7
"""Share of a table's rows that places make of which several rows are frames."""
_LONGEST_DELAY_S, _SPEED_UNIT = 2.0, "_deg_s"


class FrameLag(Effect):
    """The frames of a row do not all show its stage position.

    * late: X' = (1 − share)·X + share·X at the stage position `frames` earlier in time. Of a sweep that the table
      holds few positions of (`stride_deg`: between two of the whole sweep) that is a stride back the way it came.
      `mean` tells of distances whether they are means over frames, or of exposures that add up the light of both.
    * settling: frame k (from 0) is taken at `creep`·exp(−k / decay) of the way back to the position before.
    * on the way: where rows are single frames, each shows one place, at `creep`·exp(−t / decay) of that way, t since
      the first frame at its stage angle; t = 0 where an angle has one frame only.
    * delay: frames are taken on the run, and each shows the angle of `delay` seconds before, at the recorded speed.
    * reading: what an autocollimator or an encoder reads holds `share` of the position before, in whatever order
      positions were visited; of an even sweep that is a constant or a backlash.

    A mixture of frames widens the scatter.
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
        if signals(view) and distances(view):
            yield Variant(
                effect=self.id,
                options={"frames": 1, "mean": "by light"},
                parameters=(amplitude("share", "1", 0.0, 1.0, 0.2),),
                channels=scanned_channels(view),
                drivers=drivers,
            )
        logged = logged_direction(view)
        if logged and stride_of(view) and is_still(view.columns):
            yield Variant(
                effect=self.id,
                options={"frames": 1, "way": logged[0], "stride_deg": stride_of(view)},
                parameters=(amplitude("share", "1", 0.0, 1.0, 0.2),),
                channels=scanned_channels(view),
                drivers=("stage_angle_deg", logged[0]),
            )
        if scene(view) is None:
            return
        stride = thinned_by(view)
        if stride:
            yield Variant(
                effect=self.id,
                options={"frames": 1, "stride_deg": stride},
                parameters=(amplitude("share", "1", 0.0, 1.0, 0.2),),
                channels=scanned_channels(view),
                drivers=drivers,
                rough=is_sharp(view),
            )
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
        longest = longest_s(view)
        way = way_back(view, longest)
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
            way = way_back(view, float(variant.options["longest_s"]))
            left = np.exp(-way.since_s[view.rows] / float(values["decay"])) if "decay" in values else 1.0
            turn_stage(view, state, float(values["creep"]) * left * way.back_deg[view.rows])
            return
        if "creep" in values:
            _settle(variant, values, state, view)
            return
        if "channel" in variant.options:
            back = way_back(view, float(variant.options["longest_s"])).back_deg[view.rows]
            show_turn(variant, state, view, float(values["share"]) * back)
            return
        share, frames = float(values["share"]), int(variant.options["frames"])
        missing, there, held = _missing(variant, view), dict(state), None
        if missing.any() and _asks_others(variant, view):  # a curve over the bearing may jump there by metres
            held = _held(variant, view, missing)
        elif missing.any():
            turn_stage(view, there, missing)
        seen: dict[str, FloatArray] = {}
        for name in (*signals(view), *distances(view)):
            seen[name] = view.acquired_before(state, name, frames=frames)
            if missing.any():
                told = there[name] if held is None else view.seen_elsewhere(state, name, held)
                seen[name] = np.where(missing != 0.0, told, seen[name])
        by_light: FloatArray | float = share
        if "mean" in variant.options:
            name = signals(view)[0]
            brighter = seen[name] / state[name]
            by_light = np.nan_to_num(share * brighter / (1.0 - share + share * brighter), nan=share)
        for name, before in seen.items():
            own, part = state[name], by_light if name in distances(view) else share
            apart: FloatArray = np.where(np.isfinite(before), before - own, 0.0)
            state[name] = own + part * apart
            scatter = f"{name}_std"
            if scatter in state and "mean" not in variant.options:
                state[scatter] = np.sqrt(state[scatter] ** 2 + part * (1.0 - part) * apart**2)

    def unsure(self, variant: Variant, view: View) -> BoolArray | None:
        """Rows of a thinned table whose ray no step holds at the position before."""
        late = not {"kind", "channel"} & set(variant.options) and int(variant.options["frames"]) == 1
        if not late or not _asks_others(variant, view):
            return None
        missing = _missing(variant, view)
        return np.asarray((missing != 0.0) & (_held(variant, view, missing) < 0))

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
        if "stride_deg" in variant.options:
            way = f"by {variant.options['way']}" if "way" in variant.options else "in the sweep"
            return f"X = (1 - share) * X + share * X[{variant.options['stride_deg']:g} deg back {way}]"
        law = f"X = (1 - share) * X + share * X[{variant.options['frames']} stage position(s) earlier]"
        return f"{law}, distances by light" if "mean" in variant.options else law

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
        what = "exposure" if "mean" in variant.options else "frames"
        return (
            f"{values['share'] * 100:.2g} % of the {what} of an angle still belong to the stage position "
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
    longest = longest_s(view)
    if not (encoders(view) and way_back(view, longest).is_uneven):
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


def _missing(variant: Variant, view: View) -> FloatArray:
    """Way back to the position before where a ray's own sweep does not tell it, degrees; else zero."""
    if "way" in variant.options:
        logged = logged_direction(view)
        way = logged[1][view.rows] if logged and logged[0] == variant.options["way"] else np.zeros(view.n)
        return np.asarray(-float(variant.options["stride_deg"]) * way)
    if "stride_deg" in variant.options:
        return stride_back(view, float(variant.options["stride_deg"]))
    return missing_before(view) if int(variant.options["frames"]) == 1 else np.zeros(view.n)


def _asks_others(variant: Variant, view: View) -> bool:
    """Whether other steps tell what a sweep lacks: of a scene that stands still, at angles that some of them hold."""
    return is_still(view.columns) and ("way" in variant.options or "stride_deg" not in variant.options)


def _held(variant: Variant, view: View, missing: FloatArray) -> IntArray:
    """Whole-table rows of other steps that hold what a ray saw at the position before; −1 where none does."""
    angle = view.number("stage_angle_deg") + missing
    return per_view(view, ("held before", variant.label), lambda: view.elsewhere_place(angle))


def _repeats(view: View) -> bool:
    """Whether rows are single frames: a ray stands at its stage angle several times."""
    same = view.columns.group(*GROUPS["frame"], "ramp", "pixel_u", "pixel_v", "azimuth_deg", "elevation_deg")
    return int(same.max()) + 1 < _SINGLE * view.columns.n


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


def _on_the_way(view: View) -> dict[str, list[FloatArray]]:
    """By channel, at each of `_PLACES`: ratio of a signal and difference of a distance to the row's own position."""
    place = view.acquired_place(1)
    before = view.take_number("stage_angle_deg", place)
    missing = missing_before(view)
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
