"""A temperature log among the rows of images: its rows have neither pixel nor stage angle, and are no place."""

import numpy as np
import pyarrow as pa

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of

KNOWN = [library()[n] for n in ("thermal.sensor_offset", "thermal.contact_resistance", "thermal.latent_heat")]
ERROR_C = 0.15


def logged(seed, off_k, per_volt=0.0):
    """Images of 6 by 4 pixels at 5 stage angles in 8 steps, and 10 readings of the housing in each step."""
    rng = np.random.default_rng(seed)
    seen = np.meshgrid(np.arange(8), np.linspace(-20.0, 20.0, 5), np.arange(6), np.arange(4), indexing="ij")
    step, angle, u, v = (a.ravel() for a in seen)
    of_step, moment = (a.ravel() for a in np.meshgrid(np.arange(8), np.arange(10), indexing="ij"))
    light, level = 400.0 + 8.0 * u - 5.0 * v + 0.5 * angle, -10.0 + 12.0 * of_step
    supply = 12.0 + rng.normal(0.0, 0.3, level.size)
    images = pa.table({
        "step": step, "time_s": 900.0 * step + 2.0 * angle + 50.0,
        "stage_angle_deg": angle, "pixel_u": u, "pixel_v": v,
        "sim_intensity_counts": light, "sim_intensity_counts_std": 0.03 * light,
        "intensity_counts": light * (1.0 + 0.03 * rng.normal(size=step.size)),
    })  # fmt: skip
    log = pa.table({
        "step": of_step, "time_s": 900.0 * of_step + 60.0 * moment, "supply_v": supply,
        "sim_housing_temperature_c": level, "sim_housing_temperature_c_std": np.full(level.size, ERROR_C),
        "housing_temperature_c": level + off_k + per_volt * (supply - 12.0) + ERROR_C * rng.normal(size=level.size),
    })  # fmt: skip
    return columns_of(pa.concat_tables([images, log], promote_options="default"))


def test_a_thermometer_that_reads_low_is_told():
    (found,) = diagnose(logged(3, -0.19), effects=KNOWN)[0].findings
    assert found.effect == "thermal.sensor_offset"
    offset = next(p for p in found.parameters if p.name == "offset")
    assert offset.low < -0.19 < offset.high


def test_one_that_reads_right_is_no_finding():
    assert not diagnose(logged(4, 0.0), effects=KNOWN)[0].findings


def test_what_follows_the_loggers_supply_is_told_by_it():
    (found,) = diagnose(logged(5, 0.0, per_volt=0.8), effects=KNOWN)[0].findings
    assert found.effect == "unknown"
    assert found.drivers[0] == "supply_v"
