"""Few steps tell little of what they share, and one step's image tells enough."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats

from arl_fixtures.reconcile.law_search import is_law, search_law
from arl_fixtures.reconcile.law_steps import of_few_steps
from arl_fixtures.reconcile.law_work import Work
from arl_fixtures.reconcile.noise import Level
from arl_fixtures.reconcile.pilot import Looker
from arl_fixtures.reconcile.problem import Problem
from arl_fixtures.reconcile.robust import log_beta
from arl_fixtures.reconcile.roles import PIXEL
from arl_fixtures.reconcile.table import load_table


def steps(count, *, declared=False):
    floor = 1.0 if declared else 0.0
    return Level(
        name="step", code=np.arange(count), count=count, scale=np.ones(count), floor=floor, declared=declared
    )


@pytest.mark.parametrize(("count", "coefficients"), [(5, 1), (7, 1), (7, 3), (40, 2)])
def test_chance_exceeds_the_worth_of_a_gain_as_often_as_with_a_known_scatter(count, coefficients):
    rng = np.random.default_rng(5)
    shapes = np.column_stack([np.ones(count), rng.normal(size=(count, coefficients))])
    y = rng.normal(size=(4000, count))
    left = y - y @ np.linalg.pinv(shapes).T @ shapes.T
    level = y - y.mean(axis=1, keepdims=True)
    gains = 0.5 * count * np.log(np.sum(level**2, axis=1) / np.sum(left**2, axis=1))  # the scatter at its best twice
    worth = np.array([of_few_steps(float(g), coefficients, steps(count)) for g in gains])
    for share in (0.3, 0.05):
        rare = 0.5 * stats.chi2.isf(share, coefficients)
        assert np.mean(worth > rare) == pytest.approx(share, abs=4.0 * np.sqrt(share / 4000))


def test_a_stated_scatter_is_not_told_from_the_steps():
    assert of_few_steps(9.0, 1, steps(5, declared=True)) == 9.0
    assert of_few_steps(9.0, 1, steps(5)) < 5.0


@pytest.mark.parametrize(
    ("shape", "found"),
    [
        (lambda c: (c["pixel_v"] / 31.0) ** 2 - 1.0 / 3.0, True),  # the image of one step is another
        (lambda _: 1.0, False),  # what a step's rows share may be its own error
    ],
)
def test_a_single_step_may_tell_of_what_lies_within_its_image(tmp_path, make_table, save, shape, found):
    def shaken(columns, _rng):
        shaking = columns["step"] == 3
        columns["vibration_g"] = 0.1 * columns["step"] + 3.0 * shaking
        columns["distance_m"] = columns["distance_m"] + 6e-3 * shape(columns) * shaking

    columns = load_table(save(tmp_path / "shaken.parquet", make_table(71, shaken, duts=1)))
    looker = Looker(Problem(columns))
    data = next(d for d in looker.problem.data if d.channel.name == "distance_m")
    looker.calibrate(data, looker.problem.view.fresh_state())
    _, chosen = search_law(looker, data, looker.problem.view.fresh_state(), ["vibration_g", "pixel_v"])
    assert is_law(chosen) == found


@pytest.mark.parametrize(("steps_off", "found"), [(2, False), (14, True)])
def test_two_readings_of_the_only_edge_tell_nothing_of_edges(tmp_path, make_table, save, steps_off, found):
    """One pixel at one angle sees an edge. It is off in the last two steps, or in all."""

    def at_the_edge(columns, _rng):
        pixel = columns["pixel_u"] + 1000.0 * columns["pixel_v"]
        columns["mixed"] = (pixel == pixel[3]) & (columns["stage_angle_deg"] == columns["stage_angle_deg"][0])
        off = columns["mixed"] & (columns["step"] >= 14 - steps_off)
        columns["distance_m"] = columns["distance_m"] + 9.0 * columns["sim_distance_m_std"] / np.sqrt(10.0) * off

    columns = load_table(save(tmp_path / "edge.parquet", make_table(71, at_the_edge, duts=1)))
    looker = Looker(Problem(columns))
    data = next(d for d in looker.problem.data if d.channel.name == "distance_m")
    data.trust = np.ones(len(data.use))  # they stand by each other
    data.rebuild(data.tau)
    looker.calibrate(data, looker.problem.view.fresh_state())
    _, chosen = search_law(looker, data, looker.problem.view.fresh_state(), ["mixed", "step"])
    assert chosen.terms
    assert (chosen.rows > 10.0) == found
    assert is_law(chosen) == found


def test_a_gain_beyond_any_probability_is_worth_its_logarithm():
    """A law of a hundred steps that leaves next to nothing has no tail that a number holds, and is not infinite."""
    worth = [of_few_steps(float(gain), 2, steps(100)) for gain in (600.0, 800.0, 1600.0, 16_000.0)]
    assert np.all(np.isfinite(worth))
    assert np.all(np.diff(worth) > 0.0)
    assert worth[-1] == pytest.approx(16_000.0, rel=0.05)
    assert log_beta(-3.0, 4.0, 0.5) == pytest.approx(float(stats.beta.logcdf(np.exp(-3.0), 4.0, 0.5)))
    assert log_beta(-200.0, 4.0, 0.5) == pytest.approx(float(stats.beta.logcdf(np.exp(-150.0), 4.0, 0.5)) - 200.0)


def test_a_pixel_is_shared_by_the_rows_of_a_step_where_a_step_has_one():
    """Numbers of devices lie far apart, so that those of their pixels seem alike."""
    step, device = np.repeat(np.arange(8), 5), np.repeat([3e9, 8e9], 20)
    for pixel, alone in ((device, True), (device + np.tile(np.arange(5.0), 8), False)):
        work = SimpleNamespace(step=step, features={PIXEL: pixel, "tof_temperature_c": 1.0 * step})
        assert Work.is_shared(work, (PIXEL, "tof_temperature_c")) is alone
