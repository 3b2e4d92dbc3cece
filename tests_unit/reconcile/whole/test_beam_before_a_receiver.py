"""A flat beam that moves with heat, seen by a lens whose own fall-off stays: the simulation shows both as one."""

import numpy as np
import pyarrow as pa
import pytest

from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of


def before_a_wall(seed, turn_deg, order, far_m=2.0):
    """18 x 12 pixels before a wall, lit by a diffuser's flat beam; the wall turns away and the lens falls off."""
    rng = np.random.default_rng(seed)
    warm = np.linspace(-28.0, 70.0, 8)
    step, v, u = (x.ravel() for x in np.meshgrid(np.arange(8), np.arange(12.0), np.arange(18.0), indexing="ij"))
    az, el = np.radians((u - 8.5) * 4.0), np.radians((v - 5.5) * 4.0)
    ray = np.stack([np.cos(el) * np.cos(az), np.cos(el) * np.sin(az), np.sin(el)])
    path = far_m / ray[0]
    lens = ray[0] ** 2  # of its aperture, and of its distance to the pixel's edge
    seen = 3600.0 * lens * ray[0] / path**2

    def beam(turn, lift):
        aside = np.abs(np.degrees(az) - turn) / 42.0, np.abs(np.degrees(el) - lift) / 32.0
        return np.exp(-(aside[0] ** order) - aside[1] ** order)

    heat = (warm[step] - 25.0) / 100.0
    own, real = seen * beam(0.0, 0.0), seen * beam(turn_deg * heat, 0.15 * turn_deg * heat)
    sigma, shared = np.sqrt(25.0 + own), 1.0 + 0.002 * rng.normal(size=8)[step]
    return columns_of(pa.table({
        "step": step.astype(float), "housing_temperature_c": warm[step], "pixel_u": u, "pixel_v": v,
        "azimuth_deg": np.degrees(az), "elevation_deg": np.degrees(el), "n_frames": np.full(u.size, 20.0),
        "sim_intensity_counts": own, "sim_intensity_counts_std": sigma,
        "sim_intensity_counts_repeat_std": 0.002 * own,
        "intensity_counts": rng.normal(real * shared, sigma / np.sqrt(20.0)),
    }))  # fmt: skip


@pytest.mark.parametrize(("turn_deg", "order"), [(1.0, 4.0), (2.4, 4.0), (0.7, 6.0)])
def test_a_beam_that_moves_is_told_beside_a_fall_off_that_stays(turn_deg, order):
    found = diagnose(before_a_wall(1, turn_deg, order))[0].findings
    assert [f.effect for f in found] == ["beam.profile_shift"]
    shift = next(p for p in found[0].parameters if p.name == "shift_az")
    assert shift.low < turn_deg / 100.0 < shift.high
