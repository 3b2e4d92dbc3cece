"""A scanner whose beam is wider than the step from ray to ray, against a simulation of its middle."""

import numpy as np
import pyarrow as pa

from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of

HALF_DEG, PULSE_M = 0.12, 0.4
RANGE_M = np.arange(2.0, 13.0, 0.05)


def scene(bearing_deg):
    """Range, light and surface of a facade with posts and boards before it."""
    facade = 9.0 / np.cos(np.radians(bearing_deg))
    near, light, name = facade, 6e4 * 0.4 / facade**2, np.zeros(bearing_deg.shape, dtype=int)
    for k, (left, wide, far, white) in enumerate(
        [(-33.0, 1.5, 6.0, 0.2), (-21.0, 7.0, 5.0, 0.7), (-6.0, 1.2, 4.0, 0.5), (4.0, 9.0, 6.5, 0.1),
         (17.0, 1.8, 5.0, 0.3), (26.0, 6.0, 7.0, 0.8)], start=1,
    ):  # fmt: skip
        on = (bearing_deg > left) & (bearing_deg < left + wide)
        near, light, name = np.where(on, far, near), np.where(on, 6e4 * white / far**2, light), np.where(on, k, name)
    return near, light, name


def read(bearing_deg):
    """Echo nearest to what the middle sees, and its peak, of 241 points across the beam."""
    across = np.linspace(-3.0, 3.0, 241) * 0.5 * HALF_DEG
    weight = np.exp(-0.5 * (across / (0.5 * HALF_DEG)) ** 2)
    found = []
    for at in bearing_deg:
        far, light, _ = scene(at + across)
        trace = (weight / weight.sum() * light) @ np.exp(-0.5 * ((RANGE_M - far[:, None]) / PULSE_M) ** 2)
        gate = np.abs(RANGE_M - scene(np.array([at]))[0]) < PULSE_M
        top = int(np.argmax(np.where(gate, trace, -1.0)))
        low, mid, high = trace[top - 1 : top + 2]
        place = np.clip(0.5 * (low - high) / (low - 2.0 * mid + high), -1.0, 1.0)
        found.append((RANGE_M[top] + 0.05 * place, mid))
    return np.array(found).T


def scanner_table(seed):
    rng = np.random.default_rng(seed)
    bearing, rise = rng.uniform(-40.0, 40.0, 3200), np.repeat([-6.0, -2.0, 2.0, 6.0], 800)
    far, light, surface = scene(bearing)
    range_m, counts = read(bearing)
    sigma, sigma_m = np.sqrt(light + 30.0), 0.5 / np.sqrt(light)
    names = np.array(["facade", *(f"board {k}" for k in range(1, 7))])
    return columns_of(pa.table({
        "azimuth_deg": bearing, "elevation_deg": rise, "surface": names[surface], "n_frames": np.full(3200, 3),
        "sim_distance_m": far, "sim_distance_m_std": sigma_m, "sim_intensity_counts": light,
        "sim_intensity_counts_std": sigma,
        "distance_m": range_m + sigma_m / np.sqrt(3.0) * rng.normal(size=3200),
        "intensity_counts": counts + sigma / np.sqrt(3.0) * rng.normal(size=3200),
    }))  # fmt: skip


def test_a_beam_over_borders_is_mixing_and_as_wide_as_it_is():
    (found,) = diagnose(scanner_table(5))[0].findings
    assert found.effect == "target.edge_mixing"
    width = next(p for p in found.parameters if p.name == "width")
    assert 0.4 * HALF_DEG < width.value < 0.7 * HALF_DEG
