"""Few steps: a law that several of them bear out is one; a step that is off by itself bears out nothing."""

import numpy as np
import pyarrow as pa
import pytest

from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of

SIGMA_M, SHARED_M = 1.5e-3, 2.5e-4
STEPS, ROWS = 8, 120


def cable_table(seed, delay_m):
    """A rangefinder with its reference cable in a humid room; `delay_m` gives each step's error from the humidity."""
    rng = np.random.default_rng(seed)
    step = np.repeat(np.arange(STEPS), ROWS)
    humidity = rng.permutation(np.linspace(8.0, 92.0, STEPS))
    distance = rng.uniform(0.5, 6.0, step.size)
    shared = rng.normal(0.0, SHARED_M, STEPS) + delay_m(humidity)
    return columns_of(pa.table({
        "step": step, "time_s": step * 900.0 + np.tile(np.arange(ROWS), STEPS),
        "relative_humidity": humidity[step], "housing_temperature_c": rng.uniform(24.0, 26.0, STEPS)[step],
        "true_range_m": distance, "sim_distance_m": distance, "sim_distance_m_std": np.full(step.size, SIGMA_M),
        "sim_distance_m_repeat_std": np.full(step.size, SHARED_M),
        "distance_m": distance + shared[step] + rng.normal(0.0, SIGMA_M, step.size),
    }))  # fmt: skip


@pytest.mark.parametrize("seed", [4, 5])
def test_water_in_a_cable_is_unknown_and_follows_the_humidity(seed):
    """Langmuir's isotherm: coverage K p / (1 + K p)."""

    def delay_m(humidity):
        return 4e-3 * humidity / (20.0 + humidity)

    (finding,) = diagnose(cable_table(seed, delay_m))[0].findings
    assert finding.effect == "unknown"
    assert finding.drivers[0] == "relative_humidity"


@pytest.mark.parametrize("seed", [6, 7])
def test_a_single_step_that_is_off_makes_no_law(seed):
    def delay_m(humidity):
        return np.where(humidity == humidity[2], 2e-3, 0.0)

    findings = diagnose(cable_table(seed, delay_m))[0].findings
    assert all(f.effect == "bench.repeatability" for f in findings)


def avalanche_table(seed, drift_per_k, shared, temperature=(-10.0, 10.0, 35.0, 60.0, 80.0), repeat=None):
    """Signals of a few pixels at few temperatures; nobody says how far steps are off by themselves, or `repeat`."""
    rng = np.random.default_rng(seed)
    temperature = np.array(temperature)
    grid = np.meshgrid(np.arange(temperature.size), [-12.0, 0.0, 12.0], np.arange(16), indexing="ij")
    step, angle, pixel = (x.ravel() for x in grid)
    light = rng.uniform(200.0, 3000.0, (3, 16))[(angle / 12.0 + 1.0).astype(int), pixel]
    # the gain of an avalanche diode at a bias that follows its breakdown only partly (Miller's law)
    bias, breakdown = 140.0, 150.0 + drift_per_k * (temperature - 25.0)
    gain = (1.0 - (bias / 150.0) ** 0.8) / (1.0 - (bias / breakdown) ** 0.8)
    gain = gain * (1.0 + shared * rng.normal(size=temperature.size))
    sigma = np.sqrt(light + 49.0)
    return columns_of(pa.table({
        "step": step, "time_s": step * 1800.0 + angle, "stage_angle_deg": angle, "pixel_u": 4.0 + 7.0 * pixel,
        "housing_temperature_c": temperature[step], "n_frames": np.full(step.size, 20.0),
        "sim_intensity_counts": light, "sim_intensity_counts_std": sigma,
        "intensity_counts": light * gain[step] + sigma / np.sqrt(20.0) * rng.normal(size=step.size),
        **({} if repeat is None else {"sim_intensity_counts_repeat_std": np.full(step.size, repeat)}),
    }))  # fmt: skip


def test_five_steps_on_one_line_tell_a_gain_that_follows_temperature():
    (finding,) = diagnose(avalanche_table(8, 4e-3, 0.0))[0].findings
    assert "detector.gain_temperature" in {finding.effect, *finding.equivalent_to}


@pytest.mark.parametrize("seed", [9, 10, 11])
def test_five_steps_that_are_off_by_themselves_tell_nothing(seed):
    assert not diagnose(avalanche_table(seed, 0.0, 4e-3))[0].findings


@pytest.mark.parametrize("seed", [13, 14])
def test_four_steps_are_too_few_to_tell_their_scatter(seed):
    assert not diagnose(avalanche_table(seed, 4e-3, 4e-3, temperature=(-10.0, 20.0, 50.0, 80.0)))[0].findings


@pytest.mark.parametrize(("repeat", "found"), [(None, 0), (0.0, 1)])
def test_three_steps_tell_something_where_a_gauge_study_found_no_scatter(repeat, found):
    table = avalanche_table(12, 6e-3, 0.0, temperature=(-10.0, 35.0, 80.0), repeat=repeat)
    assert len(diagnose(table)[0].findings) == found


def start_pulse_table(seed, read):
    """A rangefinder whose start pulse comes later the warmer its driver is; `read` logs each step's temperature."""
    rng = np.random.default_rng(seed)
    step = np.repeat(np.arange(STEPS), ROWS)
    temperature = np.linspace(-5.0, 85.0, STEPS)
    distance = rng.uniform(1.0, 6.0, step.size)
    # an RC stage of 100 Ω whose capacitance grows with temperature crosses half its supply after R C ln 2
    capacitance = 1e-9 * (1.0 + 1.9e-4 * (temperature - 25.0))
    late = 0.5 * 299_792_458.0 * 100.0 * np.log(2.0) * (capacitance - 1e-9)
    return columns_of(pa.table({
        "step": step, "tof_temperature_c": temperature[step] + read(rng),
        "true_range_m": distance, "sim_distance_m": distance, "sim_distance_m_std": np.full(step.size, 2e-3),
        "distance_m": distance + late[step] + 2e-3 * rng.normal(size=step.size),
    }))  # fmt: skip


def scatter(rng):
    return 0.4 * rng.normal(size=STEPS * ROWS)


def swing(_rng):
    """A thermometer in the air of a room whose heating cycles: the driver's own body does not follow."""
    return 0.2 * np.sin(2.0 * np.pi * np.tile(np.arange(ROWS), STEPS) / 30.0)


def lose(rng):
    """A logger that drops every tenth reading."""
    return np.where(rng.random(STEPS * ROWS) < 0.1, np.nan, 0.05 * rng.normal(size=STEPS * ROWS))


@pytest.mark.parametrize("read", [scatter, swing, lose])
def test_readings_off_by_themselves_hide_no_drift_of_centimetres(read):
    """All of the drift seems to be steps' scatter: as long as they count for nothing, rows say that there is none."""
    (finding,) = diagnose(start_pulse_table(21, read))[0].findings
    assert finding.effect == "timing.temperature_offset"


def camera_table(seed, drift_per_k, ghost, steps=5):
    """A camera before a striped wall with a bright board; a lens throws `ghost` of all light to the opposite side.

    Light is of 3 by 3 points in each pixel, the mirror's centre is a point and not a pixel; the gain is that of an
    avalanche diode as above.
    """
    rng = np.random.default_rng(seed)
    angles, columns, rows, fine = np.array([-14.0, -5.0, 0.0, 6.0, 15.0]), 20, 12, 3
    temperature = np.linspace(-20.0, 65.0, steps)
    fine_u, fine_v = np.arange(columns * fine), np.arange(rows * fine)
    bearing = (fine_u[None, None, :] / fine - columns / 2) * 2.5 + angles[:, None, None]
    lift = (fine_v[None, :, None] / fine - rows / 2) * 2.5 + 0.0 * bearing
    board = (np.abs(bearing - 6.0) < 6.0) & (np.abs(lift + 5.0) < 5.0)
    wall = np.where(np.sin(np.radians(21.0 * bearing)) > 0.0, 0.2, 0.6)
    radiance = 8e3 * np.where(board, 0.95 / 2.0**2, wall / 3.5**2) * np.cos(np.radians(bearing)) ** 2
    thrown = radiance + ghost * np.roll(radiance[:, ::-1, ::-1], 1, axis=2)

    def seen(image):
        return image.reshape(len(angles), rows, fine, columns, fine).mean(axis=(2, 4))

    bias, breakdown = 140.0, 150.0 + drift_per_k * (temperature - 25.0)
    gain = (1.0 - (bias / 150.0) ** 0.8) / (1.0 - (bias / breakdown) ** 0.8)
    step, at, v, u = (
        x.ravel() for x in np.meshgrid(*(np.arange(n) for n in (steps, 5, rows, columns)), indexing="ij")
    )
    light, sigma = seen(radiance)[at, v, u], np.sqrt(seen(radiance)[at, v, u] + 25.0)
    return columns_of(pa.table({
        "step": step, "stage_angle_deg": angles[at], "pixel_u": u, "pixel_v": v, "n_frames": np.full(step.size, 60.0),
        "housing_temperature_c": temperature[step] + rng.normal(0.0, 0.2, (steps, 5))[step, at],
        "sim_intensity_counts": light, "sim_intensity_counts_std": sigma,
        "intensity_counts": seen(thrown)[at, v, u] * gain[step] + sigma / np.sqrt(60.0) * rng.normal(size=step.size),
    }))  # fmt: skip


def test_a_gain_over_five_steps_is_told_beside_what_pixels_tell_far_clearer():
    found = [{f.effect, *f.equivalent_to} for f in diagnose(camera_table(12, 8e-3, 0.03))[0].findings]
    assert len(found) == 2
    assert "optics.ghost" in found[0]
    assert "detector.gain_temperature" in found[1]
