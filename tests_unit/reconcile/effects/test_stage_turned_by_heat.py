"""A stage that is swept one way only, and whose zero depends on whether the chamber heats or cools."""

import numpy as np
import pytest
from operator_tables import fit, table
from rendered_bench import variant_of

TURN_DEG, WALL_M = 0.06, 3.0


def swept(ramps):
    """Seven pixels before a flat wall, eight sweeps upwards; the true angle lies on either side of what is read."""
    step, angle, pixel = (
        a.ravel() for a in np.meshgrid(np.arange(8), np.arange(-30.0, 31.0, 3.0), np.arange(7), indexing="ij")
    )
    azimuth, ramp = 3.0 * (pixel - 3.0), ramps[step]

    def seen(stage):
        return WALL_M / np.cos(np.radians(azimuth + stage))

    return table(
        step=step, ramp=ramp, time_s=1000.0 * step + 2.0 * (angle + 30.0), stage_angle_deg=angle, pixel_u=pixel,
        azimuth_deg=azimuth, sim_distance_m=seen(angle), distance_m=seen(angle + TURN_DEG * ramp),
        sim_intensity_counts=1000.0 / seen(angle) ** 2,
    )  # fmt: skip


def test_heating_and_cooling_turn_the_stage_apart():
    view = swept(np.repeat([1.0, -1.0], 4))
    variant = variant_of(view, "stage.zero_offset", kind="backlash", by="ramp")
    values = fit(view, variant, "distance_m", {"backlash": 0.01}, scale=np.full(view.n, 1e-3))
    assert values["backlash"] == pytest.approx(2.0 * TURN_DEG, rel=0.03)
    assert variant.drivers == ("ramp", "stage_angle_deg")


def test_a_table_that_only_heats_tells_no_such_thing():
    with pytest.raises(LookupError, match="no variant"):
        variant_of(swept(np.ones(8)), "stage.zero_offset", kind="backlash", by="ramp")
