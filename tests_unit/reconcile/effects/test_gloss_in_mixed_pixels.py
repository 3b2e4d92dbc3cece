"""A glossy wall behind a bright panel: pixels at the panel's edge get the gloss of the wall's light only."""

import numpy as np
import pytest
from rendered_bench import corrected, make_columns, variant_of

from arl_fixtures.reconcile.view import View

LOBE, SHARPNESS = 0.15, 13.0


def scene_at(bearing, wall=0.06):
    """Reflectance, incidence and whether it is the panel, by bearing in degrees: a panel from 2.3 to 9.8."""
    panel = (bearing > 2.3) & (bearing < 9.8)
    return np.where(panel, 0.8, wall), np.where(panel, 25.0 + 0.5 * bearing, 0.3 * np.abs(bearing)), panel


def swept(gloss, *, ranged="by light", wall=0.06):
    """Eight pixels a degree apart at twenty angles; each is the mean of 41 rays over its width.

    The wall is 4 m away and the panel 2.6 m: ranged by the mean of the light, or by what comes first.
    """
    angle, pixel = (a.ravel() for a in np.meshgrid(np.arange(20), np.arange(8), indexing="ij"))
    bearing = (pixel - 3.5) + 0.9 * (angle - 6)
    rays = bearing[:, None] + np.linspace(-0.5, 0.5, 41)
    reflectance, incidence, panel = scene_at(rays, wall)
    lobe = gloss * np.cos(2.0 * np.radians(incidence)) ** SHARPNESS
    of_rays = reflectance * np.cos(np.radians(incidence)) * (1.0 + lobe)
    light, far = 4000.0 * np.mean(of_rays, axis=1), np.where(panel, 2.6, 4.0)
    far = np.sum(of_rays * far, axis=1) / np.sum(of_rays, axis=1) if ranged == "by light" else far.min(axis=1)
    _, middle, centre = scene_at(bearing)
    numbers = {
        "pixel_u": pixel.astype(float), "pixel_v": np.zeros(pixel.size), "azimuth_deg": pixel - 3.5,
        "stage_angle_deg": 0.9 * (angle - 6.0), "incidence_deg": middle, "step": np.zeros(pixel.size),
        "sim_intensity_counts": light, "intensity_counts": light, "sim_distance_m": far, "distance_m": far,
        "true_range_m": np.where(scene_at(bearing)[2], 2.6, 4.0),
    }  # fmt: skip
    shared = panel.any(axis=1) & ~panel.all(axis=1)
    labels = {"surface": np.where(centre, "panel", "wall"), "mixed": np.where(shared, "true", "false")}
    return numbers, labels, shared, light, far


def test_the_gloss_of_a_wall_brightens_a_mixed_pixel_by_the_walls_share_of_its_light():
    numbers, labels, mixed, plain, _ = swept(0.0)
    glossy = swept(LOBE)[3]
    view = View(make_columns(numbers, labels, shuffle=None)[0])
    variant = variant_of(view, "target.non_lambertian", surface="")
    made = corrected(view, variant, lobe=LOBE, sharpness=SHARPNESS)["intensity_counts"]
    pure = ~mixed
    np.testing.assert_allclose(made[pure], glossy[pure], rtol=2e-3)
    assert mixed.sum() >= 10
    # on the wall's side of the edge the middle ray would say 0.13; most of that light is the panel's
    error = np.abs(made - glossy)[mixed] / plain[mixed]
    middle = np.abs(plain * (1.0 + LOBE * np.cos(2.0 * np.radians(numbers["incidence_deg"])) ** SHARPNESS) - glossy)
    assert error.mean() < 0.25 * (middle[mixed] / plain[mixed]).mean()


@pytest.mark.parametrize("ranged", ["by light", "first"])
def test_ranges_that_are_means_by_light_go_with_the_glossy_wall(ranged):
    numbers, labels, mixed, _, plain = swept(0.0, ranged=ranged, wall=0.5)
    glossy = swept(LOBE, ranged=ranged, wall=0.5)[4]
    view = View(make_columns(numbers, labels, shuffle=None)[0])
    made = corrected(view, variant_of(view, "target.non_lambertian", surface=""), lobe=LOBE, sharpness=SHARPNESS)
    error, change = made["distance_m"] - glossy, glossy - plain
    assert np.max(np.abs(made["distance_m"] - plain)[~mixed]) == 0.0
    if ranged == "first":
        assert not error.any()
    else:
        assert np.abs(error[mixed]).mean() < 0.35 * np.abs(change[mixed]).mean()
