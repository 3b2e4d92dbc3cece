"""A phase camera before a corner whose walls go on beyond its image: they light what it sees."""

import numpy as np
import pyarrow as pa

from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of

COLUMNS, ROWS, PITCH_DEG, AMBIGUITY_M = 20, 14, 1.8, 7.5
LONG_M, HIGH_M, WHITE = 2.2, 2.4, (0.35, 0.3)


def walls(edge, turn):
    """Both walls of a right angle that opens towards the camera: directions away from the edge."""
    c, s = np.cos(turn), np.sin(turn)
    left = np.array([-np.cos(np.pi / 4), 0.0, -np.sin(np.pi / 4)])
    right = np.array([np.cos(np.pi / 4), 0.0, -np.sin(np.pi / 4)])
    rotate = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    return np.asarray(edge), (rotate @ left, rotate @ right)


def seen(edge, along):
    """Which wall each pixel sees, where, and the cosine there; a wall's normal is the other's direction."""
    v, u = (x.ravel() for x in np.mgrid[0:ROWS, 0:COLUMNS])
    x, y = (np.tan(np.radians(PITCH_DEG * a)) for a in (u - 0.5 * (COLUMNS - 1), v - 0.5 * (ROWS - 1)))
    ray = np.stack([x, y, np.ones(x.size)], axis=1)
    ray /= np.linalg.norm(ray, axis=1)[:, None]
    far = np.stack([(edge @ along[1 - k]) / (ray @ along[1 - k]) for k in (0, 1)], axis=1)
    far[far <= 0.0] = np.inf
    wall = np.argmin(far, axis=1)
    point = ray * far.min(axis=1)[:, None]
    return u, v, wall, point, np.array([-ray[i] @ along[1 - w] for i, w in enumerate(wall)])


def bounced(edge, along, wall, point, rng):
    """Phasors of the light that comes by the other wall, of its points drawn at random."""
    turn = 2.0 * np.pi / AMBIGUITY_M
    total = np.zeros(len(wall), dtype=complex)
    for k in (0, 1):
        here = np.flatnonzero(wall == 1 - k)
        from_edge = np.stack([rng.uniform(0.0, LONG_M, 6000), rng.uniform(-0.5, 0.5, 6000) * HIGH_M], axis=1)
        lamp = edge + from_edge[:, :1] * along[k] + from_edge[:, 1:] * np.array([0.0, 1.0, 0.0])
        away = np.linalg.norm(lamp, axis=1)
        lit = WHITE[k] / np.pi * np.maximum(-(lamp @ along[1 - k]) / away, 0.0) / away**2
        for i in here:
            across = point[i] - lamp
            apart = np.hypot(np.linalg.norm(across, axis=1), 0.01)
            cosines = np.maximum(across @ along[1 - k], 0.0) * np.maximum(-across @ along[k], 0.0) / apart**2
            weight = lit * cosines / apart**2 * LONG_M * HIGH_M / 6000.0
            way = 0.5 * (away + apart + np.linalg.norm(point[i]))
            total[i] = np.sum(weight * np.exp(1j * turn * way))
    return total


def corner_table(seed):
    rng = np.random.default_rng(seed)
    rows = []
    poses = [(0.0, 1.7, 0.0), (0.3, 2.2, 0.1), (-0.3, 1.5, -0.2), (0.1, 2.6, 0.15)]
    for pose, (aside, far, turn) in enumerate(poses):
        edge, along = walls((aside, 0.0, far), turn)
        u, v, wall, point, cosine = seen(edge, along)
        range_m, white = np.linalg.norm(point, axis=1), np.array(WHITE)[wall]
        direct = white * cosine / range_m**2 * np.exp(2j * np.pi * range_m / AMBIGUITY_M)
        whole = direct + white * bounced(edge, along, wall, point, rng)
        light = 4e3 * np.abs(direct)
        sigma, sigma_m = np.sqrt(light + 50.0), 0.35 / np.sqrt(light)
        measured = np.angle(whole / direct) * AMBIGUITY_M / (2.0 * np.pi) + range_m
        rows.append({
            "pose": np.full(u.size, pose), "pixel_u": u, "pixel_v": v, "n_frames": np.full(u.size, 8),
            "surface": np.array(["left wall", "right wall"])[wall], "sim_distance_m": range_m,
            "sim_distance_m_std": sigma_m, "sim_intensity_counts": light, "sim_intensity_counts_std": sigma,
            "distance_m": measured + sigma_m / np.sqrt(8.0) * rng.normal(size=u.size),
            "intensity_counts": 4e3 * np.abs(whole) + sigma / np.sqrt(8.0) * rng.normal(size=u.size),
        })  # fmt: skip
    return columns_of(pa.table({name: np.concatenate([r[name] for r in rows]) for name in rows[0]}))


def test_light_by_a_wall_that_goes_on_beyond_the_image_is_multipath():
    found = diagnose(corner_table(4))[0].findings
    assert found[0].effect == "air.multipath"
    assert set(found[0].channels) == {"distance_m", "intensity_counts"}
