"""Timing: operators against pulses, ticks, delay lines and heat balances made by other means."""

import numpy as np
import pytest
from operator_tables import fit, table
from rendered_bench import corrected, left_over, variant_of
from scipy.integrate import solve_ivp

C_M_PER_S = 299_792_458.0


def crossing_range_m(shape, light, threshold):
    """Range shift of the moment a sampled pulse of given height crosses a fixed threshold."""
    time_ns = np.linspace(-30.0, 30.0, 60_001)
    pulse = shape(time_ns)
    moments = [time_ns[np.argmax(height * pulse > threshold)] for height in light]
    return 0.5 * C_M_PER_S * 1e-9 * np.array(moments)


@pytest.mark.parametrize(
    ("kind", "shape", "start"),
    [
        ("pulse", lambda t: np.exp(-0.5 * (t / 2.0) ** 2), {"walk": 0.2, "threshold": 0.05}),
        ("edge", lambda t: np.where(t < 0.0, np.exp(t / 2.0), np.exp(-t / 8.0)), {"walk": 0.1, "exponent": 0.1}),
        ("edge", lambda t: np.clip(t / 4.0 + 1.0, 0.0, 1.0), {"walk": 0.1, "exponent": 0.8}),
    ],
)
def test_range_walk_is_a_waveform_that_crosses_a_threshold(kind, shape, start):
    light = np.geomspace(100.0, 4000.0, 120)
    walk = crossing_range_m(shape, light, threshold=30.0)
    walk -= np.interp(np.median(light), light, walk)
    view = table(sim_signal_counts=light, sim_distance_m=1.1, distance_m=1.1 + walk)
    variant = variant_of(view, "timing.range_walk", kind=kind)
    values = fit(view, variant, "distance_m", start)
    assert left_over(view, corrected(view, variant, **values), "distance_m") < 2e-3


def test_clock_scale_is_a_count_of_ticks_that_are_too_long():
    truth = np.linspace(0.5, 20.0, 100)
    ticks = 2.0 * truth / C_M_PER_S * 250e6 * (1.0 + 40e-6)  # the clock runs 40 ppm fast
    view = table(sim_distance_m=truth, distance_m=0.5 * C_M_PER_S * ticks / 250e6)
    state = corrected(view, variant_of(view, "timing.clock_scale"), scale=40e-6)
    assert left_over(view, state, "distance_m") < 1e-9


def test_tdc_nonlinearity_holds_a_delay_line_of_unequal_cells():
    truth = np.linspace(1.0, 4.0, 900)
    cells = 1.0 + 0.12 * np.sin(2.0 * np.pi * np.arange(24) / 24.0) + 0.02 * np.random.default_rng(4).normal(size=24)
    edges = np.concatenate([[0.0], np.cumsum(cells)]) * 0.6 / cells.sum()  # true cell edges within 0.6 m of period
    ideal = np.linspace(0.0, 0.6, 25)
    read = np.floor(truth / 0.6) * 0.6 + np.interp(truth % 0.6, edges, ideal)
    view = table(sim_distance_m=truth, distance_m=read)
    variant = variant_of(view, "timing.tdc_nonlinearity")
    starts = variant.shapes()[0].starts
    assert min(abs(1.0 / start - 1.0 / 0.6) for start in starts) < 0.5 / 3.0  # the search starts near enough
    values = fit(view, variant, "distance_m", {"sine": 0.002, "cosine": 0.002, "period": 0.61}, offset=True)
    assert values["period"] == pytest.approx(0.6, abs=0.005)
    shifted = view.number("distance_m") - np.mean(view.number("distance_m") - truth)
    rest = shifted - corrected(view, variant, **values)["distance_m"]
    assert np.var(rest) < 0.1 * np.var(shifted - truth)


def test_temperature_offset_is_a_chain_of_gates_whose_delay_grows():
    warm = np.linspace(-10.0, 85.0, 150)
    delay_ps = 300.0 * ((warm + 273.15) / 298.15) ** 1.5  # mobility falls as T^-1.5
    shift = 0.15e-3 * (delay_ps - 300.0)
    view = table(tof_temperature_c=warm, sim_distance_m=1.1, distance_m=1.1 + shift)
    variant = variant_of(view, "timing.temperature_offset", kind="offset")
    values = fit(view, variant, "distance_m", {"slope": 1e-4, "bend": 1e-7})
    assert values["slope"] == pytest.approx(0.15e-3 * 300.0 * 1.5 / 298.15, rel=0.01)
    assert left_over(view, corrected(view, variant, **values), "distance_m") < 1e-4


def test_row_skew_is_a_delay_from_row_to_row():
    v, u = (part.ravel().astype(float) for part in np.mgrid[0:32, 0:16])
    view = table(pixel_u=u, pixel_v=v, sim_distance_m=1.1, distance_m=1.1 + 0.15e-3 * 2.0 * (v - 15.5))  # 2 ps a row
    state = corrected(view, variant_of(view, "timing.row_skew", temperature=""), per_row=0.30e-3, per_column=0.0)
    assert left_over(view, state, "distance_m") < 1e-12


@pytest.mark.parametrize("kind", ["difference", "whole"])
def test_thermal_lag_solves_the_die_s_heat_balance(kind):
    time = np.sort(np.random.default_rng(9).uniform(0.0, 8000.0, 700))
    warm = np.interp(time, [0.0, 3000.0, 5000.0, 8000.0], [-10.0, 80.0, 80.0, 0.0])

    def balance(moment, die):
        return (np.interp(moment, time, warm) - die) / 400.0

    die = solve_ivp(balance, (time[0], time[-1]), [warm[0]], t_eval=time, rtol=1e-8, max_step=20.0).y[0]
    acting = die - warm if kind == "difference" else die - 25.0
    view = table(time_s=time, housing_temperature_c=warm, sim_distance_m=1.1, distance_m=1.1 + 1e-4 * acting)
    variant = variant_of(view, "timing.thermal_lag", kind=kind)
    state = corrected(view, variant, slope=1e-4, time_constant=400.0)
    assert left_over(view, state, "distance_m") < 1e-3
