"""The twin with found effects: what a model file says is what the frames show."""

import numpy as np
import pytest

from arl_fixtures.bench.config import load_bench
from arl_fixtures.bench.twins import twins_of
from arl_fixtures.errors import ConfigError, DataError
from arl_fixtures.twin.conditions import Conditions

GAIN = """
schema: arl-model/1
effects:
- effect: detector.gain_temperature
  options: {channel: intensity_counts, temperature: tof_temperature_c, reference: 34.0}
  values: {slope: -0.002, curvature: 0.0}
  channels: [intensity_counts]
  drivers: [tof_temperature_c]
"""


@pytest.fixture
def model(tmp_path):
    path = tmp_path / "model.yaml"
    path.write_text(GAIN)
    return path


def at(tof_c):
    return Conditions(stage_angle_deg=3.0, housing_temperature_c=tof_c - 9, operating={"tof_temperature_c": tof_c})


@pytest.mark.parametrize("tof_c", [-1.0, 34.0, 94.0])
def test_intensity_follows_the_model_and_distance_stays(model, tof_c):
    config = load_bench("emulated")
    for serial, twin in twins_of(config, model).items():
        nominal = twins_of(config)[serial].expected(3.0)
        found = twin.expected(3.0, at(tof_c))
        factor = 1 - 0.002 * (tof_c - 34.0)
        np.testing.assert_allclose(found.intensity_counts, nominal.intensity_counts * factor, rtol=1e-5)
        np.testing.assert_allclose(found.distance_m, nominal.distance_m, rtol=1e-6)


def test_a_driver_that_is_not_known_is_refused(model):
    twin = next(iter(twins_of(load_bench("emulated"), model).values()))
    with pytest.raises(DataError, match="tof_temperature_c"):
        twin.expected(3.0)


def test_an_effect_outside_the_library_is_refused(model):
    model.write_text(GAIN.replace("detector.gain_temperature", "detector.gain_moonlight"))
    twin = next(iter(twins_of(load_bench("emulated"), model).values()))
    with pytest.raises(ConfigError, match=r"'detector\.gain_moonlight' is not in the library"):
        twin.expected(3.0, at(34.0))
