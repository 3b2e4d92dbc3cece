"""Laws of what has a natural nil, a path or a rate: what steps share tells no zero, and a law foretells with one."""

import json

import numpy as np
import pyarrow.parquet as pq

from arl_fixtures.reconcile.command import predict, reconcile

SHARED = 0.004


def moist_air(seed, humidity):
    """A rail of 20 m; vapour lines take light along the path, there and back; each step has a gain of its own."""
    rng = np.random.default_rng(seed)
    step = np.repeat(np.arange(humidity.size), 150)
    far = rng.uniform(0.7, 20.0, step.size)
    light = 2.0 / far**2
    sigma = 0.004 * light + 2e-5
    through = np.exp(-2.0 * far * 1.6e-4 * humidity[step] / 75.0)
    gain = 1.0 + SHARED * rng.normal(size=humidity.size)[step]
    table = {
        "step": step.astype(float), "true_range_m": far, "relative_humidity": humidity[step],
        "room_lux": rng.normal(300.0, 9.0, step.size), "sim_amplitude_v": light, "sim_amplitude_v_std": sigma,
        "sim_amplitude_v_repeat_std": SHARED * light,
        "amplitude_v": light * through * gain + sigma * rng.normal(size=step.size),
    }  # fmt: skip
    return table, {"amplitude_v": light * through}


def strained_lens(seed, steps):
    """A lens barrel under a gradient strains and dims with the square of the rate; half the rows are at rest."""
    rng = np.random.default_rng(seed)
    step = np.repeat(np.arange(steps), 160)
    fading = np.exp(-np.tile(np.arange(160.0), steps) / 40.0)
    rate = np.where(step % 2 == 0, -11.0, 5.5) * fading + rng.normal(0.0, 0.05, step.size)
    light = rng.uniform(80.0, 2500.0, step.size)
    sigma = 0.01 * light
    retardance = 0.0155 * rate  # of a polarised laser behind a polariser, in radians
    through = np.cos(retardance) ** 2
    gain = 1.0 + SHARED * rng.normal(size=steps)[step]
    table = {
        "step": step.astype(float), "plate_rate_k_per_min": rate, "room_lux": rng.normal(300.0, 9.0, step.size),
        "sim_intensity_counts": light, "sim_intensity_counts_std": sigma,
        "sim_intensity_counts_repeat_std": SHARED * light,
        "intensity_counts": light * through * gain + sigma * rng.normal(size=step.size),
    }  # fmt: skip
    return table, {"intensity_counts": light * through}


def reached(tables, save, tmp_path):
    """Findings on the first table, and the share of what is possible on the second that the correction reaches."""
    (table, _), (unseen, truth) = tables
    reconcile(save(tmp_path / "t.parquet", table), tmp_path / "out")
    (channel,) = truth
    predict(tmp_path / "out", save(tmp_path / "u.parquet", {k: v for k, v in unseen.items() if k != channel}),
            tmp_path / "p.parquet")  # fmt: skip
    said = pq.read_table(tmp_path / "p.parquet")[f"corrected_{channel}"].to_numpy()
    sim, sigma = unseen[f"sim_{channel}"], unseen[f"sim_{channel}_std"]
    left, before = (float(np.sum(((x - truth[channel]) / sigma) ** 2)) for x in (said, sim))
    return json.loads((tmp_path / "out" / "diagnosis.json").read_text())["findings"], 1.0 - left / before


def test_what_a_moist_path_takes_is_nil_at_no_path(save, tmp_path):
    """Which range has no loss, steps of unlike gain do not tell."""
    tables = moist_air(2, np.tile([15.0, 35.0, 60.0, 90.0], 4)), moist_air(3, np.array([25.0, 50.0, 80.0]))
    (finding,), share = reached(tables, save, tmp_path)
    assert {"relative_humidity", "true_range_m"} == set(finding["drivers"])
    assert share > 0.7


def test_a_strain_is_nil_at_rest(save, tmp_path):
    """Cooling is faster than heating: the middle of the rates that were met is no rest."""
    (finding,), share = reached((strained_lens(4, 9), strained_lens(5, 4)), save, tmp_path)
    assert finding["drivers"] == ["plate_rate_k_per_min"]
    assert share > 0.7
