"""A bath with a thermometer at each of four places, one of which reads low."""

import numpy as np
import pyarrow as pa

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of

KNOWN = [library()[n] for n in ("thermal.sensor_offset", "thermal.contact_resistance", "thermal.latent_heat")]


def bath(seed, off_k):
    rng = np.random.default_rng(seed)
    step, moment, node = (a.ravel() for a in np.meshgrid(np.arange(7), np.arange(12), np.arange(4), indexing="ij"))
    level = -10.0 + 15.0 * step + 2.0 * np.exp(-moment / 3.0)
    reads = level + np.where(node == 2, off_k, 0.0) + 0.1 * rng.normal(size=step.size)
    return columns_of(pa.table({
        "node": np.array(["plate", "housing_1", "housing_2", "lid"])[node], "step": 1.0 * step,
        "time_s": 900.0 * step + 60.0 * moment, "sim_temperature_c": level, "temperature_c": np.round(reads, 1),
        "sim_temperature_c_std": np.full(step.size, 0.104),
    }))  # fmt: skip


def test_the_thermometer_that_reads_low_is_told_by_its_place():
    (found,) = diagnose(bath(1, -0.12), effects=KNOWN)[0].findings
    assert found.effect == "thermal.sensor_offset"
    assert found.where["node"] == ["housing_2"]
    offset = next(p for p in found.parameters if p.name == "offset")
    assert offset.low < -0.12 < offset.high


def test_thermometers_that_agree_are_no_finding():
    assert not diagnose(bath(2, 0.0), effects=KNOWN)[0].findings


def test_thermocouples_of_different_wire_and_terminals_are_each_off_by_their_own():
    """Each wire's voltage is summed kelvin by kelvin from its terminal on, and read by the nominal wire's table."""
    rng = np.random.default_rng(17)
    couple, point, _ = (a.ravel() for a in np.meshgrid(np.arange(7), np.arange(8), np.arange(6), indexing="ij"))
    block = np.linspace(-5.0, 85.0, 8)[rng.permutation(8)][point]
    wire, terminal = rng.normal(0.0, 0.006, 7), rng.normal(0.0, 0.4, 7)
    kelvin = np.arange(-40.0, 140.0, 0.1)
    nominal = np.cumsum(39.5 + 0.02 * kelvin) * 0.1  # microvolts, from -40 degC on
    seen = np.empty(couple.size)
    for k in range(7):
        of = couple == k
        voltage = (1.0 + wire[k]) * (np.interp(block[of], kelvin, nominal) - np.interp(24.0, kelvin, nominal))
        seen[of] = np.interp(voltage + np.interp(24.0 + terminal[k], kelvin, nominal), nominal, kelvin)
    made = columns_of(pa.table({
        "dut": np.char.add("TC", couple.astype(str)), "step": point, "reference_temperature_c": block,
        "n_frames": np.ones(couple.size), "sim_temperature_c": block,
        "sim_temperature_c_std": np.full(couple.size, 0.03),
        "temperature_c": seen + 0.03 * rng.normal(size=couple.size),
    }))  # fmt: skip
    (found,) = diagnose(made)[0].findings
    assert found.effect == "thermal.sensor_offset"
    assert found.drivers[0] == "dut"
    told = {p.name: p for p in found.parameters}
    for k in range(7):
        true = terminal[k] + wire[k] * (25.0 - 24.0)  # at 25 degC
        assert abs(told[f"offset_TC{k}"].value - true) < 0.05
        assert abs(told[f"gain_TC{k}"].value - wire[k]) < 2e-3
