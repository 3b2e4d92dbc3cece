"""A block of the image that ages: between and beyond the few cycles in which it was looked at it goes on."""

import json

import numpy as np
import pyarrow.parquet as pq

from arl_fixtures.reconcile.command import predict, reconcile


def cracked_ball(seed, cycles):
    """The clock buffer of a tile slows down as its solder ball cracks: Paris' law, marched cycle by cycle."""
    rng = np.random.default_rng(seed)
    crack, late = 0.1, []
    for cycle in range(int(max(cycles)) + 1):
        if cycle in cycles:
            late.append(1.5e-2 * (crack - 0.1))
        crack += 1.5e-3 * crack**0.8
    number, step, pixel = (
        a.ravel() for a in np.meshgrid(np.arange(len(cycles)), np.arange(6), np.arange(160), indexing="ij")
    )
    u, v = (pixel % 16) * 8.0, (pixel // 16) * 3.0
    tile = (u >= 64.0) & (u < 88.0) & (v >= 12.0) & (v < 21.0)
    truth = 1.5 + np.array(late)[number] * tile
    table = {
        "cycle": np.asarray(cycles, dtype=float)[number], "step": step.astype(float), "pixel_u": u, "pixel_v": v,
        "housing_temperature_c": -20.0 + 20.0 * step, "n_frames": np.full(step.size, 10.0),
        "sim_distance_m": np.full(step.size, 1.5), "sim_distance_m_std": np.full(step.size, 0.012),
        "sim_distance_m_repeat_std": np.full(step.size, 0.0005),
        "distance_m": truth + 0.0005 * rng.normal(size=(len(cycles), 6))[number, step]
        + 0.012 / np.sqrt(10.0) * rng.normal(size=step.size),
    }  # fmt: skip
    return table, truth


def test_a_block_that_ages_is_foretold_for_cycles_between_and_beyond(save, tmp_path):
    (seen, _), (unseen, truth) = cracked_ball(1, [0, 200, 400, 600]), cracked_ball(2, [300, 700])
    reconcile(save(tmp_path / "t.parquet", seen), tmp_path / "out")
    (finding,) = json.loads((tmp_path / "out" / "diagnosis.json").read_text())["findings"]
    assert finding["effect"] == "unknown"
    assert set(finding["drivers"]) == {"pixel_u", "pixel_v", "cycle"}
    simulated = {name: values for name, values in unseen.items() if name != "distance_m"}
    predict(tmp_path / "out", save(tmp_path / "u.parquet", simulated), tmp_path / "p.parquet")
    said = pq.read_table(tmp_path / "p.parquet")["corrected_distance_m"].to_numpy()
    left, before = (float(np.sum((x - truth) ** 2)) for x in (said, unseen["sim_distance_m"]))
    assert 1.0 - left / before > 0.85
