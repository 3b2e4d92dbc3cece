"""Pixels that die in the course of a campaign that looks at each of them once a cycle."""

import numpy as np
import pyarrow as pa
import pytest

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.patterns import find_patterns
from arl_fixtures.reconcile.problem import Problem
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of

KNOWN = [library()[n] for n in ("detector.dead_pixels", "detector.pixel_response", "laser.power_decay")]


def campaign(seed, deaths):
    """Twenty frames of each pixel of four devices at five cycles; `deaths` are (device, column, row, cycle)."""
    rng = np.random.default_rng(seed)
    dut, cycle, v, u = (
        a.ravel() for a in np.meshgrid(range(4), (0, 200, 400, 700, 1000), range(6), range(12), indexing="ij")
    )
    dead = np.zeros(u.size, dtype=bool)
    for device, column, row, since in deaths:
        dead |= (dut == device) & (u == column) & (v == row) & (cycle >= since)
    answers = rng.binomial(20, np.where(dead, 0.0, 0.95)) / 20.0
    light = 900.0 + 40.0 * np.cos(u / 3.0)
    sigma = np.sqrt(light)
    return columns_of(pa.table({
        "dut": np.array(list("ABCD"))[dut], "cycle": 1.0 * cycle, "pixel_u": 1.0 * u, "pixel_v": 1.0 * v,
        "n_frames": np.full(u.size, 20.0), "valid_fraction": answers, "sim_valid_fraction": np.full(u.size, 0.95),
        "sim_valid_fraction_std": np.full(u.size, np.sqrt(0.95 * 0.05)),
        "intensity_counts": np.where(dead, 0.0, light + sigma * rng.normal(size=u.size) / np.sqrt(20.0)),
        "sim_intensity_counts": light, "sim_intensity_counts_std": sigma,
    }))  # fmt: skip


def test_pixels_that_die_on_the_way_are_counted():
    deaths = [(0, 3, 2, 300), (0, 4, 2, 300), (2, 11, 5, 900), (3, 0, 0, 100)]
    findings = diagnose(campaign(1, deaths), effects=KNOWN)[0].findings
    assert [f.effect for f in findings] == ["detector.dead_pixels"]
    assert findings[0].parameters[0].value == 4


def test_pixels_that_all_live_are_no_finding():
    assert not diagnose(campaign(2, []), effects=KNOWN)[0].findings


def sweeps(seed, light_left, *, cycles=1, tails=0.0):
    """Light of 48 pixels on four stage angles in seven steps of each cycle; `light_left` takes step, cycle, pixel."""
    rng = np.random.default_rng(seed)
    cycle, step, angle, pixel = (
        a.ravel() for a in np.meshgrid(range(cycles), range(7), range(4), range(48), indexing="ij")
    )
    light = 700.0 + 90.0 * np.sin(angle + pixel / 5.0)
    share = light_left(cycle * 7 + step, pixel)
    sigma = np.sqrt(light)
    noise = rng.normal(size=light.size) + tails * rng.standard_t(2, size=light.size)
    numbers = {
        "step": 1.0 * step, "set_temperature_c": 15.0 * step - 10.0, "stage_angle_deg": 9.0 * angle,
        "pixel_u": 1.0 * (pixel % 12), "pixel_v": 1.0 * (pixel // 12), "n_frames": np.full(light.size, 10.0),
        "intensity_counts": np.round(share * light) + sigma * noise / np.sqrt(10.0) * (share > 0.0),
        "sim_intensity_counts": light, "sim_intensity_counts_std": sigma,
    }  # fmt: skip
    if cycles > 1:
        numbers["cycle"] = 50.0 * cycle
    return columns_of(pa.table(numbers))


@pytest.mark.parametrize("cycles", [1, 6])
def test_light_alone_tells_of_a_pixel_that_dies_at_a_step(cycles):
    last = 7 * (cycles - 1)
    table = sweeps(3, lambda time, pixel: np.where((pixel == 17) & (time >= last + 3), 0.0, 1.0), cycles=cycles)
    found = diagnose(table, effects=KNOWN)[0].findings
    assert [f.effect for f in found] == ["detector.dead_pixels"]
    assert found[0].parameters[0].value == 1
    assert "step" in found[0].drivers
    assert found[0].where["pixel_u"] == [5.0]
    assert found[0].where["pixel_v"] == [1.0]


@pytest.mark.parametrize("told", ["a shadow that passes", "a window that dims", "wild frames"])
def test_light_that_comes_back_or_is_lacking_everywhere_is_no_dead_pixel(told):
    left = {
        "a shadow that passes": lambda time, pixel: np.where((pixel == 17) & (time == 3), 0.0, 1.0),
        "a window that dims": lambda time, pixel: np.where(time >= 5, 0.1, 1.0) + 0.0 * pixel,
        "wild frames": lambda time, pixel: np.ones(time.size),
    }[told]
    found = diagnose(sweeps(4, left, tails=2.0 * (told == "wild frames")), effects=KNOWN)[0].findings
    assert "detector.dead_pixels" not in [f.effect for f in found]


def weak(seed, since_of, *, left=0.0):
    """Two single frames a cycle of each pixel, before a dark and a bright board: photons, and a noisy amplifier."""
    rng = np.random.default_rng(seed)
    cycle, pixel, board = (a.ravel() for a in np.meshgrid(60 * np.arange(12), range(60), range(2), indexing="ij"))
    light = np.array([35.0, 110.0])[board] * (1.0 + 0.2 * np.cos(pixel / 4.0))
    dead = cycle >= np.array([since_of.get(p, 10_000) for p in range(60)])[pixel]
    seen = rng.poisson(light * np.where(dead, left, 1.0)) + 14.0 * rng.normal(size=light.size)
    kept = rng.random(light.size) > 0.08
    numbers = {
        "cycle": 1.0 * cycle, "pixel_u": 1.0 * (pixel % 10), "pixel_v": 1.0 * (pixel // 10),
        "reflectance": np.array([0.1, 0.32])[board], "n_frames": np.ones(light.size),
        "intensity_counts": np.where(dead & (left == 0.0), 0.0, np.round(seen)),
        "sim_intensity_counts": light, "sim_intensity_counts_std": np.sqrt(light + 14.0**2),
    }  # fmt: skip
    return columns_of(pa.table({name: values[kept] for name, values in numbers.items()}))


def test_pixels_too_dim_to_tell_at_a_cycle_are_dead_from_one_on():
    (found,) = diagnose(weak(7, {11: 240, 12: 480, 44: 360, 58: 600}), effects=KNOWN)[0].findings
    assert found.effect == "detector.dead_pixels"
    assert found.parameters[0].value == 4
    assert "cycle" in found.drivers


def test_dim_pixels_that_lose_half_of_their_light_are_not_dead():
    found = diagnose(weak(8, {11: 240, 12: 480, 44: 360, 58: 600}, left=0.5), effects=KNOWN)[0].findings
    assert "detector.dead_pixels" not in [f.effect for f in found]


def test_one_wild_reading_at_the_end_of_a_pixel_is_no_death():
    def left(time, pixel):
        wild = (pixel == 17) & (time == 6) | (pixel == 3) & (time == 2) | (pixel == 40) & (time == 4)
        return np.where(wild, 0.0, 1.0)

    table = pa.table(sweeps(5, left).numbers)
    turn = np.arange(table.num_rows) // 48 % 4  # a pixel's row at one of the four angles, drawn anew at each step
    row_of = np.random.default_rng(6).integers(0, 4, (7, 48))
    step, pixel = (np.array(table[n]).astype(int) for n in ("step", "pixel_u"))
    place = pixel + 12 * np.array(table["pixel_v"]).astype(int)
    seen = (turn == row_of[step, place]) | (step < 4)
    few = columns_of(table.filter(pa.array(seen)))
    assert not find_patterns(Problem(few), KNOWN, ())
