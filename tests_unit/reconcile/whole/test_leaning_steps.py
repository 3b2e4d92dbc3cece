"""A diode hops to its next mode where its junction is too warm: its mount's heat and its own current tell of it."""

import numpy as np
import pyarrow.parquet as pq
import pytest

from arl_fixtures.reconcile.command import predict, reconcile

STEPS, CURRENTS, FRAMES = 9, 60, 4
VOLTS, OHMS, THRESHOLD_A, WATTS_PER_A = 1.4, 0.25, 0.35, 1.0


def diode(seed, kelvin_per_watt, *, loss=0.03, warmest=65.0):
    """Of two modes, whose combs drift by 0.07 nm/K, the one nearer the gain's peak lases, which drifts by 0.27 nm/K;
    the second one's wavelength passes a filter less well. The junction is warmer than its mount by the power that
    does not leave as light."""
    rng = np.random.default_rng(seed)
    step = np.repeat(np.arange(STEPS), CURRENTS)
    mount = np.linspace(15.0, warmest, STEPS)[step] + rng.normal(0.0, 0.05, step.size)
    current = np.tile(np.linspace(0.05, 2.0, CURRENTS), STEPS)
    light = WATTS_PER_A * np.maximum(current - THRESHOLD_A, 0.0)
    junction = mount + kelvin_per_watt * ((VOLTS + OHMS * current) * current - light)
    combs = np.array([[10.5], [13.9]]) + 0.07 * junction
    second = np.argmin(np.abs(combs - 0.27 * junction), axis=0) == 1
    simulated = 1e-3 * light + 1e-6
    truth = simulated * np.where(second, 1.0 - loss, 1.0)
    scatter, bench = np.full(step.size, 2e-6), 8e-4
    seen = truth + scatter / np.sqrt(FRAMES) * rng.normal(size=step.size)
    seen += bench * rng.normal(size=STEPS)[step] * simulated
    columns = {
        "step": step, "heatsink_temperature_c": mount, "drive_current_a": current,
        "ambient_temperature_c": np.round(22.0 + rng.normal(0.0, 0.2, step.size), 1),
        "n_frames": np.full(step.size, FRAMES), "sim_photodiode_a": simulated, "sim_photodiode_a_std": scatter,
        "sim_photodiode_a_repeat_std": bench * simulated, "photodiode_a": seen,
    }  # fmt: skip
    return columns, truth


@pytest.mark.parametrize(("kelvin_per_watt", "loss"), [(15.0, 0.03), (40.0, 0.03)])
def test_a_step_leans_on_what_warms_the_junction(tmp_path, save, kelvin_per_watt, loss):
    table = save(tmp_path / "table.parquet", diode(1, kelvin_per_watt, loss=loss)[0])
    diagnosis = reconcile(table, tmp_path / "out")
    assert [f.effect for f in diagnosis.findings] == ["unknown"]
    assert set(diagnosis.findings[0].drivers) == {"heatsink_temperature_c", "drive_current_a"}
    unseen, truth = diode(2, kelvin_per_watt, loss=loss, warmest=60.0)
    predict(tmp_path / "out", save(tmp_path / "unseen.parquet", unseen), tmp_path / "said.parquet")
    said = pq.read_table(tmp_path / "said.parquet")["corrected_photodiode_a"].to_numpy()
    assert np.sum((said - truth) ** 2) < 0.15 * np.sum((unseen["sim_photodiode_a"] - truth) ** 2)


def test_a_step_over_one_column_does_not_lean(tmp_path, save):
    diagnosis = reconcile(save(tmp_path / "table.parquet", diode(1, 4.0)[0]), tmp_path / "out")
    assert diagnosis.findings[0].drivers == ["heatsink_temperature_c"]


def test_a_diode_of_one_mode_is_as_simulated(tmp_path, save):
    assert reconcile(save(tmp_path / "table.parquet", diode(1, 15.0, loss=0.0)[0]), tmp_path / "out").findings == []


def test_a_band_leans_too(tmp_path, save):
    """The middle one of three modes lases where mount and current bring the junction between two temperatures."""
    rng = np.random.default_rng(5)
    settings = 26
    mount, current = rng.choice([20.0, 28.0, 32.0, 48.0, 52.0], settings), rng.uniform(0.06, 0.105, settings)
    junction = mount + 700.0 * (current - 0.06)
    combs = np.array([[8.6], [10.0], [11.6]]) + 0.07 * junction
    middle = np.argmin(np.abs(combs - 0.27 * junction), axis=0) == 1
    step, row = (a.ravel() for a in np.meshgrid(np.arange(settings), np.arange(60), indexing="ij"))
    simulated = 300.0 + 40.0 * row
    bench = 0.002 * simulated
    columns = {
        "step": step, "laser_temperature_c": mount[step] + rng.normal(0.0, 0.05, settings)[step],
        "laser_current_a": current[step], "rail_3v3_v": 3.3 + rng.normal(0.0, 0.002, settings)[step],
        "sim_intensity_counts": simulated, "sim_intensity_counts_std": np.sqrt(simulated),
        "sim_intensity_counts_repeat_std": bench, "n_frames": np.full(step.size, FRAMES),
        "intensity_counts": simulated * np.where(middle[step], 0.985, 1.0) + bench * rng.normal(size=settings)[step]
        + np.sqrt(simulated) / np.sqrt(FRAMES) * rng.normal(size=step.size),
    }  # fmt: skip
    found = reconcile(save(tmp_path / "table.parquet", columns), tmp_path / "out").findings
    assert [f.effect for f in found] == ["unknown"]
    assert set(found[0].drivers) == {"laser_temperature_c", "laser_current_a"}
