"""A diode driven well above its threshold: the curve moves by more than the currents that the table holds."""

import numpy as np
import pytest
from rendered_bench import corrected, left_over, make_columns, variant_of

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.view import View


def carriers(current, threshold):
    """Steady light of the rate equations of carriers and photons, bisected on the carriers' balance."""
    low, high = np.zeros_like(current), np.full_like(current, 0.999999)
    for _ in range(60):
        middle = 0.5 * (low + high)
        light = 1e-3 * middle / (1.0 - middle)  # spontaneous emission, amplified below full inversion
        more = current / threshold > middle + middle * light
        low, high = np.where(more, middle, low), np.where(more, high, middle)
    filled = 0.5 * (low + high)
    return 1000.0 * (current - threshold * filled)


def diode_view(currents, warm, jitter=0.0):
    current, temperature = (part.ravel() for part in np.meshgrid(currents, warm))
    current = current + jitter * np.random.default_rng(3).normal(size=current.size)
    columns = {
        "drive_current_a": current, "heatsink_temperature_c": temperature,
        "sim_photodiode_w": carriers(current, np.full_like(current, 1.0)),
        "photodiode_w": carriers(current, 1.0 + 0.02 * (temperature - 25.0)),
    }  # fmt: skip
    return View(make_columns(columns, {}, shuffle=None)[0])


@pytest.mark.parametrize(
    ("currents", "jitter"), [(np.linspace(1.8, 3.0, 61), 0.0), (np.repeat([1.8, 2.2, 2.6, 3.0], 9), 1e-3)]
)
@pytest.mark.parametrize("warm", [[25.0, 45.0], [5.0, 25.0]])
def test_a_threshold_moves_the_light_at_the_ends_of_the_currents_too(currents, jitter, warm):
    view = diode_view(currents, warm, jitter)
    variant = variant_of(view, "laser.thermal_rolloff", kind="curve")
    state = corrected(view, variant, threshold_shift=0.02, reference=25.0)
    assert left_over(view, state, "photodiode_w") < 1e-3


def test_below_its_threshold_a_laser_gives_no_light_and_not_less():
    view = diode_view(np.linspace(1.2, 3.0, 61), [25.0, 60.0])
    state = corrected(
        view, variant_of(view, "laser.thermal_rolloff", kind="curve"), threshold_shift=0.02, reference=25.0
    )
    assert state["photodiode_w"].min() >= 0.0
    assert left_over(view, state, "photodiode_w") < 0.01


def rack(read_outs):
    """Five units with thresholds and slopes of their own, driven near 18 levels, warmed by what is not light."""
    rng = np.random.default_rng(9)
    level, warm, unit = (
        x.ravel() for x in np.meshgrid(np.linspace(0.05, 1.2, 18), np.linspace(8.0, 60.0, 9), np.arange(5))
    )
    current = level * (1.0 + 2e-3 * rng.normal(size=level.size))
    sink = warm + 0.25 * rng.normal(size=level.size)
    threshold = 0.15 * (1.0 + 0.05 * rng.normal(size=5))[unit.astype(int)]
    slope = 0.9 * (1.0 + 0.04 * rng.normal(size=5))[unit.astype(int)]

    def light(per_kelvin):
        power = slope * np.maximum(current - threshold, 0.0)
        for _ in range(40):  # what is neither light nor lost below threshold warms the junction, at 9 K/W
            junction = sink + 9.0 * (1.8 * current - power)
            moved = threshold * np.exp(per_kelvin * (junction - 25.0))
            power = slope * np.exp(-0.35 * per_kelvin * (junction - 25.0)) * np.maximum(current - moved, 0.0)
        return power

    cold, real = light(0.0), light(2e-4)
    columns = {"laser_current_a": current, "heat_sink_temperature_c": sink, "set_temperature_c": warm}
    for name, share in read_outs.items():
        columns |= {f"sim_{name}": share * cold, name: share * real}
    labels = {"dut": np.array([f"u{k:.0f}" for k in unit])}
    return View(make_columns(columns, labels, shuffle=None)[0]), current - threshold


def test_devices_near_their_thresholds_move_along_their_own_curves():
    view, above = rack({"optical_power_w": 1.0})
    variant = variant_of(view, "laser.thermal_rolloff", kind="junction", temperature="heat_sink_temperature_c")
    state = corrected(
        view, variant, threshold_shift=0.15 * 2e-4, loss=0.35 * 2e-4, heating=12.0, exponent=1.3, growth=0.0,
        reference=25.0,
    )  # fmt: skip
    change, left = (view.number("optical_power_w") - x["optical_power_w"] for x in (view.sim, state))
    for low, high in ((0.02, 0.12), (0.12, 0.4), (0.4, 2.0)):
        near = (above > low) & (above < high)
        assert near.sum() > 20
        assert np.sum(left[near] ** 2) < 0.03 * np.sum(change[near] ** 2)


def test_what_a_laser_does_all_that_see_its_light_show():
    view, _ = rack({"optical_power_w": 1.0, "monitor_current_a": 4e-4, "ambient_light_w": 1e-3})
    joint = variant_of(view, "laser.thermal_rolloff", kind="curve", seen_in="monitor_current_a")
    values = {"threshold_shift": 3e-5, "loss": 7e-5, "reference": 20.0}
    state = corrected(view, joint, **values)
    for channel in ("optical_power_w", "monitor_current_a"):
        alone = variant_of(view, "laser.thermal_rolloff", kind="curve", channel=channel)
        np.testing.assert_allclose(state[channel], corrected(view, alone, **values)[channel], rtol=1e-12)
        assert left_over(view, state, channel) < 0.3
    np.testing.assert_array_equal(state["ambient_light_w"], view.sim["ambient_light_w"])
    assert {"optical_power_w", "monitor_current_a"} <= set(joint.channels)


def test_the_current_that_the_light_follows_drives_the_laser_and_not_the_fans():
    rng = np.random.default_rng(4)
    current, temperature = (a.ravel() for a in np.meshgrid(np.repeat([1.8, 2.2, 2.6, 3.0], 9), [5.0, 25.0, 45.0]))
    columns = {
        "fan_current_a": 0.3 + 0.002 * temperature + 0.05 * rng.random(current.size), "laser_current_a": current,
        "bracket_current_a": rng.choice([1.0, 2.0], size=current.size), "laser_temperature_c": temperature,
        "sim_photodiode_w": carriers(current, np.full_like(current, 1.0)),
        "photodiode_w": carriers(current, 1.0 + 0.005 * (temperature - 25.0)),
    }  # fmt: skip
    view = View(make_columns(columns, {}, shuffle=None)[0])
    state = corrected(
        view, variant_of(view, "laser.thermal_rolloff", kind="curve"), threshold_shift=0.005, reference=25.0
    )
    assert left_over(view, state, "photodiode_w") < 0.01


def test_a_threshold_that_ages_is_that_of_the_laser_and_not_of_a_pump_before_it_in_the_alphabet():
    rng = np.random.default_rng(5)
    current, cycle = (a.ravel() for a in np.meshgrid(np.repeat([1.8, 2.2, 2.6, 3.0], 9), [0.0, 1.0, 2.0, 3.0]))
    columns = {
        "coolant_pump_current_a": rng.choice([1.0, 2.0], size=current.size), "laser_current_a": current,
        "cycle": cycle, "sim_photodiode_w": carriers(current, np.full_like(current, 1.0)),
        "photodiode_w": carriers(current, 1.0 + 0.05 * cycle),
    }  # fmt: skip
    view = View(make_columns(columns, {}, shuffle=None)[0])
    driven = {v.options["current"] for v in library()["laser.power_decay"].variants(view) if "current" in v.options}
    assert driven == {"laser_current_a"}
