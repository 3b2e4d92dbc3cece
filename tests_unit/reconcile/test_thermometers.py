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
