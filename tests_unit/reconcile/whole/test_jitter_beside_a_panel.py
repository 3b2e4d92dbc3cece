"""Pulses of unequal energy beside a panel that is whiter than its certificate.

What the panel does to the scatters of its own rows is a part of what the pulses do to all: it hides nothing.
"""

import numpy as np

from arl_fixtures.reconcile.command import reconcile

ANGLES, PIXELS, FRAMES, JITTER = 120, 40, 16, 0.0031


def pulsed(seed):
    """Every frame of four kinds of panels drawn: shot and readout noise, and one energy for all pixels of a frame."""
    rng = np.random.default_rng(seed)
    angle, pixel = (a.ravel() for a in np.meshgrid(np.arange(ANGLES), np.arange(PIXELS), indexing="ij"))
    kind = (pixel // 10 + angle) % 4
    light = 4000.0 * np.array([0.1, 0.18, 0.5, 0.8])[kind]
    scatter = np.sqrt(64.0 + 0.28 * light)
    energy = 1.0 + JITTER * rng.normal(size=(ANGLES, FRAMES))[angle]
    frames = (light * np.where(kind == 2, 1.01, 1.0))[:, None] * energy
    frames = frames + scatter[:, None] * rng.normal(size=frames.shape)
    return {
        "stage_angle_deg": 0.5 * angle, "pixel_u": pixel, "n_frames": np.full(len(kind), FRAMES),
        "surface": np.array(["black", "grey", "light", "white"])[kind],
        "sim_intensity_counts": light, "sim_intensity_counts_std": scatter,
        "intensity_counts": frames.mean(axis=1), "intensity_counts_std": frames.std(axis=1, ddof=1),
    }  # fmt: skip


def test_pulses_of_unequal_energy_are_named_beside_a_panel(tmp_path, save):
    findings = reconcile(save(tmp_path / "table.parquet", pulsed(1)), tmp_path / "out").findings
    assert {f.effect for f in findings} == {"target.reflectance_error", "laser.pulse_energy_jitter"}
