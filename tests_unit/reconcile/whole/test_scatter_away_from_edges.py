"""A table states what steps share; edges that shake with the stage are no scatter of the signal within them."""

import numpy as np

from arl_fixtures.reconcile.command import reconcile

STEPS, ANGLES, COLUMNS, ROWS = 9, 21, 9, 4


def discs(bearing_deg, height_deg):
    """Light of round panels with edges that pixels and stops sample too coarsely for their slope to be known."""
    light = 90.0
    for x, y, radius, share in ((-14.0, 1.0, 5.0, 700.0), (2.0, -2.0, 4.0, 1500.0), (15.0, 2.0, 6.0, 400.0)):
        away = np.hypot(bearing_deg - x, height_deg - y) - radius
        light = light + share / (1.0 + np.exp(away / 0.15))
    return light


def shaken(seed, shake_deg, wander=0.0):
    rng = np.random.default_rng(seed)
    step, stop, v, u = (
        a.ravel()
        for a in np.meshgrid(*map(np.arange, (STEPS, ANGLES, ROWS, COLUMNS)), indexing="ij")
    )  # fmt: skip
    angle, azimuth, elevation = np.linspace(-12.0, 12.0, ANGLES)[stop], (u - 4.0) * 2.1, (v - 1.5) * 2.4
    simulated = discs(azimuth + angle, elevation)
    left, right = (discs(azimuth + angle + half, elevation) for half in (-1.0, 1.0))
    edge = np.abs(left - right) > 0.02 * simulated
    true = discs(azimuth + angle + rng.normal(0.0, shake_deg, (STEPS, ANGLES))[step, stop], elevation)
    scatter, bench = np.sqrt(30.0 + 0.2 * simulated), 0.002
    shared = bench * rng.normal(size=STEPS)[step] + wander * rng.normal(size=(STEPS, ANGLES))[step, stop]
    return {
        "step": step, "set_temperature_c": np.linspace(-30.0, 70.0, STEPS)[step], "stage_angle_deg": angle,
        "pixel_u": u, "pixel_v": v, "azimuth_deg": azimuth, "elevation_deg": elevation,
        "mixed": np.where(edge, "true", "false"),
        "sim_intensity_counts": simulated, "sim_intensity_counts_std": scatter,
        "sim_intensity_counts_repeat_std": bench * simulated, "n_frames": np.full(step.size, 12),
        "intensity_counts": true * (1.0 + shared) + rng.normal(size=step.size) * scatter / np.sqrt(12.0),
    }  # fmt: skip


def test_what_only_edges_show_is_no_scatter_of_images(tmp_path, save):
    for seed in (1, 2):
        table = save(tmp_path / f"{seed}.parquet", shaken(seed, 0.12))
        assert "bench.repeatability" not in [f.effect for f in reconcile(table, tmp_path / str(seed)).findings]


def test_nor_is_a_stage_that_stands_well_a_mismatch(tmp_path, save):
    assert reconcile(save(tmp_path / "table.parquet", shaken(1, 0.015)), tmp_path / "out").findings == []


def test_images_that_scatter_as_wholes_are_found_beside_it(tmp_path, save):
    table = save(tmp_path / "table.parquet", shaken(1, 0.03, wander=0.02))
    assert [f.effect for f in reconcile(table, tmp_path / "out").findings] == ["bench.repeatability"]
