"""Days resemble the days before: a scatter of steps that the table states need not be new at every step."""

import numpy as np
import pyarrow as pa
import pytest

from arl_fixtures.reconcile.law import Law
from arl_fixtures.reconcile.problem import Problem
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.roles import Role
from arl_fixtures.reconcile.table import columns_of
from arl_fixtures.reconcile.wandering import is_wander

DAYS, ROWS = 90, 24


def year_on_a_roof(seed, memory, wander=(0.005, 0.004), per_kelvin=0.0, shown=1.0):
    """One visit a day to a range sensor out of doors; what it says drifts by `wander` (of the light, metres).

    A day keeps `memory` of the day before, and shows a part of the drift that is stated. The light falls by
    `per_kelvin` beside it, where season and weather make the housing warmer than 25 °C, and grows where they make it
    colder.
    """
    rng = np.random.default_rng(seed)
    day, row = (a.ravel() for a in np.meshgrid(np.arange(DAYS), np.arange(ROWS), indexing="ij"))
    season = 12.0 - 14.0 * np.cos(2.0 * np.pi * np.arange(DAYS) / 365.0 * 4.0)
    weather = _slow(rng, 0.6) * 3.0
    warm = (season + weather)[day] + rng.normal(0.0, 0.2, day.size)
    light, away = _wandering(rng, memory, [shown * size for size in wander])
    true = 1500.0 * (0.4 + 0.6 * (row % 6) / 5.0)
    metres, sigma = 6.0 + 4.0 * (row // 6), 12.0 + 0.01 * true
    return columns_of(pa.table({
        "step": day.astype(float), "time_s": 86400.0 * day + 60.0 * row, "housing_temperature_c": warm,
        "sun_elevation_deg": (30.0 - 25.0 * np.cos(2.0 * np.pi * np.arange(DAYS) / 365.0 * 4.0))[day],
        "wind_speed": np.abs(rng.normal(3.0, 2.0, day.size)), "n_frames": np.full(day.size, 20.0),
        "sim_intensity_counts": true, "sim_intensity_counts_std": sigma,
        "sim_intensity_counts_repeat_std": wander[0] * true,
        "intensity_counts": true * (1.0 - per_kelvin * (season + weather - 25.0)[day] + light[day])
        + sigma / np.sqrt(20.0) * rng.normal(size=day.size),
        "sim_distance_m": metres, "sim_distance_m_std": np.full(day.size, 0.01),
        "sim_distance_m_repeat_std": np.full(day.size, wander[1]),
        "distance_m": metres + away[day] + 0.01 / np.sqrt(20.0) * rng.normal(size=day.size),
    }))  # fmt: skip


def _slow(rng, memory):
    """A process of variance 1 whose values keep `memory` of the one before."""
    values = [rng.normal()]
    for _ in range(DAYS - 1):
        values.append(memory * values[-1] + np.sqrt(1.0 - memory**2) * rng.normal())
    return np.array(values)


def _wandering(rng, memory, wander):
    return [size * _slow(rng, memory) for size in wander]


@pytest.mark.parametrize("seed", [1, 5, 8, 9])
def test_days_that_wander_by_what_is_stated_follow_no_weather(seed):
    assert diagnose(year_on_a_roof(seed, 0.9))[0].findings == []


@pytest.mark.parametrize("memory", [0.0, 0.5])
def test_a_gain_that_follows_the_heat_of_the_season_is_found_beside_the_scatter(memory):
    found = diagnose(year_on_a_roof(5, memory, per_kelvin=0.0006))[0].findings
    assert len(found) == 1
    assert found[0].channels[0] == "intensity_counts"
    assert "detector.gain_temperature" in {found[0].effect, *found[0].equivalent_to}


def test_a_gain_that_foretells_each_day_is_no_drift_of_days_that_hardly_scatter():
    """Who states a scatter may state too much of it: a tenth of it is there, and the weather says the rest."""
    found = diagnose(year_on_a_roof(5, 0.0, per_kelvin=0.0006, shown=0.1))[0].findings
    assert len(found) == 1
    assert "detector.gain_temperature" in {found[0].effect, *found[0].equivalent_to}


@pytest.mark.parametrize(("gain", "wanders"), [(30.0, True), (3000.0, False)])
def test_what_gains_more_than_all_that_days_share_is_no_wander(gain, wanders):
    """Trees foretell what no formula does: of the days' drift, 90 days can give so much and no more."""
    problem = Problem(year_on_a_roof(1, 0.95))
    channel = next(d for d in problem.data if d.channel.role is Role.INTENSITY)
    trees = Law(channel=channel.channel.name, relative=True, terms=[], drivers=["step"], gain=gain)
    assert is_wander(channel, problem.view.fresh_state(), trees, {}) == wanders
