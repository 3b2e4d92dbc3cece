"""Signals at the end of a converter's scale are left out, said, and foretold as what they are."""

import numpy as np
import pytest

from arl_fixtures.reconcile.ceilings import ceiling_of, leave_out_ceilings, under_ceiling


def test_a_drifting_gain_is_seen_below_the_end_of_the_scale_and_not_at_it():
    rng = np.random.default_rng(2)
    true = rng.uniform(100.0, 1400.0, 4000)
    numbers = {
        "intensity_counts": np.minimum(0.95 * true, 1000.0),
        "sim_intensity_counts": np.minimum(true, 1000.0),
        "sim_intensity_counts_std": np.full(4000, 5.0),
    }
    ignored: dict[str, str] = {}
    assert leave_out_ceilings(numbers, ("intensity_counts",), ignored) == {"intensity_counts": 1000.0}
    seen = np.isfinite(numbers["intensity_counts"])
    ratio = numbers["intensity_counts"] / numbers["sim_intensity_counts"]
    assert ratio[seen] == pytest.approx(np.full(int(seen.sum()), 0.95))
    assert true[seen].max() < 1000.0
    assert str(int((~seen).sum())) in ignored["intensity_counts (ceiling)"]


def test_rounded_counts_have_no_ceiling():
    rng = np.random.default_rng(3)
    assert ceiling_of(np.round(rng.normal(20.0, 2.0, 5000))) is None
    assert ceiling_of(np.round(rng.uniform(0.0, 50.0, 5000))) is None


def test_a_prediction_stays_below_the_end_of_the_scale():
    simulated = np.array([500.0, 990.0, 1000.0])
    assert under_ceiling(1.05 * simulated, simulated, 1000.0).tolist() == [525.0, 1000.0, 1000.0]
    assert under_ceiling(0.9 * simulated, simulated, 1000.0).tolist() == [450.0, 891.0, 1000.0]


def test_a_simulation_that_stops_tells_nothing_there_though_the_recording_goes_on():
    rng = np.random.default_rng(5)
    true = rng.uniform(100.0, 1060.0, 4000)
    numbers = {"intensity_counts": true * 0.97, "sim_intensity_counts": np.minimum(true, 1000.0)}
    assert leave_out_ceilings(numbers, ("intensity_counts",), {}) == {"intensity_counts": 1000.0}
    seen = np.isfinite(numbers["intensity_counts"])
    assert true[seen].max() < 1000.0
    assert true[~seen].min() >= 1000.0


def test_a_curve_that_is_drawn_on_beyond_its_end_is_no_ceiling():
    """The simulation knows a laser up to 2 A and stays there; the warm laser gives half of it."""
    current = np.linspace(0.5, 2.4, 600)
    numbers = {
        "photodiode_a": 0.3 * np.maximum(current - 1.4, 0.0),
        "sim_photodiode_a": 0.3 * np.maximum(np.minimum(current, 2.0) - 1.0, 0.0),
    }
    assert leave_out_ceilings(numbers, ("photodiode_a",), {}) == {}
    assert np.isfinite(numbers["photodiode_a"]).all()
