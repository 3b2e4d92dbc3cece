"""A delay that follows a cable's temperature, logged beside that of the chip, is no delay of the chip."""

import numpy as np
import pyarrow as pa
import pytest

from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of


def ranged(seed, shift_m, by):
    """A rangefinder on a rail, 16 steps: its chip follows the oven, its cable the room."""
    rng = np.random.default_rng(seed)
    step = np.repeat(np.arange(16), 60)
    far = np.tile(np.linspace(0.8, 12.0, 60), 16)
    chip, cable = rng.permutation(np.linspace(5.0, 65.0, 16)), rng.permutation(np.linspace(8.0, 34.0, 16))
    hot = {"tof_temperature_c": chip, "cable_temperature_c": cable}
    late = shift_m(hot[by])[step]
    n, sigma = step.size, 0.004
    return columns_of(pa.table({
        "step": step, "stage_position_m": far, "n_frames": np.full(n, 20),
        **{name: values[step] + 0.05 * rng.normal(size=n) for name, values in hot.items()},
        "sim_distance_m": far, "sim_distance_m_std": np.full(n, sigma), "sim_distance_m_repeat_std": np.full(n, 3e-4),
        "distance_m": far + late + 3e-4 * rng.normal(size=16)[step] + sigma / np.sqrt(20.0) * rng.normal(size=n),
    }))  # fmt: skip


def teflon(celsius):
    """The phase of PTFE that is stable up to 19 °C is denser: a cable of it delays less above."""
    return -8e-3 / (1.0 + np.exp(-(celsius - 19.0) / 1.5))


@pytest.mark.parametrize(
    ("by", "shift_m", "effect"),
    [
        ("cable_temperature_c", teflon, "unknown"),
        ("cable_temperature_c", lambda c: 2e-4 * (c - 20.0), "unknown"),
        ("tof_temperature_c", lambda c: 1.2e-4 * (c - 25.0), "timing.temperature_offset"),
    ],
)
def test_a_cables_delay_is_not_the_chips(by, shift_m, effect):
    (found,) = diagnose(ranged(4, shift_m, by))[0].findings
    assert found.effect == effect
    assert found.drivers[0] == by
