"""Steps that follow each other by so many seconds each: what swings with both swings in time."""

import numpy as np
import pyarrow as pa
import pytest

from arl_fixtures.reconcile.law_drivers import told_once
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of


def gated(seed, times_s):
    """Boards at four ranges; the pulses of a second device drift through the gate once in 230 s, more in the far."""
    rng = np.random.default_rng(seed)
    step, board, _ = (a.ravel() for a in np.meshgrid(np.arange(len(times_s)), np.arange(4), np.arange(6),
                                                     indexing="ij"))  # fmt: skip
    far, time = np.array([1.1, 1.8, 2.7, 3.9])[board], np.asarray(times_s)[step]
    inside = np.abs((time / 230.0) % 1.0 - 0.4) < 0.25  # their pulse lies on the gate's flank
    pulled = 6e-3 * np.where(inside, np.cos(np.pi * ((time / 230.0) % 1.0 - 0.4) / 0.5), 0.0) * (far > 2.0)
    return columns_of(pa.table({
        "step": step.astype(float), "time_s": time, "true_range_m": far, "n_frames": np.full(far.size, 10.0),
        "sim_distance_m": far, "sim_distance_m_std": np.full(far.size, 0.004),
        "sim_distance_m_repeat_std": np.full(far.size, 4e-4),
        "distance_m": far + pulled + 4e-4 * rng.normal(size=len(times_s))[step]
        + 0.004 / np.sqrt(10.0) * rng.normal(size=far.size),
    }))  # fmt: skip


@pytest.mark.parametrize("seed", [1, 2])
def test_a_beat_over_even_steps_is_one_in_time(seed):
    even = 37.0 * np.delete(np.arange(48), [6, 7, 25, 26, 40])
    columns = gated(seed, even)
    columns.numbers["step"] = columns.numbers["time_s"] / 37.0
    (found,) = diagnose(columns)[0].findings
    assert found.effect == "unknown"
    assert "time_s" in found.drivers[:2]
    assert "step" not in found.drivers


def test_steps_are_columns_of_their_own_where_they_take_unlike_times():
    step = np.repeat(np.arange(6.0), 3)
    features = {"step": step, "time_s": 600.0 * step, "x": np.zeros(18)}
    assert set(told_once(features)) == {"time_s", "x"}
    assert told_once({**features, "time_s": 600.0 * step + np.tile([0.0, 1.0, 2.0], 6)}).keys() == features.keys()
    assert told_once({"step": step}).keys() == {"step"}
    late = np.where(np.arange(18) == 4, np.nan, 600.0 * step)  # a time that was not logged is told by the step alone
    assert told_once({**features, "time_s": late}).keys() == features.keys()
