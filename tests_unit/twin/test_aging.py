"""Aging by cycle count: monotone, reproducible, and only where a DUT's file asks for it."""

import pytest

from arl_fixtures.twin.aging import AgingSettings, aged
from arl_fixtures.twin.frame import Renderer
from arl_fixtures.twin.settings import DutSettings

FADING = DutSettings(
    serial="A",
    dead_pixels=((1, 1),),
    seed=4,
    aging=AgingSettings(
        power_per_cycle=-0.001,
        beam_width_per_cycle=-0.0005,
        beam_azimuth_deg_per_cycle=0.01,
        dead_pixels_per_cycle=0.5,
        fx_per_cycle=1e-5,
        cx_px_per_cycle=0.002,
        distance_noise_per_cycle=0.01,
    ),
)


def test_a_dut_without_aging_stays_as_it_is():
    dut = DutSettings(serial="A")
    assert aged(dut, 1000) is dut
    assert aged(FADING, 0) is FADING


def test_each_quantity_drifts_by_its_rate():
    old = aged(FADING, 100)
    assert old.gain == pytest.approx(0.999**100)
    assert old.beam.azimuth_half_width_deg == pytest.approx(75 * 0.9995**100)
    assert old.beam.azimuth_shift_deg == pytest.approx(1.0)
    assert old.intrinsics.fx == pytest.approx(58.1 * (1 + 1e-5) ** 100)
    assert old.intrinsics.cx == pytest.approx(63.7)
    assert old.intrinsics.fy == FADING.intrinsics.fy
    assert old.noise.distance_factor == pytest.approx(1.01**100)
    assert (old.serial, old.seed) == (FADING.serial, FADING.seed)


def test_pixels_that_failed_stay_dead():
    previous: set[tuple[int, int]] = {(1, 1)}
    for cycle in (1, 10, 40, 200):
        dead = aged(FADING, cycle).dead_pixels
        assert len(set(dead)) == len(dead)
        assert previous <= set(dead)
        previous = set(dead)
    assert 70 < len(previous) < 135
    assert all(0 <= u < 128 and 0 <= v < 32 for u, v in previous)


def test_other_units_lose_other_pixels():
    twin = FADING.model_copy(update={"seed": 5})
    assert set(aged(FADING, 50).dead_pixels) != set(aged(twin, 50).dead_pixels)


def test_power_decay_shows_in_the_frame():
    dut = DutSettings(serial="A", aging=AgingSettings(power_per_cycle=-0.01))
    new, old = Renderer(dut).expected(0.0), Renderer(aged(dut, 10)).expected(0.0)
    assert (old.intensity_counts / new.intensity_counts).mean() == pytest.approx(0.99**10, rel=1e-5)
