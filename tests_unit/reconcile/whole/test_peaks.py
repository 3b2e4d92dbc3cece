"""What resonates, or points at the sun, peaks at one place: a law that says so tells what lies between."""

import numpy as np
import pyarrow.parquet as pq
from scipy.signal import lti

from arl_fixtures.reconcile.command import predict, reconcile

FRAMES = 25


def foretold(tmp_path, save, channel, table, unseen, truth):
    """The diagnosis of a table, and the part of another's mismatch that stays after its prediction."""
    diagnosis = reconcile(save(tmp_path / "table.parquet", table), tmp_path / "out")
    predict(tmp_path / "out", save(tmp_path / "unseen.parquet", unseen), tmp_path / "said.parquet")
    said = pq.read_table(tmp_path / "said.parquet")[f"corrected_{channel}"].to_numpy()
    before = np.sum((unseen[f"sim_{channel}"] - truth) ** 2)
    return diagnosis.findings, float(np.sum((said - truth) ** 2) / before)


def driver_board(rng, frequency_mhz):
    """A light driver of a coil, a capacitance and a resistor in series, whose losses at the modulation show as range.

    The transfer function of its network at each frequency.
    """
    step, place = (a.ravel() for a in np.meshgrid(np.arange(len(frequency_mhz)), np.arange(48), indexing="ij"))
    coil_h, capacity_f, ohms = 90e-9, 108e-12, 4.0
    omega = 2.0 * np.pi * 1e6 * frequency_mhz
    board = lti([ohms * capacity_f, 0.0], [coil_h * capacity_f, ohms * capacity_f, 1.0])
    gain = np.abs(board.freqresp(omega)[1])
    error_m = 0.02 * gain**2  # what heats the resistor bends the pulse
    range_m = 0.4 + 0.023 * place
    scatter = np.full(step.size, 0.004)
    truth = range_m + error_m[step]
    columns = {
        "step": step, "mod_frequency_mhz": frequency_mhz[step], "true_range_m": range_m,
        "tof_temperature_c": (33.0 + rng.normal(0.0, 1.2, len(frequency_mhz)))[step],
        "sim_distance_m": range_m, "sim_distance_m_std": scatter, "n_frames": np.full(step.size, FRAMES),
        "sim_distance_m_repeat_std": np.full(step.size, 8e-4),
        "distance_m": truth + rng.normal(size=step.size) * scatter / 5.0
        + 8e-4 * rng.normal(size=len(frequency_mhz))[step],
    }  # fmt: skip
    return columns, truth


def test_a_resonance_is_foretold_between_the_frequencies_that_were_set(tmp_path, save):
    rng = np.random.default_rng(3)
    table, _ = driver_board(rng, np.linspace(12.0, 96.0, 28))
    unseen, truth = driver_board(rng, np.array([20.3, 44.7, 49.4, 51.9, 55.7, 74.0]))
    offset = np.mean(table["distance_m"] - table["sim_distance_m"])  # the user's
    for columns in (table, unseen):
        columns["sim_distance_m"] = columns["sim_distance_m"] + offset
    findings, left = foretold(tmp_path, save, "distance_m", table, unseen, truth)
    assert [f.effect for f in findings] == ["unknown"]
    assert findings[0].drivers == ["mod_frequency_mhz"]
    assert left < 0.006


def sunlit(rng, headings):
    """A scanner on a vehicle, whose window scatters sunlight where a ray points near the sun (Lorentz' lobe in both
    angles of the sphere), by as much as the sun shines."""
    step, ray = (a.ravel() for a in np.meshgrid(np.arange(len(headings)), np.arange(90), indexing="ij"))
    azimuth = np.linspace(-60.0, 60.0, 90)[ray]
    sun_deg, height_deg = 215.0, 3.0
    bearing = azimuth + headings[step]
    away = np.degrees(np.arccos(np.cos(np.radians(bearing - sun_deg)) * np.cos(np.radians(height_deg))))
    shines = rng.uniform(300.0, 950.0, len(headings))[step]
    simulated = 900.0 / (1.0 + 0.02 * np.abs(azimuth))
    truth = simulated * (1.0 + 0.08 * shines / 900.0 / (1.0 + (away / 6.0) ** 2))
    scatter = 0.05 * simulated
    columns = {
        "step": step, "time_s": 30.0 * step, "heading_deg": headings[step], "azimuth_deg": azimuth,
        "irradiance_w_m2": shines, "sim_intensity_counts": simulated, "sim_intensity_counts_std": scatter,
        "n_frames": np.full(step.size, FRAMES),
        "intensity_counts": truth + rng.normal(size=step.size) * scatter / 5.0,
    }  # fmt: skip
    return columns, truth


def test_the_sun_stands_where_two_angles_add_up_to(tmp_path, save):
    rng = np.random.default_rng(4)
    table, _ = sunlit(rng, rng.uniform(150.0, 280.0, 40))
    unseen, truth = sunlit(rng, rng.uniform(160.0, 270.0, 12))
    findings, left = foretold(tmp_path, save, "intensity_counts", table, unseen, truth)
    assert [f.effect for f in findings] == ["unknown"]
    assert {"azimuth_deg", "heading_deg"} == set(findings[0].drivers[:2])
    assert left < 0.08
