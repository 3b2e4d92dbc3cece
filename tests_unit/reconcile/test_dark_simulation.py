"""A simulation that is dark everywhere: nothing scales with it, and no warning reaches who runs the tool."""

import numpy as np
import pytest
from rendered_bench import make_columns

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.effects_common import noise_law
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.view import View


def test_light_that_is_not_simulated_is_unknown_and_gives_no_warnings():
    rng = np.random.default_rng(8)
    step, place = (a.ravel() for a in np.meshgrid(np.arange(6.0), np.linspace(-30.0, 30.0, 41), indexing="ij"))
    celsius = 10.0 * step
    table = make_columns(
        {
            "step": step, "stage_angle_deg": place, "housing_temperature_c": celsius,
            "n_frames": np.full(step.size, 4.0), "sim_intensity_counts": np.zeros(step.size),
            "sim_intensity_counts_std": np.full(step.size, 2.0),
            "intensity_counts": 40.0 + 10.0 * np.sin(place) + rng.normal(size=step.size),
        },
        {},
    )[0]  # fmt: skip
    assert noise_law(View(table), "intensity_counts") == pytest.approx((4.0, 0.0, 0.0))
    found = diagnose(table, effects=[library()["detector.gain_temperature"]])[0].findings
    assert [f.effect for f in found] == ["unknown"]
