"""Columns that are read in blocks, every other block by a converter of another gain."""

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from arl_fixtures.reconcile.command import reconcile


def read_in_blocks(width, gain):
    """Strewn pixels of 4 x 5 stills, each signal counted in electrons and digitised by its block's converter."""
    rng = np.random.default_rng(11)
    step, still, pixel = (a.ravel() for a in np.meshgrid(range(6), range(5), range(90), indexing="ij"))
    u, v = rng.integers(0, 96, 90)[pixel], rng.integers(0, 32, 90)[pixel]
    scene = rng.uniform(200.0, 3000.0, (5, 90))[still, pixel]
    electrons = rng.poisson(scene[:, None] * 12.0, (len(u), 20)).mean(axis=1)
    counts = electrons / 12.0 * np.where(u // width % 2 == 0, 1.0 + gain, 1.0 - gain)
    return {
        "step": step.astype(float), "still": still.astype(float), "pixel_u": u.astype(float),
        "pixel_v": v.astype(float), "n_frames": np.full(len(u), 20.0), "sim_intensity_counts": scene,
        "sim_intensity_counts_std": np.sqrt(scene / 12.0), "intensity_counts": counts,
    }  # fmt: skip


def test_blocks_of_columns_are_a_pattern_and_not_a_law(tmp_path):
    pq.write_table(pa.table(read_in_blocks(5, 0.0022)), tmp_path / "t.parquet")
    found = reconcile(tmp_path / "t.parquet", tmp_path / "d")
    assert [finding.effect for finding in found.findings] == ["readout.column_pattern"]
    assert "blocks" in found.findings[0].statement
