"""Light that turns with the stage, seen by pixels that face the target at few angles each: no picture of the lens."""

import numpy as np
import pyarrow as pa

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of

RIVALS = [
    library()[name]
    for name in (
        "optics.vignetting", "beam.profile_change", "detector.pixel_response", "detector.gain_temperature",
        "target.reflectance_error",
    )
]  # fmt: skip


def polarised(seed, share, pattern=0.0):
    """A flash sensor of 40 by 8 pixels looks at a board 36° wide; a cover turns the light's polarisation with it."""
    rng = np.random.default_rng(seed)
    stage = np.linspace(-48.0, 48.0, 13)
    step, place, u, v = (
        part.ravel() for part in np.meshgrid(np.arange(8), np.arange(13), np.arange(40), np.arange(8), indexing="ij")
    )
    azimuth = 3.0 * (u - 19.5)
    on_board = np.abs(azimuth + stage[place]) < 18.0
    keep = on_board & (rng.random((13, 40, 8)) < 0.25)[place, u, v]
    step, place, u, v, azimuth = (x[keep] for x in (step, place, u, v, azimuth))
    light = 1500.0 * np.exp(-((azimuth / 75.0) ** 4)) * np.where((place + u) % 3 == 0, 0.3, 1.0)
    kept = 1.0 + share * np.cos(2.0 * np.radians(stage[place] - 11.0))
    kept = kept * (1.0 + pattern * rng.normal(size=(40, 8)))[u, v]
    sigma = np.sqrt(40.0 + 0.3 * light)
    shared = 1.0 + 0.003 * rng.normal(size=8)[step]
    return columns_of(pa.table({
        "step": step, "housing_temperature_c": 5.0 * step + 0.1 * rng.normal(size=8)[step], "pixel_u": u,
        "pixel_v": v, "azimuth_deg": azimuth, "elevation_deg": 2.0 * (v - 3.5), "stage_angle_deg": stage[place],
        "n_frames": np.full(step.size, 20), "sim_intensity_counts": light, "sim_intensity_counts_std": sigma,
        "sim_intensity_counts_repeat_std": 0.003 * light,
        "intensity_counts": light * kept * shared + sigma / np.sqrt(20.0) * rng.normal(size=step.size),
    }))  # fmt: skip


def test_light_that_turns_with_the_stage_is_no_fall_off_of_the_lens():
    found = diagnose(polarised(1, 0.004), effects=RIVALS)[0].findings
    assert [f.effect for f in found] == ["unknown"]
    assert found[0].drivers[0] == "stage_angle_deg"


def test_pixels_that_differ_are_still_pixels():
    (found,) = diagnose(polarised(3, 0.0, pattern=0.004), effects=RIVALS)[0].findings
    assert found.effect == "detector.pixel_response"
