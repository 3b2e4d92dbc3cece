"""A sweep in steps of several pixels, its mixed pixels left out: what a displaced sensor sees beside the holes."""

import numpy as np
import pytest
from rendered_bench import make_columns, variant_of

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.view import View

BOARDS = ((-32.0, 2.2, 0.5, 0.60, 0.40), (4.0, 1.5, 0.25, 0.45, 0.72), (24.0, 3.1, 0.65, 0.70, 0.12),
          (-64.0, 1.2, 0.25, 0.40, 0.80), (52.0, 1.5, 0.30, 0.40, 0.05))  # fmt: skip
"""Bearing of the normal in degrees, distance, half width and half height in metres, reflectance."""
WALL_M, WALL = 3.4, 0.25
PITCH, ROW, CLEAR = 1.6, 3.0, 0.7
"""Degrees from pixel to pixel and from row to row, and pixels about a ray that must see one surface."""


def trace(boards, bearing, elevation, along=0.0, across=0.0):
    """Range, light and surface of rays (degrees) from a point in the room (metres): boards before a round wall."""
    b, e = np.radians(bearing), np.radians(elevation)
    far = np.sqrt(WALL_M**2 - (along * np.sin(b) - across * np.cos(b)) ** 2) - along * np.cos(b) - across * np.sin(b)
    level, facing, paint = far, np.ones(b.shape), np.full(b.shape, WALL)
    seen = np.full(b.shape, -1)
    for k, (normal, distance, half, high, white) in enumerate(boards):
        n = np.radians(normal)
        cosine = np.cos(b - n)
        with np.errstate(divide="ignore"):
            reach = (distance - along * np.cos(n) - across * np.sin(n)) / cosine
        x, y, z = along + reach * np.cos(b), across + reach * np.sin(b), reach * np.tan(e)
        hit = (cosine > 0.1) & (np.abs(y * np.cos(n) - x * np.sin(n)) < half) & (np.abs(z) < high) & (reach < level)
        level, seen = np.where(hit, reach, level), np.where(hit, k, seen)
        facing, paint = np.where(hit, cosine, facing), np.where(hit, white, paint)
    return level / np.cos(e), 2000.0 * paint * facing * np.cos(e) ** 3 / level**2, seen


def moved(seed):
    """The boards, each a little elsewhere and of another size."""
    rng = np.random.default_rng(seed)
    span = ((-4.0, 4.0), (0.8, 1.2), (0.7, 1.3), (0.6, 1.2))
    return [(b + turn, d * x, h * y, z * up, white) for b, d, h, z, white in BOARDS
            for turn, x, y, up in [[rng.uniform(*s) for s in span]]]  # fmt: skip


@pytest.mark.parametrize("seed", [0, 2, 4, 10])
@pytest.mark.parametrize(("forward_mm", "right_mm"), [(-1.4, 2.5), (2.0, -2.0)])
def test_no_pixel_beside_a_hole_takes_over_what_its_own_sweep_sees_steps_away(seed, forward_mm, right_mm):
    boards = moved(seed)
    grid = np.meshgrid(np.linspace(-45, 45, 19), np.arange(24), np.arange(8), indexing="ij")
    stage, u, v = (axis.ravel() for axis in grid)
    azimuth, elevation = PITCH * (u - 11.5), -ROW * (v - 3.5)
    far, light, seen = trace(boards, azimuth + stage, elevation)
    sides = [(x * CLEAR * PITCH, y * CLEAR * ROW) for x in (-1.0, 0.0, 1.0) for y in (-1.0, 0.0, 1.0)]
    beam = np.exp(-((azimuth / 75.0) ** 4) - (elevation / 30.0) ** 4)
    mixed = np.any([trace(boards, azimuth + x + stage, elevation + y)[2] != seen for x, y in sides], axis=0)
    numbers = {"stage_angle_deg": stage, "pixel_u": u, "pixel_v": v, "azimuth_deg": azimuth,
               "elevation_deg": elevation, "true_range_m": far, "sim_distance_m": np.where(mixed, np.nan, far),
               "sim_intensity_counts": np.where(mixed, np.nan, beam * light)}  # fmt: skip
    numbers |= {name: numbers[f"sim_{name}"].copy() for name in ("distance_m", "intensity_counts")}
    names = {"surface": [f"s{k + 1}" for k in seen], "mixed": [str(m).lower() for m in mixed]}
    view = View(make_columns(numbers, names, shuffle=None)[0])
    f, r, turned = 1e-3 * forward_mm, 1e-3 * right_mm, np.radians(stage)
    place = (f * np.cos(turned) - r * np.sin(turned), f * np.sin(turned) + r * np.cos(turned))
    real_far, real_light, _ = trace(boards, azimuth + stage, elevation, *place)
    effect, state = library()["stage.eccentricity"], view.fresh_state()
    effect.apply(variant_of(view, effect.id, frame="sensor"), {"forward": f, "right": r}, state, view)
    assert np.count_nonzero(mixed) > 300
    assert np.max(np.abs(state["intensity_counts"] / (beam * real_light) - 1.0)[~mixed]) < 0.01
    assert np.quantile(np.abs(state["distance_m"] - real_far)[~mixed], 0.99) < 0.15 * np.hypot(f, r)
