"""A table that states no noise: its size and what it grows with are read off the rows."""

import numpy as np
import pyarrow as pa
import pytest

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.estimated_noise import estimated_error
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of


def test_a_signal_s_noise_has_its_floor_and_grows_with_the_signal():
    rng = np.random.default_rng(1)
    signal, step = 10.0 ** rng.uniform(-3.0, 3.0, 6000), rng.integers(0, 12, 6000)
    frames = np.where(np.arange(6000) % 2, 4.0, 25.0)
    truth = np.sqrt(0.05**2 + (0.02 * signal) ** 2) / np.sqrt(frames)
    shared = 0.3 * rng.normal(size=12)[step]  # what a step's rows have in common is no noise of theirs
    said = estimated_error(shared + truth * rng.normal(size=6000), frames, [signal], step, signal)
    assert np.median(np.abs(np.log(said / truth))) < 0.1
    assert np.quantile(np.abs(np.log(said / truth)), 0.95) < 0.4


def test_the_few_rows_in_bright_light_have_the_noise_of_bright_light():
    """A scene in daylight: most boards are far and dim, a twentieth of the rows spans the upper decade of signals."""
    ratios = []
    for seed in range(4):
        rng = np.random.default_rng(seed)
        signal, step = 300.0 * rng.lognormal(0.0, 1.2, 4000), np.zeros(4000, dtype=int)
        truth = np.sqrt(0.8 * signal + (0.015 * signal) ** 2)
        said = estimated_error(truth * rng.normal(size=4000), np.ones(4000), [signal], step, signal)
        bright = np.argsort(signal)[-80:]
        ratios.append(said[bright] / truth[bright])
    low, middle = np.quantile(ratios, [0.1, 0.5])
    assert low > 0.7
    assert middle == pytest.approx(1.0, abs=0.15)


def test_a_range_s_noise_follows_the_light_and_nothing_that_does_not_matter():
    rng = np.random.default_rng(2)
    light, metres = 10.0 ** rng.uniform(1.0, 3.5, 4000), rng.uniform(0.5, 4.0, 4000)
    alone = np.zeros(4000, dtype=int)
    truth = 0.5 / light
    said = estimated_error(
        truth * rng.normal(size=4000), np.ones(4000), [metres, light], np.zeros(4000, dtype=int), metres
    )
    assert np.quantile(np.abs(np.log(said / truth)), 0.95) < 0.25
    flat = estimated_error(rng.normal(size=4000), np.ones(4000), [metres, light], alone, metres)
    assert np.ptp(flat) == 0.0
    assert flat[0] == pytest.approx(1.0, abs=0.05)


def test_a_dark_current_is_named_where_a_photodiode_s_curve_states_no_noise():
    """Leakage by Arrhenius; below the threshold there is next to no light, and no relative noise."""
    rng = np.random.default_rng(3)
    current, step = (a.ravel() for a in np.meshgrid(np.linspace(0.05, 1.9, 40), np.arange(12), indexing="ij"))
    celsius = np.array([10.0, 20, 30, 40, 50, 60, 55, 45, 35, 25, 15, 5])[step]
    light = 0.25 * np.logaddexp(0.0, (current - 0.45) / 0.01) * 0.01
    leak = 2e-4 * np.exp(-0.66 / 8.617e-5 * (1.0 / (celsius + 273.15) - 1.0 / 323.15))
    noise = np.hypot(8e-5, 1e-3 * light) * rng.normal(size=light.size)
    table = pa.table({
        "step": step.astype(float), "heatsink_temperature_c": celsius, "drive_current_a": current,
        "sim_photodiode_a": light, "photodiode_a": light + leak + noise,
    })  # fmt: skip
    known = [library()[name] for name in ("detector.dark_offset", "laser.power_decay", "laser.thermal_rolloff")]
    assert [f.effect for f in diagnose(columns_of(table), effects=known)[0].findings] == ["detector.dark_offset"]
