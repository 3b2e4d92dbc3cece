"""A few readings in a thousand that are off by far, alone: they are nobody's missing physics, and hide none."""

import numpy as np
import pyarrow as pa
import pytest

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.lonely import Kin, common_part, distance_alone
from arl_fixtures.reconcile.pilot import Looker
from arl_fixtures.reconcile.problem import Problem
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of
from arl_fixtures.reconcile.terms import forward


def wild_table(make_table, seed, *, share=0.002, change=None, steps=8):
    """A bench's table in which some readings, any of them, are off by 10 to 40 standard errors."""
    columns = make_table(seed, change, duts=1, steps=steps)
    rng = np.random.default_rng(seed)
    for name in ("intensity_counts", "distance_m"):
        off = rng.random(columns[name].size) < share
        far = rng.choice([-1.0, 1.0], off.sum()) * rng.uniform(10.0, 40.0, off.sum())
        columns[name][off] += far * columns[f"sim_{name}_std"][off] / np.sqrt(10.0)
    return columns


@pytest.mark.parametrize("seed", [81, 83])
def test_a_few_wild_readings_are_no_finding(make_table, seed):
    assert diagnose(columns_of(pa.table(wild_table(make_table, seed))))[0].findings == []


def test_what_acts_beside_wild_readings_is_named(make_table):
    def late(columns, rng):
        columns["distance_m"] += 4e-5 * (columns["tof_temperature_c"] - 25.0)

    columns = columns_of(pa.table(wild_table(make_table, 85, share=0.004, change=late)))
    known = [library()[n] for n in ("timing.temperature_offset", "optics.window_contamination", "air.multipath")]
    findings = diagnose(columns, effects=known)[0].findings
    assert [f.effect for f in findings] == ["timing.temperature_offset"]
    slope = next(p for p in findings[0].parameters if p.name == "slope")
    assert slope.low < 4e-5 < slope.high


def test_only_what_is_off_alone_is_held_back(make_table):
    def stained(columns, rng):
        here = columns["pixel_u"] == columns["pixel_u"][0]
        columns["intensity_counts"][here] *= 0.8

    columns = make_table(87, stained, duts=1, steps=8)
    lone = np.flatnonzero(columns["pixel_u"] != columns["pixel_u"][0])[40]
    columns["intensity_counts"][lone] += 15.0 * columns["sim_intensity_counts_std"][lone] / np.sqrt(10.0)
    pixel = columns["pixel_u"] == columns["pixel_u"][0]
    problem = Problem(columns_of(pa.table(columns)))
    light = next(d for d in problem.data if d.channel.name == "intensity_counts")
    Looker(problem).calibrate(light, forward([], problem.view))
    assert light.trust[light.use == lone] < 0.05
    assert np.median(light.trust[np.isin(light.use, np.flatnonzero(pixel))]) == 1.0


def test_rows_of_a_kind_and_neighbours_stand_by_a_far_one():
    rng = np.random.default_rng(3)
    z, pixel, order = rng.normal(size=600), np.arange(600) % 20, np.arange(600)
    z[40] = 30.0
    alone = distance_alone(z, Kin(kinds=[pixel], lines=[order]))
    assert alone[40] > 25.0
    z[38:43] = 28.0  # a burst
    assert distance_alone(z, Kin(kinds=[pixel], lines=[order]))[40] > 25.0
    z[36:45] = 29.0  # a spot in the image
    assert distance_alone(z, Kin(kinds=[pixel], lines=[order]))[40] < 5.0
    z = rng.normal(size=600)
    z[pixel == 7] += 30.0  # a pixel in all steps
    assert np.max(distance_alone(z, Kin(kinds=[pixel], lines=[order]))[pixel == 7]) < 5.0


def test_what_an_image_shares_it_shares_with_nearly_all_of_its_rows():
    rng = np.random.default_rng(8)
    z, image = rng.normal(size=90), np.repeat(np.arange(10), 9)
    z[image == 3] += 30.0  # the image
    z[np.flatnonzero(image == 6)[:5]] = [578.0, 379.0, 717.0, 353.0, 875.0]  # a burst in another
    shared = common_part(image, z, 10)
    assert shared[3] == pytest.approx(30.0, abs=1.0)
    assert shared[6] == 0.0
    alone = distance_alone(z, Kin(images=[image]))
    assert alone[image == 3].max() < 5.0
    assert alone[np.flatnonzero(image == 6)[:5]].min() > 300.0


def test_light_that_comes_again_at_two_angles_is_no_tail(make_table):
    """Another sensor shines into one of three at two of seven stage angles, the same in every step."""

    def stray(columns, _rng):
        seen = (columns["dut"] == "S1") & (np.abs(columns["stage_angle_deg"] - 4.0) < 5.0)
        columns["intensity_counts"] += 60.0 * seen

    table = make_table(5, stray, duts=3, steps=5)
    columns = columns_of(pa.table({name: x for name, x in table.items() if "distance_m" not in name}))
    problem = Problem(columns)
    d = next(d for d in problem.data if d.channel.name == "intensity_counts")
    Looker(problem).calibrate(d, problem.view.fresh_state())
    code, labels = problem.view.codes("dut")
    at = problem.view.number("stage_angle_deg")[d.use]
    hit = (np.asarray(labels)[code][d.use] == "S1") & (np.abs(at - 4.0) < 5.0)
    assert np.mean(d.trust[hit]) > 0.9
    findings = diagnose(columns)[0].findings
    assert [f.effect for f in findings] == ["unknown"]
    assert set(findings[0].drivers[:2]) == {"stage_angle_deg", "dut"}
