"""Columns that a bench logs beside its channels and that tell an effect what it needs."""

import numpy as np
import pytest
from rendered_bench import bench, corrected, left_over, make_columns, render, variant_of

from arl_fixtures.reconcile.view import View

LIGHT = "intensity_counts"


def vapour(temperature_c):
    return 6.112 * np.exp(17.62 * temperature_c / (243.12 + temperature_c))


def test_frost_grows_when_the_air_that_came_was_moist():
    time = np.arange(0.0, 40_000.0, 20.0)
    warm = np.interp(time % 10_000.0, [0.0, 3000.0, 6000.0, 9000.0, 10_000.0], [20.0, -5.0, -5.0, 20.0, 20.0])
    dew = np.interp(time, np.arange(0.0, 50_000.0, 10_000.0), [-14.0, 3.0, 2.0, -16.0, -9.0])
    film, grown = 0.0, []
    for temperature, point in zip(warm, dew, strict=True):
        grown.append(film)
        film = max(film + 20.0 / 3600.0 * (vapour(point) - vapour(temperature)), 0.0)
    columns = {
        "time_s": time, "housing_temperature_c": warm, "dew_point_c": dew, "sim_signal_counts": np.full(2000, 1e3),
        "signal_counts": 1e3 * np.exp(-0.1 * np.array(grown)),
    }  # fmt: skip
    view = View(make_columns(columns, {}, shuffle=None)[0])
    moist = corrected(
        view, variant_of(view, "optics.window_frost", kind="dew point"), depth=0.1, margin=0.0, melt=1.0
    )
    assert left_over(view, moist, "signal_counts") < 0.01
    steady = variant_of(view, "optics.window_frost", kind="balance")
    best = min(
        left_over(view, corrected(view, steady, depth=depth, onset=onset, melt=1.0), "signal_counts")
        for depth in np.geomspace(0.01, 0.3, 12)
        for onset in np.linspace(-8.0, 8.0, 17)
    )
    assert best > 0.2  # as if the air had always been equally moist


@pytest.mark.parametrize(("on", "back"), [("up", "down"), ("forward", "reverse"), ("cw", "ccw")])
def test_the_way_of_the_stage_may_be_told_in_words(on, back):
    columns = bench(steps=2)  # whose times and angles always rise
    second = columns.numbers["step"] == 1.0
    columns.categories["travel"] = (np.where(second, 0, 1).astype(np.int64), (back, on))
    real = render(
        columns.numbers["pixel_u"],
        columns.numbers["pixel_v"],
        columns.numbers["stage_angle_deg"] + np.where(second, -0.1, 0.1),
    )
    columns.numbers[LIGHT] = real[LIGHT]
    view = View(columns)
    state = corrected(view, variant_of(view, "stage.zero_offset", kind="backlash"), backlash=0.2)
    assert left_over(view, state, LIGHT) < 0.03


def test_ranges_alone_walk_with_the_peak_that_was_read():
    rng = np.random.default_rng(9)
    far, reflectance = rng.uniform(0.5, 8.0, 700), rng.choice([0.05, 0.2, 0.8], 700)
    peak = 0.4 * (reflectance / far**2) ** 0.6  # a gain control between light and peak
    crossing = 0.010 * np.sqrt(2.0 * np.log(peak.max() / peak + 3.0))  # of a Gaussian edge, less and less late
    columns = {
        "true_range_m": far, "reflectance": reflectance, "peak_v": peak, "sim_distance_m": far,
        "distance_m": far + crossing - np.median(crossing),
    }  # fmt: skip
    view = View(make_columns(columns, {}, shuffle=None)[0])
    variant = variant_of(view, "timing.range_walk", signal="peak_v", kind="edge")
    least = min(
        left_over(view, corrected(view, variant, walk=walk, exponent=power), "distance_m")
        for walk in np.linspace(1e-3, 8e-3, 15)
        for power in np.linspace(-0.5, 0.5, 11)
    )
    assert least < 0.02


def test_a_record_that_begins_in_the_cold_begins_with_ice():
    time = np.arange(0.0, 14_000.0, 20.0)
    warm = np.interp(time, [0.0, 4000.0, 5000.0, 8000.0, 14_000.0], [-8.0, -8.0, 0.0, 1.0, 25.0])
    film, grown = 0.0, []
    for temperature in warm:
        grown.append(film)
        film = max(film + 20.0 / 3600.0 * (vapour(2.0) - vapour(temperature)), 0.0)
    seen = time >= 3000.0  # nobody looked while the chamber went cold
    columns = {
        "time_s": time[seen], "housing_temperature_c": warm[seen], "sim_signal_counts": np.full(seen.sum(), 1e3),
        "signal_counts": 1e3 * np.exp(-0.1 * np.array(grown)[seen]),
    }  # fmt: skip
    view = View(make_columns(columns, {}, shuffle=None)[0])
    frost = variant_of(view, "optics.window_frost", kind="balance")
    known = {"depth": 0.1, "onset": 2.0, "melt": 1.0}
    assert left_over(view, corrected(view, frost, **known, before=3000.0), "signal_counts") < 0.01
    assert left_over(view, corrected(view, frost, **known, before=0.0), "signal_counts") > 0.2
