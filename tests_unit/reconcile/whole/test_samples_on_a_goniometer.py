"""Samples that a goniometer sweeps one after another within a step: what was seen before is of the same sample."""

import numpy as np
import pyarrow as pa

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of

KNOWN = [library()[name] for name in ("acquisition.frame_lag", "stage.zero_offset", "target.reflectance_error")]
ANGLES = np.cumsum([-68.0, 2.0, 7.0, 3.0, 9.0, 2.0, 6.0, 10.0, 3.0, 5.0, 8.0, 2.0, 9.0, 4.0, 6.0, 2.0, 8.0, 5.0, 9.0])


def seen(angle):
    """Light of a matt sample that a Gaussian beam of fixed width overfills more and more as it turns."""
    across = np.linspace(-1.0, 1.0, 81)
    beam = np.exp(-2.0 * (across / 0.6) ** 2)
    cosine = np.cos(np.radians(angle))[..., None]
    return cosine[..., 0] * np.sum(beam * (np.abs(across) * 9.0 < 22.0 * cosine), axis=-1) / beam.sum()


def goniometer(seed, stale):
    """Four samples in eight steps, up and down by turns, at uneven angles; `stale`: share of the position before."""
    rng = np.random.default_rng(seed)
    step, sample, place = (
        x.ravel() for x in np.meshgrid(np.arange(8), np.arange(4), np.arange(ANGLES.size), indexing="ij")
    )
    turn = np.where(step % 2 == 0, place, ANGLES.size - 1 - place)  # position number in order of time
    before = np.where(turn == 0, place, np.where(step % 2 == 0, place - 1, place + 1))
    paint = np.array([0.2, 0.4, 0.6, 0.8])[sample]
    sim = 2.0 * paint * seen(ANGLES[place])
    true = 2.0 * paint * ((1.0 - stale) * seen(ANGLES[place]) + stale * seen(ANGLES[before]))
    error = np.hypot(1.2e-3, 6e-3 * sim)
    return columns_of(pa.table({
        "step": step.astype(float), "stage_angle_deg": ANGLES[place],
        "time_s": 3e3 * step + 200.0 * sample + 12.0 * turn,
        "surface": np.array(["tile a", "tile b", "tile c", "tile d"])[sample], "reflectance": paint,
        "n_frames": np.full(step.size, 9.0), "sim_signal_v": sim, "sim_signal_v_std": error,
        "signal_v": true + error / 3.0 * rng.normal(size=step.size),
    }))  # fmt: skip


def test_frames_of_the_position_before_are_named_though_samples_go_by_turns():
    (found,) = diagnose(goniometer(2, 0.04), effects=KNOWN)[0].findings
    assert found.effect == "acquisition.frame_lag"
    share = found.parameters[0]
    assert share.low < 0.04 < share.high


def test_samples_that_are_swept_one_after_another_are_sweeps_of_their_own():
    assert goniometer(2, 0.0).sweep_columns == ("dut", "cycle", "step", "surface")
