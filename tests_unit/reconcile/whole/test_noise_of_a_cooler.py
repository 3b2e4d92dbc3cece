"""A cooler's driver that switches makes noise in proportion to its current, whether it heats or cools."""

import numpy as np
import pytest

from arl_fixtures.reconcile.reconcile import diagnose
from tests_unit.reconcile.whole.test_seldom_names import columns_of, grid


def images(counts_per_a, seed):
    """Images at 24 currents of both signs, with their standard deviations over 20 frames."""
    rng = np.random.default_rng(seed)
    step, pixel = grid(np.arange(24), np.arange(60))
    amperes = rng.uniform(-2.0, 2.0, 24)[step]
    light = np.linspace(80.0, 900.0, 60)[pixel]
    noise = np.sqrt(36.0 + 0.25 * light)
    real = np.hypot(noise, counts_per_a * np.abs(amperes))
    return columns_of(
        {
            "step": step, "pixel_u": pixel, "tec_current_a": amperes + rng.normal(0.0, 0.01, step.size),
            "tof_temperature_c": 30.0 + rng.normal(0.0, 8.0, 24)[step], "n_frames": np.full(step.size, 20.0),
            "sim_intensity_counts": light, "sim_intensity_counts_std": noise,
            "sim_intensity_counts_repeat_std": np.full(step.size, 1e-3),
            "intensity_counts": light + rng.normal(0.0, real / np.sqrt(20.0)),
            "intensity_counts_std": real * np.sqrt(rng.chisquare(19, step.size) / 19.0),
        },
    )  # fmt: skip


@pytest.mark.parametrize("counts_per_a", [2.0, 8.0])
def test_noise_that_grows_with_a_current_of_either_sign_is_named(counts_per_a):
    (found,) = diagnose(images(counts_per_a, seed=1))[0].findings
    assert found.effect == "readout.noise_excess"
    assert found.drivers == ["tec_current_a"]
    told = {p.name: p.value for p in found.parameters}
    assert told["added"] == pytest.approx(2.0 * counts_per_a, rel=0.3)  # at two amperes
