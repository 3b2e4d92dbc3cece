"""Effects so large that a tangent tells little of them, against rays and waveforms traced here."""

import numpy as np
import pytest
from traced_bench import LIGHT, RANGE, table

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.columns import Columns, find_channels
from arl_fixtures.reconcile.decide import Decision
from arl_fixtures.reconcile.search import Search

GEOMETRY = ("stage.zero_offset", "mount.tilt", "stage.eccentricity", "timing.row_skew", "detector.dead_pixels")


def told(columns, names):
    effects = [library()[name] for name in names]
    search = Search(columns, effects)
    return Decision(search, search.run(), effects).run()[0]


def test_a_stage_several_degrees_off_is_that_and_no_tilt_of_the_mount():
    findings = told(table(turn_deg=4.7, angles=11, pixels=36), GEOMETRY)
    assert [f.effect for f in findings] == ["stage.zero_offset"]
    zero = findings[0].parameters[0]
    assert zero.value == pytest.approx(4.7, abs=0.05)


def test_a_mount_several_degrees_off_in_pitch_and_roll_is_found():
    findings = told(table(tilt_deg=(0.0, 5.5, -3.0), angles=11, pixels=40), GEOMETRY)
    assert [f.effect for f in findings] == ["mount.tilt"]
    values = {p.name: p.value for p in findings[0].parameters}
    assert abs(values["pitch"]) == pytest.approx(5.5, abs=0.15)
    assert abs(values["roll"]) == pytest.approx(3.0, abs=0.3)


def smeared(depth):
    """Every fourth pixel of an image through a smear on the window, thick in its middle."""
    columns = table(angles=4, pixels=200)
    u, v = columns.numbers["pixel_u"], columns.numbers["pixel_v"]
    thick = np.exp(-((u - 70.0) ** 2) / 200.0 - (v - 13.0) ** 2 / 40.0)
    columns.numbers[LIGHT] = columns.numbers[LIGHT] * np.exp(-depth * thick)
    return columns


def test_a_thick_smear_is_dirt_and_no_field_of_dead_pixels():
    findings = told(smeared(2.5), ("optics.window_contamination", "detector.dead_pixels", "detector.pixel_response"))
    assert "detector.dead_pixels" not in {f.effect for f in findings}
    assert findings[0].effect == "optics.window_contamination"


def test_pixels_that_are_dark_are_dead():
    columns = table(angles=6, pixels=200)
    pixel = columns.numbers["pixel_u"] * 100.0 + columns.numbers["pixel_v"]
    dead = np.isin(pixel, np.unique(pixel)[::40])
    columns.numbers[LIGHT] = np.where(dead, 0.02 * columns.numbers[LIGHT], columns.numbers[LIGHT])
    findings = told(columns, ("optics.window_contamination", "detector.dead_pixels", "detector.pixel_response"))
    assert [f.effect for f in findings] == ["detector.dead_pixels"]


def rail_and_walk(seed=4):
    """A threshold crossed by a pulse of two exponentials, metres late on weak echoes, and a rail in the gain."""
    rng = np.random.default_rng(seed)
    step, board = (x.ravel() for x in np.meshgrid(np.arange(12), np.arange(80), indexing="ij"))
    true_m = np.random.default_rng(1).uniform(1.0, 20.0, 80)[board]
    light = 2.0e4 * np.random.default_rng(2).choice([0.1, 0.3, 0.6, 0.9], 80)[board] / true_m**2
    rail = 5.0 + rng.normal(0.0, 0.04, step.size)
    noise, blur = np.sqrt(25.0 + light), np.full(step.size, 0.01)
    seen = light * (1.0 + 0.5 * (rail / 5.0 - 1.0))
    time = np.linspace(0.0, 12.0, 4000)  # ns
    pulse = np.exp(-time / 6.0) - np.exp(-time / 2.5)
    pulse, rise = pulse / pulse.max(), slice(0, int(np.argmax(pulse)) + 1)
    late_m = 0.1499 * np.interp(12.0 / np.maximum(seen, 13.0), pulse[rise], time[rise])
    numbers = {
        "step": step, "time_s": 900.0 * step + board, "rail_5v0_v": rail, "true_range_m": true_m,
        "n_frames": np.full(step.size, 10.0), f"sim_{LIGHT}": light, f"sim_{LIGHT}_std": noise,
        f"sim_{RANGE}": true_m, f"sim_{RANGE}_std": blur,
        LIGHT: seen + rng.normal(0.0, noise / np.sqrt(10.0)),
        RANGE: true_m + 8.0 * late_m + rng.normal(0.0, blur / np.sqrt(10.0)),
    }  # fmt: skip
    numbers = {name: np.asarray(values, dtype=float) for name, values in numbers.items()}
    return Columns(n=step.size, numbers=numbers, categories={}, channels=find_channels(set(numbers)))


def test_a_faint_effect_beside_a_huge_one_in_another_channel_is_not_crowded_out():
    names = ("timing.range_walk", "electronics.rail_coupling", "detector.compression", "detector.dark_offset",
             "detector.pile_up", "timing.clock_scale", "air.multipath", "target.reflectance_error")  # fmt: skip
    findings = told(rail_and_walk(), names)
    assert {f.effect for f in findings} == {"timing.range_walk", "electronics.rail_coupling"}


def slow_quartz_and_skew(seed=8):
    """A counter whose quartz is 0.5 % slow; its stop signal reaches each image column 55 fs after the one before.

    Edges are counted and interpolated, as the counter sees them.
    """
    rng = np.random.default_rng(seed)
    step, pixel = (x.ravel() for x in np.meshgrid(np.arange(4), np.arange(900), indexing="ij"))
    u, v = np.random.default_rng(1).integers(0, 96, 900)[pixel], np.random.default_rng(2).integers(0, 24, 900)[pixel]
    true_m = np.random.default_rng(3).uniform(0.8, 3.0, (4, 900))[step, pixel]
    flight_s = true_m / 149_896_229.0 + 5.5e-14 * u
    period_s = 2e-9 / 0.995  # taken for 2 ns
    edges, rest = np.divmod(flight_s, period_s)
    blur = np.full(step.size, 0.006)
    numbers = {
        "step": step, "time_s": 600.0 * step, "pixel_u": u, "pixel_v": v, "n_frames": np.full(step.size, 10.0),
        f"sim_{RANGE}": true_m, f"sim_{RANGE}_std": blur,
        RANGE: 149_896_229.0 * (edges + rest / period_s) * 2e-9 + rng.normal(0.0, blur / np.sqrt(10.0)),
    }  # fmt: skip
    numbers = {name: np.asarray(values, dtype=float) for name, values in numbers.items()}
    return Columns(n=step.size, numbers=numbers, categories={}, channels=find_channels(set(numbers)))


def test_a_faint_skew_stands_beside_a_huge_error_that_is_a_plain_number():
    names = ("timing.clock_scale", "timing.row_skew", "timing.tdc_nonlinearity", "readout.column_pattern")
    findings = told(slow_quartz_and_skew(), names)
    assert [f.effect for f in findings] == ["timing.clock_scale", "timing.row_skew"]
    skew = next(p for p in findings[1].parameters if p.name == "per_column")
    assert skew.low < 149_896_229.0 * 5.5e-14 * 0.995 < skew.high


def test_a_column_that_is_empty_where_a_channel_has_rows_stops_no_law():
    columns = table(angles=21, pixels=24)
    far = columns.numbers[RANGE]
    half = columns.numbers["stage_angle_deg"] > 0.0
    columns.numbers["humidity_pct"] = np.where(half, 40.0 + columns.numbers["stage_angle_deg"], np.nan)
    columns.numbers[RANGE] = np.where(half, np.nan, far + 0.03 * np.sin(columns.numbers["time_s"] / 90.0))
    findings = told(columns, GEOMETRY[3:])
    assert [f.effect for f in findings] == ["unknown"]
