"""Where the model without physics lags behind a steep end of a curve, its rows are off together: no wild readings."""

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from arl_fixtures.reconcile.command import predict, reconcile
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of

CURRENT_A = np.arange(0.0, 2.2, 0.025)
SINK_C = np.arange(20.0, 70.0, 5.0)


def heated_laser(current, sink_c):
    """Light of a laser that heats itself: threshold and slope grow and fall with the junction's temperature."""
    light = np.zeros_like(current)
    junction = sink_c.copy()
    for _ in range(200):
        threshold = 0.25 * np.exp((junction - 20.0) / 55.0)
        slope = 0.45 * np.exp(-(junction - 20.0) / 170.0) * np.clip(1.0 - (junction - 20.0) / 180.0, 0.0, 1.0)
        light = 0.5 * light + 0.5 * slope * np.maximum(current - threshold, 0.0)
        heat = 8.0 * (current * (1.3 + 0.25 * current) - light)
        junction = 0.5 * junction + 0.5 * np.minimum(sink_c + heat, 180.0)
    return light


@pytest.mark.parametrize(("band", "relative"), [(0, 3e-4), (2, 1e-3), (1, 3e-3)])
def test_a_laser_that_rolls_over_is_foretold_between_its_currents(tmp_path, band, relative):
    current, sink = (x.ravel() for x in np.meshgrid(CURRENT_A, SINK_C))
    cold = 0.45 * np.maximum(current - 0.25, 0.0)
    true = heated_laser(current, sink)
    std = np.hypot(2e-5, relative * true)
    rng = np.random.default_rng(41)
    table = pa.table(
        {
            "heatsink_temperature_c": sink,
            "drive_current_a": current,
            "photodiode_a": true + std * rng.normal(size=true.size),
            "sim_photodiode_a": cold,
            "sim_photodiode_a_std": std,
            "n_frames": np.ones(true.size, dtype=int),
        }
    )
    held = np.floor(current / 0.1 + 1e-9) % 3 == band
    pq.write_table(table.filter(pa.array(~held)), tmp_path / "seen.parquet")
    pq.write_table(table.filter(pa.array(held)).drop_columns(["photodiode_a"]), tmp_path / "unseen.parquet")
    found = reconcile(tmp_path / "seen.parquet", tmp_path / "out")
    predict(tmp_path / "out", tmp_path / "unseen.parquet", tmp_path / "said.parquet")
    said = pq.read_table(tmp_path / "said.parquet")["corrected_photodiode_a"].to_numpy()
    left, before = np.sqrt(np.mean((said - true[held]) ** 2)), np.sqrt(np.mean((cold - true)[held] ** 2))
    assert found.findings[0].effect == "laser.thermal_rolloff"
    assert left / before < 0.02


def rail(rng, stop_error_m):
    """Stops of a rail before four cards each: where a stop is off, it is so before every card."""
    stops = np.linspace(0.5, 4.0, 60)
    far, card = (x.ravel() for x in np.meshgrid(stops, [0.1, 0.3, 0.6, 0.9], indexing="ij"))
    off = np.repeat(stop_error_m * rng.normal(size=stops.size), 4)
    return pa.table(
        {
            "true_range_m": far,
            "reflectance": card,
            "sim_distance_m": far,
            "sim_distance_m_std": np.full(far.size, 1e-3),
            "distance_m": far + off + 1e-3 / np.sqrt(10.0) * rng.normal(size=far.size),
            "n_frames": np.full(far.size, 10),
        }
    )


@pytest.mark.parametrize("seed", [1, 2, 3, 4])
def test_stops_of_a_rail_that_are_off_before_every_card_get_no_name(seed):
    findings = diagnose(columns_of(rail(np.random.default_rng(seed), 1e-3)))[0].findings
    assert not {f.effect for f in findings} - {"bench.repeatability"}
