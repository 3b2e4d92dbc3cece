"""Laser and beam: operators against diodes, rate equations and beams made by other means."""

import re

import numpy as np
import pytest
from operator_tables import fit, table
from rendered_bench import bench, corrected, left_over, variant_of

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.view import View

LIGHT = "intensity_counts"


def test_a_worn_beam_and_a_gain_are_told_apart_by_where_they_act():
    view = View(bench(columns=(20, 108), rows=(2, 30), angles=(0.0, 0.9, 2)))
    worn = corrected(view, variant_of(view, "beam.profile_change", kind="centre", driver=""), centre=0.1, radius=0.5)
    ratio = worn[LIGHT] / view.sim[LIGHT]
    az, el = view.number("azimuth_deg"), view.number("elevation_deg")
    assert ratio[(np.abs(az) < 3.0) & (np.abs(el) < 2.0)].mean() < 0.92
    assert ratio[np.abs(az) > 34.0].mean() > 0.985


def test_rolloff_fits_a_diode_whose_threshold_grows_exponentially():
    warm = np.linspace(-10.0, 85.0, 300)
    power = 40.0 - 5.0 * np.exp((warm - 25.0) / 45.0)  # slope · (J − J_th(T)), T0 = 45 K
    view = table(laser_temperature_c=warm, sim_signal_counts=1000.0, signal_counts=1000.0 * power / 35.0)
    variant = variant_of(view, "laser.thermal_rolloff", kind="slope")
    fit(view, variant, "signal_counts", {"slope": 0.001, "growth": 0.01})
    values = fit(view, variant, "signal_counts", {"slope": 0.003, "growth": 0.02})
    state = corrected(view, variant, **values)
    assert np.abs(state["signal_counts"] / view.number("signal_counts") - 1.0).max() < 0.01
    assert np.all(np.diff(state["signal_counts"]) < 0.0)


@pytest.mark.parametrize("fade", [0.004, -0.009])
def test_rolloff_shifts_the_whole_light_current_curve_and_says_which_way_its_slope_goes(fade):
    current, warm = (part.ravel() for part in np.meshgrid(np.linspace(0.0, 3.0, 301), [20.0, 35.0]))

    def diode(j, temperature):
        threshold = 1.0 + 0.02 * (temperature - 20.0)
        slope = 400.0 * np.exp(-fade * (temperature - 20.0))
        return 5.0 * j + slope * 0.02 * np.logaddexp(0.0, (j - threshold) / 0.02)

    cold, real = diode(current, 20.0), diode(current, warm)
    view = table(
        drive_current_a=current, heatsink_temperature_c=warm, sim_photodiode_w=cold, photodiode_w=real
    )  # fmt: skip
    variant = variant_of(view, "laser.thermal_rolloff", kind="curve")
    values = fit(
        view,
        variant,
        "photodiode_w",
        {"threshold_shift": 0.01, "loss": 0.002, "reference": 21.0},
        scale=np.full(602, 1.0),
    )
    assert left_over(view, corrected(view, variant, **values), "photodiode_w") < 2e-3
    assert values["threshold_shift"] == pytest.approx(0.02, rel=0.05)
    slopes = [
        np.diff(diode(np.array([2.5, 3.0]), temperature))[0] / 0.5 - 5.0 for temperature in (20.0, 35.0)
    ]  # fmt: skip
    said = library()["laser.thermal_rolloff"].sentence(variant, values, view)
    percent = float(re.search(r"changes by ([+-][\d.]+) %", said)[1])
    assert percent == pytest.approx((slopes[1] / slopes[0] - 1.0) * 100.0, abs=1.5)
    assert f"{values['threshold_shift'] * 1e3:.2f} mA per kelvin" in said


def test_power_decay_weights_time_by_temperature_as_a_rate_equation_does():
    time = np.linspace(0.0, 40_000.0, 800)
    warm = 40.0 + 40.0 * np.sin(time / 3000.0)
    power, kept = 1.0, []
    for temperature in warm:  # explicit steps of dP/dt = −k0 exp(−E/kT) P
        kept.append(power)
        power -= 50.0 * 2e-6 * np.exp(-0.5 / 8.617e-5 * (1.0 / (temperature + 273.15) - 1.0 / 313.15)) * power
    view = table(
        time_s=time, housing_temperature_c=warm, sim_signal_counts=1000.0, signal_counts=1000.0 * np.array(kept)
    )
    variant = variant_of(view, "laser.power_decay", temperature="housing_temperature_c")
    values = fit(view, variant, "signal_counts", {"loss": 0.05, "activation_energy": 0.4})
    assert values["activation_energy"] == pytest.approx(0.5, abs=0.01)
    assert left_over(view, corrected(view, variant, **values), "signal_counts") < 1e-3


def test_pulse_energy_jitter_widens_the_scatter_as_drawn_pulses_do():
    rng = np.random.default_rng(4)
    light = np.linspace(100.0, 3000.0, 30)
    frames = light * (1.0 + 0.02 * rng.normal(size=(20_000, 1))) + 8.0 * rng.normal(size=(20_000, 30))
    view = table(sim_signal_counts=light, sim_signal_counts_std=8.0, signal_counts_std=frames.std(axis=0))
    state = corrected(view, variant_of(view, "laser.pulse_energy_jitter"), jitter=0.02)
    np.testing.assert_allclose(state["signal_counts_std"], view.number("signal_counts_std"), rtol=0.03)


@pytest.mark.parametrize("end", ["low", "high"])
def test_a_beam_is_blurred_by_no_more_than_a_law_of_second_order_holds_for(end):
    u, v = (a.ravel().astype(float) for a in np.meshgrid(np.arange(48), np.arange(6)))
    angle = 0.75 * (u - 23.5)
    fine = np.arange(-90.0, 90.0, 0.02)

    def beam(variance):  # of rays of 6 deg, each spread by 8 deg and what the blur adds to that
        spread = np.exp(-0.5 * np.arange(-60.0, 60.01, 0.02) ** 2 / (64.0 + variance))
        rays = np.exp(-0.5 * (fine / 6.0) ** 2)
        return np.interp(angle, fine, np.convolve(rays, spread / spread.sum(), mode="same"))

    elevation, plain = 0.75 * (v - 2.5), 1000.0 * beam(0.0)
    view = table(pixel_u=u, pixel_v=v, azimuth_deg=angle, elevation_deg=elevation, sim_signal_counts=plain)
    blur = variant_of(view, "beam.profile_change", kind="blur")
    along = blur.parameters[0]
    most = getattr(along, end)
    values = {p.name: most if p is along else 0.0 for p in blur.parameters}
    told = corrected(view, blur, **values)["signal_counts"] / view.sim["signal_counts"]
    np.testing.assert_allclose(told, beam(most) / beam(0.0), rtol=0.16)
