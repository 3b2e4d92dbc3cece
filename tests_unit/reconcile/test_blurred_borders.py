"""A wider point spread in tables of few pixels: what each sees of two surfaces, by rays that are traced here."""

import numpy as np
import pytest
from rendered_bench import make_columns

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.effects_pulled import pulled_channels
from arl_fixtures.reconcile.effects_sides import part_of, sides_of
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.view import View

PITCH_DEG, SHARP_PX, WALL_M, STRIPES_M = 1.0, 0.22, 1.6, 1.1
EDGES_DEG = (-9.7, -5.1, -2.3, 2.6, 4.4, 8.9)
"""Where three stripes begin and end."""
PAINT = (0.18, 0.5, 0.8)
NAMES = ("wall", "stripe_18", "stripe_50", "stripe_80")


def seen(bearing_deg, blur_px, beyond=0.0):
    """Light, range by light and what each surface fills of pixels: 801 rays through pixel and point spread.

    `beyond`: share of the light that comes in turn from the other surfaces of the pixel, as they fill the rest.
    """
    rays = np.linspace(-1.5, 1.5, 801)
    inside = np.abs(rays[:, None] - np.linspace(-0.5, 0.5, 201)[None, :])
    weight = np.exp(-0.5 * (inside / blur_px) ** 2).sum(axis=1)
    weight /= weight.sum()
    where = bearing_deg[:, None] + PITCH_DEG * rays[None, :]
    which = np.searchsorted(EDGES_DEG, where)
    which = np.where(which % 2 == 1, (which + 1) // 2, 0)
    level = 2000.0 * np.array([0.2, *PAINT]) / np.array([WALL_M, *[STRIPES_M] * 3]) ** 2
    facing = np.cos(np.radians(where))
    fills = np.stack([np.sum(weight * (which == one), axis=1) for one in range(4)])
    light = np.sum(weight * level[which] * facing, axis=1)
    moment = np.sum(weight * level[which] * facing * np.where(which > 0, STRIPES_M, WALL_M), axis=1)
    if beyond:
        most = np.argmax(fills, axis=0)
        two = fills.max(axis=0) < 1.0 - 1e-4
        other = np.argmax(np.where(np.arange(4)[:, None] == most, -1.0, fills), axis=0)
        more = np.where(two, beyond * level[other], 0.0)
        light, moment = (1.0 - beyond * two) * light + more, (1.0 - beyond * two) * moment + more * np.where(
            other > 0, STRIPES_M, WALL_M
        )
    return light, moment / light, fills


def few_pixels(real, seed, turn_deg=1.1, apart=4.0):
    """Columns, few and far apart if nothing else is said, and four rows, at many stage angles and three steps."""
    axes = np.arange(3.0), np.arange(-13.2, 13.3, turn_deg), np.arange(0.0, 16.0, 5.0), np.arange(24.0, 41.0, apart)
    step, stage, v, u = (axis.ravel() for axis in np.meshgrid(*axes, indexing="ij"))
    azimuth = PITCH_DEG * (u - 31.5)
    light, far, fills = seen(azimuth + stage, SHARP_PX)
    found, found_far, _ = real(azimuth + stage)
    rng, sigma = np.random.default_rng(seed), 4.0 + 0.1 * np.sqrt(light)
    numbers = {
        "step": step, "stage_angle_deg": stage, "pixel_u": u, "pixel_v": v, "azimuth_deg": azimuth,
        "n_frames": np.full(u.size, 25.0), "sim_intensity_counts": light, "sim_distance_m": far,
        "sim_intensity_counts_std": sigma, "sim_distance_m_std": np.full(u.size, 0.004),
        "intensity_counts": found + sigma / 5.0 * rng.normal(size=u.size),
        "distance_m": found_far + 0.004 / 5.0 * rng.normal(size=u.size),
    }  # fmt: skip
    labels = {
        "dut": np.full(u.size, "A"),
        "surface": np.array(NAMES)[np.argmax(fills, axis=0)],
        "mixed": np.where(fills.max(axis=0) < 1.0 - 1e-4, "true", "false"),
    }
    return make_columns(numbers, labels)[0]


@pytest.mark.parametrize("width_px", [0.11, 0.2])
def test_a_blur_between_pixels_that_lie_apart_is_told_from_mixing_by_how_full_they_are(width_px):
    columns = few_pixels(lambda bearing: seen(bearing, np.hypot(SHARP_PX, width_px)), 1)
    effects = [library()[name] for name in ("target.edge_mixing", "optics.defocus", "detector.crosstalk")]
    found = diagnose(columns, effects=effects)[0].findings
    assert [f.effect for f in found] == ["optics.defocus"]
    width = next(p for p in found[0].parameters if p.name == "width")
    assert width.value == pytest.approx(width_px, rel=0.35)  # the blur that was there is not in the table


def test_light_from_beyond_whatever_a_pixel_sees_is_no_blur():
    columns = few_pixels(lambda bearing: seen(bearing, SHARP_PX, beyond=0.03), 2)
    effects = [library()[name] for name in ("target.edge_mixing", "optics.defocus", "detector.crosstalk")]
    assert [f.effect for f in diagnose(columns, effects=effects)[0].findings] == ["target.edge_mixing"]


def test_the_simulated_light_tells_how_much_of_a_pixel_lies_beyond_a_border():
    view = View(few_pixels(lambda bearing: seen(bearing, SHARP_PX), 3))
    part = part_of(sides_of(view), view, "intensity_counts", pulled_channels(view))
    _, _, fills = seen(view.number("azimuth_deg") + view.number("stage_angle_deg"), SHARP_PX)
    other = 1.0 - fills.max(axis=0)
    known = np.isfinite(part)
    assert known.sum() > 0.9 * np.sum(view.selects("mixed", "true"))
    assert np.quantile(np.abs(part - other)[known], 0.9) < 0.03


@pytest.mark.parametrize(("means", "follow"), [(True, ("distance_m",)), (False, ())])
def test_ranges_that_are_called_true_may_be_means_of_what_a_pixel_sees(means, follow):
    columns = few_pixels(lambda bearing: seen(bearing, SHARP_PX), 5)
    if not means:  # a simulation of middle rays, whose ranges lie on one surface or the other
        wall = np.array(columns.categories["surface"][1])[columns.categories["surface"][0]] == "wall"
        columns.numbers["sim_distance_m"] = np.where(wall, WALL_M, STRIPES_M)
    columns.numbers["true_range_m"] = columns.numbers["sim_distance_m"].copy()
    assert pulled_channels(View(columns)) == follow


def test_a_blur_that_reaches_over_edges_is_found_though_a_small_one_does_nothing():
    """Most rays are no border's: until the blur is as wide as the way to the next one, none of them shows it."""
    columns = few_pixels(lambda bearing: seen(bearing, np.hypot(SHARP_PX, 0.35)), 4, turn_deg=3.3, apart=1.0)
    effects = [library()[name] for name in ("target.edge_mixing", "optics.defocus", "detector.crosstalk")]
    found = diagnose(columns, effects=effects)[0].findings
    assert [f.effect for f in found] == ["optics.defocus"]
