"""What steps share is told from what they owe to a recorded condition, whatever the law."""

import numpy as np
import pytest

from arl_fixtures.reconcile.followed import condition_of, followed_law
from arl_fixtures.reconcile.problem import Problem
from arl_fixtures.reconcile.table import load_table

STEPS = 24


def followed(tmp_path, make_table, save, seed, shift_of):
    """Condition that a distance's steps follow when each is off by `shift_of(temperature, time, rng)`, in metres."""

    def change(columns, rng):
        first = np.unique(columns["step"] + 100.0 * (columns["dut"] == "S1"), return_index=True)
        warm, time = columns["housing_temperature_c"][first[1]], columns["time_s"][first[1]]
        shift = dict(zip(first[0], shift_of(warm, time, rng), strict=True))
        key = columns["step"] + 100.0 * (columns["dut"] == "S1")
        columns["distance_m"] = columns["distance_m"] + np.array([shift[k] for k in key])

    table = save(tmp_path / f"{seed}.parquet", make_table(seed, change, steps=STEPS))
    problem = Problem(load_table(table))
    data = next(d for d in problem.data if d.channel.name == "distance_m")
    return condition_of(problem, data, "step", problem.view.fresh_state())


@pytest.mark.parametrize("seed", range(60, 64))
def test_scatter_follows_nothing(tmp_path, make_table, save, seed):
    assert followed(tmp_path, make_table, save, seed, lambda warm, _t, rng: 2e-3 * rng.normal(size=warm.size)) == ""


def test_a_wave_in_temperature_is_followed_although_no_parabola_shows_it(tmp_path, make_table, save):
    name = followed(tmp_path, make_table, save, 70, lambda warm, _t, _rng: 3e-3 * np.sin(warm / 6.0))
    assert name.endswith("temperature_c")


def test_a_random_walk_is_a_drift_in_time(tmp_path, make_table, save):
    def walk(_warm, time, rng):
        return 1e-3 * np.cumsum(rng.normal(size=time.size))[np.argsort(np.argsort(time, kind="stable"))]

    assert followed(tmp_path, make_table, save, 71, walk) == "time_s"


def test_a_condition_that_no_library_knows_is_followed(tmp_path, make_table, save):
    """A shaker's level, logged once a step: any steady column counts, not only those of the bench."""
    made = make_table(72, None, steps=STEPS)
    rng = np.random.default_rng(7)
    level = rng.gamma(2.0, 0.6, STEPS)[made["step"].astype(int)]
    made["vibration_ms2"] = level
    made["distance_m"] = made["distance_m"] + 2e-3 * level
    problem = Problem(load_table(save(tmp_path / "shaken.parquet", made)))
    data = next(d for d in problem.data if d.channel.name == "distance_m")
    assert condition_of(problem, data, "step", problem.view.fresh_state()) == "vibration_ms2"


@pytest.mark.parametrize(("bend", "kinds"), [(0.0, ["linear"]), (1.0, ["linear", "square"])])
def test_what_steps_follow_is_foretold_of_steps_that_were_left_out(tmp_path, make_table, save, bend, kinds):
    def fan(speed):  # air that a fan moves cools the housing of the clock: no column but the speed tells
        return 1e-3 * (speed + bend * speed**2)

    made = make_table(73, None, steps=STEPS)
    speed = np.random.default_rng(8).uniform(0.0, 3.0, STEPS)[made["step"].astype(int)]
    made["fan_speed"], made["distance_m"] = speed, made["distance_m"] + fan(speed)
    kept = made["step"] < 18
    problem = Problem(load_table(save(tmp_path / "fan.parquet", {n: v[kept] for n, v in made.items()})))
    data = next(d for d in problem.data if d.channel.name == "distance_m")
    terms = followed_law(problem, data, "step", problem.view.fresh_state(), "fan_speed")
    assert [term.axes[0].kind for term in terms] == kinds
    unseen = {"fan_speed": np.unique(speed[~kept])}
    told = sum(term.value * term.axes[0](unseen) for term in terms)
    off = told - fan(unseen["fan_speed"])
    assert np.std(off) < 0.15 * np.std(told)


def test_a_wave_between_conditions_is_foretold_by_no_parabola(tmp_path, make_table, save):
    made = make_table(74, None, steps=STEPS)
    made["distance_m"] = made["distance_m"] + 3e-3 * np.sin(made["housing_temperature_c"] / 6.0)
    problem = Problem(load_table(save(tmp_path / "wave.parquet", made)))
    data = next(d for d in problem.data if d.channel.name == "distance_m")
    assert followed_law(problem, data, "step", problem.view.fresh_state(), "housing_temperature_c") == []
