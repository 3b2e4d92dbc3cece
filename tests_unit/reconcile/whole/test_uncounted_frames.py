"""A table that does not count its frames shows them: shares of n frames are multiples of 1/n, and scatter like it."""

import numpy as np
import pyarrow as pa
import pytest

from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of

ANGLES = [-18.0, -12.0, -6.0, 0.0, 6.0, 12.0, 18.0]


def returns(seed, frames, lost=0.0):
    """Weak light, whose frames return as often as a threshold in noise lets them; `lost` more where it is weakest."""
    rng = np.random.default_rng(seed)
    angle, v, u = (x.ravel() for x in np.meshgrid(ANGLES, np.arange(8.0), np.arange(40.0), indexing="ij"))
    light = 10.0 + 45.0 * (1.0 + np.sin(0.3 * u + 0.1 * angle)) * np.exp(-(((v - 3.5) / 5.0) ** 2))
    expected = 1.0 - np.exp(-light / 8.0)
    seen = light + np.sqrt(light) * rng.normal(size=u.size)
    return columns_of(pa.table({
        "pixel_u": u, "pixel_v": v, "stage_angle_deg": angle, "sim_intensity_counts": light,
        "sim_intensity_counts_std": np.sqrt(light), "intensity_counts": seen,
        "sim_valid_fraction": expected,
        "valid_fraction": rng.binomial(frames, expected * (1.0 - lost * (light < 25.0))) / frames,
    }))  # fmt: skip


@pytest.mark.parametrize(("seed", "frames"), [(1, 1), (2, 1), (3, 4)])
def test_frames_that_return_by_chance_are_no_mismatch(seed, frames):
    assert diagnose(returns(seed, frames))[0].verdict == "consistent"


def test_frames_that_are_lost_are_one():
    found = diagnose(returns(4, 4, lost=0.2))[0].findings
    assert {name for finding in found for name in finding.channels} == {"valid_fraction"}
