"""An avalanche diode at several bias voltages, from the ionisation of carriers in its field; no law of its gain."""

import numpy as np
import pytest
from rendered_bench import make_columns

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.effects_avalanche import multiplication
from arl_fixtures.reconcile.search import Search
from arl_fixtures.reconcile.view import View

SIGNAL = "photocurrent_a"


def gain_of(bias_v, field_of_ionisation=1.1e7):
    """1 / (1 − ∫α dx) of a one-sided junction, α = A·exp(−F / E), E falling linearly from the junction."""
    depth = np.linspace(0.0, 1.0, 400)
    width = 1.2e-5 * np.sqrt(np.asarray(bias_v)[..., None] / 100.0)
    field = 2.0 * np.asarray(bias_v)[..., None] / width * (1.0 - depth)
    rate = 2.64e5 * np.exp(-np.asarray(field_of_ionisation)[..., None] / np.maximum(field, 1.0))
    return 1.0 / (1.0 - np.trapezoid(rate * width, depth, axis=-1))


def stand(*, hot=0.0, dark=0.0, seed=4):
    """Currents at biases, powers and temperatures; `hot`: relative growth of the ionisation field per kelvin."""
    rng = np.random.default_rng(seed)
    temperatures = np.array([-20.0, 0.0, 20.0, 40.0, 60.0, 75.0, 50.0, 10.0])
    step, bias, power = (
        a.ravel()
        for a in np.meshgrid(
            np.arange(8.0), np.array([60.0, 80.0, 95.0, 105.0]), np.geomspace(3e-8, 3e-6, 10), indexing="ij"
        )
    )
    warm = temperatures[step.astype(int)] - 25.0
    sim = 0.5 * power * gain_of(bias)
    gain = gain_of(bias, 1.1e7 * (1.0 + hot * warm))
    true = gain * (0.5 * power + dark * 2.0 ** (warm / 9.0))
    error = np.hypot(3e-10, 0.002 * sim)
    return make_columns(
        {
        "step": step, "diode_temperature_c": warm + 25.0, "bias_v": bias, "optical_power_w": power,
        "n_frames": np.full(step.size, 20.0), f"sim_{SIGNAL}": sim, f"sim_{SIGNAL}_std": error,
        SIGNAL: true + rng.normal(0.0, error / np.sqrt(20.0)),
    }, {})[0]  # fmt: skip


def test_the_multiplication_is_read_from_the_simulation():
    law = multiplication(View(stand()), SIGNAL)
    bias = np.array([60.0, 80.0, 95.0, 105.0])
    ratio = law.gain(bias / law.breakdown_v) / gain_of(bias)
    assert ratio / ratio[0] == pytest.approx(1.0, abs=0.03)


def test_a_moving_breakdown_and_a_multiplied_dark_current_are_named():
    names = ("detector.gain_temperature", "detector.dark_offset", "laser.thermal_rolloff", "detector.compression")
    found = Search(stand(hot=1e-4, dark=6e-11), [library()[name] for name in names]).run()
    assert {term.effect.id for term in found.best.terms} == set(names[:2])
    assert all("bias" in term.variant.options for term in found.best.terms)


def test_a_bias_that_multiplies_nothing_is_no_avalanche():
    columns = stand()
    columns.numbers[f"sim_{SIGNAL}"] = 0.5 * columns.numbers["optical_power_w"]
    assert multiplication(View(columns), SIGNAL) is None
