"""What stands in the room shows on whichever pixel looks at it; and pixels may drift each their own way."""

import numpy as np
import pyarrow.parquet as pq
import pytest

from arl_fixtures.errors import DataError
from arl_fixtures.reconcile.command import predict, reconcile


@pytest.fixture
def judged(tmp_path, make_table, save, knows_only):
    """First finding on some steps, and share of the mismatch that is foretold on the others."""

    def run(change, channel: str, **shape: int):
        knows_only("timing.temperature_offset", "detector.gain_temperature", "timing.row_skew")
        columns = make_table(91, change, **shape)
        truth = columns.pop("truth")
        unseen = np.isin(columns["step"], (3.0, 8.0, 12.0))
        found = reconcile(save(tmp_path / "t.parquet", {n: v[~unseen] for n, v in columns.items()}), tmp_path / "out")
        simulated = {n: v[unseen] for n, v in columns.items() if n not in {"distance_m", "intensity_counts"}}
        predict(tmp_path / "out", save(tmp_path / "new.parquet", simulated), tmp_path / "said.parquet")
        said = pq.read_table(tmp_path / "said.parquet")[f"corrected_{channel}"].to_numpy()
        weight, sim = simulated[f"sim_{channel}_std"] ** -2, simulated[f"sim_{channel}"]
        left = float(weight @ (said - sim - truth[unseen]) ** 2) / float(weight @ truth[unseen] ** 2)
        return found.findings[0], 1.0 - left, simulated

    return run


def port(columns, _rng):
    """A pane in the chamber's wall, fresnel losses at its two faces and a frame with soft edges, 9 degrees wide."""
    bearing = columns["azimuth_deg"] + columns["stage_angle_deg"]
    inside = 0.5 * (np.tanh((bearing - 11.0) / 1.5) - np.tanh((bearing - 20.0) / 1.5))
    passed = (1.0 - 0.04 * inside) ** 4
    columns["truth"] = columns["intensity_counts"] * (passed - 1.0)
    columns["intensity_counts"] = columns["intensity_counts"] * passed


def ageing_pixels(columns, _rng, per_k=8e-4):
    """Every pixel's quantum efficiency has its own temperature coefficient, drawn anew on each device."""
    own = np.random.default_rng(6).normal(0.0, per_k, size=(2, 32, 128))
    device = (columns["dut"] == "S1").astype(int)
    drift = own[device, columns["pixel_v"].astype(int), columns["pixel_u"].astype(int)]
    factor = np.exp(drift * (columns["tof_temperature_c"] - 46.0))
    columns["truth"] = columns["intensity_counts"] * (factor - 1.0)
    columns["intensity_counts"] = columns["intensity_counts"] * factor


def test_a_port_of_the_chamber_is_found_at_its_bearing(judged, tmp_path, save):
    finding, foretold, simulated = judged(port, "intensity_counts", steps=16)
    assert finding.effect == "unknown"
    assert set(finding.drivers[:2]) == {"stage_angle_deg", "azimuth_deg"}
    assert foretold > 0.6
    del simulated["azimuth_deg"]
    with pytest.raises(DataError, match="lacks column 'azimuth_deg'"):
        predict(tmp_path / "out", save(tmp_path / "less.parquet", simulated), tmp_path / "no.parquet")


def test_pixels_that_drift_apart_are_told_one_by_one(judged, tmp_path, save):
    finding, foretold, simulated = judged(ageing_pixels, "intensity_counts", steps=16)
    assert finding.effect == "unknown"
    assert {"pixel_u", "pixel_v"} <= set(finding.drivers)
    assert any(name.endswith("temperature_c") for name in finding.drivers)
    assert foretold > 0.7
    del simulated["pixel_v"]
    with pytest.raises(DataError, match="lacks column 'pixel_v'"):
        predict(tmp_path / "out", save(tmp_path / "less.parquet", simulated), tmp_path / "no.parquet")


def undeclared(columns, rng):
    """Faint drifts, and steps that differ by what nobody states."""
    ageing_pixels(columns, rng, per_k=1.2e-4)
    for name in [n for n in columns if n.endswith("_repeat_std")]:
        del columns[name]


def test_pixels_of_two_devices_are_no_more_shared_by_a_step_than_those_of_one(judged):
    finding, foretold, _ = judged(undeclared, "intensity_counts", steps=11)
    assert finding.effect == "unknown"
    assert {"pixel_u", "pixel_v"} <= set(finding.drivers)
    assert foretold > 0.4
