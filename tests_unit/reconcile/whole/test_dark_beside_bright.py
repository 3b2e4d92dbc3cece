"""Few dark counts beside returns of a hundred thousand: no gain stands for what a calibration may have done."""

import numpy as np
import pyarrow as pa

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.constants import constants_of
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of

STEPS, ROWS, SHARED = 11, 600, 0.0015
BOLTZMANN_EV = 8.617e-5


def counting_array(seed):
    """A photon-counting array between 15 and 65 °C; thermal generation over 0.7 eV adds eight counts at the end."""
    rng = np.random.default_rng(seed)
    step = np.repeat(np.arange(STEPS), ROWS)
    celsius = np.linspace(15.0, 65.0, STEPS)[rng.permutation(STEPS)][step]
    bright = 10.0 ** rng.uniform(1.5, 5.5, step.size)
    dark = 8.0 * np.exp(-0.7 / BOLTZMANN_EV * (1.0 / (celsius + 273.15) - 1.0 / 338.15))
    frames, noise = 50, np.sqrt(bright + 4.0)
    measured = (bright + dark) * (1.0 + rng.normal(0.0, SHARED, STEPS)[step])
    table = pa.table({
        "dut": ["A"] * step.size, "step": step.astype(float), "tof_temperature_c": celsius,
        "n_frames": np.full(step.size, float(frames)), "sim_intensity_counts": bright,
        "sim_intensity_counts_std": noise, "sim_intensity_counts_repeat_std": SHARED * bright,
        "intensity_counts": measured + rng.normal(0.0, noise / np.sqrt(frames)),
    })  # fmt: skip
    return columns_of(table), dark


def test_the_signal_of_a_dark_current_is_foretold_in_bright_pixels_too():
    columns, dark = counting_array(4)
    known = [library()[name] for name in ("detector.dark_offset", "detector.gain_temperature")]
    found, _, decision = diagnose(columns, effects=known)
    assert [finding.effect for finding in found.findings] == ["detector.dark_offset"]
    gain = constants_of(decision).get("intensity_counts", {}).get("A", 0.0)
    view = decision.problem.view
    added = decision.final_state()["intensity_counts"] - view.sim["intensity_counts"]
    told = added + gain * view.sim["intensity_counts"]
    assert np.mean((told - dark[view.rows]) ** 2) < 0.1 * np.mean(dark[view.rows] ** 2)
