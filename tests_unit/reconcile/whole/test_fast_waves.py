"""A compressor that cycles for half a day: waves of many turns over time."""

import numpy as np
import pyarrow as pa
import pytest

from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of


def watched(seed, swing_m, period_s):
    """A still target, four readings a minute for thirteen hours with breaks; a compressor runs 35 % of its cycle."""
    rng = np.random.default_rng(seed)
    time = np.concatenate([hour * 3600.0 + np.sort(rng.uniform(0.0, 3300.0, 240)) for hour in range(13)])
    state, shift = 0.0, np.zeros(len(time))
    clock = np.arange(0.0, time[-1] + 5.0, 5.0)
    charge = np.zeros(len(clock))
    for k, now in enumerate(clock):  # the supply's capacitor charges while it runs
        state += 5.0 / 90.0 * (float(now % period_s < 0.35 * period_s) - state)
        charge[k] = state
    shift = swing_m * np.interp(time, clock, charge)
    step = (time // 3600.0).astype(int)
    return {
        "step": step, "time_s": time, "ambient_temperature_c": 23.0 + 0.1 * rng.normal(size=len(time)),
        "n_frames": np.full(len(time), 10), "sim_distance_m": np.full(len(time), 0.85),
        "sim_distance_m_std": np.full(len(time), 0.0035), "sim_distance_m_repeat_std": np.full(len(time), 0.0003),
        "distance_m": 0.85 + shift + 0.0003 * rng.normal(size=13)[step] + 0.0011 * rng.normal(size=len(time)),
    }  # fmt: skip


@pytest.mark.parametrize("period_s", [1370.0, 410.0])
def test_a_compressor_is_seen_by_its_period(period_s):
    (found,) = diagnose(columns_of(pa.table(watched(5, 0.0009, period_s))))[0].findings
    assert found.effect == "unknown"
    assert found.drivers[0] == "time_s"
    turns = [abs(axis.at) for term in found.law.terms for axis in term.axes if axis.at]
    assert min(turns) == pytest.approx(period_s, rel=5e-3)


def test_nothing_turns_where_nothing_runs():
    assert not diagnose(columns_of(pa.table(watched(6, 0.0, 1370.0))))[0].findings
