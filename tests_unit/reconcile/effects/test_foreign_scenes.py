"""Scenes of which the table tells nothing but what they look like: a stepped wall with posts before it."""

import numpy as np
import pyarrow as pa
import pytest
from rendered_bench import corrected, left_over, variant_of

from arl_fixtures.reconcile.table import columns_of
from arl_fixtures.reconcile.view import View

RAYS = 201


def hall(seed):
    """Range (m) and reflectance over the bearing (degrees): a wall in nine steps, and four posts."""
    rng = np.random.default_rng(seed)
    steps, far, rho = np.sort(rng.uniform(-80, 80, 8)), rng.uniform(2.5, 4.0, 9), rng.uniform(0.1, 0.7, 9)
    posts = rng.uniform([-70, 0.4, 1.2, 0.1], [70, 1.25, 2.2, 0.9], (4, 4))

    def look(bearing):
        there = np.searchsorted(steps, bearing)
        range_m, reflectance = far[there], rho[there]
        for middle, half, near, bright in posts:
            on = np.abs(bearing - middle) < half
            range_m, reflectance = np.where(on, near, range_m), np.where(on, bright, reflectance)
        return range_m, reflectance

    return look


def swept(seed, shift, *, pitch, step):
    """A line of 16 pixels on a stage that stands `shift` degrees from where its angle says; 201 rays a pixel."""
    look = hall(seed)
    pixel, stage = (a.ravel() for a in np.meshgrid(np.arange(16.0), np.arange(-20.0, 20.1, step), indexing="ij"))
    azimuth = (pixel - 7.5) * pitch
    made = {"pixel_u": pixel, "azimuth_deg": azimuth, "stage_angle_deg": stage}
    across = (np.arange(RAYS) - RAYS // 2) / RAYS * pitch
    for name, angle in (("sim_", stage), ("", stage + shift)):
        range_m, reflectance = look((azimuth + angle)[:, None] + across)
        light = reflectance / range_m**2
        made[f"{name}intensity_counts"] = 3000.0 * light.mean(axis=1)
        made[f"{name}distance_m"] = np.sum(light * range_m, axis=1) / light.sum(axis=1)
    return View(columns_of(pa.table(made)))


@pytest.mark.parametrize(("pitch", "step"), [(0.94, 1.0), (2.3, 1.0), (2.3, 2.0), (3.7, 2.0)])
def test_a_displaced_stage_is_looked_up_in_the_scene_and_not_in_a_beam_that_is_none(pitch, step):
    left = []
    for seed in range(1, 6):
        view = swept(seed, 0.2, pitch=pitch, step=step)
        state = corrected(view, variant_of(view, "stage.zero_offset"), zero=0.2)
        left.append(left_over(view, state, "intensity_counts"))
    assert np.mean(left) < 0.1


@pytest.mark.parametrize(("pitch", "step"), [(2.0, 3.0), (1.4, 2.1)])
def test_samples_half_a_pixel_apart_tell_where_inside_a_pixel_an_edge_lies(pitch, step):
    """Straight lines would move the light of pixels beside an edge, too, and that of the edge too little."""
    told = []
    for seed in range(1, 6):
        view = swept(seed, 0.1, pitch=pitch, step=step)
        change = view.number("intensity_counts") - view.sim["intensity_counts"]
        state = corrected(view, variant_of(view, "stage.zero_offset"), zero=0.1)
        told.append(np.corrcoef(change, state["intensity_counts"] - view.sim["intensity_counts"])[0, 1])
    assert np.mean(told) > 0.8


def test_ranges_that_are_lost_at_edges_leave_those_beside_them_alone():
    """A pixel that sees two surfaces gives no range: the next one keeps that of its own surface."""
    view = swept(3, 0.1, pitch=2.3, step=1.0)
    table = {name: view.number(name) for name in ("pixel_u", "azimuth_deg", "stage_angle_deg", "intensity_counts")}
    look = hall(3)
    across = (np.arange(RAYS) - RAYS // 2) / RAYS * 2.3
    for name, turn in (("sim_", 0.0), ("", 0.1)):
        seen, _ = look((table["azimuth_deg"] + table["stage_angle_deg"] + turn)[:, None] + across)
        table[f"{name}distance_m"] = np.where(np.ptp(seen, axis=1) > 0.0, np.nan, seen.mean(axis=1))
        table[f"{name}intensity_counts"] = table.get(f"{name}intensity_counts", view.sim["intensity_counts"])
    lost = View(columns_of(pa.table(table)))
    state = corrected(lost, variant_of(lost, "stage.zero_offset"), zero=0.1)
    known = np.isfinite(lost.number("distance_m"))
    assert known.mean() > 0.3
    assert np.nanmax(np.abs(state["distance_m"] - lost.number("distance_m"))[known]) < 0.05
