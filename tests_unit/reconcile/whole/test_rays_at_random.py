"""Rays drawn at random from an image, none of which sees two surfaces: planes, not curves, tell what is beside."""

import numpy as np
import pyarrow as pa
import pytest

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of

KNOWN = [
    library()[name]
    for name in (
        "stage.zero_offset", "stage.periodic_error", "mount.tilt", "optics.focal_drift", "beam.profile_change",
        "timing.tdc_nonlinearity", "stage.eccentricity",
    )
]  # fmt: skip
PITCH_DEG = 0.5


def unit(angle_deg):
    return np.array([np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg)), 0.0])


SURFACES = (
    # normal away from the sensor, distance in m, paint, bearings and elevations in degrees where it stands in front
    ("board", unit(35.0), 1.1, 0.8, (2.0, 60.0), (1.5, 90.0)),
    ("door", unit(-20.0), 1.3, 0.2, (-60.0, -4.0), (-1.0, 90.0)),
    ("floor", np.array([0.0, 0.0, -1.0]), 0.16, 0.4, (-180.0, 180.0), (-90.0, -4.5)),
    ("wall", unit(0.0), 1.7, 0.5, (-180.0, 180.0), (-90.0, 90.0)),
)
SURFACES_DISTANCE = np.array([s[2] for s in SURFACES])


def look(bearing, elevation):
    """Range, light and surface of rays."""
    az, el = np.radians(bearing), np.radians(elevation)
    ray = np.stack([np.cos(el) * np.cos(az), np.cos(el) * np.sin(az), np.sin(el)], axis=-1)
    far, light, which = np.zeros(bearing.shape), np.zeros(bearing.shape), np.full(bearing.shape, -1)
    for number, (_, normal, distance, paint, across, along) in enumerate(SURFACES):
        inside = (bearing > across[0]) & (bearing < across[1]) & (elevation > along[0]) & (elevation < along[1])
        facing = ray @ normal
        new = (which < 0) & inside & (facing > 0.05)
        far[new] = (distance / facing)[new]
        light[new] = (2000.0 * paint * facing**3 / distance**2)[new]
        which[new] = number
    return far, light, which


def seen(bearing, elevation):
    """What a pixel makes of nine rays over its area; and whether all of them end on one surface."""
    off = np.array([(a, b) for a in (-1.0, 0.0, 1.0) for b in (-1.0, 0.0, 1.0)]) * PITCH_DEG / 3.0
    far, light, which = look(bearing[:, None] + off[:, 0], elevation[:, None] + off[:, 1])
    return (far * light).sum(axis=1) / light.sum(axis=1), light.mean(axis=1), np.ptp(which, axis=1) == 0, which[:, 4]


def bench(seed, error, rows=3000):
    """Rows of a turning camera whose stage stands off by `error`(angle, way), in degrees."""
    rng = np.random.default_rng(seed)
    u, v, step = rng.integers(0, 64, rows), rng.integers(0, 32, rows), rng.integers(0, 6, rows)
    stage, way = rng.integers(-20, 21, rows) * 1.0, np.where(step % 2 == 0, 1.0, -1.0)
    az, el = (u - 31.5) * PITCH_DEG, (v - 15.5) * PITCH_DEG
    far, light, one, which = seen(az + stage, el)
    met = np.degrees(np.arccos(np.clip(SURFACES_DISTANCE[which] / far, -1.0, 1.0)))
    far_off, light_off, _, _ = seen(az + stage + error(stage, way), el)
    made = {
        "step": step, "stage_angle_deg": stage, "travel_direction": way, "pixel_u": u, "pixel_v": v,
        "azimuth_deg": az, "elevation_deg": el, "n_frames": np.full(rows, 25), "incidence_deg": met,
        "housing_temperature_c": 15.0 + 7.0 * step, "surface": np.array([s[0] for s in SURFACES])[which],
        "mixed": np.full(rows, "false"),
        "sim_distance_m": far, "sim_distance_m_std": np.full(rows, 0.004), "sim_intensity_counts": light,
        "sim_intensity_counts_std": 0.02 * light, "sim_intensity_counts_repeat_std": 0.002 * light,
        "distance_m": far_off + 0.0008 * rng.normal(size=rows),
        "intensity_counts": light_off * (1.0 + 0.002 * rng.normal(size=6)[step] + 0.004 * rng.normal(size=rows)),
    }  # fmt: skip
    return columns_of(pa.table({name: values[one] for name, values in made.items()}))


@pytest.mark.parametrize("seed", [1, 2])
def test_a_stage_off_by_a_constant_and_by_its_way_is_one_finding(seed):
    (found,) = diagnose(bench(seed, lambda _stage, way: 0.2 + 0.12 * way), effects=KNOWN)[0].findings
    assert found.effect == "stage.zero_offset"
    told = {p.name: p for p in found.parameters}
    assert told["zero"].low < 0.2 < told["zero"].high
    assert told["backlash"].low < 0.24 < told["backlash"].high


def test_a_screw_shows_in_rays_that_no_curve_joins():
    off = diagnose(bench(3, lambda stage, _way: 0.2 * np.sin(np.radians(24.0 * stage))), effects=KNOWN)[0].findings
    assert [f.effect for f in off] == ["stage.periodic_error"]
    assert abs(next(p for p in off[0].parameters if p.name == "period").value - 15.0) < 0.3
