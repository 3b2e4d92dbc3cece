"""A chamber heats everything: of temperatures that go along with each other, a law names the one that acts."""

import numpy as np
import pyarrow as pa
import pytest

from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of

SURFACES = np.array(["wall", "stripe", "post"])


def chamber(seed, act, apart_k=0.6):
    """A sensor and three surfaces in a chamber that goes up and down; `act` gives the factor of the light.

    It is given the setpoint, the sensor's and the board's temperature as they are, and the surface's number; these
    scatter about the setpoint by about `apart_k`.
    """
    rng = np.random.default_rng(seed)
    step, surface, view = (a.ravel() for a in np.meshgrid(np.arange(26), np.arange(3), np.arange(20), indexing="ij"))
    rise = np.abs(np.arange(26) - 13.0)
    setpoint = (60.0 - 6.0 * rise)[step]
    sensor = (0.96 * (60.0 - 6.0 * rise) + 6.0 + rng.normal(0.0, apart_k, 26))[step]
    board = (0.97 * (60.0 - 6.0 * rise) + 1.0 + rng.normal(0.0, 1.3 * apart_k, 26))[step]
    light = 900.0 * np.array([0.3, 0.6, 0.8])[surface] * (1.0 + 0.1 * np.cos(0.3 * view))
    sigma = np.hypot(4.0, 0.02 * light)
    kept = act(setpoint, sensor, board, surface) * (1.0 + 0.001 * rng.normal(size=26)[step])
    read = lambda true: np.round(true + rng.normal(0.0, 0.15, true.size), 2)  # noqa: E731
    return columns_of(pa.table({
        "step": step.astype(float), "time_s": 1800.0 * step + 5.0 * view, "pixel_u": 3.0 * view,
        "surface": SURFACES[surface], "set_temperature_c": setpoint, "housing_temperature_c": read(sensor),
        "panel_temperature_c": read(board), "n_frames": np.full(step.size, 10.0), "sim_intensity_counts": light,
        "sim_intensity_counts_std": sigma, "sim_intensity_counts_repeat_std": 0.001 * light,
        "intensity_counts": light * kept + sigma / np.sqrt(10.0) * rng.normal(size=step.size),
    }))  # fmt: skip


def drivers_of(table):
    (found,) = diagnose(table, effects=[])[0].findings
    return found.drivers


@pytest.mark.parametrize("seed", [1, 2])
def test_the_paint_of_a_board_follows_the_boards_heat(seed):
    def fades(setpoint, sensor, board, surface):
        return 1.0 - 0.03 * (surface == 1) / (1.0 + np.exp(-(board - 35.0) / 6.0))

    drivers = drivers_of(chamber(seed, fades))
    assert "panel_temperature_c" in drivers
    assert not {"set_temperature_c", "housing_temperature_c", "step"} & set(drivers)


@pytest.mark.parametrize("seed", [1, 2])
def test_what_the_sensor_does_is_not_told_by_what_was_asked_of_the_chamber(seed):
    def stalls(setpoint, sensor, board, surface):
        return 1.0 - 0.012 / (1.0 + np.exp(-(sensor - 30.0) / 1.5))

    assert drivers_of(chamber(seed, stalls)) == ["housing_temperature_c"]


def test_a_pump_that_runs_for_the_setpoint_is_told_by_it():
    def shakes(setpoint, sensor, board, surface):
        return 1.0 - 0.02 * (setpoint > 33.0)

    assert drivers_of(chamber(3, shakes, apart_k=9.0)) == ["set_temperature_c"]
