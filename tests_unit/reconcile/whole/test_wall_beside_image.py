"""A camera that looks at a board on a rail past a bright wall: two bounces summed over the wall's patches."""

import numpy as np
import pytest

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.columns import Columns, find_channels
from arl_fixtures.reconcile.search import Search

LIGHT, RANGE = "intensity_counts", "distance_m"
NAMES = ("air.multipath", "timing.row_skew", "timing.clock_scale", "timing.range_walk", "readout.column_pattern")


def bounced(place, walls, reflectance=0.6):
    """Light over the board's own, and mean extra one-way path, by way of walls upright at x = ±1.2 m."""
    depth, up = (a.ravel() for a in np.meshgrid(np.arange(0.3, 5.0, 0.1), np.arange(-0.9, 0.91, 0.15)))
    total, moment = np.zeros(len(place)), np.zeros(len(place))
    away = np.linalg.norm(place, axis=1)
    for side in walls:
        patch = np.column_stack([np.full(depth.size, 1.2 * side), up, depth])
        far = np.linalg.norm(patch, axis=1)
        seen = np.abs(patch[:, 0]) / patch[:, 2] < np.tan(np.radians(40.0))
        lit = seen * reflectance * 0.015 * (1.2 / far) / far**2
        way = place[:, None, :] - patch[None]
        length = np.linalg.norm(way, axis=2)
        in_front = depth[None, :] < place[:, 2:] - 0.02
        swap = lit * np.maximum(-side * way[:, :, 0], 0.0) * np.maximum(way[:, :, 2], 0.0) / length**4 / np.pi
        swap = np.where(in_front, swap, 0.0)
        total += swap.sum(axis=1)
        moment += np.sum(swap * 0.5 * (far + length - away[:, None]), axis=1)
    direct = place[:, 2] / away**3
    return total / direct, moment / np.maximum(total, 1e-12)


def camera(walls, *, share=1.0, skew_m=0.0, seed=2):
    rng = np.random.default_rng(seed)
    stop, v, u = (a.ravel() for a in np.meshgrid(np.arange(11), np.arange(12.0), np.arange(16.0), indexing="ij"))
    depth = np.linspace(1.0, 4.6, 11)[stop]
    place = depth[:, None] * np.column_stack([(u - 7.5) / 16.0, (v - 5.5) / 16.0, np.ones(u.size)])
    far = np.linalg.norm(place, axis=1)
    rho = np.where((u // 4 + v // 4) % 2 == 0, 0.8, 0.3)
    sim = 6000.0 * rho * depth / far**3
    k, longer = bounced(place, walls)
    k = share * k
    error, blur = np.sqrt(25.0 + sim), np.full(u.size, 0.006)
    numbers = {
        "distance_stop": stop, "pixel_u": u, "pixel_v": v, "true_range_m": far, "n_frames": np.full(u.size, 20.0),
        f"sim_{LIGHT}": sim, f"sim_{LIGHT}_std": error, f"sim_{RANGE}": far, f"sim_{RANGE}_std": blur,
        LIGHT: sim * (1.0 + k) + rng.normal(0.0, error / np.sqrt(20.0)),
        RANGE: far + k / (1.0 + k) * longer + skew_m * (v - 5.5) + rng.normal(0.0, blur / np.sqrt(20.0)),
    }  # fmt: skip
    numbers = {name: np.asarray(values, dtype=float) for name, values in numbers.items()}
    return Columns(n=u.size, numbers=numbers, categories={}, channels=find_channels(set(numbers)))


def named(columns):
    found = Search(columns, [library()[name] for name in NAMES]).run()
    return {term.effect.id: term for term in found.best.terms}


@pytest.mark.parametrize("walls", [(1.0,), (-1.0, 1.0)])
def test_a_wall_beside_the_image_is_the_only_name(walls):
    terms = named(camera(walls, share=0.08))
    assert set(terms) == {"air.multipath"}
    lean = abs(terms["air.multipath"].values["across"])  # a patch near a wall faces it less
    assert lean > 0.2 if len(walls) == 1 else lean < 0.05


def test_a_skew_of_the_rows_is_no_wall():
    assert set(named(camera((), skew_m=3e-4))) == {"timing.row_skew"}


def test_without_a_wall_nothing_is_named():
    assert not named(camera(()))
