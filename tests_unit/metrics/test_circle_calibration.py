"""Circle centres from four-pixel blobs, and the adjustment that makes K of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from arl_fixtures.metrics.calibration.adjustment import adjust
from arl_fixtures.metrics.calibration.circles import Centres, circle_plan, find_centres
from arl_fixtures.metrics.calibration.places import MOST_COLUMNS, PLACE_PX, places
from arl_fixtures.metrics.geometry import GeometryCache
from arl_fixtures.metrics.reference import NotMeasurableError
from arl_fixtures.metrics.step import BenchUncertainty
from arl_fixtures.twin.beam import BeamSettings
from arl_fixtures.twin.frame import Renderer
from arl_fixtures.twin.settings import DutSettings

DUT = DutSettings(serial="A")
ANGLES_DEG = np.array([-60.0 + 1.8 * k for k in range(67)])
BENCH = BenchUncertainty()


@pytest.fixture(scope="module")
def geometry():
    return GeometryCache(DUT).at(ANGLES_DEG)


@pytest.fixture(scope="module")
def plan(geometry):
    return geometry.derive(circle_plan)


def seen(dut: DutSettings, plan):
    """Centres in noise-free frames of a DUT, its own beam divided out."""
    renderer = Renderer(dut)
    counts = np.concatenate([renderer.expected(float(a)).intensity_counts.ravel() for a in ANGLES_DEG]).astype(float)
    return find_centres(plan, counts, np.ones_like(counts), dut.gain * renderer.power.ravel())


def test_the_twins_own_frames_show_no_deviation(plan):
    centres = seen(DUT, plan)
    assert centres.usable.all()
    assert np.abs(centres.deviation_px).max() < 1e-4


def test_a_shift_by_part_of_a_pixel_is_seen_in_full(plan):
    moved = DUT.model_copy(update={"intrinsics": DUT.intrinsics.model_copy(update={"cx": 63.65, "cy": 15.4})})
    deviation = seen(moved, plan).deviation_px
    # single centres feel the coarse sampling of 3 × 3 rays, their mean does not
    assert deviation.mean(axis=0) == pytest.approx([0.15, -0.10], abs=0.004)
    assert deviation.std(axis=0).max() < 0.06


def test_another_beam_moves_no_centre_once_it_is_divided_out(plan):
    bent = DUT.model_copy(
        update={"beam": BeamSettings(azimuth_half_width_deg=60.0, azimuth_shift_deg=2.0), "gain": 0.8}
    )
    assert np.abs(seen(bent, plan).deviation_px).max() < 2e-3


def test_planted_deviations_come_back_with_their_uncertainty(plan):
    field = plan.circles
    rng = np.random.default_rng(1)
    sigma_px, m = 0.01, len(field.angle)
    scores = []
    for _ in range(40):
        truth = {"fx": 0.05, "fy": -0.03, "cx": 0.02, "cy": 0.05, "k4": 1e-4}
        for name in field.names[5:]:
            u = BENCH.mount_angle_deg if name.endswith("_deg") else BENCH.target_position_m
            truth[name] = u * rng.standard_normal()
        turned = BENCH.stage_angle_deg * rng.standard_normal(len(ANGLES_DEG))
        deviation = field.jacobian @ [truth[name] for name in field.names]
        deviation += field.stage_jacobian * turned[field.angle][:, None] + sigma_px * rng.standard_normal((m, 2))
        found = adjust(field, Centres(np.ones(m, bool), deviation, np.full((m, 2), sigma_px**2)), BENCH, {})
        total = found.centres.covariance + sum(found.by_group.values())
        error = np.array([found.offsets[name] - truth[name] for name in found.names])
        scores.append(error / np.sqrt(np.diag(total)))
    # the allowance for alike residuals of one place costs a tenth where there are none
    spread = np.sqrt(np.mean(np.square(scores), axis=0))
    assert np.all(spread > 0.6)
    assert np.all(spread < 1.25)


def test_residuals_alike_where_circles_of_a_row_pass_widen_the_uncertainty(plan):
    field = plan.circles
    rng = np.random.default_rng(2)
    m = len(field.angle)
    alone = 0.01 * rng.standard_normal((m, 2))
    # what a sampling does: by the place in the image, whichever circle, target and angle it is
    row = np.unique(np.rint(1e6 * field.up_m), return_inverse=True)[1]
    column = (field.pixels()[:, 0] / PLACE_PX[0]).astype(int)
    of_place = 0.01 * rng.standard_normal((row.max() + 1, column.max() + 1, 2))[row, column]
    variance = np.full((m, 2), 0.01**2)
    usable = np.ones(m, bool)
    single, alike = (
        adjust(field, Centres(usable, deviation, variance), BENCH, {}) for deviation in (alone, of_place)
    )
    ratio = np.sqrt(np.diag(alike.centres.covariance) / np.diag(single.centres.covariance))
    assert np.all(ratio > 2.0)


def test_what_a_place_repeats_cancels_in_a_change_and_what_it_does_not_adds(plan):
    field = plan.circles
    rng = np.random.default_rng(4)
    m = len(field.angle)
    variance, usable = np.full((m, 2), 0.01**2), np.ones(m, bool)
    shared, then, now = (0.01 * rng.standard_normal((m, 2)) for _ in range(3))

    def of(deviation):
        return adjust(field, Centres(usable, deviation, variance), BENCH, {}).centres

    for k in range(5):
        same, other = of(shared), of(now)
        assert same.variance_of_change(k, same.place, same.influence[:, k])[0] == 0.0
        before = of(then)
        apart = other.variance_of_change(k, before.place, before.influence[:, k])[0]
        assert apart == pytest.approx(other.variance(k)[0] + before.variance(k)[0], rel=0.5)
        elsewhere = other.variance_of_change(k, before.place + 10**15, before.influence[:, k])[0]
        assert elsewhere == pytest.approx(other.variance(k)[0] + before.variance(k)[0], rel=1e-9)


def test_a_place_is_called_the_same_when_a_target_was_found_higher(plan):
    field, used = plan.circles, np.ones(len(plan.circles.angle), bool)
    raised = replace(field, up_m=field.up_m + np.where(field.board == 0, 0.0007, -0.0004))
    known = {f"{field.boards[0]}.up_m": 0.0007, f"{field.boards[1]}.up_m": -0.0004}
    row = places(field, used, {}) // 2 // MOST_COLUMNS
    assert len(np.unique(row)) == 5
    assert np.array_equal(places(raised, used, known) // 2 // MOST_COLUMNS, row)


def test_wild_centres_lose_their_weight(plan):
    field = plan.circles
    rng = np.random.default_rng(3)
    m = len(field.angle)
    deviation = 0.01 * rng.standard_normal((m, 2))
    deviation[rng.random(m) < 0.05] += 1.0
    found = adjust(field, Centres(np.ones(m, bool), deviation, np.full((m, 2), 0.01**2)), BENCH, {})
    assert abs(found.offsets["cx"]) < 4 * np.sqrt(found.centres.covariance[2, 2])
    assert abs(found.offsets["cx"]) < 0.01


def test_too_few_circles_are_refused(plan):
    m = len(plan.circles.angle)
    few = np.arange(m) < 50
    with pytest.raises(NotMeasurableError, match="50 circles"):
        adjust(plan.circles, Centres(few, np.zeros((m, 2)), np.ones((m, 2))), BENCH, {})
