"""A receiver with one line of pixels: what mixes neighbours is found, told in its own columns and foretold."""

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from arl_fixtures.reconcile.command import predict, reconcile


def line_scan(scans: int = 12, pixels: int = 64) -> dict[str, np.ndarray]:
    """Bars of a resolution chart through a lens that is a little out of focus: a sampled PSF, fine grid to pixels."""
    rng = np.random.default_rng(15)
    fine = 16
    place = (np.arange(pixels * fine) + 0.5) / fine
    scan, u = (part.ravel() for part in np.mgrid[0:scans, 0:pixels])
    psf = np.exp(-0.5 * (np.arange(-4 * fine, 4 * fine + 1) / fine / 0.45) ** 2)
    sim, seen = [], []
    for k in range(scans):
        chart = 300.0 + 900.0 * (np.sin(2.0 * np.pi * (place + 1.7 * k) / (6.0 + 0.2 * k)) > 0.2)
        sim.append(chart.reshape(pixels, fine).mean(axis=1))
        seen.append(np.convolve(np.pad(chart, 4 * fine, mode="edge"), psf / psf.sum(), "valid").reshape(pixels, fine))
    sim_counts = np.concatenate(sim)
    seen_counts = np.concatenate([part.mean(axis=1) for part in seen])
    error = np.sqrt(25.0 + 0.3 * sim_counts)
    return {
        "step": scan, "pixel_u": u, "sim_intensity_counts": sim_counts, "sim_intensity_counts_std": error,
        "n_frames": np.full(u.size, 16),
        "intensity_counts": seen_counts + rng.normal(size=u.size) * error / 4.0,
    }  # fmt: skip


def test_a_blurred_line_is_named_in_its_own_columns_and_foretold(tmp_path):
    columns = line_scan()
    unseen = np.isin(columns["step"], (3, 7, 10))
    pq.write_table(pa.table({n: v[~unseen] for n, v in columns.items()}), tmp_path / "t.parquet")
    left = {n: v[unseen] for n, v in columns.items() if n != "intensity_counts"}
    pq.write_table(pa.table(left), tmp_path / "new.parquet")
    first = reconcile(tmp_path / "t.parquet", tmp_path / "out").findings[0]
    assert {first.effect, *first.equivalent_to} & {"optics.defocus", "detector.crosstalk"}
    assert first.drivers == ["pixel_u"]
    predict(tmp_path / "out", tmp_path / "new.parquet", tmp_path / "said.parquet")
    said = pq.read_table(tmp_path / "said.parquet")["corrected_intensity_counts"].to_numpy()
    off = columns["intensity_counts"][unseen] - said
    before = columns["intensity_counts"][unseen] - columns["sim_intensity_counts"][unseen]
    assert np.mean(off**2) < 0.3 * np.mean(before**2)
