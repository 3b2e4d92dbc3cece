"""A beam that moves, of which a table holds few pixels: what lies between them is read off a plain profile."""

import numpy as np
import pytest
from operator_tables import table
from rendered_bench import corrected, left_over, variant_of


def beam(azimuth, elevation):
    return np.exp(-((azimuth / 75.0) ** 4) - (elevation / 18.0) ** 4)


@pytest.mark.parametrize("pixels", [9, 14])
def test_a_moved_beam_over_few_pixels_is_the_profile_seen_from_aside(pixels):
    rng = np.random.default_rng(4)
    looks = rng.uniform((-58.0, -12.5), (58.0, 12.5), (pixels, 2))
    angle, pixel = (a.ravel() for a in np.meshgrid(np.arange(7) * 9.0, np.arange(pixels), indexing="ij"))
    azimuth, elevation = looks[pixel].T
    paint = rng.choice([0.06, 0.18, 0.5, 0.8], angle.size)
    light = 3000.0 * paint * np.cos(np.radians(elevation))
    view = table(
        stage_angle_deg=angle, azimuth_deg=azimuth, elevation_deg=elevation, reflectance=paint,
        incidence_deg=np.abs(elevation), true_range_m=np.ones(angle.size),
        sim_intensity_counts=light * beam(azimuth, elevation),
        intensity_counts=light * beam(azimuth - 0.8, elevation + 0.5),
    )  # fmt: skip
    state = corrected(view, variant_of(view, "beam.profile_shift", driver=""), shift_az=0.8, shift_el=-0.5)
    assert left_over(view, state, "intensity_counts") < 0.01
