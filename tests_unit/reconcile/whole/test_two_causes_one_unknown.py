"""Two causes in one channel, one of them in no library: the name stands, the other is a finding of its own."""

import numpy as np
import pyarrow as pa
import pytest

from arl_fixtures.reconcile.command import reconcile
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of


def switched_heater(columns, rng):
    """A heater whose switching couples into the timing, by its phase at each shot."""
    columns["heater_phase_deg"] = rng.uniform(0.0, 360.0, len(columns["step"]))
    step = np.where((columns["heater_phase_deg"] > 60.0) & (columns["heater_phase_deg"] < 170.0), 1.0, 0.0)
    columns["distance_m"] = columns["distance_m"] + 1.5e-3 * step


def turned_polariser(columns, rng):
    """A polariser before the receiver, turned from image to image (Malus), and a stripe brighter than its card."""
    image = np.unique(
        np.stack([columns["step"], columns["stage_angle_deg"], columns["dut"] == "S1"]), axis=1, return_inverse=True
    )[1].ravel()
    columns["polariser_deg"] = rng.choice(np.arange(16) * 11.25, int(image.max()) + 1)[image]
    malus = np.cos(np.radians(columns["polariser_deg"])) ** 2
    columns["intensity_counts"] = columns["intensity_counts"] * (1.0 + 0.01 * malus)


def brighter_stripe(columns, rng):
    turned_polariser(columns, rng)
    gain = np.where(columns["surface"] == "stripe_50", 1.012, 1.0)
    columns["intensity_counts"] = columns["intensity_counts"] * gain


def late_and_heated(columns, rng):
    switched_heater(columns, rng)
    columns["distance_m"] = columns["distance_m"] + 2.5e-5 * (columns["tof_temperature_c"] - 40.0)


def without(channel, table):
    """One of the two channels has nothing to tell here, and a search of its own."""
    return columns_of(pa.table({name: x for name, x in table.items() if channel not in name}))


@pytest.mark.parametrize(
    ("change", "name", "driver", "unasked"),
    [
        (brighter_stripe, "target.reflectance_error", "polariser_deg", "distance_m"),
        (late_and_heated, "timing.temperature_offset", "heater_phase_deg", "intensity_counts"),
    ],
    ids=["polariser", "heater"],
)
def test_a_name_stands_beside_what_no_library_has(make_table, change, name, driver, unasked):
    findings = diagnose(without(unasked, make_table(1, change, steps=7)))[0].findings
    assert sorted(f.effect for f in findings) == sorted([name, "unknown"])
    unknown = next(f for f in findings if f.effect == "unknown")
    assert unknown.drivers[0] == driver


def product(columns, _rng):
    """A stripe that pales as it warms: in no library, and its share at 85 °C looks like a wrong reflectance."""
    warm = (columns["housing_temperature_c"] + 10.0) / 95.0
    pale = np.where(columns["surface"] == "stripe_50", 0.03 * warm, 0.0)
    columns["intensity_counts"] = columns["intensity_counts"] * (1.0 - pale)


def test_a_product_is_no_name_beside_an_unknown(make_table):
    findings = diagnose(without("distance_m", make_table(1, product, steps=7)))[0].findings
    assert [f.effect for f in findings] == ["unknown"]
    assert {"surface", "housing_temperature_c"} & set(findings[0].drivers)


@pytest.mark.parametrize("seed", [1, 2])
def test_a_resonance_of_the_stage_has_no_zero_beside_it(tmp_path, save, seed):
    """A rotor on a belt, driven through its resonance: the mean of what it does is no zero of the stage."""
    rng = np.random.default_rng(seed)
    speed, angle, run = (
        a.ravel() for a in np.meshgrid(np.linspace(2.0, 40.0, 13), np.linspace(-40.0, 40.0, 9), np.arange(7))
    )
    ratio = speed / 19.0
    swing = 3e-4 * ratio**2 / np.hypot(1.0 - ratio**2, 0.12 * ratio)  # of an unbalanced rotor: none at rest
    table = {
        "run": run, "stage_speed_dps": speed, "stage_angle_deg": angle,
        "room_temperature_c": rng.uniform(20.0, 23.0, 819),
        "sim_measured_angle_deg": angle, "sim_measured_angle_deg_std": np.full(819, 1e-3),
        "measured_angle_deg": angle + swing + rng.normal(0.0, 1e-3, 819),
    }  # fmt: skip
    found = reconcile(save(tmp_path / "table.parquet", table), tmp_path / "out").findings
    assert [f.effect for f in found] == ["unknown"]
    assert found[0].drivers[0] == "stage_speed_dps"


def saturated_and_heated(columns, rng):
    switched_heater(columns, rng)
    light = columns["intensity_counts"]
    columns["intensity_counts"] = light / (1.0 + 0.2 * light / light.max())


def test_what_a_name_gains_in_another_channel_explains_nothing_of_an_unknown(make_table):
    findings = diagnose(columns_of(pa.table(make_table(1, saturated_and_heated, steps=7))))[0].findings
    unknown = next(f for f in findings if f.effect == "unknown")
    assert unknown.channels == ["distance_m"]
    assert unknown.alternatives
    assert all(a.gain < 0.2 for a in unknown.alternatives), unknown.alternatives
