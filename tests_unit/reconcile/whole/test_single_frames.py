"""Frames of one pulse each, all of them recorded: what a frame's pixels share is the pulse's energy."""

import numpy as np
import pyarrow as pa
import pytest

from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of


def filmed(seed, jitter):
    """90 frames of 32 pixels before grey cards; photons are counted, and each pulse has an energy of its own."""
    rng = np.random.default_rng(seed)
    frame, pixel = (a.ravel() for a in np.meshgrid(np.arange(90), np.arange(32), indexing="ij"))
    light = 1500.0 * (0.15 + 0.85 * np.abs(np.sin(0.4 * pixel + 0.3)))
    energy = 1.0 + jitter * rng.normal(size=90)
    return columns_of(pa.table({
        "frame": 1.0 * frame, "time_s": 0.05 * frame, "pixel_u": 1.0 * pixel, "sim_intensity_counts": light,
        "sim_intensity_counts_std": np.sqrt(light), "intensity_counts": 1.0 * rng.poisson(light * energy[frame]),
    }))  # fmt: skip


def test_pulses_that_scatter_are_named_where_every_frame_is_told_apart():
    (found,) = diagnose(filmed(1, 0.012))[0].findings
    assert found.effect == "laser.pulse_energy_jitter"
    assert found.drivers == ["frame"]
    (jitter,) = found.parameters
    assert jitter.low < 0.012 < jitter.high
    assert jitter.value == pytest.approx(0.012, rel=0.3)


def test_pulses_that_do_not_are_no_finding():
    assert not diagnose(filmed(2, 0.0))[0].findings
