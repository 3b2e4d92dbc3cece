"""Simulations whose gain and zero their user fitted to a recording with the effect in it."""

import json

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from arl_fixtures.reconcile.command import predict, reconcile
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of

CHANNEL = "photocurrent_na"


def recorded(change, *, seed=4):
    """Three detectors over light and temperature; the simulation's line through the recording, unit by unit."""
    rng = np.random.default_rng(seed)
    levels = np.arange(3), np.linspace(-25.0, 60.0, 10), np.geomspace(1.0, 120.0, 12)
    unit, warm, light = (x.ravel() for x in np.meshgrid(*levels, indexing="ij"))
    step = np.unique(warm, return_inverse=True)[1]
    plain = 6.0 * light * (1.0 + 0.04 * rng.normal(size=3))[unit]
    true = change(plain, warm)
    noise = np.sqrt(0.3**2 + 0.01 * plain) / np.sqrt(10.0)
    measured = true + noise * rng.normal(size=plain.size)
    sim = np.empty_like(plain)
    for k in range(3):
        mine = unit == k
        sim[mine] = np.polyval(np.polyfit(plain[mine], measured[mine], 1, w=1.0 / noise[mine]), plain[mine])
    return {
        "dut": np.array(["d0", "d1", "d2"])[unit], "step": step.astype(float), "detector_temperature_c": warm,
        "optical_power_nw": light, "n_frames": np.full(plain.size, 10.0), f"sim_{CHANNEL}": sim,
        f"sim_{CHANNEL}_std": noise * np.sqrt(10.0), CHANNEL: measured,
    }, true  # fmt: skip


def dark(light, warm):
    """Charge that a warm junction generates, which doubles every nine kelvin."""
    return light + 0.9 * np.exp(np.log(2.0) * (warm - 40.0) / 9.0)


def saturating(light, warm):
    """A feedback stage that clips softly: its output solves v + (v / 900)^3 / 3 · 900 = light."""
    v = light.copy()
    for _ in range(60):
        v = v - (v + 300.0 * (v / 900.0) ** 3 - light) / (1.0 + (v / 900.0) ** 2)
    return v


@pytest.mark.parametrize(
    ("change", "effect", "least"), [(dark, "detector.dark_offset", 0.95), (saturating, "detector.compression", 0.7)]
)
def test_an_effect_whose_mean_a_line_took_along_is_named_and_foretold(change, effect, least, save, tmp_path):
    table, true = recorded(change)
    held = np.isin(table["step"], [3.0, 8.0])
    reconcile(save(tmp_path / "t.parquet", {n: x[~held] for n, x in table.items()}), tmp_path / "out")
    findings = json.loads((tmp_path / "out" / "diagnosis.json").read_text())["findings"]
    assert [f["effect"] for f in findings] == [effect]
    blind = {n: x[held] for n, x in table.items() if n != CHANNEL}
    predict(tmp_path / "out", save(tmp_path / "u.parquet", blind), tmp_path / "p.parquet")
    said = pq.read_table(tmp_path / "p.parquet")[f"corrected_{CHANNEL}"].to_numpy()
    error = table[f"sim_{CHANNEL}_std"][held]
    left, before = (np.sum(((true[held] - x) / error) ** 2) for x in (said, table[f"sim_{CHANNEL}"][held]))
    assert 1.0 - left / before > least


def line_sensor(seed):
    """Three line sensors in an oven; a zero was fitted to each that took the mean of its dark charge along."""
    rng = np.random.default_rng(seed)
    oven_c = np.array([5.0, 10.0, 15.0, 25.0, 30.0, 40.0, 45.0, 55.0, 60.0])
    step, unit, pixel = (a.ravel() for a in np.meshgrid(np.arange(9), np.arange(3), np.arange(28), indexing="ij"))
    warm = oven_c[step] + 4.0 + 1.5 * unit + 0.1 * rng.normal(size=step.size)
    # carriers that heat sets free over the gap of the crystal
    charge = 6.0 * np.exp(-0.63 / 8.617e-5 * (1.0 / (warm + 273.15) - 1.0 / 318.15))
    zero = np.array([charge[unit == k].mean() for k in range(3)])[unit]
    light = 300.0 + 40.0 * pixel + 200.0 * rng.random(step.size)
    noise = np.sqrt(light + 100.0)
    return columns_of(pa.table({
        "dut": np.array(["A", "B", "C"])[unit], "step": step, "set_temperature_c": oven_c[step],
        "detector_temperature_c": warm, "pixel_u": 9.0 * pixel, "n_frames": np.full(step.size, 16.0),
        "sim_intensity_counts": light, "sim_intensity_counts_std": noise,
        "sim_intensity_counts_repeat_std": np.ones(step.size),
        "intensity_counts": light + charge - zero + rng.normal(size=27)[step * 3 + unit]
        + noise / 4.0 * rng.normal(size=step.size),
    }))  # fmt: skip


@pytest.mark.parametrize("seed", [1, 2])
def test_a_zero_shows_by_how_steps_are_said_to_scatter(seed):
    """They seem to scatter by as much more as the zero is off: nothing else is needed beside the dark charge."""
    (found,) = diagnose(line_sensor(seed))[0].findings
    assert found.effect == "detector.dark_offset"
