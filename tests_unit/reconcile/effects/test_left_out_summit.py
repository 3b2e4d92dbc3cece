"""A temperature whose highest step is not in the table: both flanks say how high it was, and a lag needs that."""

import numpy as np
import pytest
from rendered_bench import corrected, make_columns, variant_of
from scipy.integrate import solve_ivp

from arl_fixtures.reconcile.effects_history import history
from arl_fixtures.reconcile.view import View

STEP_S, STEPS, SUMMIT = 600.0, 21, 10


def up_and_down(time):
    """5 K more with each step up to the summit, then 5 K less."""
    return np.interp(time, [0.0, SUMMIT * STEP_S, 2 * SUMMIT * STEP_S], [20.0, 70.0, 20.0])


def late_at(time, course, tau):
    """A die that the housing warms, marched by an integrator."""
    found = solve_ivp(
        lambda t, x: [(course(t) - x[0]) / tau], (0.0, float(np.max(time))), [20.0], rtol=1e-8, max_step=20.0,
        dense_output=True,
    )  # fmt: skip
    return found.sol(time)[0]


def table(course, left_out, named_steps=True, tau=500.0):
    """Three looks in each step, some steps left out."""
    step = np.repeat(np.arange(STEPS), 3)
    time = STEP_S * step + np.tile([0.0, 6.0, 12.0], STEPS)
    kept = ~np.isin(step, left_out)
    step, time = step[kept], time[kept]
    numbers = {
        "time_s": time, "housing_temperature_c": course(time), "sim_distance_m": np.full(time.size, 2.0),
        "distance_m": 2.0 + 1e-4 * (late_at(time, course, tau) - course(time)),
    }  # fmt: skip
    if named_steps:
        numbers["step"] = step.astype(float)
    return View(make_columns(numbers, {}, shuffle=5)[0])


@pytest.mark.parametrize("left_out", [[SUMMIT], [4, SUMMIT, 12, 16], [SUMMIT, SUMMIT + 1]])
@pytest.mark.parametrize("named_steps", [True, False])
def test_a_lag_knows_the_summit_that_was_left_out(left_out, named_steps):
    view = table(up_and_down, left_out, named_steps)
    variant = variant_of(view, "timing.thermal_lag", temperature="housing_temperature_c", kind="difference")
    state = corrected(view, variant, slope=1e-4, time_constant=500.0)
    moved, missed = view.number("distance_m") - 2.0, view.number("distance_m") - state["distance_m"]
    assert np.max(np.abs(missed)) < 0.03 * np.max(np.abs(moved))


def soaked(time):
    """Held at the summit for a step's time: the table has all steps, one of them took longer."""
    return np.interp(time, [0.0, 3000.0, 4800.0, 7800.0], [20.0, 45.0, 45.0, 20.0])


def test_a_summit_is_not_made_up_where_a_step_took_longer():
    step = np.arange(11)
    time = np.where(step <= 5, STEP_S * step, STEP_S * (step + 2))
    view = View(
        make_columns(
            {
                "time_s": time, "step": step.astype(float), "housing_temperature_c": soaked(time),
                "sim_distance_m": np.full(step.size, 2.0), "distance_m": np.full(step.size, 2.0),
            },
            {},
        )[0]
    )  # fmt: skip
    assert history(view, "housing_temperature_c").values.max() <= 45.0


def test_steps_in_quick_succession_leave_none_out():
    """Steps 4 to 6 are one look to whoever tells looks by their times; between 6 and 7 there is none."""
    time = STEP_S * np.array([0.0, 1.0, 2.0, 3.0, 4.0, 4.1, 4.2, 5.2, 6.2, 7.2, 8.2])
    readings = np.array([20.0, 25.0, 30.0, 35.0, 40.0, 40.5, 40.5, 38.0, 33.0, 28.0, 23.0])
    numbers = {
        "time_s": time, "step": np.arange(11.0), "housing_temperature_c": readings,
        "sim_distance_m": np.full(11, 2.0), "distance_m": np.full(11, 2.0),
    }  # fmt: skip
    view = View(make_columns(numbers, {})[0])
    assert history(view, "housing_temperature_c").values.max() <= readings.max() + 1e-9


def quick_up_slow_down(time):
    return np.interp(time, [0.0, SUMMIT * STEP_S, 2 * SUMMIT * STEP_S], [20.0, 70.0, 60.0])


def wandering(time):
    return 20.0 + np.cumsum(np.where(np.arange(time.size) % 4 < 2, 2.0, -2.0))


@pytest.mark.parametrize("course", [quick_up_slow_down, wandering])
def test_a_summit_is_not_made_up_of_flanks_that_do_not_agree(course):
    view = table(course, [SUMMIT]) if course is quick_up_slow_down else _seldom(course)
    readings = view.number("housing_temperature_c")
    assert history(view, "housing_temperature_c").values.max() <= readings.max() + 1e-9


def _seldom(course):
    time = STEP_S * np.delete(np.arange(24.0), [5, 11, 14])
    numbers = {
        "time_s": time, "housing_temperature_c": course(time), "sim_distance_m": np.full(time.size, 2.0),
        "distance_m": np.full(time.size, 2.0),
    }  # fmt: skip
    return View(make_columns(numbers, {})[0])
