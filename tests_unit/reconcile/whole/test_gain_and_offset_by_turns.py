"""Eight converters that read columns in turn, each with a gain and an offset of its own."""

import numpy as np
import pyarrow as pa

from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of


def read_by_turns(seed, gain=0.004, offset=1.2):
    """Strewn pixels over six stage angles and six steps, ten frames each."""
    rng = np.random.default_rng(seed)
    step, angle, place = (x.ravel() for x in np.meshgrid(np.arange(4), np.arange(6), np.arange(90), indexing="ij"))
    u, v = rng.choice(120, 90, replace=False)[place].astype(float), rng.integers(0, 30, 90)[place].astype(float)
    sim = 3000.0 * np.geomspace(0.03, 1.0, 540)[rng.permutation(540)][90 * angle + place]
    converter = u.astype(int) % 8
    own = rng.normal(size=(2, 8))
    true = sim * (1.0 + gain * own[0][converter]) + offset * own[1][converter]
    error = np.sqrt(36.0 + 0.25 * sim)
    return columns_of(pa.table({
        "step": step.astype(float), "stage_angle_deg": 8.0 * angle, "pixel_u": u, "pixel_v": v,
        "n_frames": np.full(step.size, 10.0), "sim_intensity_counts": sim, "sim_intensity_counts_std": error,
        "intensity_counts": true + error / np.sqrt(10.0) * rng.normal(size=step.size),
    }))  # fmt: skip


def test_gains_and_offsets_of_converters_in_turn_are_one_pattern():
    (found,) = diagnose(read_by_turns(4))[0].findings
    assert found.effect == "readout.column_pattern"
    assert {p.name.partition("_")[0] for p in found.parameters} == {"gain", "tap"}
