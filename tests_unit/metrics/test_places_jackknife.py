"""Leaving a place out by formula is leaving it out."""

from __future__ import annotations

import numpy as np
import pytest

from arl_fixtures.metrics.calibration.normal import NormalMatrix
from arl_fixtures.metrics.calibration.places import influence
from arl_fixtures.metrics.reference import NotMeasurableError

CENTRES, DENSE, ANGLES, ASKED = 90, 4, 7, 2


def problem(seed: int):
    rng = np.random.default_rng(seed)
    design = tuple(rng.standard_normal((CENTRES, DENSE)) for _ in range(2))
    stage = rng.standard_normal((CENTRES, 2))
    angle = rng.integers(ANGLES, size=CENTRES)
    place = rng.integers(6, size=(CENTRES, 2)) * 2 + [0, 1]
    rows = np.zeros((2, CENTRES, DENSE + ANGLES))
    for axis in range(2):
        rows[axis, :, :DENSE] = design[axis]
        rows[axis, np.arange(CENTRES), DENSE + angle] = stage[:, axis]
    prior = np.diag(np.r_[np.zeros(DENSE), np.full(ANGLES, 2.0)])
    deviation = rng.standard_normal((CENTRES, 2))
    return design, stage, angle, place, rows, prior, deviation


def fit(rows, prior, deviation, weight):
    normal = prior + sum((rows[a].T * weight[:, a]) @ rows[a] for a in range(2))
    right = sum(rows[a].T @ (weight[:, a] * deviation[:, a]) for a in range(2))
    return np.linalg.solve(normal, right), normal


def parts(normal, shared=DENSE):
    return NormalMatrix(normal[:shared, :shared], normal[:shared, shared:], np.diag(normal)[shared:])


def test_influence_is_the_change_when_a_place_is_left_out():
    design, stage, angle, place, rows, prior, deviation = problem(1)
    theta, normal = fit(rows, prior, deviation, np.ones((CENTRES, 2)))
    residuals = np.stack([deviation[:, a] - rows[a] @ theta for a in range(2)], axis=1)
    found = influence(place, design, stage, angle, parts(normal), residuals, ASKED)
    assert len(found.place) == 12
    for name, moved in zip(found.place, found.influence, strict=True):
        without, _ = fit(rows, prior, deviation, (place != name).astype(float))
        assert moved == pytest.approx((theta - without)[:ASKED], abs=1e-10)


def test_equal_places_are_as_many_degrees_of_freedom_and_one_that_decides_is_one():
    _, stage, angle, _, _, _, deviation = problem(2)
    alike = tuple(np.ones((CENTRES, 1)) for _ in range(2))
    place = np.repeat(np.arange(9), 10)[:, None] * 2 + [0, 1]
    normal = parts(np.diag(np.r_[2.0 * CENTRES, np.full(ANGLES, 1e9)]), shared=1)
    found = influence(place, alike, 0.0 * stage, angle, normal, deviation, 1)
    assert 9.0 <= found.variance(0)[1] <= 18.0
    # what is seen in one place only cannot say how far it can be trusted
    lone = np.zeros((CENTRES, 1))
    lone[:10] = 1.0
    normal = parts(np.diag(np.r_[20.0, np.full(ANGLES, 1e9)]), shared=1)
    alone = influence(place, (lone, 0.0 * lone), 0.0 * stage, angle, normal, deviation, 1)
    assert alone.variance(0)[1] == pytest.approx(1.0)


def test_a_parameter_that_hangs_on_one_place_alone_is_refused():
    dense = np.ones((4, 1))
    place = np.tile([0, 1], (4, 1))
    with pytest.raises(NotMeasurableError, match="one place"):
        influence(
            place,
            (dense, 0.0 * dense),
            np.zeros((4, 2)),
            np.zeros(4, dtype=int),
            parts(np.diag([4.0, 1.0]), shared=1),
            np.ones((4, 2)),
            1,
        )


def test_the_matrix_in_parts_solves_as_the_whole_one():
    _, _, _, _, rows, prior, deviation = problem(3)
    theta, normal = fit(rows, prior, deviation, np.ones((CENTRES, 2)))
    right = normal @ theta
    assert parts(normal).solve(right) == pytest.approx(theta, rel=1e-9)
    assert parts(normal).covariance() == pytest.approx(np.linalg.inv(normal)[:DENSE], rel=1e-9, abs=1e-12)
