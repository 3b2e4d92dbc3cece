"""Pixels strewn over a sweep, each at one stage angle: what a few of them see is no law of the sensor."""

import numpy as np
import pyarrow as pa
import pytest

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of

KNOWN = [
    library()[name]
    for name in ("detector.compression", "detector.pile_up", "detector.pixel_response", "target.reflectance_error")
]


def strewn(seed, bend):
    """40 pixels of two devices, one angle each, 20 steps; `bend` gets light, mean one, and each row's place."""
    rng = np.random.default_rng(seed)
    dut, step, place = (a.ravel() for a in np.meshgrid(np.arange(2), np.arange(20), np.arange(40), indexing="ij"))
    grey = np.array([0.02, 0.2, 0.4, 1.0])[place % 4]
    light = 3600.0 * grey * (0.8 + 0.005 * place)
    sigma = np.sqrt(36.0 + 0.3 * light)
    seen = bend(light, light / 3600.0, place, rng) * (1.0 + 0.001 * rng.normal(size=(2, 20))[dut, step])
    return columns_of(pa.table({
        "dut": np.array(["A", "B"])[dut], "step": step, "housing_temperature_c": 20.0 + 3.0 * step,
        "stage_angle_deg": 7.5 * (place * 7 % 11), "pixel_u": place * 37 % 128, "pixel_v": place * 5 % 32,
        "surface": np.array(["wall", "dark", "grey", "white"])[place % 4], "n_frames": np.full(step.size, 10),
        "sim_intensity_counts": light, "sim_intensity_counts_std": sigma,
        "sim_intensity_counts_repeat_std": 0.001 * light,
        "intensity_counts": seen + sigma / np.sqrt(10.0) * rng.normal(size=step.size),
    }))  # fmt: skip


def two_edges(light, _share, place, _rng):
    """The brightest place and another one look past an edge."""
    return light * np.where(place == 39, 0.92, np.where(place == 18, 0.95, 1.0))


def uneven_pixels(light, _share, place, _rng):
    return light * (1.0 + 0.015 * np.random.default_rng(3).normal(size=40)[place])


def full_wells(light, share, _place, _rng):
    """Electrons stop where the well's potential has gone: marched over the exposure."""
    held = np.zeros(light.size)
    for _ in range(400):
        held += share / 400.0 * (1.0 - held / 3.0)
    return light * held / share


def test_what_two_places_miss_is_neither_a_full_well_nor_uneven_pixels():
    assert {f.effect for f in diagnose(strewn(3, two_edges), effects=KNOWN)[0].findings} == {"unknown"}


@pytest.mark.parametrize(
    ("bend", "names"),
    [(uneven_pixels, {"detector.pixel_response"}), (full_wells, {"detector.compression", "detector.pile_up"})],
)
def test_what_all_of_them_tell_is_named(bend, names):
    (found,) = diagnose(strewn(4, bend), effects=KNOWN)[0].findings
    assert {found.effect, *found.equivalent_to} & names
