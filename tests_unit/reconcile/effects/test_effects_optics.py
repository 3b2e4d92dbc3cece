"""Optics: operators against radiometry, apertures, passbands, films and filtered images."""

import numpy as np
import pytest
from operator_tables import fit, image_of, image_view, table
from rendered_bench import corrected, left_over, variant_of
from scipy.ndimage import gaussian_filter

from arl_fixtures.reconcile.catalogue import library

LIGHT, RANGE = "intensity_counts", "distance_m"


def test_natural_vignetting_is_the_cosine_fourth_of_radiometry():
    angle = np.linspace(-50.0, 50.0, 201)
    # irradiance behind a small aperture, summed over it: two obliquities and the longer way squared
    lens = np.stack(np.meshgrid(np.linspace(-0.01, 0.01, 21), np.linspace(-0.01, 0.01, 21))).reshape(2, -1)
    image_x = np.tan(np.radians(angle))[:, None]
    far = np.sqrt(1.0 + (image_x - lens[0]) ** 2 + lens[1] ** 2)
    light = np.mean(1.0 / far**4, axis=1)
    view = table(azimuth_deg=angle, sim_signal_counts=1000.0, signal_counts=1000.0 * light)
    values = fit(view, variant_of(view, "optics.vignetting", kind="natural"), "signal_counts", {"exponent": 1.0})
    assert values["exponent"] == pytest.approx(4.0, abs=0.02)


def test_vignetting_needs_no_rays_where_an_image_is_known():
    u, v = (a.ravel().astype(float) for a in np.meshgrid(np.arange(32), np.arange(24)))
    # a sensor 30 pixels behind a small aperture: light falls with the cosine twice and the distance squared
    far = np.stack([u - 15.5, v - 11.5, np.full(u.size, 30.0)])
    size = np.linalg.norm(far, axis=0)
    light = (far[2] / size) ** 2 * (30.0 / size) ** 2
    view = table(pixel_u=u, pixel_v=v, step=0.0, sim_signal_counts=1000.0, signal_counts=1000.0 * light)
    variant = variant_of(view, "optics.vignetting", kind="by pixels")
    values = fit(view, variant, "signal_counts", {"exponent": 1.0, "reach": 0.4})
    assert values["exponent"] == pytest.approx(4.0, abs=0.02)
    assert values["reach"] == pytest.approx(np.hypot(15.5, 11.5) / 30.0, abs=0.005)


def test_mechanical_vignetting_is_the_share_of_rays_that_pass_two_apertures():
    rng = np.random.default_rng(2)
    angle = np.linspace(0.0, 45.0, 46)
    first = np.sqrt(rng.random(200_000)) * np.exp(2j * np.pi * rng.random(200_000))  # a filled disc
    passed = [np.mean(np.abs(first + 0.9 * np.tan(np.radians(a))) < 1.2) for a in angle]
    view = table(azimuth_deg=angle, sim_signal_counts=1000.0)
    state = corrected(view, variant_of(view, "optics.vignetting", kind="mechanical"), parting=0.9, knee=0.2 / 0.9)
    np.testing.assert_allclose(state["signal_counts"] / 1000.0, passed, atol=0.004)


def test_the_passband_leaves_the_line_at_large_angles_as_an_interference_filter_does():
    angle = np.linspace(-60.0, 60.0, 241)
    inside = np.arcsin(np.sin(np.radians(angle)) / 1.8)
    # Airy function of one cavity of index 1.8, finesse coefficient 200, centred on 1064 nm at normal incidence
    phase = 2.0 * np.pi * 20.0 * np.cos(inside)
    passed = 1.0 / (1.0 + 200.0 * np.sin(phase / 2.0) ** 2)
    near = np.abs(angle) < 12.0  # within the first order
    view = table(azimuth_deg=angle[near], sim_signal_counts=1000.0, signal_counts=1000.0 * passed[near])
    variant = variant_of(view, "optics.filter_shift", temperature="")
    start = {"tilt": 20.0, "offset": 0.0, "cavities": 1.0}
    values = fit(view, variant, "signal_counts", start, scale=np.full(int(near.sum()), 10.0))
    assert left_over(view, corrected(view, variant, **values), "signal_counts") < 1e-3


def test_frost_follows_a_mass_balance_stepped_through_time():
    time = np.linspace(0.0, 20_000.0, 1001)
    warm = np.interp(time, [0.0, 6000.0, 9000.0, 20_000.0], [20.0, -10.0, -10.0, 20.0])

    def vapour(temperature):
        return 6.112 * np.exp(17.62 * temperature / (243.12 + temperature))

    film, grown = 0.0, []
    for temperature in warm:
        grown.append(film)
        film = max(film + 20.0 / 3600.0 * (vapour(2.0) - vapour(temperature)), 0.0)
    passed = np.exp(-0.12 * np.array(grown))
    view = table(time_s=time, housing_temperature_c=warm, sim_signal_counts=1000.0, signal_counts=1000.0 * passed)
    variant = variant_of(view, "optics.window_frost", kind="balance")
    state = corrected(view, variant, depth=0.12, onset=2.0, melt=1.0)
    assert np.abs(state["signal_counts"] / view.number("signal_counts") - 1.0).max() < 0.01
    cooling, heating = np.interp([4500.0, 11_200.0], time, state["signal_counts"])
    assert heating < 0.9 * cooling  # at nearly the same temperature: it remembers


def test_glare_is_a_convolution_with_a_flat_kernel():
    u, v, light, far = image_of()
    view = image_view(light, far, u, v)
    state = corrected(view, variant_of(view, "optics.veiling_glare"), share=0.03, pull=1.0)
    flat = 0.97 * view.sim[LIGHT] + 0.03 * light.mean()
    np.testing.assert_allclose(state[LIGHT], flat, rtol=1e-9)
    mean = (light * far).sum() / light.sum()
    expected = (0.97 * view.sim[LIGHT] * view.sim[RANGE] + 0.03 * light.mean() * mean) / flat
    np.testing.assert_allclose(state[RANGE], expected, rtol=1e-9)


def test_ghost_adds_the_image_turned_by_half_a_turn():
    u, v, light, far = image_of()
    view = image_view(light, far, u, v)
    state = corrected(view, variant_of(view, "optics.ghost", flip="point"), share=0.05, centre_u=51.5, centre_v=15.5)
    turned = (light + 0.05 * light[::-1, ::-1]).ravel()
    order = np.lexsort((view.number("pixel_u"), view.number("pixel_v")))
    np.testing.assert_allclose(state[LIGHT][order], turned, rtol=1e-9)


def test_a_ghost_reaches_pixels_whose_mirror_image_the_table_does_not_hold():
    u, v, light, far = image_of()
    kept = np.random.default_rng(4).uniform(size=light.shape) < 0.5
    view = image_view(light[kept], far[kept], u[kept], v[kept])
    state = corrected(view, variant_of(view, "optics.ghost", flip="point"), share=0.05, centre_u=51.5, centre_v=15.5)
    true = 0.05 * light[::-1, ::-1][kept]
    order = np.lexsort((view.number("pixel_u"), view.number("pixel_v")))
    added = (state[LIGHT] - view.sim[LIGHT])[order]
    assert np.mean((added - true) ** 2) < 0.3 * np.mean(true**2)  # without neighbours half of it is missing


def test_defocus_blurs_like_a_gaussian_filter_on_a_finer_image():
    fine_v, fine_u = np.mgrid[0 : 16 * 9, 0 : 24 * 9] / 9.0
    fine = np.where(np.hypot(fine_u - 10.2, fine_v - 7.6) < 4.0, 3000.0, 200.0)

    def seen(image):
        return image.reshape(16, 9, 24, 9).mean(axis=(1, 3))

    light, blurred = seen(fine), seen(gaussian_filter(fine, 0.6 * 9.0, mode="nearest"))
    u, v, _, far = image_of()
    view = image_view(light, far, u, v)
    state = corrected(view, variant_of(view, "optics.defocus", temperature=""), width=0.6)
    order = np.lexsort((view.number("pixel_u"), view.number("pixel_v")))
    found = state[LIGHT][order].reshape(16, 24)
    # the pixels' own integration hides where in a pixel an edge runs: a few percent cannot be known
    assert np.sum((found - blurred) ** 2) < 0.08 * np.sum((light - blurred) ** 2)
    assert found.sum() == pytest.approx(light.sum(), rel=1e-3)  # light moves, none is lost


def test_contamination_takes_light_inside_its_ellipse_only():
    u, v, light, far = image_of()
    view = image_view(light, far, u, v)
    values = {"loss": 0.2, "centre_u": 52.0, "radius_u": 4.0, "centre_v": 16.0, "radius_v": 3.0}
    variant = variant_of(view, "optics.window_contamination")
    kept = corrected(view, variant, **values)[LIGHT] / view.sim[LIGHT]
    reach = np.hypot((view.number("pixel_u") - 52.0) / 4.0, (view.number("pixel_v") - 16.0) / 3.0)
    assert kept[reach < 0.4].max() < 0.81
    assert kept[reach > 1.8].min() > 0.999
    where = library()["optics.window_contamination"].where(variant, values, view)
    assert where == {"pixel_u": [48.0, 56.0], "pixel_v": [13.0, 19.0]}
