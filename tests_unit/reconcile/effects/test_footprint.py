"""A scene between samples a pixel apart, against pixels that average a scene of surfaces and edges."""

import numpy as np
import pytest

from arl_fixtures.reconcile.effects_footprint import cells_of, sharp_curve, with_edges
from arl_fixtures.reconcile.effects_scene import curves_over_bearing

WIDTH_DEG = 2.0


def scene(bearing):
    """Light of three boards, the last one slanted."""
    return 1.0 + 2.0 * (bearing > 3.3) - 1.5 * (bearing > 11.7) + 0.05 * np.maximum(bearing - 20.0, 0.0)


def seen(bearing):
    across = (np.arange(801) - 400) / 801.0 * WIDTH_DEG
    return scene(bearing[:, None] + across).mean(axis=1)


@pytest.mark.parametrize("step", [1.0, 1.3, 2.0, 2.4])
def test_what_a_small_turn_changes_is_the_light_of_pixels_that_hold_an_edge(step):
    bearing = np.arange(-20.0, 30.0, step)
    values = seen(bearing)
    place = bearing[3:-3] + 0.05
    change = seen(place) - values[3:-3]
    sharp = sharp_curve(bearing, values[None, :], WIDTH_DEG, place)[0] - values[3:-3]
    straight = np.interp(place, bearing, values) - values[3:-3]
    assert np.sum((sharp - change) ** 2) < 0.5 * np.sum((straight - change) ** 2)
    assert np.corrcoef(sharp, change)[0, 1] > 0.85


def test_the_curve_passes_through_its_samples_and_keeps_a_ratio_that_no_edge_changes():
    bearing = np.arange(-20.0, 30.0, 2.0)
    values = np.stack([seen(bearing), 2.5 * seen(bearing)])
    assert sharp_curve(bearing, values, WIDTH_DEG, bearing) == pytest.approx(values, rel=1e-9)
    between = sharp_curve(bearing, values, WIDTH_DEG, bearing[:-1] + 0.7)
    assert between[1] / between[0] == pytest.approx(2.5, rel=1e-9)


def test_a_slope_stays_a_slope():
    bearing = np.arange(0.0, 40.0, 2.0)
    place = np.arange(4.0, 36.0, 0.5)
    made = sharp_curve(bearing, (0.1 * bearing)[None, :], WIDTH_DEG, place)[0]
    assert made == pytest.approx(0.1 * place, abs=0.01)


def test_curves_of_close_samples_are_left_alone():
    bearing = np.tile(np.arange(0.0, 30.0, 0.5), 2)
    line = np.repeat([0, 1], 60)
    bearing[60:] = np.repeat(np.arange(0.0, 30.0, 2.0), 4)  # every bearing four times
    cells = cells_of(line, bearing, np.full(120, WIDTH_DEG))
    assert cells.width.tolist() == [0.0, WIDTH_DEG]
    assert cells.mean(np.where(line == 1, bearing, np.nan)) == pytest.approx(np.arange(0.0, 30.0, 2.0))


@pytest.mark.parametrize("width", [0.0, 1e-6])
def test_pixels_far_narrower_than_their_distance_tell_nothing_of_what_lies_between(width):
    cells = cells_of(np.zeros(20, dtype=np.int64), np.arange(0.0, 40.0, 2.0), np.full(20, width))
    straight = {"light": np.ones((1, 5))}
    assert cells.width.tolist() == [0.0]
    assert cells.curves(straight, {"light": np.ones(20)}, 1.0) is straight


def curve_of(bearing, values, step=0.05):
    """The curve through the samples of one line, straight between them and with edges in the gaps."""
    line, place = np.zeros(bearing.size, dtype=np.int64), bearing / step
    straight = {name: curves_over_bearing(line, place, row, 1) for name, row in values.items()}
    return straight, with_edges(line, bearing, np.full(bearing.size, WIDTH_DEG), values, straight, step)


def test_an_edge_whose_mixed_pixels_were_left_out_does_not_move_the_light_of_pure_ones():
    bearing = np.sort(np.random.default_rng(4).uniform(0.0, 30.0, 300))
    edges = np.array([3.3, 11.7])
    bearing = bearing[np.abs(bearing[:, None] - edges).min(axis=1) > 0.6 * WIDTH_DEG]
    straight, made = curve_of(bearing, {"light": seen(bearing), "moment": 1.5 * seen(bearing)})
    place = np.arange(made["light"].size) * 0.05
    beside = np.abs(np.abs(place[:, None] - edges).min(axis=1) - 0.6 * WIDTH_DEG) < 0.1  # a small turn into the gap
    wrong, right = (np.abs(found["light"][0] - seen(place))[beside] for found in (straight, made))
    assert right.max() < 0.1 * wrong.max()
    np.testing.assert_allclose(made["moment"], 1.5 * made["light"], rtol=1e-9)  # one edge, common to all
    crossed = np.interp(edges, place, made["light"][0])
    assert crossed == pytest.approx(seen(edges), abs=0.2)  # within a quarter of the gap about its middle


@pytest.mark.parametrize(
    "law", [lambda x: 0.1 * x, lambda x: np.sin(x / 12.0), lambda x: 1.0 + 0.002 * (x - 15) ** 2]
)
def test_a_gap_in_what_changes_gradually_is_no_edge(law):
    bearing = np.concatenate([np.arange(0.0, 11.0, 0.3), np.arange(16.0, 30.0, 0.3)])
    straight, made = curve_of(bearing, {"light": law(bearing)})
    np.testing.assert_array_equal(made["light"], straight["light"])
    few = np.arange(0.0, 30.0, 5.0)  # nor are samples that all lie far apart
    straight, made = curve_of(few, {"light": 0.1 * few})
    np.testing.assert_array_equal(made["light"], straight["light"])
