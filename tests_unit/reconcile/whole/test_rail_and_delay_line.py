"""A board on a rail before one beam: an uneven delay line errs with the distance, the rail's screw might, too."""

import numpy as np
import pyarrow as pa
import pytest

from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of

CLOCK_NS, LIGHT_M_PER_NS = 2.5, 0.299792458


def timed(distance_m, seed, uneven, jitter_ns=0.25):
    """Distance by a clock whose period is cut into sixteen taps of unlike length, the mean of pulses that jitter."""
    taps = 1.0 + uneven * np.random.default_rng(seed).normal(size=16)
    edges = CLOCK_NS * np.concatenate([[0.0], np.cumsum(taps) / taps.sum()])
    pulses = 2.0 * distance_m[:, None] / LIGHT_M_PER_NS + jitter_ns * np.linspace(-2.5, 2.5, 41)
    weight = np.exp(-0.5 * np.linspace(-2.5, 2.5, 41) ** 2)
    tap = np.searchsorted(edges, pulses % CLOCK_NS, side="right") - 1
    told = (np.floor(pulses / CLOCK_NS) + (tap + 0.5) / 16.0) * CLOCK_NS
    return 0.5 * LIGHT_M_PER_NS * (told @ weight) / weight.sum()


@pytest.mark.parametrize("seed", [2, 5])
def test_of_what_a_delay_line_and_a_rail_say_alike_the_delay_line_comes_first(seed):
    rng = np.random.default_rng(seed)
    place = np.repeat(np.arange(0.4, 4.6, 0.045), 6)
    true = place + 0.35
    measured = timed(true, seed, 0.06) - np.mean(timed(true, seed, 0.06) - true)
    (found,) = diagnose(columns_of(pa.table({
        "rail_position_m": place, "true_range_m": true, "n_frames": np.full(place.size, 16.0),
        "sim_distance_m": true, "sim_distance_m_std": np.full(place.size, 0.006),
        "distance_m": measured + 0.006 / 4.0 * rng.normal(size=place.size),
    })))[0].findings  # fmt: skip
    assert (found.effect, found.equivalent_to) == ("timing.tdc_nonlinearity", ["stage.periodic_error"])
