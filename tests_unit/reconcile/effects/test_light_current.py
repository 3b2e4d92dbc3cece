"""A diode driven well above its threshold: the curve moves by more than the currents that the table holds."""

import numpy as np
import pytest
from rendered_bench import corrected, left_over, make_columns, variant_of

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
