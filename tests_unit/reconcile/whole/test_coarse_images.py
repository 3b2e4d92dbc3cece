"""Few wide pixels before panels, and few stops of the stage: what moves the rays shows in what pixels mix."""

import numpy as np
import pyarrow as pa
import pytest

from arl_fixtures.reconcile.effects_image_borders import borders_in_images
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of
from arl_fixtures.reconcile.view import View

COLUMNS, ROWS, PITCH_DEG, SUB = 12, 10, 4.5, 60
WALL = (6.5, 0.35)
PANELS = [
    (-27.0, -13.0, -8.0, 9.0, 4.5, 0.85), (-4.0, 7.0, -12.0, 6.0, 3.6, 0.15), (16.0, 29.0, -6.0, 11.0, 5.0, 0.6),
]  # fmt: skip
"""Bearing and height of a panel's sides, degrees; its range in metres; what it reflects."""
TEMPERATURES = [0.0, 12.0, 25.0, 38.0, 52.0, 66.0, 78.0]


def image(stage_deg, stretch):
    """What each pixel sees by 3600 rays over its area: light, range by light, and the surface at its centre."""
    u, v = (x.ravel() for x in np.meshgrid(np.arange(COLUMNS), np.arange(ROWS)))
    offset = (np.arange(SUB) + 0.5) / SUB - 0.5
    sub_u, sub_v = (x.ravel() for x in np.meshgrid(offset, offset))
    focal = 1.0 / np.tan(np.radians(PITCH_DEG))
    x = (u[:, None] + np.append(sub_u, 0.0) - 0.5 * (COLUMNS - 1)) / (focal * stretch)
    y = (v[:, None] + np.append(sub_v, 0.0) - 0.5 * (ROWS - 1)) / (focal * stretch)
    azimuth, height = np.degrees(np.arctan(x)) + stage_deg, np.degrees(np.arctan(y))
    surface = np.zeros(azimuth.shape, dtype=int)
    for number, (left, right, low, high, *_) in enumerate(PANELS, start=1):
        surface[(azimuth > left) & (azimuth < right) & (height > low) & (height < high)] = number
    plane = np.array([WALL[0], *(panel[4] for panel in PANELS)])[surface]
    far = plane * np.sqrt(1.0 + x**2 + y**2)
    light = 2500.0 * np.array([WALL[1], *(panel[5] for panel in PANELS)])[surface] / far**2
    seen = light[:, :-1].mean(axis=1)
    return {
        "pixel_u": u.astype(float), "pixel_v": v.astype(float), "light": seen,
        "range": (light * far)[:, :-1].mean(axis=1) / seen, "surface": surface[:, -1],
        "mixed": (surface != surface[:, :1]).any(axis=1),
        "azimuth_deg": np.degrees(np.arctan(x[:, -1])), "elevation_deg": np.degrees(np.arctan(y[:, -1])),
    }  # fmt: skip


def drifting(drift, seed):
    """Two stops of the stage at each temperature of a housing that stretches its lens by `drift` per kelvin."""
    rng, parts = np.random.default_rng(seed), []
    for step, warm in enumerate(TEMPERATURES):
        for angle in (-9.0, 11.0):
            nominal, real = image(angle, 1.0), image(angle, 1.0 + drift * (warm - 25.0))
            size, mixed = nominal["light"].size, nominal["mixed"]
            noise = 0.005 + 0.03 * mixed  # what sees two surfaces ranges them by chance
            parts.append({
                **{k: nominal[k] for k in ("pixel_u", "pixel_v", "azimuth_deg", "elevation_deg")},
                "mixed": mixed, "surface": np.array(["wall", "bright", "dark", "grey"])[nominal["surface"]],
                "step": np.full(size, step), "stage_angle_deg": np.full(size, angle),
                "housing_temperature_c": np.full(size, warm), "n_frames": np.full(size, 8.0),
                "sim_intensity_counts": nominal["light"], "sim_distance_m": nominal["range"],
                "intensity_counts": real["light"] * (1.0 + 0.002 * rng.normal()) + 0.7 * rng.normal(size=size),
                "distance_m": real["range"] + noise * rng.normal(size=size),
            })  # fmt: skip
    return columns_of(pa.table({name: np.concatenate([p[name] for p in parts]) for name in parts[0]}))


@pytest.mark.parametrize(("drift", "seed"), [(-1.1e-4, 3), (1.3e-4, 4)])
def test_a_lens_that_stretches_shows_at_the_borders_of_wide_pixels(drift, seed):
    first = diagnose(drifting(drift, seed))[0].findings[0]
    assert first.effect == "optics.focal_drift"
    (said,) = (p.value for p in first.parameters if p.name == "drift")
    assert said == pytest.approx(drift, rel=0.25)


def test_what_lies_pixels_away_is_what_curves_tell():
    """How a pixel is filled tells of what it sees next to it, and not of what lies beyond."""
    view = View(drifting(0.0, 5))
    told = {name: np.full(view.n, 7.0) for name in ("intensity_counts", "distance_m")}
    images = borders_in_images(view)
    near, far = (images.changes(view, turn, 0.0, told) for turn in (0.1 * PITCH_DEG, 1.5 * PITCH_DEG))
    mixed = view.selects("mixed", "true")
    assert np.mean(near["distance_m"][mixed] != 7.0) > 0.7
    assert np.all(near["intensity_counts"][~mixed] == pytest.approx(1.0, abs=0.05))
    assert all(np.allclose(far[name], told[name]) for name in told)
