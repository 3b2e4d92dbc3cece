"""Targets and air: operators against rough diffusers, echoes and light that bounced twice."""

import numpy as np
import pytest
from operator_tables import fit, table
from rendered_bench import bench, corrected, left_over, variant_of

from arl_fixtures.reconcile.view import View

LIGHT, RANGE = "intensity_counts", "distance_m"


def test_a_rough_diffuser_is_within_reach_of_the_non_lambertian_family():
    angle = np.linspace(0.0, 60.0, 200)
    a = np.radians(angle)
    rough = np.radians(20.0) ** 2  # Oren-Nayar, source and eye together
    relative = 1.0 - 0.5 * rough / (rough + 0.33) + 0.45 * rough / (rough + 0.09) * np.sin(a) * np.tan(a)
    relative /= relative[0]
    plain = 1000.0 * np.cos(a)
    view = table(incidence_deg=angle, sim_signal_counts=plain, signal_counts=plain * relative)
    variant = variant_of(view, "target.non_lambertian", surface="")
    values = fit(view, variant, "signal_counts", {"oblique": 0.1, "lobe": 0.01, "sharpness": 12.0})
    assert left_over(view, corrected(view, variant, **values), "signal_counts") < 0.03


def test_at_an_edge_the_stronger_echo_can_win():
    view = View(bench())
    # one pixel, two echoes: the sensor reports the range of the stronger one instead of the light-weighted mean
    wall = np.abs(view.sim[RANGE] - 1.6) < 0.02
    border = view.selects("mixed", "true") & ~wall & (view.sim[RANGE] > 1.12) & (view.sim[RANGE] < 1.59)
    assert border.sum() > 50
    share_near = (1.603 - view.sim[RANGE]) / (1.603 - 1.104)
    winner = np.where(share_near > 0.5, 1.104, 1.603)
    state = corrected(view, variant_of(view, "target.edge_mixing", kind="dominant"), share=1.0)
    off = np.abs(state[RANGE] - winner)[border]
    assert np.median(off) < 0.01
    assert np.mean(off < 0.05) > 0.85


def test_light_that_lights_other_targets_lengthens_all_ranges_and_most_beside_bright_ones():
    view = View(bench())
    state = corrected(view, variant_of(view, "air.multipath", source="room"), share=0.02)
    longer = state[RANGE] - view.sim[RANGE]
    assert longer.min() > 0.0
    brighter = state[LIGHT] / view.sim[LIGHT] - 1.0
    assert brighter.mean() == pytest.approx(0.02, rel=0.15)
    bearing = view.number("azimuth_deg") + view.number("stage_angle_deg")
    far_off, beside = longer[np.abs(bearing) > 18.0].mean(), longer[np.abs(bearing - 7.5) < 2.0].mean()
    assert far_off > beside  # the way to the bright panels and back is longer from there


def test_a_surface_beside_the_beam_is_a_longer_way_mostly_at_short_range():
    truth = np.linspace(0.3, 6.0, 200)
    bounced = 0.5 * (truth + np.sqrt(truth**2 + 4.0 * 0.5**2))  # there straight, back over a mirror 0.5 m below
    part = 0.05 * (truth / np.sqrt(truth**2 + 1.0)) ** 2
    view = table(sim_distance_m=truth, distance_m=(truth + part * bounced) / (1.0 + part))
    state = corrected(view, variant_of(view, "air.multipath", source="side"), share=0.05, height=0.5)
    assert left_over(view, state, "distance_m") < 1e-6


def test_a_receiver_that_gathers_all_light_sees_the_surface_beside_the_beam_in_its_signal_too():
    truth = np.linspace(0.3, 4.0, 120)
    time = np.linspace(-4e-9, 45e-9, 2500)

    def echo(way):  # a pulse of 1.1 ns on its way there and back
        return np.exp(-0.5 * ((time - 2.0 * way[:, None] / 299_792_458.0) / 1.1e-9) ** 2)

    part = 0.03 * (truth / np.sqrt(truth**2 + 4.0 * 0.4**2)) ** 2  # the longer way, weaker by its square
    wave = 800.0 * (echo(truth) + part[:, None] * echo(0.5 * (truth + np.sqrt(truth**2 + 4.0 * 0.4**2))))
    direct = 800.0 * echo(truth)
    centre = 0.5 * 299_792_458.0 * (wave @ time) / wave.sum(axis=1)
    plain, seen = direct.sum(axis=1), wave.sum(axis=1)
    view = table(sim_distance_m=truth, distance_m=centre, sim_signal_counts=plain, signal_counts=seen)
    state = corrected(view, variant_of(view, "air.multipath", source="side", lit=True), share=0.03, height=0.4)
    assert left_over(view, state, "signal_counts") < 1e-3
    assert left_over(view, state, "distance_m") < 1e-3
