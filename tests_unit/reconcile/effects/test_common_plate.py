"""Two devices on one plate: what was logged beside the one is known of the other, unless it was another run."""

import numpy as np
import pytest
from rendered_bench import corrected, left_over, make_columns, variant_of
from scipy.integrate import solve_ivp

from arl_fixtures.reconcile.effects_history import history
from arl_fixtures.reconcile.view import View

COURSE = ([0.0, 600.0, 2400.0, 3000.0, 4200.0, 6000.0], [20.0, 20.0, 70.0, 70.0, -10.0, -10.0])


def plate_at(time):
    return np.interp(time, *COURSE)


def late_at(time, tau):
    """A body that the plate warms, marched by an integrator."""
    found = solve_ivp(
        lambda t, x: [(plate_at(t) - x[0]) / tau], (0.0, 6000.0), [20.0], rtol=1e-8, max_step=10.0, dense_output=True
    )
    return found.sol(time)[0]


def two_devices(logged, tau=500.0, cycles=(1.0, 1.0)):
    """A is asked every 15 s, B at seven moments; B's distance follows its late board, as A's does."""
    time = np.concatenate([np.arange(0.0, 6000.0, 15.0), [700.0, 1500.0, 2300.0, 3300.0, 4100.0, 4900.0, 5900.0]])
    second = np.arange(time.size) >= time.size - 7
    numbers = {
        "time_s": time, "cycle": np.where(second, cycles[1], cycles[0]), "sim_distance_m": np.full(time.size, 2.0),
        "plate_temperature_c": logged(time, second),
        "distance_m": 2.0 + 1e-4 * (late_at(time, tau) - plate_at(time)),
    }  # fmt: skip
    view = View(make_columns(numbers, {"dut": np.where(second, "B", "A")}, shuffle=3)[0])
    return view, view.selects("dut", "B")


def shared_log(time, second):
    return plate_at(time)


def log_beside_the_first_only(time, second):
    return np.where(second, np.nan, plate_at(time))


def own_thermometers(time, second):
    return plate_at(time) + np.where(second, 0.7, 0.0)


@pytest.mark.parametrize("logged", [shared_log, log_beside_the_first_only, own_thermometers])
def test_a_device_asked_seldom_knows_its_plate_from_the_one_asked_often(logged):
    view, second = two_devices(logged)
    variant = variant_of(view, "timing.thermal_lag", temperature="plate_temperature_c", kind="difference")
    state = corrected(view, variant, slope=1e-4, time_constant=500.0)
    moved = view.number("distance_m")[second] - 2.0
    missed = view.number("distance_m")[second] - state["distance_m"][second]
    assert np.sum(missed**2) < 0.01 * np.sum(moved**2)
    assert left_over(view, state, "distance_m") < 0.01


def test_a_run_with_another_course_lends_nothing():
    """The second device saw the plate at other temperatures at the same times: these are its own."""

    def other_course(time, second):
        return np.where(second, plate_at(np.mod(time + 1500.0, 6000.0)), plate_at(time))

    view, second = two_devices(other_course)
    record = history(view, "plate_temperature_c")
    time = np.arange(record.values.shape[1]) * record.interval
    own = np.argsort(view.number("time_s")[second])
    at, logged = (view.number(name)[second][own] for name in ("time_s", "plate_temperature_c"))
    found = [np.interp(at, time, values) for values in record.values]
    assert min(np.abs(values - logged).max() for values in found) < 2.0
    kept = record.values[np.argmin([np.abs(values - logged).max() for values in found])]
    np.testing.assert_allclose(kept, np.interp(time, at, logged), atol=2.0)


def test_devices_of_different_cycles_lend_nothing_to_each_other():
    view, _ = two_devices(log_beside_the_first_only, cycles=(1.0, 2.0))
    record = history(view, "plate_temperature_c")
    flat = np.ptp(record.values, axis=1)
    assert sorted(flat > 1.0) == [False, True]


def test_a_housing_is_a_devices_own():
    view, _ = two_devices(shared_log)
    view.columns.numbers["housing_temperature_c"] = view.number("plate_temperature_c").copy()
    pooled, own = history(view, "plate_temperature_c").values, history(view, "housing_temperature_c").values
    differ = np.abs(pooled - own).max(axis=1)
    assert differ.min() < 0.5
    assert differ.max() > 5.0
