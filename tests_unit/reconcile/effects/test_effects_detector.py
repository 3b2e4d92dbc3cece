"""Detector: operators against counts, diodes and neighbours made by other means."""

import numpy as np
import pytest
from operator_tables import fit, table
from rendered_bench import bench, corrected, left_over, make_columns, variant_of

from arl_fixtures.reconcile.view import View


def test_compression_reaches_an_amplifier_that_saturates_as_a_tanh():
    light = np.linspace(20.0, 4000.0, 300)
    view = table(sim_signal_counts=light, signal_counts=5000.0 * np.tanh(light / 5000.0))
    variant = variant_of(view, "detector.compression")
    values = fit(view, variant, "signal_counts", {"strength": 0.5, "sharpness": 2.0})
    assert left_over(view, corrected(view, variant, **values), "signal_counts") < 1e-3
    assert values["sharpness"] == pytest.approx(2.0, abs=0.5)


def test_compression_takes_scatter_with_its_slope():
    light, step = np.linspace(100.0, 4000.0, 200), 1.0
    view = table(sim_signal_counts=light, sim_signal_counts_std=10.0)
    variant = variant_of(view, "detector.compression")
    state = corrected(view, variant, strength=0.8, sharpness=3.0)
    moved = table(sim_signal_counts=light + step)
    other = variant_of(moved, "detector.compression")
    scale = other.options["top"] / variant.options["top"]
    bent = corrected(moved, other, strength=0.8 * scale, sharpness=3.0)["signal_counts"]
    slope = (bent - state["signal_counts"]) / step
    np.testing.assert_allclose(state["signal_counts_std"], 10.0 * slope, rtol=2e-3)


def test_dark_offset_reaches_generation_current_over_a_band_gap():
    warm = np.linspace(0.0, 80.0, 200)
    kelvin = warm + 273.15
    generated = kelvin**1.5 * np.exp(-1.12 / (2.0 * 8.617e-5 * kelvin))
    view = table(
        tof_temperature_c=warm, sim_signal_counts=500.0, signal_counts=500.0 + 40.0 * generated / generated[-1]
    )
    variant = variant_of(view, "detector.dark_offset")
    values = fit(view, variant, "signal_counts", {"dark": 20.0, "doubling": 7.0})
    assert values["dark"] == pytest.approx(40.0, rel=0.05)
    assert 8.0 < values["doubling"] < 13.0
    assert left_over(view, corrected(view, variant, **values), "signal_counts") < 0.01


def test_dark_counts_bring_their_shot_noise():
    rng = np.random.default_rng(8)
    own, dark = 900.0, 300.0  # Poisson counts of gain 1
    frames = rng.poisson(own + dark, size=40_000)
    view = table(tof_temperature_c=[20.0, 40.0], sim_signal_counts=own, sim_signal_counts_std=np.sqrt(own))
    state = corrected(view, variant_of(view, "detector.dark_offset"), dark=dark, doubling=9.0, shot=1.0)
    assert state["signal_counts"][1] == pytest.approx(frames.mean(), rel=1e-3)
    assert state["signal_counts_std"][1] == pytest.approx(frames.std(), rel=0.02)


def test_dark_counts_fire_cells_that_light_would_have_fired():
    rng, cells, dark = np.random.default_rng(21), 1000, np.array([1.0, 3.0, 10.0, 30.0])
    light, warm = np.meshgrid(np.array([20.0, 60.0, 200.0, 500.0, 900.0, 1500.0]), [10.0, 30.0, 50.0, 70.0])
    lost = np.exp(-(light + dark[:, None]) / cells)  # a cell fires once a gate, whatever fired it
    counts = rng.binomial(cells, 1.0 - lost, (400, *light.shape))
    own = cells * -np.expm1(-light / cells)
    view = table(
        sim_signal_counts=np.tile(own.ravel(), 2), sim_signal_counts_std=np.sqrt(np.tile(own.ravel(), 2)),
        signal_counts=np.concatenate([counts[:200].mean(axis=0).ravel(), counts[200:].mean(axis=0).ravel()]),
        tof_temperature_c=np.tile(warm.ravel(), 2),
    )  # fmt: skip
    variant = variant_of(view, "detector.dark_offset", counter="fills")
    values = fit(view, variant, "signal_counts", {"dark": 10.0, "doubling": 9.0, "cells": 1500.0}, scale=1.0)
    assert values["dark"] == pytest.approx(dark[-1], rel=0.1)
    assert values["doubling"] == pytest.approx(20.0 * np.log(2.0) / np.log(10**0.5), rel=0.15)
    assert values["cells"] == pytest.approx(cells, rel=0.25)


def test_dark_counts_of_an_unmeasured_scatter_bring_the_shot_noise_that_the_simulation_has():
    own, dark = np.linspace(100.0, 900.0, 50), 300.0
    frames = np.random.default_rng(8).poisson(own[0] + dark, size=40_000)
    numbers = {"signal_counts": own, "sim_signal_counts": own, "sim_signal_counts_std": np.sqrt(own)}
    view = View(make_columns({**numbers, "tof_temperature_c": np.full(50, 40.0)}, {}, shuffle=None)[0])
    variant = variant_of(view, "detector.dark_offset")
    assert [p.name for p in variant.parameters] == ["dark"]
    assert corrected(view, variant, dark=dark)["signal_counts_std"][0] == pytest.approx(frames.std(), rel=0.02)


@pytest.mark.parametrize("paralysis", [0.0, 1.0])
def test_pile_up_counts_and_ranges_as_photons_that_meet_a_dead_time(paralysis):
    rng = np.random.default_rng(5)
    kept = []
    for rate in (0.1, 0.5, 1.5):  # photons per dead time
        arrivals = np.cumsum(rng.exponential(1.0 / rate, 200_000))
        if paralysis:
            counted = 1 + int(np.sum(np.diff(arrivals) > 1.0))  # every photon starts the dead time anew
        else:
            counted, free = 0, 0.0
            for moment in arrivals:
                if moment >= free:
                    counted, free = counted + 1, moment + 1.0
        kept.append(counted / arrivals.size)
    light = np.array([0.1, 0.5, 1.5])
    view = table(sim_signal_counts=light)
    variant = variant_of(view, "detector.pile_up")
    load = variant.options["top"]
    state = corrected(view, variant, load=load, paralysis=paralysis)
    np.testing.assert_allclose(state["signal_counts"] / light, kept, rtol=0.02)


@pytest.mark.parametrize("tail", [0.0, 0.5, 1.0])
def test_first_photons_of_drawn_pulses_are_early_and_fire_the_detector_once(tail):
    rng = np.random.default_rng(6)
    size = np.hypot(1.0 - tail, tail)
    lead, fired, scatter = [], [], []
    light = np.array([0.5, 3.0, 20.0])
    for photons in light:
        number = rng.poisson(photons, 60_000)
        shape = (60_000, number.max())
        arrival = ((1.0 - tail) * rng.normal(size=shape) + tail * (rng.exponential(size=shape) - 1.0)) / size
        arrival[np.arange(number.max()) >= number[:, None]] = np.inf
        lead.append(-np.mean(arrival.min(axis=1)[number > 0]))
        fired.append(np.mean(number > 0))
        scatter.append(np.std(number > 0))
    view = table(sim_signal_counts=light, sim_signal_counts_std=np.sqrt(light), sim_distance_m=2.0)
    variant = variant_of(view, "detector.pile_up", kind="pulse")
    state = corrected(view, variant, load=variant.options["top"], width=0.1, tail=tail)
    np.testing.assert_allclose(state["signal_counts"], fired, rtol=0.01)
    np.testing.assert_allclose(state["signal_counts_std"], scatter, rtol=0.02, atol=0.002)
    np.testing.assert_allclose((2.0 - state["distance_m"]) / 0.1, lead, atol=0.02)


def test_crosstalk_is_a_convolution_with_the_four_neighbours():
    rng = np.random.default_rng(1)
    image = rng.uniform(100.0, 2000.0, (10, 12))
    v, u = np.mgrid[0:10, 0:12]
    view = table(pixel_u=u.ravel(), pixel_v=v.ravel(), stage_angle_deg=np.zeros(120), sim_signal_counts=image.ravel())
    state = corrected(view, variant_of(view, "detector.crosstalk", direction="both"), share=0.02)
    padded = np.pad(image, 1, mode="edge")
    around = padded[:-2, 1:-1] + padded[2:, 1:-1] + padded[1:-1, :-2] + padded[1:-1, 2:]
    np.testing.assert_allclose(state["signal_counts"].reshape(10, 12), image + 0.02 * (around - 4.0 * image))


def test_detector_gain_reaches_an_avalanche_diode_below_its_breakdown():
    warm = np.linspace(0.0, 70.0, 100)
    gain = 1.0 / (1.0 - (0.6 + 1.2e-4 * (25.0 - warm)) ** 3)  # M = 1 / (1 − (V / V_breakdown)^n)
    view = table(
        tof_temperature_c=warm, sim_signal_counts=800.0, signal_counts=800.0 * gain / np.interp(25.0, warm, gain)
    )
    variant = variant_of(view, "detector.gain_temperature")
    values = fit(view, variant, "signal_counts", {"slope": -1e-4, "curvature": 1e-7})
    assert left_over(view, corrected(view, variant, **values), "signal_counts") < 1e-4
    assert values["slope"] < 0.0


def test_rail_coupling_follows_the_rail_and_nothing_else():
    rng = np.random.default_rng(2)
    rail = 3.3 + 0.02 * rng.normal(size=500)
    view = table(rail_3v3_v=rail, sim_signal_counts=1000.0, signal_counts=1000.0 * rail / np.median(rail))
    variant = variant_of(view, "electronics.rail_coupling")
    assert fit(view, variant, "signal_counts", {"coupling": 0.5})["coupling"] == pytest.approx(1.0, rel=1e-3)


def test_rail_coupling_is_not_weakened_by_noisy_readings_of_the_rail():
    rng = np.random.default_rng(4)
    step = np.repeat(np.arange(12.0), 60)
    true = (3.3 + rng.normal(0.0, 0.01, 12))[step.astype(int)]
    read = true + rng.normal(0.0, 0.01, step.size)
    view = table(step=step, rail_3v3_v=read, sim_signal_counts=1000.0, signal_counts=1000.0 * true / np.median(read))
    variant = variant_of(view, "electronics.rail_coupling", reading="step mean")
    assert fit(view, variant, "signal_counts", {"coupling": 0.5})["coupling"] == pytest.approx(1.0, rel=0.05)


def test_pixel_gains_and_dead_pixels_are_fields():
    view = View(bench(columns=(58, 64), rows=(12, 16), angles=(0.0, 0.9, 2), steps=2))
    pixel = view.group("dut", "pixel_u", "pixel_v")
    gain = np.random.default_rng(3).normal(0.0, 0.02, pixel.max() + 1)[pixel]
    variant = variant_of(view, "detector.pixel_response")
    assert variant.parameters[0].per == ("pixel_u", "pixel_v")  # one DUT only: it is no level
    state = corrected(view, variant, gain=gain)
    np.testing.assert_allclose(state["intensity_counts"], view.sim["intensity_counts"] * (1.0 + gain))
    dead = (pixel % 7 == 0).astype(float)
    fraction = corrected(view, variant_of(view, "detector.dead_pixels"), dead=dead)["valid_fraction"]
    np.testing.assert_array_equal(fraction, 1.0 - dead)


def test_dark_counts_scatter_the_time_of_a_pulse_as_its_amplifier_would():
    """A pulse rises through half its height on a noisy line; its time scatters with the noise over the slope."""
    rng = np.random.default_rng(12)
    own, dark, read = np.array([300.0, 1200.0]), 150.0, 12.0
    rise = np.linspace(0.0, 1.0, 2001)  # of the pulse, in ns

    def timed(light, variance):
        level = light * (0.5 - 0.5 * np.cos(np.pi * rise))
        slope = np.interp(0.5, level / light, np.gradient(level, rise))
        return 0.15 * np.hypot(0.02, (np.sqrt(variance) * rng.normal(size=20_000) / slope).std())

    still, noisy = ([timed(x, read**2 + x + more) for x in own] for more in (0.0, dark))
    numbers = {
        "signal_counts": own, "sim_signal_counts": own, "sim_signal_counts_std": np.sqrt(read**2 + own),
        "distance_m": np.full(2, 5.0), "sim_distance_m": np.full(2, 5.0), "distance_m_std": np.array(noisy),
        "sim_distance_m_std": np.array(still), "tof_temperature_c": np.full(2, 40.0),
    }  # fmt: skip
    many = {name: np.tile(values, 40) for name, values in numbers.items()}
    view = View(make_columns(many, {}, shuffle=None)[0])
    variant = variant_of(view, "detector.dark_offset")
    assert "distance_m_std" in variant.channels
    state = corrected(view, variant, dark=dark, shot=1.0)
    np.testing.assert_allclose(state["distance_m_std"][:2], noisy, rtol=0.03)
