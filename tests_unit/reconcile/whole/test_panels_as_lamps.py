"""Panels of the bench that shine to all sides, summed point by point: their light takes a longer way."""

import numpy as np
from traced_bench import BOARDS, LIGHT, RANGE, STRIPES, table

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.reconcile import diagnose

KNOWN = [library()[name] for name in ("air.multipath", "target.reflectance_error", "detector.compression",
         "target.non_lambertian", "optics.veiling_glare", "timing.range_walk")]  # fmt: skip
SENSOR = np.array([0.0, 0.0, 0.10])
DOTTED = 0.05 + 25 * 0.8 * np.pi * 0.035**2 / 0.56**2
PANELS = [*((a, 0.135, 0.80, paint) for a, paint in STRIPES), *((a, 0.56, 0.56, DOTTED) for a in BOARDS)]


def by_all_points(place, own, far, turn=0.0):
    """Light that panels send to places in the room, point by point, its whole way, and its phasor.

    Args:
        place: (n, 3), metres; own: panel on which each lies, -1 for none; far: distance of each from the sensor.
        turn: phase of a metre of one-way path, radians.
    """
    light, way, phasor = np.zeros(len(place)), np.zeros(len(place)), np.zeros(len(place), dtype=complex)
    for k, (azimuth, width, height, paint) in enumerate(PANELS):
        angle = np.radians(azimuth)
        across, up = (x.ravel() for x in np.meshgrid(np.linspace(-0.5, 0.5, 9), np.linspace(-0.5, 0.5, 15)))
        ahead, aside = np.array([np.cos(angle), np.sin(angle), 0.0]), np.array([-np.sin(angle), np.cos(angle), 0.0])
        points = 1.1 * ahead + width * across[:, None] * aside + height * up[:, None] * np.eye(3)[2]
        apart = np.linalg.norm(place[:, None] - points, axis=2)
        there = np.linalg.norm(points - SENSOR, axis=1)
        part = paint * width * height / across.size / (np.pi * apart**2 + 0.02) * (own != k)[:, None]
        light += part.sum(axis=1)
        way += (part * (there + apart)).sum(axis=1)
        phasor += (part * np.exp(0.5j * turn * (there + apart - far[:, None]))).sum(axis=1)
    return light, way / np.maximum(light, 1e-12), phasor


def lit_by_panels(seed, share, ambiguity=0.0):
    columns = table(seed=seed, noise=False, angles=15)
    numbers, rng = columns.numbers, np.random.default_rng(seed)
    bearing = -np.radians(numbers["azimuth_deg"] + numbers["stage_angle_deg"])  # to the left, from the arc's middle
    far, up = numbers[f"sim_{RANGE}"], np.radians(numbers["elevation_deg"])
    level = far * np.cos(up)
    place = np.stack([level * np.cos(bearing), level * np.sin(bearing), 0.10 + far * np.sin(up)], axis=1)
    off = np.abs(np.degrees(bearing)[:, None] - np.array([azimuth for azimuth, *_ in PANELS]))
    own = np.where(level > 1.4, -1, np.argmin(off, axis=1))
    turn = 2.0 * np.pi / ambiguity if ambiguity else 0.0
    light, way, phasor = by_all_points(place, own, far, turn)
    part, seen = share * light / light.mean(), 1.0 + share * phasor / light.mean()
    noise = rng.normal(size=(2, columns.n)) / np.sqrt(10.0)
    numbers[LIGHT] = numbers[f"sim_{LIGHT}"] * np.abs(seen) + numbers[f"sim_{LIGHT}_std"] * noise[0]
    moved = np.angle(seen) / turn if ambiguity else part / (1.0 + part) * (0.5 * (way + far) - far)
    numbers[RANGE] = far + moved + numbers[f"sim_{RANGE}_std"] * noise[1]
    return columns


def test_panels_that_light_each_other_from_all_sides_are_named():
    found = diagnose(lit_by_panels(4, 0.01), effects=KNOWN)[0].findings
    assert [f.effect for f in found] == ["air.multipath"]


def test_panels_that_light_each_other_before_a_camera_that_measures_phases_are_named():
    found = diagnose(lit_by_panels(4, 0.03, ambiguity=2.0), effects=KNOWN)[0].findings
    assert [f.effect for f in found] == ["air.multipath"]
    assert found[0].held_out.explained > 0.97
    values = {p.name: p.value for p in found[0].parameters}
    assert 1.5 < values["ambiguity"] < 2.5  # the phases of the lamps differ among each other
