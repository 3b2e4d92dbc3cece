"""Gains near breakdown, and lasers that age within a cycle and along their light-current curve, by other means."""

import numpy as np
import pytest
from rendered_bench import corrected, left_over, make_columns, variant_of
from scipy.optimize import least_squares

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.view import View


def view_of(labels=None, **columns):
    n = len(next(iter(columns.values())))
    filled = {name: np.broadcast_to(np.asarray(x, dtype=float), (n,)).copy() for name, x in columns.items()}
    return View(make_columns(filled, labels or {}, shuffle=None)[0])


def fitted(view, variant, channel, **starts):
    names = list(starts)
    bounds = {p.name: (p.low, p.high) for p in variant.parameters}
    size_of_noise = np.maximum(0.01 * view.sim[channel], 0.002 * view.sim[channel].max())

    def misfit(x):
        state = corrected(view, variant, **dict(zip(names, map(float, x), strict=True)))
        return (view.number(channel) - state[channel]) / size_of_noise

    low, high = np.transpose([bounds[name] for name in names])
    size = np.maximum(np.abs(list(starts.values())), 1e-6)
    found = least_squares(misfit, list(starts.values()), bounds=(low, high), x_scale=size)
    return dict(zip(names, map(float, found.x), strict=True))


def avalanche(bias, temperature):
    """Gain of a region in which holes ionise a tenth as often as electrons (McIntyre), phonons slowing both."""
    ionising = 60.0 * np.exp(-700.0 * (1.0 + 1e-3 * (temperature - 25.0)) / bias)
    return 0.9 / (np.exp(-0.9 * ionising) - 0.1)


def stand(gain, dark=0.0):
    bias, temperature, power = (
        a.ravel()
        for a in np.meshgrid([120.0, 140.0, 155.0, 170.0, 180.0], [-20.0, 5.0, 25.0, 50.0, 80.0], [1.0, 10.0])
    )
    cold = 50.0 * power * avalanche(bias, 25.0)
    seen = 50.0 * power * avalanche(bias, temperature if gain else 25.0) + dark * avalanche(
        bias, temperature if gain else 25.0
    ) * 2.0 ** ((temperature - 80.0) / 9.0)
    return view_of(
        bias_v=bias, tof_temperature_c=temperature, lamp_w=power, sim_signal_counts=cold, signal_counts=seen
    )


def test_a_gain_that_loses_its_breakdown_to_the_warmth_does_so_the_more_the_nearer_it_is():
    view = stand(gain=True)
    variant = variant_of(view, "detector.gain_temperature", bias="bias_v")
    values = fitted(view, variant, "signal_counts", drift=0.05, breakdown=220.0, order=2.0)
    assert left_over(view, corrected(view, variant, **values), "signal_counts") < 0.03
    # at a bias that grows in proportion to the phonons' toll the gain is what it was
    assert values["drift"] / values["breakdown"] == pytest.approx(1e-3, rel=0.25)
    assert "mV per kelvin" in library()["detector.gain_temperature"].sentence(variant, values, view)


def test_a_dark_signal_is_multiplied_as_the_light_is():
    view = stand(gain=False, dark=40.0)
    plain = variant_of(view, "detector.dark_offset")
    multiplied = variant_of(view, "detector.dark_offset", bias="bias_v")
    alone = fitted(view, plain, "signal_counts", dark=40.0, doubling=9.0)
    values = fitted(view, multiplied, "signal_counts", dark=40.0, doubling=9.0, breakdown=220.0)
    assert values["doubling"] == pytest.approx(9.0, rel=0.02)
    left = [
        left_over(view, corrected(view, v, **x), "signal_counts") for v, x in ((multiplied, values), (plain, alone))
    ]
    assert left[0] < 0.01
    assert left[1] > 10.0 * left[0]


def test_a_dark_signal_is_multiplied_as_the_simulation_multiplies_light_by_whatever_law():
    grid = np.meshgrid(np.linspace(90.0, 150.0, 7), [0.0, 25.0, 50.0], [2.0, 20.0, 90.0])
    bias, warm, light = (x.ravel() for x in grid)
    breakdown = 158.0 + 0.14 * (warm - 25.0)
    gain = 1.0 / (1.0 - (bias / breakdown) ** 3.4)  # and it drifts with the die
    generated = 0.02 * np.exp2((warm - 25.0) / 9.0)
    view = view_of(
        bias_v=bias, detector_temperature_c=warm, optical_power_nw=light, sim_photocurrent_na=0.7 * light * gain,
        photocurrent_na=(0.7 * light + generated) * gain,
    )  # fmt: skip
    known = variant_of(view, "detector.dark_offset", light="optical_power_nw")
    values = fitted(view, known, "photocurrent_na", dark=0.3, doubling=10.0)
    assert values["doubling"] == pytest.approx(9.0, rel=0.02)
    assert left_over(view, corrected(view, known, **values), "photocurrent_na") < 0.01


def test_without_a_swept_bias_there_is_no_breakdown_to_tell():
    view = view_of(
        bias_v=np.full(60, 150.0) + 0.1 * np.sin(np.arange(60)), tof_temperature_c=np.linspace(0.0, 60.0, 60),
        sim_signal_counts=1000.0, signal_counts=1000.0,
    )  # fmt: skip
    variants = [
        v for name in ("gain_temperature", "dark_offset") for v in library()[f"detector.{name}"].variants(view)
    ]
    assert variants
    assert not any("bias" in v.options for v in variants)


def test_emitters_that_die_do_so_within_a_cycle_as_well():
    """Five thousand emitters with lives drawn at random; a cycle's steps follow each other at 2.5 hours."""
    cycle, step = (a.ravel() for a in np.meshgrid(np.arange(4.0), np.arange(4.0), indexing="ij"))
    hours = 10.0 * cycle + 2.5 * step
    lives = np.random.default_rng(8).lognormal(np.log(150.0), 0.6, 5000)
    alive = np.mean(lives > hours[:, None] + 40.0, axis=1)
    view = view_of(
        cycle=cycle, step=step, time_s=3600.0 * (2.5 * step + 2.4), sim_signal_counts=1000.0,
        signal_counts=1000.0 * alive / alive[0],
    )  # fmt: skip
    left = {}
    for within in (None, "time_s"):
        variant = variant_of(view, "laser.power_decay", age="cycle", within=within)
        values = fitted(view, variant, "signal_counts", loss=0.05, exponent=1.0)
        left[within] = left_over(view, corrected(view, variant, **values), "signal_counts")
    assert left["time_s"] < 0.5 * left[None]


def carriers(current, threshold):
    """Steady light of the rate equations of carriers and photons, bisected on the carriers' balance."""
    low, high = np.zeros_like(current), np.full_like(current, 0.999999)
    for _ in range(60):
        middle = 0.5 * (low + high)
        light = 1e-3 * middle / (1.0 - middle)
        more = current / threshold > middle + middle * light
        low, high = np.where(more, middle, low), np.where(more, high, middle)
    filled = 0.5 * (low + high)
    return 1000.0 * (current - threshold * filled)


def test_a_cavity_that_loses_more_every_hour_raises_its_threshold_and_lowers_its_slope():
    current, hours = (a.ravel() for a in np.meshgrid(np.linspace(0.2, 3.0, 40), [0.0, 500.0, 1000.0, 2000.0]))
    inner = 4.0 + 0.5 * hours / 2000.0  # per cm, beside 12 per cm of the mirrors
    seen = carriers(current, (inner + 12.0) / 16.0) * 16.0 / (inner + 12.0)
    view = view_of(
        drive_current_a=current, operating_h=hours, sim_photodiode_w=carriers(current, np.ones_like(current)),
        photodiode_w=seen,
    )  # fmt: skip
    variant = variant_of(view, "laser.power_decay", age="operating_h", current="drive_current_a")
    values = fitted(view, variant, "photodiode_w", threshold_rise=0.01, loss=0.01, exponent=0.7)
    assert left_over(view, corrected(view, variant, **values), "photodiode_w") < 1e-3
    assert values["threshold_rise"] == pytest.approx(0.5 / 16.0, rel=0.05)
    assert values["loss"] == pytest.approx(0.5 / 16.0, rel=0.1)
    plain = variant_of(view, "laser.power_decay", age="operating_h")
    alone = fitted(view, plain, "photodiode_w", loss=0.03, exponent=1.0)
    assert left_over(view, corrected(view, plain, **alone), "photodiode_w") > 0.05


def test_lasers_whose_thresholds_rise_at_their_own_pace_are_told_from_targets_that_change_with_the_current():
    """Which board is shown goes with the current: no two of them share more than a pair of currents."""
    paces = np.array([0.0021, 0.0012, 0.0034, 0.0017])
    number, cycle, shot = (a.ravel() for a in np.meshgrid(np.arange(4), np.arange(0, 500, 50), np.arange(24),
                                                          indexing="ij"))  # fmt: skip
    paint, away = np.array([0.1, 0.3, 0.5, 0.8])[shot % 4], 3.0 + 0.5 * (shot % 3)
    drive = np.array([0.60, 0.68, 0.75, 0.83, 0.90, 1.00])[shot // 4]
    risen = 0.12 * (1.0 + paces[number] * cycle / 4.5) ** 1.2
    view = view_of(
        labels={"dut": np.array(["A", "B", "C", "D"])[number]}, cycle=cycle.astype(float), laser_current_a=drive,
        reflectance=paint, true_range_m=away, sim_intensity_counts=3e4 * (drive - 0.12) * paint / away**2,
        intensity_counts=3e4 * (drive - risen) * paint / away**2,
    )  # fmt: skip
    variant = next(
        v for v in library()["laser.power_decay"].variants(view)
        if v.options["age"] == "cycle" and {"units", "current"} <= set(v.options)
    )  # fmt: skip
    starts = {p.name: 0.01 if p.is_amplitude else 1.0 for p in variant.parameters}
    values = fitted(view, variant, "intensity_counts", **starts)
    assert left_over(view, corrected(view, variant, **values), "intensity_counts") < 2e-3
    last = 0.12 * ((1.0 + paces * 450.0 / 4.5) ** 1.2 - 1.0)
    assert [values[f"threshold_rise_{unit}"] for unit in "ABCD"] == pytest.approx(last, rel=0.03)
