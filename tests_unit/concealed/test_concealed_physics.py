from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks.concealed import effects_timing
from benchmarks.concealed.flash import OFFSET_U, OFFSET_V, Reality, footprint
from benchmarks.concealed.laser_curve import photons
from benchmarks.concealed.rows import Design, lay_out, random_pixels
from benchmarks.concealed.scene import SURFACES, field_angles_deg, pixel_rays, to_chamber, trace
from benchmarks.concealed.spad import first_photon
from benchmarks.concealed.thermal_network import STEP_S, Network, march
from benchmarks.concealed.thermal_plant import Plant, PlantDesign, _coolant, _march
from benchmarks.concealed.waveform import Receiver, stamp_ns, strongest_return_m

GOLDEN = Path(__file__).parents[2] / "../shared/golden/nominal_v1.npz"


def _frame(stage_angle_deg, height_m, footprint_rad=0.0):
    third = np.array([-1.0, 0.0, 1.0]) / 3.0
    du, dv = (a.ravel() for a in np.meshgrid(third, third))
    u, v = np.meshgrid(np.arange(128.0), np.arange(32.0))
    rays = to_chamber(pixel_rays(u[..., None] + du, v[..., None] + dv), np.asarray(stage_angle_deg))
    return trace(np.array([0.0, 0.0, height_m]), rays, footprint_rad)


@pytest.mark.skipif(not GOLDEN.exists(), reason="golden frames of the nominal model are not beside the checkout")
def test_rays_meet_what_an_independent_renderer_met():
    golden = np.load(GOLDEN)
    azimuth, elevation = field_angles_deg(pixel_rays(*np.meshgrid(np.arange(128.0), np.arange(32.0))))
    np.testing.assert_allclose(azimuth, golden["azimuth_deg"], atol=1e-9)
    beam = np.exp(-((azimuth / 75) ** 4) - (elevation / 18) ** 4)
    for k, angle in enumerate(golden["stage_angle_deg"]):
        hits = _frame(angle, golden["dut_height_m"][0])
        weight = hits.reflectance * hits.cos_incidence * (1.1 / hits.range_m) ** 2
        clear = ~golden["mixed"][0, k]
        off = np.abs(4000.0 * beam * weight.mean(axis=-1) - golden["intensity_counts"][0, k])[clear]
        # a ray that grazes a circle's rim may fall on either side
        assert np.mean(off < 0.05) > 0.999
        assert np.mean(hits.surface[..., 4] == golden["surface"][0, k]) > 0.999


def test_a_footprint_shares_its_light_between_panel_and_wall():
    hits = _frame(0.0, 0.0, footprint_rad=0.0055)
    share = hits.share[..., :9] + hits.share[..., 9:]
    np.testing.assert_allclose(share, 1.0)
    front = hits.share[..., :9]
    assert np.any((front > 0.1) & (front < 0.9))
    assert set(np.unique(hits.surface)) <= set(range(len(SURFACES)))


def test_a_blur_is_round_and_moves_nothing():
    rows = lay_out(Design(pixels=random_pixels(np.random.default_rng(3), 4)), np.random.default_rng(3))
    reality = Reality()
    reality.blur_px.append(lambda rows: np.full(len(rows), 0.3))
    du, dv = footprint(rows, reality)
    grid = np.cov(OFFSET_U, OFFSET_V, bias=True)
    np.testing.assert_allclose(np.mean([du[0], dv[0]], axis=1), [OFFSET_U.mean(), OFFSET_V.mean()], atol=1e-12)
    np.testing.assert_allclose(np.cov(du[0], dv[0], bias=True) - grid, 0.3**2 * np.eye(2), atol=1e-12)


def test_smooth_edges_move_in_proportion_to_the_stage():
    def light(angle):
        hits = _frame(angle, 0.0, footprint_rad=0.0055)
        return (hits.share * hits.reflectance).sum(axis=-1)

    small, twice = light(0.01) - light(0.0), light(0.02) - light(0.0)
    moving = np.abs(small) > 1e-4
    assert moving.sum() > 50
    assert np.median(twice[moving] / small[moving]) == pytest.approx(2.0, rel=0.05)


def test_a_weak_pulse_crosses_its_threshold_late_and_by_less_than_its_rise():
    for family in ("gaussian", "double_exponential", "q_switch"):
        receiver = Receiver(family=family, width_ns=5.0, level=20.0)
        stamps = stamp_ns(receiver, np.array([60.0, 300.0, 1500.0, 3000.0]))
        assert np.all(np.diff(stamps) < 0)
        assert stamps[0] - stamps[-1] < 15.0


def test_the_faintest_walk_is_as_smooth_as_a_strong_one():
    recipe = next(r for r in effects_timing.RECIPES if r.effect == "timing.range_walk")
    for seed in range(4):
        reality = SimpleNamespace(timing=[])
        recipe.make(np.random.default_rng(seed), None, None).apply(reality, 0.005)
        late = reality.timing[0](None, np.geomspace(90.0, 3300.0, 200), np.zeros(200))
        assert np.all(np.diff(late) < 0.0)


def test_a_peak_detector_locks_to_the_stronger_of_two_returns():
    receiver = Receiver(width_ns=1.0, tau_ns=0.3)
    near_far = np.array([[1.1, 1.6], [1.1, 1.6]])
    told = strongest_return_m(receiver, np.array([[3.0, 1.0], [1.0, 3.0]]), near_far)
    np.testing.assert_allclose(told, [1.1, 1.6], atol=0.02)


def test_first_photons_win_more_as_the_flux_grows():
    shift = first_photon(np.array([1e-4, 0.1, 1.0, 5.0]), 2.0)
    assert shift[0] == pytest.approx(0.0, abs=1e-4)
    assert np.all(np.diff(shift) < 0)
    assert shift[-1] > -0.30  # never before the pulse


def test_the_controller_holds_the_housing_at_its_set_point_and_slow_parts_remember_the_ramp():
    course = march(Network())
    settled = (np.arange(39) * STEP_S + 0.9 * STEP_S).astype(int) // 4
    np.testing.assert_allclose(course.node_c["housing"][settled], course.set_c[settled], atol=0.7)
    lag = course.node_c["slow"][settled] - course.node_c["housing"][settled]
    assert np.all(lag[3:19] < 0)
    assert np.all(lag[22:] > 0)


def test_frost_grows_below_the_dew_point_and_melts_on_the_way_up():
    course = march(Network(), dew_point_c=2.0)
    cold = course.set_c < 0
    heating = course.ramp > 0
    assert course.frost_kg_m2[cold].max() > 0
    assert np.all(course.frost_kg_m2[course.set_c > 60] == 0)
    same = course.set_c == 5.0
    assert course.frost_kg_m2[same & heating].max() > course.frost_kg_m2[same & ~heating].max()


def test_water_on_the_plate_holds_it_at_zero_for_as_long_as_it_melts():
    design = PlantDesign(profiles=((-10.0, 10.0),), dwell_s=900.0)
    coolant, *_ = _coolant(design, 5.0)

    def held_s(water_kg):
        plate, _ = _march(Plant(contact_w_k=np.full(3, 25.0), water_kg=water_kg), coolant, design, 5.0)
        return 5.0 * np.sum(np.abs(plate) < 0.3), plate[-1]

    (dry, dry_end), (wet, _), (wetter, end) = held_s(0.0), held_s(0.2), held_s(0.4)
    assert wet > dry + 60.0
    # the coolant warms on while the ice melts, so that twice the ice takes less than twice as long
    assert 1.2 < (wetter - dry) / (wet - dry) < 2.0
    assert end == pytest.approx(dry_end, abs=0.3)


def test_a_laser_has_a_knee_at_its_threshold():
    current = np.linspace(0.0, 2.0, 201)
    light = photons(current, np.full(201, 0.4))
    assert light[30] < 0.01
    assert np.diff(light)[150] / 0.01 == pytest.approx(1.0, rel=0.02)


def test_rows_know_which_angle_came_before():
    design = Design(pixels=random_pixels(np.random.default_rng(1), 3), shuffled=True)
    rows = lay_out(design, np.random.default_rng(2))
    first_step = rows.group == 0
    order = np.argsort(rows.time_s[first_step], kind="stable")[::3]
    angles = rows.angle_deg[first_step][order]
    np.testing.assert_allclose(rows.previous_angle_deg[first_step][order][1:], angles[:-1])
