"""A scanner without pixels on a stage that goes up and comes back: what a ray saw before is told by its direction."""

import numpy as np
import pytest

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.columns import Columns, find_channels
from arl_fixtures.reconcile.reconcile import diagnose

NAMES = ("acquisition.frame_lag", "stage.zero_offset", "timing.clock_scale", "timing.thermal_lag")
LIGHT, RANGE = "intensity_counts", "distance_m"
WALLS = ((0, 1.0, 3.6, 0.6), (0, -1.0, 4.4, 0.3), (1, 1.0, 2.2, 0.7), (1, -1.0, 2.9, 0.45))
"""Axis, side, distance in metres, reflectance."""


def seen(azimuth, elevation, stage):
    """Range in metres and light of rays in a room of four walls, angles in degrees."""
    bearing, el = np.radians(azimuth + stage), np.radians(elevation)
    ray = np.stack([np.cos(el) * np.cos(bearing), np.cos(el) * np.sin(bearing)])
    with np.errstate(divide="ignore"):
        far = np.stack(
            [np.where(side * ray[axis] > 1e-9, at / (side * ray[axis]), np.inf) for axis, side, at, _ in WALLS]
        )
    wall = np.argmin(far, axis=0)
    range_m = np.min(far, axis=0)
    cosine = np.abs(np.where(wall < 2, ray[0], ray[1]))
    return range_m, 6000.0 * np.array([w[3] for w in WALLS])[wall] * cosine / range_m**2


def swept_room(*, late, seed=3, frames=5):
    """Stops numbered as steps, no times; the first frames show a stage that still comes from the stop before."""
    rng = np.random.default_rng(seed)
    back, place, line, beam = (
        a.ravel() for a in np.meshgrid(np.arange(2), np.arange(21), np.arange(4), np.arange(9), indexing="ij")
    )
    stage, azimuth, elevation = 2.0 * place - 20.0, 15.0 * beam - 60.0, 4.0 * line - 6.0
    before = np.clip(stage - np.where(back == 1, -2.0, 2.0), -20.0, 20.0)
    far, light = seen(azimuth, elevation, stage)
    shown = [seen(azimuth, elevation, stage + late * np.exp(-k / 1.2) * (before - stage)) for k in range(frames)]
    blur, error = 0.006 + 0.0 * far, np.sqrt(16.0 + 0.5 * light)
    numbers = {
        "stage_angle_deg": stage, "azimuth_deg": azimuth, "elevation_deg": elevation, "ramp": 1.0 - 2.0 * back,
        "step": 21.0 * back + place, "n_frames": np.full(far.size, float(frames)),
        "housing_temperature_c": rng.uniform(22.0, 28.0, 42)[21 * back + place],
        f"sim_{RANGE}": far, f"sim_{RANGE}_std": blur, f"sim_{LIGHT}": light, f"sim_{LIGHT}_std": error,
        RANGE: np.mean([r for r, _ in shown], axis=0) + blur / np.sqrt(frames) * rng.normal(size=far.size),
        LIGHT: np.mean([i for _, i in shown], axis=0) + error / np.sqrt(frames) * rng.normal(size=far.size),
    }  # fmt: skip
    kept = rng.random(far.size) > 0.1
    numbers = {name: np.asarray(values, dtype=float)[kept] for name, values in numbers.items()}
    return Columns(n=int(kept.sum()), numbers=numbers, categories={}, channels=find_channels(set(numbers)))


@pytest.mark.parametrize("late", [0.12, 0.0])
def test_a_lag_of_a_scanner_turns_round_where_the_stage_comes_back(late):
    findings = diagnose(swept_room(late=late), effects=[library()[name] for name in NAMES])[0].findings
    assert [f.effect for f in findings] == (["acquisition.frame_lag"] if late else [])


def test_what_a_ray_saw_before_lies_on_the_way_that_the_stage_came():
    columns = swept_room(late=0.0)
    order, angle = columns.sweep_order, columns.numbers["stage_angle_deg"]
    cell = columns.group(*columns.sweep_columns, *columns.ray_columns)
    place = columns.following(("before",), cell, order, -1)
    there = place >= 0
    assert there.mean() > 0.9
    for name in ("azimuth_deg", "elevation_deg", "ramp"):
        assert np.array_equal(columns.numbers[name][place[there]], columns.numbers[name][there])
    came = (angle[there] - angle[place[there]]) * columns.numbers["ramp"][there]
    assert np.all(came > 0.0)
