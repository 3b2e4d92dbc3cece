"""Readings that follow one another in time wander: a second row is no second witness of what the first one says."""

import numpy as np
import pyarrow as pa
import pytest

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of

ROWS, STEPS, CYCLES = 240, 6, 3
DIE_S = 25.0


def flicker(rng, n):
    """Noise of equal power in each octave, standard deviation 1: a random spectrum that falls as 1/f."""
    frequency = np.fft.rfftfreq(n, 1.0)
    spectrum = (rng.normal(size=frequency.size) + 1j * rng.normal(size=frequency.size)) / np.sqrt(
        np.maximum(frequency, frequency[1])
    )
    noise = np.fft.irfft(spectrum, n)
    return noise / noise.std()


def one_point_for_hours(seed, slope=0.0):
    """A range finder before a plate, a reading each second; its housing is heated in steps and its die is late."""
    rng = np.random.default_rng(seed)
    count = ROWS * STEPS * CYCLES
    visit = np.arange(count) // ROWS
    second = np.arange(count) % ROWS
    levels = np.tile([-20.0, 0.0, 20.0, 40.0, 60.0, 20.0], CYCLES)
    before = np.concatenate([[20.0], levels[:-1]])
    housing = levels[visit] + rng.normal(0.0, 0.2, count)
    die = levels[visit] + (before - levels)[visit] * np.exp(-second / DIE_S)
    wander = np.concatenate([flicker(rng, ROWS) for _ in range(STEPS * CYCLES)])
    own, steps = rng.normal(0.0, 6e-4, count), rng.normal(0.0, 2e-4, STEPS * CYCLES)
    return pa.table({
        "cycle": visit // STEPS, "step": visit % STEPS, "time_s": visit * 900.0 + second,
        "housing_temperature_c": housing, "ramp": np.sign(levels - before)[visit],
        "humidity_pct": 40.0 + np.cumsum(rng.normal(0.0, 0.05, count)),
        "sim_distance_m": np.full(count, 0.8), "sim_distance_m_std": np.full(count, 1.2e-3),
        "distance_m": 0.8 + slope * (die - 20.0) + 1.2e-3 * wander + own + steps[visit],
    })  # fmt: skip


@pytest.mark.parametrize("seed", [3, 4, 6])
def test_noise_that_wanders_within_steps_is_no_finding(seed):
    assert diagnose(columns_of(one_point_for_hours(seed)))[0].findings == []


def test_a_late_die_is_named_in_it():
    columns = columns_of(one_point_for_hours(5, slope=4e-5))
    known = [library()[n] for n in ("timing.temperature_offset", "timing.thermal_lag", "timing.tdc_nonlinearity")]
    findings = diagnose(columns, effects=known)[0].findings
    assert [f.effect for f in findings] == ["timing.thermal_lag"]
    slope = next(p for p in findings[0].parameters if p.name == "slope")
    assert slope.low < 4e-5 < slope.high
