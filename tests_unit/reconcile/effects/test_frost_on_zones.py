"""Frost on the window of a range module with zones, and on one that comes into the cold without any."""

import numpy as np
import pytest
from operator_tables import fit, table
from rendered_bench import corrected, variant_of

HOURS_S = np.arange(0.0, 14_400.0, 120.0)


def vapour_hpa(celsius):
    """Saturation over ice, Goff-Gratch."""
    ratio = 273.16 / (celsius + 273.15)
    return 6.1071 * 10.0 ** (-9.09718 * (ratio - 1.0) - 3.56654 * np.log10(ratio) + 0.876793 * (1.0 - 1.0 / ratio))


def ice(celsius, moist_hpa, seconds):
    """Ice that grows in moist air and goes in dry, in hPa h, at the start of each interval."""
    grown, film = [], 0.0
    for temperature in celsius:
        grown.append(film)
        film = max(film + seconds / 3600.0 * (moist_hpa - float(vapour_hpa(temperature))), 0.0)
    return np.array(grown)


def test_water_that_runs_down_is_seen_by_zones_that_are_numbered_row_by_row():
    celsius = 15.0 - 25.0 * np.sin(np.pi * HOURS_S / HOURS_S[-1])
    film = ice(celsius, float(vapour_hpa(-2.0)), 120.0)
    moment, zone = (a.ravel() for a in np.meshgrid(np.arange(HOURS_S.size), np.arange(16), indexing="ij"))
    down = zone // 4  # the lowest row holds twice what the middle holds
    passed = np.exp(-0.05 * film[moment] * (0.4 + 0.4 * down))
    light = 800.0 + 40.0 * (zone % 4)
    view = table(
        time_s=HOURS_S[moment], housing_temperature_c=celsius[moment], zone=zone.astype(float),
        sim_signal_counts=light, signal_counts=light * passed,
    )  # fmt: skip
    variant = variant_of(view, "optics.window_frost", kind="balance")
    start = {"depth": 0.02, "lean": 0.0, "onset": -3.0, "melt": 1.0}
    values = fit(view, variant, "signal_counts", start, scale=np.full(view.n, 1.0))
    state = corrected(view, variant, **values)
    assert np.abs(state["signal_counts"] / view.number("signal_counts") - 1.0).max() < 0.005
    assert values["lean"] / values["depth"] == pytest.approx(-0.6, abs=0.02)


def test_a_window_has_no_film_when_it_comes_into_the_cold():
    view = table(time_s=HOURS_S, housing_temperature_c=np.full(HOURS_S.size, -10.0) + 20.0 * (HOURS_S > 12_000.0),
                 sim_signal_counts=1000.0)  # fmt: skip
    variant = variant_of(view, "optics.window_frost", kind="settled")
    seen = corrected(view, variant, depth=0.01, lean=0.0, onset=0.0, lag=3000.0)["signal_counts"]
    settled = 1000.0 * np.exp(-0.01 * 10.0)
    assert seen[0] > 1000.0 - 0.03 * (1000.0 - settled)
    assert seen[HOURS_S == 12_000.0] < settled + 0.05 * (1000.0 - settled)
