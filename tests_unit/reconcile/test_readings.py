"""A logged temperature scatters about what the temperature was; effects follow the latter, unless they do not."""

import numpy as np
import pytest

from arl_fixtures.reconcile.columns import Columns, find_channels
from arl_fixtures.reconcile.readings import smooth_readings
from arl_fixtures.reconcile.view import View

STEPS, FRAMES, PIXELS = 12, 10, 20


def bench(read, act, seed=1, frames=FRAMES, drift=0.4):
    """A body that drifts in each step; `read` logs it, `act` says what of body and log the signal follows."""
    rng = np.random.default_rng(seed)
    step, frame, u = (
        a.ravel() for a in np.meshgrid(np.arange(STEPS), np.arange(frames), np.arange(PIXELS), indexing="ij")
    )
    body = 7.0 * np.arange(STEPS)[:, None] + drift * np.linspace(-1.0, 1.0, frames)
    logged = read(body, rng)
    light = 500.0 * (1.0 - 0.002 * act(body, logged)[step, frame])
    noise = 2.0
    numbers = {
        "step": step.astype(float), "time_s": 600.0 * step + 20.0 * frame, "pixel_u": u.astype(float),
        "tof_temperature_c": logged[step, frame], "n_frames": np.full(u.size, 10.0),
        "sim_intensity_counts": np.full(u.size, 500.0), "sim_intensity_counts_std": np.full(u.size, noise),
        "intensity_counts": light + noise / np.sqrt(10.0) * rng.normal(size=u.size),
    }  # fmt: skip
    return Columns(n=u.size, numbers=numbers, categories={}, channels=find_channels(set(numbers))), body[step, frame]


def noisy(body, rng):
    return np.round(body + 0.3 * rng.normal(size=body.shape), 1)


def test_readings_that_scatter_about_a_line_are_its_noise():
    table, body = bench(noisy, lambda body, _logged: body)
    assert smooth_readings(table) == ["tof_temperature_c"]
    error, logged = (View(table).number("tof_temperature_c") - body, table.numbers["tof_temperature_c"] - body)
    assert np.std(error) < 0.6 * np.std(logged)
    known, _ = bench(noisy, lambda body, _logged: body)
    assert smooth_readings(known, ["tof_temperature_c", "board_temperature_c"]) == ["tof_temperature_c"]
    assert View(known).number("tof_temperature_c") == pytest.approx(View(table).number("tof_temperature_c"))


def test_four_readings_of_a_step_that_does_not_drift_are_their_mean():
    table, body = bench(noisy, lambda body, _logged: body, frames=4, drift=0.0)
    assert smooth_readings(table) == ["tof_temperature_c"]
    error, logged = (View(table).number("tof_temperature_c") - body, table.numbers["tof_temperature_c"] - body)
    assert np.std(error) < 0.65 * np.std(logged)  # half as much, but for chance in twelve steps


def test_readings_that_the_signal_follows_stay():
    table, _ = bench(noisy, lambda _body, logged: logged)
    assert smooth_readings(table) == []
    assert not table.smoothed


@pytest.mark.parametrize("times", [True, False])
def test_readings_that_the_signal_follows_stay_where_some_rows_returned_nothing(times):
    table, _ = bench(noisy, lambda _body, logged: logged)
    lost = np.random.default_rng(6).random(table.n) < 0.03
    if times:  # whole images
        lost = table.numbers["time_s"] % 1200.0 == 40.0
    else:
        del table.numbers["time_s"]
        reading = 7.0 * table.numbers["step"] + np.random.default_rng(7).normal(0.0, 0.3, table.n)
        table.numbers["tof_temperature_c"] = reading
        table.numbers["intensity_counts"] = 500.0 * (1.0 - 0.002 * reading) + np.random.default_rng(8).normal(
            0.0, 0.6, table.n
        )
    table.numbers["intensity_counts"][lost] = np.nan
    assert smooth_readings(table) == []


def test_a_temperature_that_swings_within_a_step_stays():
    def swing(body, rng):
        return body + 0.5 * np.sin(2.0 * np.pi * np.arange(FRAMES) / FRAMES) + 0.02 * rng.normal(size=body.shape)

    table, _ = bench(swing, lambda body, _logged: body)
    assert smooth_readings(table) == []


def test_a_log_without_scatter_and_a_table_without_times_stay():
    table, _ = bench(lambda body, _rng: body, lambda body, _logged: body)
    error = [abs(smoothed - table.numbers[name]).max() for name in smooth_readings(table)
             for smoothed in [table.smoothed[name]]]  # fmt: skip
    assert all(e < 1e-9 for e in error)
    table, _ = bench(noisy, lambda body, _logged: body)
    del table.numbers["time_s"]
    assert smooth_readings(table) == []


def test_where_no_times_were_written_each_row_is_a_reading():
    rng = np.random.default_rng(3)
    step = np.repeat(np.arange(STEPS), 40)
    body = 7.0 * step
    distance = rng.uniform(1.0, 6.0, step.size)
    numbers = {
        "step": step.astype(float), "tof_temperature_c": body + 0.3 * rng.normal(size=step.size),
        "sim_distance_m": distance, "distance_m": distance + 1e-4 * body + 2e-3 * rng.normal(size=step.size),
    }  # fmt: skip
    table = Columns(n=step.size, numbers=numbers, categories={}, channels=find_channels(set(numbers)))
    assert smooth_readings(table) == ["tof_temperature_c"]
    assert np.std(View(table).number("tof_temperature_c") - body) < 0.1


def test_readings_that_were_lost_are_what_the_others_of_their_step_say():
    table, body = bench(lambda body, _rng: body, lambda body, _logged: body)
    lost = np.random.default_rng(4).random(body.size) < 0.3
    table.numbers["tof_temperature_c"][lost] = np.nan
    assert smooth_readings(table) == ["tof_temperature_c"]
    assert View(table).number("tof_temperature_c") == pytest.approx(body, abs=1e-6)


def test_one_reading_of_a_step_is_that_of_all_its_images():
    """It scatters about nothing, and nothing can follow its noise."""
    table, _ = bench(lambda body, _rng: np.floor(body), lambda body, _logged: body)
    logged = table.numbers["tof_temperature_c"]
    logged[table.numbers["time_s"] % 600.0 > 0.0] = np.nan
    assert smooth_readings(table) == ["tof_temperature_c"]
    first = np.floor(7.0 * table.numbers["step"] - 0.4)
    assert np.array_equal(View(table).number("tof_temperature_c"), first)
