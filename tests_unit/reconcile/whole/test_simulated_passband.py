"""A simulation that has the filter's passband over the angle, and lacks only that the laser line drifts in it."""

import numpy as np
import pyarrow as pa
import pytest
from rendered_bench import corrected, left_over, make_columns, variant_of
from scipy.optimize import least_squares

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of
from arl_fixtures.reconcile.view import View

LINE_NM, DRIFT_NM_PER_K = 940.0, 0.07


def stack(wavelength_nm, angle_deg):
    """Transmission of a glass | half-wave cavity between quarter-wave mirrors | glass stack, by its matrices."""
    sine = np.sin(np.radians(angle_deg))
    high, low, glass, design = 2.3, 1.46, 1.5, 949.0
    layers = [high, low] * 3 + [high, low, low, high] + [low, high] * 3
    matrix = np.zeros((*np.broadcast(wavelength_nm, sine).shape, 2, 2), dtype=complex)
    matrix[..., 0, 0] = matrix[..., 1, 1] = 1.0
    for index in layers:
        inside = np.sqrt(1.0 - (sine / index) ** 2)
        phase = 2.0 * np.pi * index * (design / 4.0 / index) * inside / wavelength_nm
        admittance = index * inside
        layer = np.empty_like(matrix)
        layer[..., 0, 0] = layer[..., 1, 1] = np.cos(phase)
        layer[..., 0, 1], layer[..., 1, 0] = 1j * np.sin(phase) / admittance, 1j * admittance * np.sin(phase)
        matrix = matrix @ layer
    outside = glass * np.sqrt(1.0 - (sine / glass) ** 2)
    low_side = matrix[..., 0, 0] + matrix[..., 0, 1] * outside
    field = outside * low_side + matrix[..., 1, 0] + matrix[..., 1, 1] * outside
    return 4.0 * outside**2 / np.abs(field) ** 2


def drifting_view():
    """Laser light averaged over a line 6 nm wide, at angles and laser temperatures."""
    angle, warm = (a.ravel() for a in np.meshgrid(np.linspace(-24.0, 24.0, 49), np.linspace(-15.0, 65.0, 17)))
    across = np.linspace(-6.0, 6.0, 13)
    weight = np.exp(-0.5 * (across / 3.0) ** 2)

    def passed(line_nm):
        return sum(w * stack(line_nm + d, angle) for w, d in zip(weight, across, strict=True)) / weight.sum()

    simulated = passed(np.full(angle.size, LINE_NM))
    real = passed(LINE_NM + DRIFT_NM_PER_K * (warm - 25.0))
    numbers = {
        "azimuth_deg": angle, "laser_temperature_c": warm, "sim_signal_counts": 2000.0 * simulated,
        "signal_counts": 2000.0 * real,
    }  # fmt: skip
    return View(make_columns(numbers, {}, shuffle=None)[0])


def fitted(view, variant):
    free = variant.parameters

    def misfit(x):
        state = corrected(view, variant, **{p.name: float(v) for p, v in zip(free, x, strict=True)})
        return (view.number("signal_counts") - state["signal_counts"]) / 10.0

    found = [
        least_squares(
            misfit, [p.typical if p.is_amplitude else {"offset": start}.get(p.name, p.starts[0]) for p in free],
            bounds=([p.low for p in free], [p.high for p in free]),
            x_scale=[abs(p.typical if p.is_amplitude else p.high) for p in free],
        )
        for start in (-0.5, 0.3)
    ]  # fmt: skip
    best = min(found, key=lambda fit: fit.cost)
    return {p.name: float(v) for p, v in zip(free, best.x, strict=True)}


def test_a_drift_within_a_simulated_passband_is_within_reach():
    view = drifting_view()
    variant = variant_of(view, "optics.filter_shift", simulated=True)
    values = fitted(view, variant)
    state = corrected(view, variant, **values)
    assert left_over(view, state, "signal_counts") < 0.02
    # the line's drift over the wavelength: the tilt is the wavelength in half-widths
    assert values["drift"] / values["tilt"] * LINE_NM == pytest.approx(DRIFT_NM_PER_K, rel=0.35)
    said = library()["optics.filter_shift"].sentence(variant, values, view)
    assert "simulation has at 25 °C only" in said


def test_what_the_simulation_has_at_the_reference_temperature_is_left_alone():
    view = drifting_view()
    variant = variant_of(view, "optics.filter_shift", simulated=True)
    state = corrected(view, variant, drift=0.02, tilt=100.0, offset=-0.4)
    same = view.number("laser_temperature_c") == 25.0
    assert same.sum() == 49
    np.testing.assert_allclose(state["signal_counts"][same], view.sim["signal_counts"][same], rtol=1e-12)


def test_without_angles_there_is_one_passband_only():
    numbers = {"laser_temperature_c": np.linspace(0.0, 50.0, 60), "sim_signal_counts": np.full(60, 500.0)}
    view = View(make_columns(numbers | {"signal_counts": np.full(60, 500.0)}, {}, shuffle=None)[0])
    assert not any(v.options.get("simulated") for v in library()["optics.filter_shift"].variants(view))


def test_a_filter_that_is_turned_in_a_beam_is_told_by_its_own_angle():
    """A gas cell's filter, at another angle and laser temperature on each of 40 days; no pixels, no rays."""
    rng = np.random.default_rng(6)
    day, level = (a.ravel() for a in np.meshgrid(np.arange(40), np.array([0.2, 0.6, 1.0]), indexing="ij"))
    turned, warm = rng.uniform(0.0, 10.0, 40)[day], rng.uniform(16.0, 36.0, 40)[day]
    passed = stack(947.0 + 0.1 * (warm - 25.0), turned) / stack(np.array(947.0), np.array(0.0))
    light = 9000.0 * level
    sigma = np.hypot(20.0, 0.01 * light)
    table = columns_of(pa.table({
        "step": day, "filter_angle_deg": turned, "laser_temperature_c": warm, "n_frames": np.full(day.size, 16),
        "sim_signal_counts": light, "sim_signal_counts_std": sigma, "sim_signal_counts_repeat_std": 1e-3 * light,
        "signal_counts": light * passed * (1.0 + 1e-3 * rng.normal(size=40)[day])
        + sigma / 4.0 * rng.normal(size=day.size),
    }))  # fmt: skip
    (found,) = diagnose(table)[0].findings
    assert found.effect == "optics.filter_shift"
    assert set(found.drivers) == {"filter_angle_deg", "laser_temperature_c"}
    assert found.held_out.explained > 0.8
