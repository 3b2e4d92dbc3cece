"""What is late, and what merely follows a temperature: a die on its housing, marched, with the chip logged or not."""

import numpy as np
import pyarrow as pa

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of

STEP_S = 900.0
RIVALS = [
    library()[name] for name in ("timing.temperature_offset", "timing.thermal_lag", "timing.clock_scale")
]  # fmt: skip


def ramped(seed, per_kelvin_late, per_kelvin_chip, logged_chip, unrecorded_s=0.0, within_s=(0.0, STEP_S)):
    """A single-point sensor over two cycles of 14 temperature steps; a node of 1100 s follows the housing."""
    rng = np.random.default_rng(seed)
    levels = np.tile([20.0, 0.0, -10.0, 0.0, 20.0, 40.0, 60.0, 80.0, 60.0, 40.0, 20.0, 50.0, 70.0, 30.0], 2)
    housing, late, moment = [], [], []
    now = node = 20.0
    for step, level in enumerate(levels):
        for second in np.arange(0.0, STEP_S, 10.0):
            now += (level - now) * 10.0 / 150.0
            node += (now - node) * 10.0 / 1100.0
            if second % 60.0 == 30.0:
                housing.append(now)
                late.append(node)
                moment.append((step, step * STEP_S + second))
    housing, late, (step, time) = np.array(housing), np.array(late), np.array(moment).T
    chip = housing + 9.0
    away = np.tile([0.8, 1.5, 2.6], step.size)
    row = np.repeat(np.arange(step.size), 3)
    error = per_kelvin_late * (late - housing) + per_kelvin_chip * (chip - 30.0 if logged_chip else late - 20.0)
    sigma = 2e-3
    shared = 1e-4 * rng.normal(size=levels.size)[step.astype(int)]
    measured = away + (error + shared)[row] + sigma / 5.0 * rng.normal(size=row.size)
    since = time - STEP_S * step
    recorded = (time - 14.0 * STEP_S * (step // 14) >= unrecorded_s) & (since >= within_s[0]) & (since < within_s[1])
    recorded = recorded[row]
    return columns_of(pa.table({
        "cycle": step[row] // 14, "step": step[row] % 14, "time_s": time[row] - 14.0 * STEP_S * (step[row] // 14),
        "housing_temperature_c": housing[row], "true_range_m": away, "n_frames": np.full(row.size, 25.0),
        **({"tof_temperature_c": chip[row]} if logged_chip else {}),
        "sim_distance_m": away, "sim_distance_m_std": np.full(row.size, sigma),
        "sim_distance_m_repeat_std": np.full(row.size, 1e-4), "distance_m": measured,
    }).filter(pa.array(recorded)))  # fmt: skip


def names(findings):
    return {f.effect for f in findings}


def test_an_offset_of_the_logged_chip_and_a_lag_are_two_findings():
    found = diagnose(ramped(1, 6e-5, 5e-5, True), effects=RIVALS)[0].findings
    assert names(found) == {"timing.temperature_offset", "timing.thermal_lag"}
    lag = next(f for f in found if f.effect == "timing.thermal_lag")
    assert 800.0 < next(p.value for p in lag.parameters if p.name == "time_constant") < 1500.0


def test_a_lag_alone_is_no_offset():
    assert names(diagnose(ramped(2, 6e-5, 0.0, True), effects=RIVALS)[0].findings) == {"timing.thermal_lag"}


def test_an_offset_that_follows_a_chip_nobody_logged_is_told_as_either():
    (found,) = diagnose(ramped(3, 0.0, 5e-5, False), effects=RIVALS)[0].findings
    assert {found.effect, *found.equivalent_to} == {"timing.temperature_offset", "timing.thermal_lag"}


def test_a_record_that_begins_amid_a_ramp_does_not_hide_a_lag():
    found = diagnose(ramped(4, 6e-5, 0.0, False, unrecorded_s=2.1 * STEP_S), effects=RIVALS)[0].findings
    assert names(found) == {"timing.thermal_lag"}
    time_constant = next(p for p in found[0].parameters if p.name == "time_constant")
    assert time_constant.low < 1100.0 < time_constant.high


def test_what_nobody_logged_between_the_steps_is_in_the_interval():
    """Logged for two minutes of every quarter of an hour: whether the steps came early or late is not known."""
    widths = []
    for within_s in ((0.0, STEP_S), (240.0, 360.0)):
        (found,) = diagnose(ramped(5, 2e-4, 0.0, True, within_s=within_s), effects=RIVALS)[0].findings
        lag = next(p for p in found.parameters if p.name == "time_constant")
        assert lag.low < 1100.0 < lag.high
        widths.append(lag.high - lag.low)
    assert widths[1] > 3.0 * widths[0]
