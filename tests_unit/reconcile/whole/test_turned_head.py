"""A device that is rolled behind a film which polarises: steps share much, and what they share is a law.

The gauge study has said how much steps share by chance; what they share beyond that is not to hide it.
"""

import numpy as np
import pyarrow.parquet as pq
import pytest
from foretold import share_told

from arl_fixtures.reconcile.command import predict, reconcile

TURNS_DEG = np.arange(24) * 15.0
REPEAT = 0.004


def film(roll_deg):
    """Light through an imperfect polarising film: the power of a Jones vector behind it, of 1 on average."""
    plane = np.radians(roll_deg - 17.0)
    along, across = np.cos(plane), 0.98 * np.sin(plane)
    return (along**2 + across**2) / (0.5 + 0.5 * 0.98**2)


def rolled(seed, turns_deg, *, filmed=True):
    """Panels of two kinds at nine distances, seen by a head of few pixels at rolls of which each is a step."""
    rng = np.random.default_rng(seed)
    step, place, pixel = (
        a.ravel() for a in np.meshgrid(np.arange(len(turns_deg)), np.arange(18), np.arange(9), indexing="ij")
    )
    far, white = (0.6 + 0.09 * np.arange(18))[place], np.array([0.2, 0.8])[place % 2]
    light = 9000.0 * white / far**2
    scatter = np.sqrt(100.0 + 0.4 * light)
    seen = light * (film(turns_deg[step]) if filmed else 1.0) * (1.0 + REPEAT * rng.normal(size=len(turns_deg))[step])
    return {
        "step": step, "roll_deg": turns_deg[step], "true_range_m": far, "reflectance": white, "pixel_u": pixel,
        "housing_temperature_c": 19.0 + 0.03 * turns_deg[step] + 0.05 * rng.normal(size=len(step)),
        "sim_intensity_counts": light, "sim_intensity_counts_std": scatter, "n_frames": np.full(len(step), 10),
        "sim_intensity_counts_repeat_std": REPEAT * light,
        "intensity_counts": seen + rng.normal(size=len(step)) * scatter / np.sqrt(10.0),
    }  # fmt: skip


@pytest.mark.parametrize("seed", [1, 2])
def test_light_that_follows_the_roll_is_told_and_foretold(tmp_path, save, seed):
    train, unseen = TURNS_DEG[np.arange(24) % 4 != 2], TURNS_DEG[np.arange(24) % 4 == 2]
    (found,) = reconcile(save(tmp_path / "train.parquet", rolled(seed, train)), tmp_path / "out").findings
    assert (found.effect, found.drivers[0]) == ("unknown", "roll_deg")
    table = rolled(seed + 50, unseen)
    predict(tmp_path / "out", save(tmp_path / "unseen.parquet", table), tmp_path / "said.parquet")
    said = pq.read_table(tmp_path / "said.parquet")["corrected_intensity_counts"].to_numpy()
    light = table["sim_intensity_counts"]
    off, left = light * film(table["roll_deg"]) - light, light * film(table["roll_deg"]) - said
    assert share_told(off, left) > 0.6


@pytest.mark.parametrize("period_deg", [128.4, 134.6])
def test_a_wave_is_as_long_as_it_is(tmp_path, save, period_deg):
    """Between eighths of a turn over the columns' span lie lengths that foretell the next turn better."""
    table = rolled(4, TURNS_DEG, filmed=False)
    wave = 1.0 + 0.03 * np.sin(2.0 * np.pi * table["roll_deg"] / period_deg)
    table["intensity_counts"] = table["intensity_counts"] * wave
    (found,) = reconcile(save(tmp_path / "table.parquet", table), tmp_path / "out").findings
    lengths = {axis.at for term in found.law.terms for axis in term.axes if axis.kind in {"sin", "cos"}}
    assert min(abs(length - period_deg) for length in lengths) < 0.01 * period_deg


def test_what_steps_share_by_chance_is_no_law_of_the_roll(tmp_path, save):
    table = save(tmp_path / "table.parquet", rolled(2, TURNS_DEG, filmed=False))
    assert reconcile(table, tmp_path / "out").findings == []
