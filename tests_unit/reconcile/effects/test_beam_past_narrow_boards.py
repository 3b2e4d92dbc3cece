"""A beam that a stage turns past boards of a few angles each, and past a post: what few rays tell, and what none."""

import numpy as np
import pyarrow as pa
import pytest
from rendered_bench import corrected, left_over, variant_of

from arl_fixtures.reconcile.table import columns_of
from arl_fixtures.reconcile.view import View

LINES = (
    # ends (ahead, right) in m
    ((2.4, -6.0), (4.9, -2.2)), ((2.2, -0.95), (2.2, -0.29)), ((5.7, -3.5), (5.7, 3.5)), ((3.5, 0.55), (2.68, 1.42)),
    ((4.6, 2.5), (1.0, 2.25)),
)  # fmt: skip
POST = (np.array([3.1, -0.35]), 0.05)
"""Its middle and radius, m."""


def ranges(bearing_deg):
    """Nearest crossing of rays from the origin with the lines and the post, by Cramer's rule and Pythagoras."""
    ray = np.stack([np.cos(np.radians(bearing_deg)), np.sin(np.radians(bearing_deg))], axis=-1)
    found = np.full(bearing_deg.shape, np.inf)
    for start, end in ((np.array(a), np.array(b)) for a, b in LINES):
        along = end - start
        area = ray[:, 0] * along[1] - ray[:, 1] * along[0]
        far = (start[0] * along[1] - start[1] * along[0]) / area
        share = (start[0] * ray[:, 1] - start[1] * ray[:, 0]) / area
        found = np.where((far > 0.0) & (share >= 0.0) & (share <= 1.0), np.minimum(found, far), found)
    middle, radius = POST
    beside = ray[:, 0] * middle[1] - ray[:, 1] * middle[0]
    depth = ray @ middle - np.sqrt(np.maximum(radius**2 - beside**2, 0.0))
    return np.where(np.abs(beside) < radius, np.minimum(found, depth), found)


@pytest.mark.parametrize("seed", [1, 2])
def test_a_stage_off_by_less_than_its_stride_turns_the_beam_along_each_board(seed):
    rng = np.random.default_rng(seed)
    angle = np.arange(-55.0, 55.0, 1.8)
    angle = np.sort(rng.choice(angle, 50, replace=False))
    off_deg = 0.07
    before, after = ranges(angle), ranges(angle + off_deg)
    same = np.abs(after / before - 1.0) < 0.02  # has not come to another board
    made = {"stage_angle_deg": angle[same], "sim_distance_m": before[same], "distance_m": after[same]}
    made["dut"] = np.repeat(["a", "b"], same.sum())
    view = View(columns_of(pa.table({name: np.resize(values, made["dut"].size) for name, values in made.items()})))
    state = corrected(view, variant_of(view, "stage.zero_offset"), zero=off_deg)
    assert left_over(view, state, "distance_m") < 0.05
