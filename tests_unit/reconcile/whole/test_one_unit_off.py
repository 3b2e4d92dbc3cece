"""One thermocouple of several reads off, and a constant was fitted to all of them together."""

import numpy as np
import pyarrow as pa
import pytest

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of

NAMES = ("thermal.sensor_offset", "thermal.contact_resistance", "thermal.latent_heat", "timing.temperature_offset")


def logged(off_k, *, units=3, seed=2, calibrated=True):
    """Housings that follow a plate through a ramp and back; the last one's thermocouple is off."""
    rng = np.random.default_rng(seed)
    hours = np.arange(0.0, 12.0, 0.1)
    plate = 25.0 + 45.0 * np.sin(2.0 * np.pi * hours / 12.0)
    made: dict[str, list] = {name: [] for name in ("dut", "time_s", "plate_temperature_c", "sim", "seen")}
    for unit in range(units):
        housing = np.zeros(hours.size)
        housing[0] = plate[0] + 5.0
        for k in range(1, hours.size):  # a node of 900 J/K and 25 W/K, 360 s apart
            housing[k] = housing[k - 1] + 360.0 * (25.0 * (plate[k] - housing[k - 1]) + 125.0) / 9000.0
        made["dut"] += ["ABCDEFGH"[unit]] * hours.size
        made["time_s"] += list(3600.0 * hours)
        made["plate_temperature_c"] += list(plate)
        made["sim"] += list(housing)
        made["seen"] += list(housing + off_k * (unit == units - 1) + rng.normal(0.0, 0.1, hours.size))
    sim, seen = np.array(made.pop("sim")), np.array(made.pop("seen"))
    if calibrated:
        sim = sim + np.mean(seen - sim)  # the user's own calibration, of all units at once
    return columns_of(pa.table({
        **made, "housing_temperature_c": seen, "sim_housing_temperature_c": sim,
        "sim_housing_temperature_c_std": np.full(sim.size, 0.1),
    }))  # fmt: skip


@pytest.mark.parametrize(("off_k", "units"), [(0.12, 3), (-0.2, 5)])
def test_the_unit_that_is_off_is_told_and_by_how_much(off_k, units):
    found = diagnose(logged(off_k, units=units), effects=[library()[name] for name in NAMES])[0].findings
    assert [f.effect for f in found] == ["thermal.sensor_offset"]
    assert found[0].where == {"dut": ["ABCDEFGH"[units - 1]]}
    (offset,) = found[0].parameters
    assert offset.low < off_k < offset.high
    assert offset.value == pytest.approx(off_k, rel=0.2)


def test_without_a_calibration_the_offset_is_that_of_the_unit_itself():
    found = diagnose(logged(-0.6, calibrated=False), effects=[library()[name] for name in NAMES])[0].findings
    assert [f.effect for f in found] == ["thermal.sensor_offset"]
    assert found[0].where == {"dut": ["C"]}
    offset = next(p for p in found[0].parameters if p.name == "offset")
    assert offset.low < -0.6 < offset.high
    assert "of A" not in found[0].statement


def test_units_that_read_alike_are_consistent():
    assert diagnose(logged(0.0))[0].verdict == "consistent"
