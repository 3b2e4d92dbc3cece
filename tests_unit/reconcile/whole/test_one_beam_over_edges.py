"""A single beam that a stage turns over the edges of boards, of which it samples a few angles: traced with fine rays.

What its neighbours on the sweep see tells how a surface goes on; across an edge they tell nothing of it.
"""

import numpy as np
import pytest

from arl_fixtures.reconcile.columns import Columns
from arl_fixtures.reconcile.effects_scene import scene
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.view import View
from tests_unit.reconcile.rendered_bench import corrected, variant_of
from tests_unit.reconcile.whole.test_seldom_names import columns_of

STEP_DEG, WIDE_DEG, ACROSS = 0.6, 0.58, 256
SWEEP = np.setdiff1d(np.arange(-60, 61), np.arange(24, 34)) * STEP_DEG
"""A tenth of the sweep is missing; on one side of it samples lie beside an edge."""
STAND_OFFS, PAINTS = (1.1, 1.5, 2.0, 2.6), (0.2, 0.5, 0.8)
WALL_M, WALL, LEFT_M, RIGHT_M = 4.4, 0.35, -0.83, 0.61
LIGHT, FAR = "intensity_counts", "distance_m"


def seen(angle_deg, board_m, paint):
    """Light and range by light of beams a little wider than a few rays, at true angles."""
    light, moment = np.zeros(angle_deg.size), np.zeros(angle_deg.size)
    for part in (np.arange(ACROSS) + 0.5) / ACROSS - 0.5:
        angle = np.radians(angle_deg + part * WIDE_DEG)
        across = board_m * np.tan(angle)
        on = (across > LEFT_M) & (across < RIGHT_M)
        far = np.where(on, board_m, WALL_M) / np.cos(angle)
        one = 8e3 * np.where(on, paint, WALL) * np.cos(angle) / far**2 / ACROSS
        light, moment = light + one, moment + one * far
    return light, moment / light


def goniometer(turn, channels=(LIGHT, FAR), seed=5) -> Columns:
    """Sweeps before boards of three paints at four stand-offs, whose true angle is off by `turn` of the angle."""
    rng = np.random.default_rng(seed)
    step, angle = (a.ravel() for a in np.meshgrid(np.arange(12), SWEEP, indexing="ij"))
    board, paint = np.array(STAND_OFFS)[step % 4], np.array(PAINTS)[step // 4]
    nominal, real = (
        dict(zip((LIGHT, FAR), seen(at, board, paint), strict=True)) for at in (angle, angle + turn(angle))
    )
    table = {
        "step": step, "stage_angle_deg": angle, "board_range_m": board, "reflectance": paint,
        "motor_current_a": 0.8 + rng.normal(0.0, 0.03, angle.size), "n_frames": np.full(angle.size, 8.0),
    }  # fmt: skip
    spread = {LIGHT: np.sqrt(20.0 + nominal[LIGHT]), FAR: 0.15 / np.sqrt(20.0 + nominal[LIGHT])}
    for name in channels:
        repeat = 1e-3 * (nominal[name] if name == LIGHT else 1.0)
        measured = real[name] + rng.normal(0.0, spread[name] / np.sqrt(8.0)) + repeat * rng.normal(size=12)[step]
        table |= {f"sim_{name}": nominal[name], f"sim_{name}_std": spread[name],
                  f"sim_{name}_repeat_std": np.broadcast_to(repeat, angle.shape), name: measured}  # fmt: skip
    return columns_of(table)


def worm(angle_deg):
    return 0.15 * np.sin(2.0 * np.pi * angle_deg / 15.0 + 0.7)


def test_the_worm_that_turns_a_beam_is_named():
    findings = diagnose(goniometer(worm))[0].findings
    assert [found.effect for found in findings] == ["stage.periodic_error"]
    period = next(p for p in findings[0].parameters if p.name == "period")
    assert period.value == pytest.approx(15.0, rel=0.02)


@pytest.mark.parametrize("channels", [(LIGHT, FAR), (LIGHT,)], ids=["light and range", "light"])
def test_a_beam_beside_an_edge_sees_its_own_surface(channels):
    """Turned by a tenth of the beam: what does not reach an edge changes by what its own surface does, no more."""
    view = View(goniometer(lambda angle: 0.0 * angle, channels))
    angle, board = view.number("stage_angle_deg"), view.number("board_range_m")
    there = seen(angle + 0.04, board, view.number("reflectance"))[0]
    state = corrected(view, variant_of(view, "stage.zero_offset"), zero=0.04)
    across = board[:, None] * np.tan(np.radians(angle[:, None] + np.array([-0.5, 0.5]) * (WIDE_DEG + 0.1)))
    mixed = np.any([np.prod(across - edge, axis=1) < 0.0 for edge in (LEFT_M, RIGHT_M)], axis=0)
    assert 10 < np.count_nonzero(mixed) < 40
    off = ((state[LIGHT] - there) / there)[~mixed & (angle < SWEEP[-1])]
    assert np.max(np.abs(off)) < 1.5e-3


def test_boards_at_other_stand_offs_are_other_scenes():
    """One curve through all of them would be none of any."""
    view = View(goniometer(worm))
    found = scene(view)
    for line in np.unique(found.line):
        rows = found.line == line
        assert np.unique(view.number("board_range_m")[rows]).size == 1
        assert np.unique(view.number("reflectance")[rows]).size == 1


def test_light_that_only_a_laser_dims_shows_one_scene():
    """A laser that warms from sweep to sweep: all light falls alike, and all sweeps tell one curve."""
    columns = goniometer(worm)
    keep = np.flatnonzero((columns.numbers["board_range_m"] == 2.0) & (columns.numbers["reflectance"] == 0.5))
    one = {name: np.tile(values[keep], 3) for name, values in columns.numbers.items()}
    one["step"] = np.repeat([0.0, 1.0, 2.0], keep.size)
    one[f"sim_{LIGHT}"] = one[f"sim_{LIGHT}"] * (1.0 - 0.08 * one["step"])
    assert np.unique(scene(View(columns_of(one))).line).size == 1
