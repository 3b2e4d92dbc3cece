"""Effects enter the twin in their order, and see the circumstances under the names of the observation table."""

import dataclasses

from arl_fixtures.twin.conditions import Conditions, altered
from arl_fixtures.twin.frame import Renderer
from arl_fixtures.twin.settings import DutSettings

EXPECTED = Renderer(DutSettings(serial="C")).expected(0.0)


class Rolloff:
    def alter(self, expected, conditions):
        factor = 1 - 0.001 * (conditions.housing_temperature_c - 25)
        return dataclasses.replace(expected, intensity_counts=expected.intensity_counts * factor)


class Offset:
    def alter(self, expected, conditions):
        return dataclasses.replace(expected, intensity_counts=expected.intensity_counts + 10)


def test_models_apply_one_after_the_other():
    warm = Conditions(housing_temperature_c=75.0)
    result = altered(EXPECTED, warm, (Rolloff(), Offset())).intensity_counts
    assert abs(result - (EXPECTED.intensity_counts * 0.95 + 10)).max() < 1e-3
    other = altered(EXPECTED, warm, (Offset(), Rolloff())).intensity_counts
    assert abs(other - (EXPECTED.intensity_counts + 10) * 0.95).max() < 1e-3


def test_covariates_bear_the_names_of_the_observation_table():
    conditions = Conditions(cycle=3, ramp=-1, housing_temperature_c=40.0, operating={"tec_current_a": 0.45})
    covariates = conditions.covariates()
    assert covariates["cycle"] == 3.0
    assert covariates["ramp"] == -1.0
    assert covariates["housing_temperature_c"] == 40.0
    assert covariates["tec_current_a"] == 0.45
