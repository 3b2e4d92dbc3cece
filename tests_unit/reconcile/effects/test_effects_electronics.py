"""Detector, read-out, timing, thermal plant and book-keeping: operators against physics made by other means."""

import numpy as np
import pytest
from rendered_bench import bench, corrected, left_over, make_columns, variant_of
from scipy.integrate import solve_ivp
from scipy.optimize import least_squares

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.effect import Kind
from arl_fixtures.reconcile.view import View

C_M_PER_S = 299_792_458.0


def table(**columns):
    """Columns only; measured channels equal their simulation where not given."""
    n = max(np.size(values) for values in columns.values())
    numbers = {
        name: np.broadcast_to(np.asarray(values, dtype=float), (n,)).copy() for name, values in columns.items()
    }
    for name in [name for name in numbers if name.startswith("sim_")]:
        numbers.setdefault(name.removeprefix("sim_"), numbers[name].copy())
    return View(make_columns(numbers, {}, shuffle=None)[0])


def fit(view, variant, channel, start, *, offset=False):
    """Least-squares values from a start, on one channel; with `offset`, beside a free constant."""
    names = list(start)
    bounds = {p.name: (p.low, p.high) for p in variant.parameters}
    scale = np.std(view.number(channel) - view.sim[channel])

    def misfit(x):
        state = corrected(view, variant, **dict(zip(names, map(float, x), strict=True)))
        rest = (view.number(channel) - state[channel]) / scale
        return rest - rest.mean() if offset else rest

    low, high = np.transpose([bounds[name] for name in names])
    found = least_squares(misfit, list(start.values()), bounds=(low, high), x_scale=np.abs(list(start.values())))
    return dict(zip(names, map(float, found.x), strict=True))


# ---- detector and read-out ----------------------------------------------------------------------------------


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


def test_column_pattern_holds_four_interleaved_converters_of_different_gain():
    column = np.tile(np.arange(32.0), 20)
    gains = np.array([1.012, 0.994, 0.988, 1.006])[column.astype(int) % 4]
    light = np.repeat(np.linspace(200.0, 2000.0, 20), 32)
    view = table(pixel_u=column, sim_signal_counts=light, signal_counts=light * gains)
    periodic = variant_of(view, "readout.column_pattern", axis="pixel_u", kind="periodic")
    assert 4.0 in periodic.shapes()[0].starts
    start = {"cosine": 1.0, "sine": 1.0, "gain_cosine": 0.001, "gain_sine": 0.001, "period": 4.0}
    values = fit(view, periodic, "signal_counts", start)
    assert values["period"] == pytest.approx(4.0, abs=0.001)
    assert np.hypot(values["gain_cosine"], values["gain_sine"]) == pytest.approx(0.0134, abs=5e-4)
    assert left_over(view, corrected(view, periodic, **values), "signal_counts") < 1e-3


@pytest.mark.parametrize("kind", ["taps", "gains"])
def test_each_of_four_converters_may_be_off_by_itself(kind):
    column = np.tile(np.arange(32.0), 20)
    own = np.array([0.0, 3.0, -4.0, 1.0])[column.astype(int) % 4]  # no wave of one period says this
    light = np.repeat(np.linspace(200.0, 2000.0, 20), 32)
    measured = light + own if kind == "taps" else light * (1.0 + own / 1000.0)
    view = table(pixel_u=column, sim_signal_counts=light, signal_counts=measured)
    variant = variant_of(view, "readout.column_pattern", axis="pixel_u", kind=kind, converters=4)
    values = fit(
        view, variant, "signal_counts", {f"tap_{k}": 1.0 / (1.0 if kind == "taps" else 1e3) for k in (1, 2, 3)}
    )
    scale = 1.0 if kind == "taps" else 1000.0
    assert [scale * values[f"tap_{k}"] for k in (1, 2, 3)] == pytest.approx([3.0, -4.0, 1.0], rel=1e-3)
    assert "4 converters" in library()["readout.column_pattern"].sentence(variant, values, view)


def test_every_second_column_sees_half_of_the_converters_and_no_parity():
    column = np.tile(np.arange(0.0, 64.0, 2.0), 20)
    own = np.array([3.0, 9.0, -4.0, 9.0, -1.0, 9.0, 2.0, 9.0])[column.astype(int) % 8]
    light = np.repeat(np.linspace(200.0, 2000.0, 20), 32)
    view = table(pixel_u=column, sim_signal_counts=light, signal_counts=light + own)
    variants = list(library()["readout.column_pattern"].variants(view))
    assert {v.options["kind"] for v in variants} == {"periodic", "taps", "gains"}
    (eight,) = (v for v in variants if v.options["kind"] == "taps" and v.options["converters"] == 8)
    values = fit(view, eight, "signal_counts", {p.name: 1.0 for p in eight.parameters})
    assert values == pytest.approx({"tap_0": 3.0, "tap_2": -4.0, "tap_4": -1.0, "tap_6": 2.0}, rel=1e-3)
    assert left_over(view, corrected(view, eight, **values), "signal_counts") < 1e-3


def test_converters_of_which_only_some_are_seen_need_not_sum_to_nothing():
    column = np.tile(np.arange(0.0, 32.0, 2.0), 20)
    own = np.array([6.0, -7.0, 2.0, -1.0])[column.astype(int) % 4]  # these sum to nothing, 6 and 2 do not
    light = np.repeat(np.linspace(200.0, 2000.0, 20), 16)
    view = table(pixel_u=column, sim_signal_counts=light, signal_counts=light + own)
    variant = variant_of(view, "readout.column_pattern", kind="taps", converters=4)
    values = fit(view, variant, "signal_counts", {p.name: 1.0 for p in variant.parameters})
    np.testing.assert_allclose(corrected(view, variant, **values)["signal_counts"], light + own, atol=1e-6)
    assert "up to 4 counts" in library()["readout.column_pattern"].sentence(variant, values, view)


def test_a_level_is_no_pattern_of_the_converters_that_are_seen():
    column = np.tile(np.array([k for k in range(17) if k % 8 != 7], dtype=float), 20)  # none of the eighth
    light = np.repeat(np.linspace(200.0, 2000.0, 20), 15)
    view = table(pixel_u=column, sim_signal_counts=light, signal_counts=light + 5.0 + 0.01 * np.cos(light))
    (eight,) = (
        v
        for v in library()["readout.column_pattern"].variants(view)
        if v.options["kind"] == "taps" and v.options["converters"] == 8
    )
    values = fit(view, eight, "signal_counts", {p.name: 1.0 + 0.1 * k for k, p in enumerate(eight.parameters)})
    assert left_over(view, corrected(view, eight, **values), "signal_counts") > 0.5


def test_noise_excess_beyond_a_knee_says_where():
    warm = np.linspace(-10.0, 85.0, 400)
    view = table(
        tof_temperature_c=warm, sim_signal_counts=500.0, sim_signal_counts_std=10.0,
        signal_counts_std=np.where(warm > 60.0, 14.0, 10.0),
    )  # fmt: skip
    variant = variant_of(view, "readout.noise_excess", condition="split", column="tof_temperature_c")
    values = {"factor_below": 0.0, "factor_above": 0.4, "knee": 60.0}
    assert left_over(view, corrected(view, variant, **values), "signal_counts_std") < 0.02
    assert library()["readout.noise_excess"].where(variant, values, view) == {"tof_temperature_c": [60.0, 85.0]}


def test_repeatability_is_a_group_scatter_and_moves_nothing():
    view = View(bench(columns=(58, 62), rows=(12, 14), angles=(-1.8, 1.8, 5), steps=6))
    effect = library()["bench.repeatability"]
    assert effect.kind is Kind.GROUP_SCATTER
    groups = {(v.options["channel"], v.options["group"]) for v in effect.variants(view)}
    assert ("distance_m", "step") in groups
    assert ("intensity_counts", "frame") in groups
    state = corrected(view, variant_of(view, "bench.repeatability"), scatter=5.0)
    for name, values in state.items():
        np.testing.assert_array_equal(values, view.sim[name])


# ---- timing -------------------------------------------------------------------------------------------------


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


# ---- thermal plant ------------------------------------------------------------------------------------------


def plant(resistance=1.0, water_k=0.0):
    """A housing on a plate: 900 J/K, 25 W/K / resistance to the plate, 12 W of its own; water that melts at 0 °C."""
    time = np.linspace(0.0, 9000.0, 1500)
    plate = np.interp(time, [0.0, 500.0, 4000.0, 6000.0, 9000.0], [-15.0, -15.0, 50.0, 50.0, -15.0])

    def balance(moment, state):
        heat = state[0]  # kelvin of stored heat, water_k of it latent
        node = heat if heat < 0.0 else max(heat - water_k, 0.0)
        return [((np.interp(moment, time, plate) - node) * 25.0 / resistance + 12.0) / 900.0]

    start = plate[0] + 12.0 * resistance / 25.0
    heat = solve_ivp(balance, (0.0, 9000.0), [start], t_eval=time, rtol=1e-8, atol=1e-8, max_step=10.0).y[0]
    return time, plate, np.where(heat < 0.0, heat, np.maximum(heat - water_k, 0.0))


def test_contact_resistance_settles_warmer_and_follows_later():
    time, plate, assumed = plant()
    _, _, real = plant(resistance=2.5)
    view = table(
        time_s=time, plate_temperature_c=plate, sim_housing_temperature_c=assumed, housing_temperature_c=real
    )
    variant = variant_of(view, "thermal.contact_resistance")
    state = corrected(view, variant, excess=1.5, time_constant=36.0)
    assert left_over(view, state, "housing_temperature_c") < 2e-3


def test_latent_heat_holds_the_temperature_while_water_melts_and_freezes():
    time, plate, dry = plant()
    _, _, wet = plant(water_k=8.0)
    view = table(time_s=time, plate_temperature_c=plate, sim_node_temperature_c=dry, node_temperature_c=wet)
    variant = variant_of(view, "thermal.latent_heat", channel="node_temperature_c")
    state = corrected(view, variant, latent=8.0, time_constant=36.0)
    assert left_over(view, state, "node_temperature_c") < 0.01
    held = np.abs(state["node_temperature_c"]) < 0.05
    assert held.sum() * (time[1] - time[0]) > 200.0


def test_sensor_offset_is_a_thermocouple_off_at_ice_and_off_in_gain():
    truth = np.linspace(-10.0, 85.0, 50)
    view = table(sim_housing_temperature_c=truth, housing_temperature_c=truth * 1.01 + 0.8)
    variant = variant_of(view, "thermal.sensor_offset")
    state = corrected(view, variant, offset=0.8 + 0.25, gain=0.01)  # the offset is told at 25 °C
    assert left_over(view, state, "housing_temperature_c") < 1e-12
