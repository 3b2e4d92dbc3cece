"""Frames with heavy tails: their standard deviations are too small on average, which is nobody's missing physics."""

import numpy as np
import pyarrow as pa

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of

FRAMES = 10


def tailed_table(make_table, seed, *, steps=12, excess=1.0):
    """Ten frames a row, of Student's t with 4 degrees of freedom; `excess` times the scatter that is declared."""
    columns = make_table(seed, steps=steps)
    rng = np.random.default_rng(seed)
    rows = len(columns["pixel_u"])
    for name in ("intensity_counts", "distance_m"):
        sigma = excess * columns[f"sim_{name}_std"][:, None]
        frames = columns[f"sim_{name}"][:, None] + sigma * rng.standard_t(4, (rows, FRAMES)) / np.sqrt(2.0)
        columns[name], columns[f"{name}_std"] = frames.mean(axis=1), frames.std(axis=1, ddof=1)
        del columns[f"sim_{name}_repeat_std"]
    return columns_of(pa.table(columns))


def test_tails_alone_are_no_finding(make_table):
    assert diagnose(tailed_table(make_table, 71))[0].findings == []


def test_more_scatter_than_declared_is_found_in_spite_of_tails(make_table):
    rivals = ("readout.noise_excess", "laser.pulse_energy_jitter", "bench.repeatability")
    known = [library()[name] for name in rivals]
    findings = diagnose(tailed_table(make_table, 73, steps=8, excess=1.3), effects=known)[0].findings
    assert findings
    assert all(channel.endswith("_std") for f in findings for channel in f.channels)
    assert all(f.effect in {"readout.noise_excess", "unknown"} for f in findings)


def test_a_table_is_consistent_with_itself():
    """Also where its scatters are those of ten frames, which on average are 2.8 % smaller than the noise."""
    rng = np.random.default_rng(4)
    step, v, u = (a.ravel().astype(float) for a in np.meshgrid(*(np.arange(n) for n in (6, 20, 64)), indexing="ij"))
    light = rng.uniform(200.0, 900.0, step.size)
    made = {
        "step": step, "pixel_u": 2.0 * u, "pixel_v": 6.0 * v, "housing_temperature_c": 10.0 * step,
        "n_frames": np.full(step.size, 10.0), "intensity_counts": light, "sim_intensity_counts": light,
        "intensity_counts_std": np.sqrt(light), "sim_intensity_counts_std": np.sqrt(light),
    }  # fmt: skip
    assert diagnose(columns_of(pa.table(made)))[0].verdict == "consistent"
