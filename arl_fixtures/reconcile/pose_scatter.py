"""How far a stage stands from where it was sent, at random from image to image: what all edges of an image share.

A stage repeats a position to some hundredths of a degree. Where a surface fills the pixel nothing of it is seen; the
pixels at edges move all together, up at the one side of a panel and down at the other. Taken for independent noise,
or for none, it would tell of anything that only edges show. Its size is estimated like that of every other scatter
that rows share; what moves all images alike, or as a smooth function of the stage angle, is no scatter.
"""

from __future__ import annotations

import numpy as np

from arl_fixtures.reconcile.channel_data import ChannelData
from arl_fixtures.reconcile.columns import BoolArray, FloatArray, IntArray
from arl_fixtures.reconcile.effect import State
from arl_fixtures.reconcile.effects_bench import is_sharp
from arl_fixtures.reconcile.effects_common import distances, per_view, signals
from arl_fixtures.reconcile.effects_pointing import turn_stage
from arl_fixtures.reconcile.effects_scene import scene
from arl_fixtures.reconcile.noise import POSE, Level, less_shared
from arl_fixtures.reconcile.roles import Role
from arl_fixtures.reconcile.view import View

TURN_DEG = 0.02
"""Half of the turn over which a slope is told: of the order of what stages miss their positions by."""
FEWEST_IMAGES, FEWEST_BEYOND = 12, 6
"""Images that must show an edge for their scatter to be told, at all and beyond what follows the angle."""
EDGE = 0.02
"""Share of its image's largest slope (in standard errors) from which a row shows an edge."""
LEAST_APART = 1e-6
"""Share of an image's squared slopes that must be left beside a gain of it: a board that fills the pixel has none but
for rounding."""
LIKELY = 3.0
"""Standard errors by which images must differ in how they stand, for it to be asked for at all."""
MOST_OFF = 9.0
"""Squared standard errors at which an image counts at most: what is off at one edge of two images is no stage."""
HARMONICS = (1.0, 2.0)
"""Half waves over the sweep that a displacement may follow: an axis beside the centre, the turn of an encoder."""


def add_pose(data: ChannelData, view: View, frame: IntArray | None) -> None:
    """Give a channel the scatter of its images' poses, where a stage turns the sensor and they seem to scatter.

    Args:
        data: of a signal or a distance; view: its rows; frame: image of each row of the whole table, None for none.
    """
    if frame is None or data.channel.role not in {Role.INTENSITY, Role.DISTANCE}:
        return
    if not view.varies("stage_angle_deg") or scene(view) is None:
        return
    slopes = per_view(view, "pose slopes", lambda: _slopes(view))
    if data.channel.name not in slopes:
        return
    slope = np.nan_to_num(slopes[data.channel.name][data.use] * data.expect)
    angle_deg = np.nan_to_num(view.number("stage_angle_deg"))[data.use]
    level = pose_level(data, slope, frame[view.rows[data.use]], angle_deg)
    if level is not None and scatters(data, level, data.residual(view.sim)):
        data.share_within(level)


def pose_level(data: ChannelData, slope: FloatArray, image: IntArray, angle_deg: FloatArray) -> Level | None:
    """The level of images' poses; None where too few images show an edge.

    Args:
        data: of the channel; slope: change of each row by a degree of the stage; image, angle_deg: of each row.
    """
    present, code = np.unique(image, return_inverse=True)
    weight = data.root_weight**2
    slope = np.where(_shows_edge(slope * data.root_weight, code), slope, 0.0)
    power = np.bincount(code, weight * slope**2)
    slope = less_shared(slope, data.scale, weight, code.astype(np.int64))  # beside what an image shares as a gain
    seen = np.bincount(code, weight * slope**2) > LEAST_APART * power
    slope = np.where(seen[code], slope, 0.0)
    first = np.unique(code, return_index=True)[1]  # an image is of one unit at one angle
    smooth = _smooth(angle_deg[first], data.unit[first])
    if np.count_nonzero(seen) < max(FEWEST_IMAGES, smooth.shape[1] + FEWEST_BEYOND):
        return None
    return Level(name=POSE, code=code.astype(np.int64), count=len(present), scale=slope, smooth=smooth)


def scatters(data: ChannelData, level: Level, residual: FloatArray) -> bool:
    """Whether images stand apart from one another by more than their rows' noise."""
    weight = data.root_weight**2
    beside = less_shared(residual, data.scale, weight, level.code)
    power: FloatArray = np.bincount(level.code, weight * level.scale**2).astype(np.float64)
    score: FloatArray = np.bincount(level.code, weight * level.scale * beside).astype(np.float64)
    pull, seen = level.beyond_smooth(score, power), power > 0.0
    beyond = float(np.mean(np.minimum(pull[seen] ** 2 / power[seen], MOST_OFF))) - 1.0
    return beyond > LIKELY * float(np.sqrt(2.0 / np.count_nonzero(seen)))


def beside_pose(level: Level, z: FloatArray, shape: FloatArray) -> FloatArray:
    """What rows are off beside how their image stands, as far as its other rows tell.

    Args:
        level: of the poses; z: of each row, in its standard errors; shape: what a degree makes of it.

    Returns:
        In standard errors, (n,); `z` where it is no more than what would be left.
    """
    pull, power = np.bincount(level.code, shape * z)[level.code], np.bincount(level.code, shape**2)[level.code]
    others = power - shape**2
    told = others > shape**2  # or one row says nearly all of it
    beside = z - shape * np.divide(pull - shape * z, others, out=np.zeros_like(z), where=told)
    return np.where(np.abs(beside) < np.abs(z), beside, z)


def _shows_edge(slope: FloatArray, code: IntArray) -> BoolArray:
    most = np.zeros(int(code.max()) + 1)
    np.maximum.at(most, code, np.abs(slope))
    return np.asarray(np.abs(slope) > EDGE * most[code])


def _slopes(view: View) -> dict[str, FloatArray]:
    """Change of every signal and distance by a degree of the stage, by row."""
    sides: list[State] = []
    for turn in (-TURN_DEG, TURN_DEG):
        state = view.fresh_state()
        turn_stage(view, state, turn, whole=is_sharp(view))
        sides.append(state)
    names = (*signals(view), *distances(view))
    return {name: np.asarray((sides[1][name] - sides[0][name]) / (2.0 * TURN_DEG)) for name in names}


def _smooth(angle_deg: FloatArray, unit: IntArray) -> FloatArray:
    """Functions of the stage angle that laws of displacements follow, by unit; (images, functions)."""
    span = max(float(np.ptp(angle_deg)), 1e-9)
    turn = np.pi * (angle_deg - float(angle_deg.min())) / span
    waves = [np.ones(len(turn)), *(f(n * turn) for n in HARMONICS for f in (np.cos, np.sin))]
    mine = unit[:, None] == np.unique(unit)
    return np.concatenate([mine * wave[:, None] for wave in waves], axis=1)
