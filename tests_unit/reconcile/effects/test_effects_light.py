"""Laser, beam, optics, targets and air: operators against physics made by other means."""

import re

import numpy as np
import pytest
from rendered_bench import bench, corrected, left_over, make_columns, variant_of
from scipy.ndimage import gaussian_filter
from scipy.optimize import least_squares

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.rivals import needed_by_law
from arl_fixtures.reconcile.terms import Term, default_values
from arl_fixtures.reconcile.view import View

LIGHT, RANGE = "intensity_counts", "distance_m"


def fitted(view, variant, channel, starts, scale=None):
    """Least-squares values of the named parameters, on one channel."""
    names = list(starts)
    bounds = {p.name: (p.low, p.high) for p in variant.parameters}
    scale = view.sim[channel] * 0.01 if scale is None else scale

    def misfit(x):
        state = corrected(view, variant, **dict(zip(names, map(float, x), strict=True)))
        return (view.number(channel) - state[channel]) / scale

    low, high = np.transpose([bounds[name] for name in names])
    found = least_squares(
        misfit, list(starts.values()), bounds=(low, high), x_scale=np.maximum(np.abs(list(starts.values())), 1e-6)
    )
    return dict(zip(names, map(float, found.x), strict=True))


def plain_table(n=400, **columns):
    """A table of columns only; channels get their `sim_` unchanged where no measured one is given."""
    numbers = {
        name: np.broadcast_to(np.asarray(values, dtype=float), (n,)).copy() for name, values in columns.items()
    }
    for name in [name for name in numbers if name.startswith("sim_")]:
        numbers.setdefault(name.removeprefix("sim_"), numbers[name].copy())
    return make_columns(numbers, {}, shuffle=None)[0]


def test_natural_vignetting_is_the_cosine_fourth_of_radiometry():
    angle = np.linspace(-50.0, 50.0, 201)
    # irradiance behind a small aperture, summed over it: two obliquities and the longer way squared
    lens = np.stack(np.meshgrid(np.linspace(-0.01, 0.01, 21), np.linspace(-0.01, 0.01, 21))).reshape(2, -1)
    image_x = np.tan(np.radians(angle))[:, None]
    far = np.sqrt(1.0 + (image_x - lens[0]) ** 2 + lens[1] ** 2)
    light = np.mean(1.0 / far**4, axis=1)
    columns = plain_table(201, azimuth_deg=angle, sim_signal_counts=1000.0, signal_counts=1000.0 * light)
    view = View(columns)
    values = fitted(view, variant_of(view, "optics.vignetting", kind="natural"), "signal_counts", {"exponent": 1.0})
    assert values["exponent"] == pytest.approx(4.0, abs=0.02)


def test_vignetting_needs_no_rays_where_an_image_is_known():
    u, v = (a.ravel().astype(float) for a in np.meshgrid(np.arange(32), np.arange(24)))
    # a sensor 30 pixels behind a small aperture: light falls with the cosine twice and the distance squared
    far = np.stack([u - 15.5, v - 11.5, np.full(u.size, 30.0)])
    size = np.linalg.norm(far, axis=0)
    light = (far[2] / size) ** 2 * (30.0 / size) ** 2
    columns = plain_table(
        u.size, pixel_u=u, pixel_v=v, step=0.0, sim_signal_counts=1000.0, signal_counts=1000.0 * light
    )
    view = View(columns)
    variant = variant_of(view, "optics.vignetting", kind="by pixels")
    values = fitted(view, variant, "signal_counts", {"exponent": 1.0, "reach": 0.4})
    assert values["exponent"] == pytest.approx(4.0, abs=0.02)
    assert values["reach"] == pytest.approx(np.hypot(15.5, 11.5) / 30.0, abs=0.005)


def test_mechanical_vignetting_is_the_share_of_rays_that_pass_two_apertures():
    rng = np.random.default_rng(2)
    angle = np.linspace(0.0, 45.0, 46)
    first = np.sqrt(rng.random(200_000)) * np.exp(2j * np.pi * rng.random(200_000))  # a filled disc
    passed = [np.mean(np.abs(first + 0.9 * np.tan(np.radians(a))) < 1.2) for a in angle]
    columns = plain_table(46, azimuth_deg=angle, sim_signal_counts=1000.0)
    view = View(columns)
    state = corrected(view, variant_of(view, "optics.vignetting", kind="mechanical"), parting=0.9, knee=0.2 / 0.9)
    np.testing.assert_allclose(state["signal_counts"] / 1000.0, passed, atol=0.004)


def test_a_worn_beam_and_a_gain_are_told_apart_by_where_they_act():
    view = View(bench(columns=(20, 108), rows=(2, 30), angles=(0.0, 0.9, 2)))
    worn = corrected(view, variant_of(view, "beam.profile_change", kind="centre", driver=""), centre=0.1, radius=0.5)
    ratio = worn[LIGHT] / view.sim[LIGHT]
    az, el = view.number("azimuth_deg"), view.number("elevation_deg")
    assert ratio[(np.abs(az) < 3.0) & (np.abs(el) < 2.0)].mean() < 0.92
    assert ratio[np.abs(az) > 34.0].mean() > 0.985


def test_rolloff_fits_a_diode_whose_threshold_grows_exponentially():
    warm = np.linspace(-10.0, 85.0, 300)
    power = 40.0 - 5.0 * np.exp((warm - 25.0) / 45.0)  # slope · (J − J_th(T)), T0 = 45 K
    columns = plain_table(
        300, laser_temperature_c=warm, sim_signal_counts=1000.0, signal_counts=1000.0 * power / 35.0
    )
    view = View(columns)
    variant = variant_of(view, "laser.thermal_rolloff", kind="slope")
    fitted(view, variant, "signal_counts", {"slope": 0.001, "growth": 0.01})
    values = fitted(view, variant, "signal_counts", {"slope": 0.003, "growth": 0.02})
    state = corrected(view, variant, **values)
    assert np.abs(state["signal_counts"] / view.number("signal_counts") - 1.0).max() < 0.01
    assert np.all(np.diff(state["signal_counts"]) < 0.0)


@pytest.mark.parametrize("fade", [0.004, -0.009])
def test_rolloff_shifts_the_whole_light_current_curve_and_says_which_way_its_slope_goes(fade):
    current, warm = (part.ravel() for part in np.meshgrid(np.linspace(0.0, 3.0, 301), [20.0, 35.0]))

    def diode(j, temperature):
        threshold = 1.0 + 0.02 * (temperature - 20.0)
        slope = 400.0 * np.exp(-fade * (temperature - 20.0))
        return 5.0 * j + slope * 0.02 * np.logaddexp(0.0, (j - threshold) / 0.02)

    columns = plain_table(
        602, drive_current_a=current, heatsink_temperature_c=warm, sim_photodiode_w=diode(current, 20.0),
        photodiode_w=diode(current, warm),
    )  # fmt: skip
    view = View(columns)
    variant = variant_of(view, "laser.thermal_rolloff", kind="curve")
    values = fitted(
        view,
        variant,
        "photodiode_w",
        {"threshold_shift": 0.01, "loss": 0.002, "reference": 21.0},
        scale=np.full(602, 1.0),
    )
    assert left_over(view, corrected(view, variant, **values), "photodiode_w") < 2e-3
    assert values["threshold_shift"] == pytest.approx(0.02, rel=0.05)
    slopes = [
        np.diff(diode(np.array([2.5, 3.0]), temperature))[0] / 0.5 - 5.0 for temperature in (20.0, 35.0)
    ]  # fmt: skip
    said = library()["laser.thermal_rolloff"].sentence(variant, values, view)
    percent = float(re.search(r"changes by ([+-][\d.]+) %", said)[1])
    assert percent == pytest.approx((slopes[1] / slopes[0] - 1.0) * 100.0, abs=1.5)
    assert f"{values['threshold_shift'] * 1e3:.2f} mA per kelvin" in said


def test_power_decay_weights_time_by_temperature_as_a_rate_equation_does():
    time = np.linspace(0.0, 40_000.0, 800)
    warm = 40.0 + 40.0 * np.sin(time / 3000.0)
    power, kept = 1.0, []
    for temperature in warm:  # explicit steps of dP/dt = −k0 exp(−E/kT) P
        kept.append(power)
        power -= 50.0 * 2e-6 * np.exp(-0.5 / 8.617e-5 * (1.0 / (temperature + 273.15) - 1.0 / 313.15)) * power
    columns = plain_table(
        800, time_s=time, housing_temperature_c=warm, sim_signal_counts=1000.0, signal_counts=1000.0 * np.array(kept)
    )
    view = View(columns)
    variant = variant_of(view, "laser.power_decay", temperature="housing_temperature_c")
    values = fitted(view, variant, "signal_counts", {"loss": 0.05, "activation_energy": 0.4})
    assert values["activation_energy"] == pytest.approx(0.5, abs=0.01)
    assert left_over(view, corrected(view, variant, **values), "signal_counts") < 1e-3


def test_pulse_energy_jitter_widens_the_scatter_as_drawn_pulses_do():
    rng = np.random.default_rng(4)
    light = np.linspace(100.0, 3000.0, 30)
    frames = light * (1.0 + 0.02 * rng.normal(size=(20_000, 1))) + 8.0 * rng.normal(size=(20_000, 30))
    columns = plain_table(
        30, sim_signal_counts=light, sim_signal_counts_std=8.0, signal_counts_std=frames.std(axis=0)
    )
    view = View(columns)
    state = corrected(view, variant_of(view, "laser.pulse_energy_jitter"), jitter=0.02)
    np.testing.assert_allclose(state["signal_counts_std"], view.number("signal_counts_std"), rtol=0.03)


def test_the_passband_leaves_the_line_at_large_angles_as_an_interference_filter_does():
    angle = np.linspace(-60.0, 60.0, 241)
    inside = np.arcsin(np.sin(np.radians(angle)) / 1.8)
    # Airy function of one cavity of index 1.8, finesse coefficient 200, centred on 1064 nm at normal incidence
    phase = 2.0 * np.pi * 20.0 * np.cos(inside)
    passed = 1.0 / (1.0 + 200.0 * np.sin(phase / 2.0) ** 2)
    near = np.abs(angle) < 12.0  # within the first order
    columns = plain_table(
        int(near.sum()), azimuth_deg=angle[near], sim_signal_counts=1000.0, signal_counts=1000.0 * passed[near]
    )
    view = View(columns)
    variant = variant_of(view, "optics.filter_shift", temperature="")
    start = {"tilt": 20.0, "offset": 0.0, "cavities": 1.0}
    values = fitted(view, variant, "signal_counts", start, scale=np.full(int(near.sum()), 10.0))
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
    columns = plain_table(
        1001, time_s=time, housing_temperature_c=warm, sim_signal_counts=1000.0, signal_counts=1000.0 * passed
    )
    view = View(columns)
    variant = variant_of(view, "optics.window_frost", kind="balance")
    state = corrected(view, variant, depth=0.12, onset=2.0, melt=1.0)
    assert np.abs(state["signal_counts"] / view.number("signal_counts") - 1.0).max() < 0.01
    cooling, heating = np.interp([4500.0, 11_200.0], time, state["signal_counts"])
    assert heating < 0.9 * cooling  # at nearly the same temperature: it remembers


def image_of(columns_u=range(40, 64), rows_v=range(8, 24)):
    """One image with a bright block: u, v, light, range as 2-D arrays."""
    v, u = np.meshgrid(np.array(list(rows_v), dtype=float), np.array(list(columns_u), dtype=float), indexing="ij")
    bright = ((u - 45.0) ** 2 + (v - 14.0) ** 2) < 16.0
    return u, v, np.where(bright, 3000.0, 200.0), np.where(bright, 1.1, 1.6)


def image_view(light, far, u, v):
    numbers = {
        "pixel_u": u.ravel(), "pixel_v": v.ravel(), "stage_angle_deg": np.zeros(u.size),
        "sim_intensity_counts": light.ravel(), "sim_distance_m": far.ravel(),
    }  # fmt: skip
    numbers |= {"intensity_counts": light.ravel().copy(), "distance_m": far.ravel().copy()}
    return View(make_columns(numbers, {})[0])


def test_a_law_of_neighbouring_rows_is_no_rival_of_a_name_that_mixes_them():
    """Neighbours say in other words what crosstalk says; a temperature, or a name of one row, is another matter."""
    view = image_view(*(image_of()[k] for k in (2, 3, 0, 1)))

    def term(effect):
        variant = variant_of(view, effect)
        return Term(effect=library()[effect], variant=variant, values=default_values(variant))

    needed = [
        needed_by_law(100.0, 0.0, [term(effect)], columns)
        for effect, columns in (
            ("detector.crosstalk", ["tof_temperature_c", "~edge(intensity_counts)"]),
            ("detector.crosstalk", ["tof_temperature_c"]),
            ("detector.compression", ["~edge(intensity_counts)"]),
        )
    ]
    assert needed[0] > 1.5 * needed[1] == 1.5 * needed[2]


def test_a_law_of_a_names_own_columns_must_do_better_than_one_of_others():
    """It has the freer shape only; a law of other columns tells of another cause."""
    view = image_view(*(image_of()[k] for k in (2, 3, 0, 1)))
    variant = variant_of(view, "detector.crosstalk")
    acting = [Term(effect=library()[variant.effect], variant=variant, values=default_values(variant))]
    own, other = (needed_by_law(100.0, 0.0, acting, columns) for columns in (["pixel_u"], ["tof_temperature_c"]))
    assert own > other


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


def test_a_rough_diffuser_is_within_reach_of_the_non_lambertian_family():
    angle = np.linspace(0.0, 60.0, 200)
    a = np.radians(angle)
    rough = np.radians(20.0) ** 2  # Oren-Nayar, source and eye together
    relative = 1.0 - 0.5 * rough / (rough + 0.33) + 0.45 * rough / (rough + 0.09) * np.sin(a) * np.tan(a)
    relative /= relative[0]
    columns = plain_table(200, incidence_deg=angle, sim_signal_counts=1000.0 * np.cos(a))
    columns.numbers["signal_counts"] = 1000.0 * np.cos(a) * relative
    view = View(columns)
    variant = variant_of(view, "target.non_lambertian", surface="")
    values = fitted(view, variant, "signal_counts", {"oblique": 0.1, "lobe": 0.01, "sharpness": 12.0})
    assert left_over(view, corrected(view, variant, **values), "signal_counts") < 0.03


def test_at_an_edge_the_stronger_echo_can_win():
    view = View(bench())
    # one pixel, two echoes: the sensor reports the range of the stronger one instead of the light-weighted mean
    wall = np.abs(view.sim[RANGE] - 1.6) < 0.02
    border = view.selects("mixed", "true") & ~wall & (view.sim[RANGE] > 1.12) & (view.sim[RANGE] < 1.59)
    assert border.sum() > 50
    share_near = (1.603 - view.sim[RANGE]) / (1.603 - 1.104)
    winner = np.where(share_near > 0.5, 1.104, 1.603)
    state = corrected(view, variant_of(view, "target.edge_mixing", kind="dominant"), share=1.0)
    off = np.abs(state[RANGE] - winner)[border]
    assert np.median(off) < 0.01
    assert np.mean(off < 0.05) > 0.85


def test_light_that_lights_other_targets_lengthens_all_ranges_and_most_beside_bright_ones():
    view = View(bench())
    state = corrected(view, variant_of(view, "air.multipath", source="room"), share=0.02)
    longer = state[RANGE] - view.sim[RANGE]
    assert longer.min() > 0.0
    brighter = state[LIGHT] / view.sim[LIGHT] - 1.0
    assert brighter.mean() == pytest.approx(0.02, rel=0.15)
    bearing = view.number("azimuth_deg") + view.number("stage_angle_deg")
    far_off, beside = longer[np.abs(bearing) > 18.0].mean(), longer[np.abs(bearing - 7.5) < 2.0].mean()
    assert far_off > beside  # the way to the bright panels and back is longer from there


def test_a_surface_beside_the_beam_is_a_longer_way_mostly_at_short_range():
    truth = np.linspace(0.3, 6.0, 200)
    bounced = 0.5 * (truth + np.sqrt(truth**2 + 4.0 * 0.5**2))  # there straight, back over a mirror 0.5 m below
    part = 0.05 * (truth / np.sqrt(truth**2 + 1.0)) ** 2
    columns = plain_table(200, sim_distance_m=truth, distance_m=(truth + part * bounced) / (1.0 + part))
    view = View(columns)
    state = corrected(view, variant_of(view, "air.multipath", source="side"), share=0.05, height=0.5)
    assert left_over(view, state, "distance_m") < 1e-6


def test_a_receiver_that_gathers_all_light_sees_the_surface_beside_the_beam_in_its_signal_too():
    truth = np.linspace(0.3, 4.0, 120)
    time = np.linspace(-4e-9, 45e-9, 2500)

    def echo(way):  # a pulse of 1.1 ns on its way there and back
        return np.exp(-0.5 * ((time - 2.0 * way[:, None] / 299_792_458.0) / 1.1e-9) ** 2)

    part = 0.03 * (truth / np.sqrt(truth**2 + 4.0 * 0.4**2)) ** 2  # the longer way, weaker by its square
    wave = 800.0 * (echo(truth) + part[:, None] * echo(0.5 * (truth + np.sqrt(truth**2 + 4.0 * 0.4**2))))
    direct = 800.0 * echo(truth)
    centre = 0.5 * 299_792_458.0 * (wave @ time) / wave.sum(axis=1)
    columns = plain_table(
        120, sim_distance_m=truth, distance_m=centre, sim_signal_counts=direct.sum(axis=1),
        signal_counts=wave.sum(axis=1),
    )  # fmt: skip
    view = View(columns)
    state = corrected(view, variant_of(view, "air.multipath", source="side", lit=True), share=0.03, height=0.4)
    assert left_over(view, state, "signal_counts") < 1e-3
    assert left_over(view, state, "distance_m") < 1e-3


@pytest.mark.parametrize("end", ["low", "high"])
def test_a_beam_is_blurred_by_no_more_than_a_law_of_second_order_holds_for(end):
    u, v = (a.ravel().astype(float) for a in np.meshgrid(np.arange(48), np.arange(6)))
    angle = 0.75 * (u - 23.5)
    fine = np.arange(-90.0, 90.0, 0.02)

    def beam(variance):  # of rays of 6 deg, each spread by 8 deg and what the blur adds to that
        spread = np.exp(-0.5 * np.arange(-60.0, 60.01, 0.02) ** 2 / (64.0 + variance))
        rays = np.exp(-0.5 * (fine / 6.0) ** 2)
        return np.interp(angle, fine, np.convolve(rays, spread / spread.sum(), mode="same"))

    columns = plain_table(
        angle.size, pixel_u=u, pixel_v=v, azimuth_deg=angle, elevation_deg=0.75 * (v - 2.5),
        sim_signal_counts=1000.0 * beam(0.0),
    )  # fmt: skip
    view = View(columns)
    blur = variant_of(view, "beam.profile_change", kind="blur")
    along = blur.parameters[0]
    most = getattr(along, end)
    values = {p.name: most if p is along else 0.0 for p in blur.parameters}
    told = corrected(view, blur, **values)["signal_counts"] / view.sim["signal_counts"]
    np.testing.assert_allclose(told, beam(most) / beam(0.0), rtol=0.16)
