"""Edges of a scan that names no surfaces: they lie where the simulated range jumps from one ray to the next."""

import numpy as np
import pyarrow as pa

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.effects_surface import borders
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of
from arl_fixtures.reconcile.view import View

BOARDS = (
    (-40.0, 5.3, 5.0, 0.5), (-22.0, 1.3, 8.0, 0.2), (-5.0, 6.1, 6.5, 0.4), (11.0, 2.2, 3.5, 0.6),
    (31.0, 3.7, 9.0, 0.3),
)  # fmt: skip


def hall(azimuth):
    """Range and light of single rays: five boards before a wall."""
    far, light = np.full(azimuth.shape, 14.0), np.full(azimuth.shape, 0.25)
    for centre, wide, near, grey in BOARDS:
        on = np.abs(azimuth - centre) < 0.5 * wide
        far, light = np.where(on, near, far), np.where(on, grey, light)
    return far, 1e5 * light / far**2


def scan(seed, footprint_deg):
    """Six turns of a scanner whose beam has a width, which the simulation's rays have not."""
    rng = np.random.default_rng(seed)
    turn, ray = (a.ravel() for a in np.meshgrid(np.arange(6), np.arange(440), indexing="ij"))
    azimuth = -50.0 + 0.23 * ray
    place = np.linspace(-2.5, 2.5, 61)[:, None]
    far, light = hall(azimuth + footprint_deg * place)
    light = light * np.exp(-0.5 * place**2) / np.exp(-0.5 * place**2).sum()
    seen, centre = (light * far).sum(axis=0) / light.sum(axis=0), hall(azimuth)
    off = 0.12 / footprint_deg * place  # the mirror shakes by half a ray, which the simulation states
    shaken = np.stack(hall(azimuth + footprint_deg * off)).std(axis=1)
    sigma, spread = np.hypot(0.01, 0.6 * shaken[0]), np.hypot(10.0, 0.6 * shaken[1])
    return columns_of(pa.table({
        "step": turn, "azimuth_deg": azimuth, "set_temperature_c": 20.0 + turn, "n_frames": np.full(turn.size, 20),
        "sim_distance_m": centre[0], "sim_distance_m_std": sigma,
        "distance_m": seen + sigma / np.sqrt(20.0) * rng.normal(size=turn.size),
        "sim_intensity_counts": centre[1], "sim_intensity_counts_std": spread,
        "intensity_counts": light.sum(axis=0) + spread / np.sqrt(20.0) * rng.normal(size=turn.size),
    }))  # fmt: skip


def test_a_beam_wider_than_a_ray_mixes_what_lies_on_both_sides_of_a_jump():
    known = [library()[name] for name in ("target.edge_mixing", "mount.tilt", "timing.clock_scale")]
    findings = diagnose(scan(3, 0.1), effects=known)[0].findings
    assert findings[0].effect == "target.edge_mixing"
    assert findings[0].drivers == ["azimuth_deg", "sim_distance_m"]


def test_an_edge_is_one_whichever_rows_are_looked_at():
    """Rays along a floor that end farther and farther, by a fiftieth each, and a kerb of a fifth near the scanner."""
    ray = np.arange(200)
    far = 1.5 * np.exp(0.02 * ray) * np.where(ray < 20, 0.8, 1.0)
    columns = columns_of(pa.table({
        "step": np.zeros(200), "azimuth_deg": 0.5 * ray, "distance_m": far, "sim_distance_m": far,
    }))  # fmt: skip
    whole, near = View(columns), View(columns, np.arange(40))
    np.testing.assert_array_equal(borders(near), borders(whole)[:40])
