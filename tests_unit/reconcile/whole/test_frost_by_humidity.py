"""Nights at a roadside: a window radiates its heat away, and hoar grows by the humidity of each night's own air."""

import numpy as np
import pyarrow as pa
import pytest

from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of

NIGHTS, HOURS = 7, 14


def saturated_hpa(celsius, over_ice=False):
    """Wexler's vapour pressure in Goff's form over water, or Murphy and Koop's over ice."""
    kelvin = celsius + 273.15
    if over_ice:
        return 0.01 * np.exp(9.550426 - 5723.265 / kelvin + 3.53068 * np.log(kelvin) - 0.00728332 * kelvin)
    return 6.1078 * 10.0 ** (7.5 * celsius / (237.3 + celsius))


def weather(rng):
    """Air, window and relative humidity at every hour of every night, (nights, hours)."""
    hour = np.arange(HOURS)
    air = rng.uniform(-1.0, 6.0, NIGHTS)[:, None] - 5.0 * np.sin(np.pi * hour / (HOURS - 1.0))
    window = air - 2.5 * np.sqrt(np.minimum(hour, 3) / 3.0) + np.where(hour > 10, 12.0, 0.0)  # heated at sunrise
    moist = rng.uniform(0.72, 0.99, NIGHTS)[:, None] + 0.015 * np.cumsum(rng.normal(size=(NIGHTS, HOURS)), axis=1)
    return air, window, np.clip(moist, 0.4, 1.0)


def hoar(air, window, moist):
    """Ice in kg/m² at every hour: vapour that crosses the boundary layer, marched in minutes."""
    grown = np.zeros_like(air)
    for night in range(NIGHTS):
        ice = 0.0
        for hour in range(1, HOURS):
            for share in np.linspace(0.0, 1.0, 60, endpoint=False):
                a, w, m = (x[night, hour - 1] + share * (x[night, hour] - x[night, hour - 1])
                           for x in (air, window, moist))  # fmt: skip
                surplus_pa = 100.0 * (m * saturated_hpa(a) - saturated_hpa(w, over_ice=w < 0.0))
                ice = max(ice + 60.0 * 4e-8 * surplus_pa, 0.0)
            grown[night, hour] = ice
    return grown


def roadside(seed, per_kg_m2, *, percent):
    """Nine zones before a wall; their light is known to 0.2 % from hour to hour."""
    rng = np.random.default_rng(seed)
    air, window, moist = weather(rng)
    clear = np.exp(-2.0 * per_kg_m2 * hoar(air, window, moist)) * (1.0 + 0.002 * rng.normal(size=air.shape))
    night, hour, zone = (x.ravel() for x in np.meshgrid(*map(np.arange, (NIGHTS, HOURS, 9)), indexing="ij"))
    light = np.array([210.0, 340.0, 480.0, 620.0, 700.0, 600.0, 470.0, 330.0, 200.0])[zone]
    noise = np.sqrt(30.0 + light)
    return columns_of(pa.table({
        "cycle": night, "step": hour, "time_s": 3600.0 * hour, "zone": zone.astype(float),
        "ambient_temperature_c": air[night, hour], "window_temperature_c": window[night, hour],
        "relative_humidity": moist[night, hour] * (100.0 if percent else 1.0), "n_frames": np.full(zone.size, 100.0),
        "sim_intensity_counts": light, "sim_intensity_counts_std": noise,
        "sim_intensity_counts_repeat_std": 0.002 * light,
        "intensity_counts": light * clear[night, hour] + noise / 10.0 * rng.normal(size=zone.size),
    }))  # fmt: skip


@pytest.mark.parametrize("percent", [False, True])
def test_hoar_that_follows_each_night_s_humidity_is_frost(percent):
    (found,) = diagnose(roadside(1, 0.3, percent=percent))[0].findings
    assert found.effect == "optics.window_frost"
    assert "relative_humidity" in found.drivers


def test_humid_nights_alone_are_no_frost():
    assert diagnose(roadside(2, 0.0, percent=True))[0].findings == []
