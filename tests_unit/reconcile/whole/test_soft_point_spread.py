"""Simulations whose pixels have a point spread of their own: the nominal bench traced through many scattered rays."""

from copy import deepcopy
from functools import cache

import numpy as np
import pytest
from scipy.special import ndtri
from traced_bench import LIGHT, RANGE, THIRDS, table

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.columns import find_channels
from arl_fixtures.reconcile.effects_bench import bench_of
from arl_fixtures.reconcile.effects_rays import Pose
from arl_fixtures.reconcile.effects_render import as_simulated, rendered
from arl_fixtures.reconcile.view import View

NORMAL = ndtri((np.arange(7) + 0.5) / 7)
SPREAD_PX, TURN_DEG = 0.28, 0.15


def through(spread_px):
    """Places of rays that fill a pixel and scatter about it."""
    within = (np.arange(5) - 2.0) / 5.0
    return tuple((within[:, None] + spread_px * (NORMAL / NORMAL.std())[None, :]).ravel())


def only(columns, channel):
    """The table without all that tells of its other channels."""
    other = RANGE if channel == LIGHT else LIGHT
    columns.numbers = {name: x for name, x in columns.numbers.items() if other not in name}
    columns.channels = find_channels(set(columns.numbers))
    return columns


@pytest.fixture(scope="module")
def soft():
    @cache
    def traced(**other):
        return table(places=through(SPREAD_PX), turn_deg=TURN_DEG, noise=False, angles=31, pixels=16, **other)

    return lambda **other: deepcopy(traced(**other))


def test_the_spread_is_read_off_the_simulation(soft):
    bench = bench_of(View(soft()))
    assert not bench.sharp
    assert abs(bench.optics.spread_px - SPREAD_PX) < 0.06


def test_a_spread_is_seen_by_a_few_rows_at_edges():
    """So few that nearly all rows agree with sharp rays: who made the table has left most mixed pixels out."""
    columns, sharp = (
        table(places=places, noise=False, angles=31, pixels=40) for places in (through(0.2), THIRDS)
    )  # fmt: skip
    at_edges = np.abs(np.log(columns.numbers[f"sim_{LIGHT}"] / sharp.numbers[f"sim_{LIGHT}"])) > 4e-3
    kept = ~at_edges | (np.cumsum(at_edges) % 60 == 0)
    assert 0 < np.mean(at_edges[kept]) < 0.01
    columns.numbers = {name: x[kept] for name, x in columns.numbers.items()}
    columns.categories = {name: (codes[kept], labels) for name, (codes, labels) in columns.categories.items()}
    columns.n = int(kept.sum())
    bench = bench_of(View(columns))
    assert not bench.sharp
    assert 0.1 < bench.optics.spread_px < 0.26


@pytest.mark.parametrize(("channel", "most"), [(LIGHT, 0.1), (RANGE, 0.15)])
def test_one_channel_tells_of_the_bench_and_of_a_stage_that_is_off(soft, channel, most):
    columns = only(soft(), channel)
    view = View(columns)
    there, here = rendered(view, Pose(turn_deg=TURN_DEG)), rendered(view)
    change = columns.numbers[channel] - columns.numbers[f"sim_{channel}"]
    predicted = there[channel] - here[channel]
    if channel == LIGHT:
        predicted = predicted * columns.numbers[f"sim_{channel}"] / here[channel]
    assert np.sum((change - predicted) ** 2) < most * np.sum(change**2)


@pytest.mark.parametrize("channel", [LIGHT, RANGE])
def test_one_channel_of_another_bench_is_not_taken_for_the_nominal_one(soft, channel):
    assert bench_of(View(only(soft(arc_m=1.0), channel))) is None


def test_a_leak_of_what_lies_about_a_sharp_ray_is_told_with_its_width():
    sharp, whole = (table(places=places, noise=False, angles=31, pixels=16) for places in ((0.0,), through(0.35)))
    share, numbers = 0.03, sharp.numbers
    light = (1.0 - share) * numbers[LIGHT] + share * whole.numbers[LIGHT]
    moment = (1.0 - share) * numbers[LIGHT] * numbers[RANGE] + share * whole.numbers[LIGHT] * whole.numbers[RANGE]
    numbers[LIGHT], numbers[RANGE] = light, moment / light
    view = View(sharp)
    assert bench_of(view).sharp
    variant = next(
        v for v in library()["target.edge_mixing"].variants(view) if v.options.get("kind") == "blurred"
    )
    left = {}
    for blur in (0.05, 0.35, 0.8):
        state = view.fresh_state()
        library()["target.edge_mixing"].apply(variant, {"share": share, "blur": blur}, state, view)
        rest = np.log(view.number(LIGHT) / state[LIGHT])[as_simulated(view)]
        left[blur] = float(np.sum(rest**2))
    before = np.log(view.number(LIGHT) / view.sim[LIGHT])[as_simulated(view)]
    assert left[0.35] < 0.03 * np.sum(before**2)
    assert left[0.35] < 0.3 * min(left[0.05], left[0.8])
    assert np.mean(as_simulated(view)) > 0.95
