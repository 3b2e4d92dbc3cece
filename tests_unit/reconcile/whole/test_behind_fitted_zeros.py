"""Simulations whose gain and zero their user fitted to a recording with the effect in it."""

import json

import numpy as np
import pyarrow.parquet as pq
import pytest

from arl_fixtures.reconcile.command import predict, reconcile

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
