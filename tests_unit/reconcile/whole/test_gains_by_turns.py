"""Light swept in the same order at every gain: what one gain does goes along with the time within a step as well."""

import numpy as np
import pyarrow as pa
import pytest

from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of

LIGHT_UW = np.geomspace(0.2, 120.0, 14)


def swept(seed, seen_at_four):
    """A photodiode behind an amplifier of three gains: 10 steps of temperature, each gain's sweep in turn."""
    rng = np.random.default_rng(seed)
    step = np.repeat(np.arange(10), 42)
    gain, light = np.tile(np.repeat([1.0, 4.0, 16.0], 14), 10), np.tile(LIGHT_UW, 30)
    plain = 0.0021 * gain * light
    seen = np.where(gain == 4.0, seen_at_four(plain), plain)
    sigma, shared = 3e-4 + 0.004 * plain, 0.002 * plain
    return columns_of(pa.table({
        "step": step, "gain_setting": gain, "illumination_uw": light,
        "housing_temperature_c": np.linspace(12.0, 58.0, 10)[step],
        "time_s": 1500.0 * step + np.tile(30.0 + 7.0 * np.arange(42), 10), "n_frames": np.full(len(step), 40),
        "sim_signal_v": plain, "sim_signal_v_std": sigma, "sim_signal_v_repeat_std": shared,
        "signal_v": seen + shared * rng.normal(size=10)[step] + sigma / np.sqrt(40.0) * rng.normal(size=len(step)),
    }))  # fmt: skip


def test_a_gain_that_is_no_line_is_told_by_the_gain_and_not_by_the_time_of_its_sweep():
    (found,) = diagnose(swept(3, lambda v: v * (v / 0.4) ** -0.012))[0].findings
    assert found.effect == "unknown"
    assert "gain_setting" in found.drivers
    assert "time_s" not in found.drivers
    assert found.where["gain_setting"] == pytest.approx([4.0, 4.0])


def test_a_law_of_a_signal_names_the_column_that_rows_to_be_predicted_have():
    table = swept(5, lambda v: v)
    measured, plain = table.numbers["signal_v"], table.numbers["sim_signal_v"]
    table.numbers["signal_v"] = np.where((plain > 0.05) & (plain < 0.5), 1.012 * measured, measured)  # its converter
    (found,) = diagnose(table)[0].findings
    assert found.effect == "unknown"
    assert found.drivers[0] == "sim_signal_v"
