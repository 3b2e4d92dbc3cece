"""What few rows say: it is not stretched beyond them, costs no other its name, and is said simply or not at all."""

from dataclasses import replace

import numpy as np
import pyarrow as pa

from arl_fixtures.reconcile import law_search
from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.features import features_of
from arl_fixtures.reconcile.law import Axis
from arl_fixtures.reconcile.law_bands import bands_of
from arl_fixtures.reconcile.law_fit import joint, weighed
from arl_fixtures.reconcile.law_work import Work
from arl_fixtures.reconcile.pilot import Looker
from arl_fixtures.reconcile.problem import Problem
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of
from arl_fixtures.reconcile.view import View


def test_one_edge_that_is_elsewhere_costs_no_gain_its_name(make_table):
    """A pixel at one angle sees a stripe's neighbour in all steps; a detector loses gain in the heat everywhere."""

    def moved(columns, _rng):
        columns["intensity_counts"] *= 1.0 - 7e-4 * (columns["tof_temperature_c"] - 25.0)
        place = (columns["pixel_u"] == columns["pixel_u"][3]) & (columns["pixel_v"] == columns["pixel_v"][3])
        columns["intensity_counts"][place & (columns["stage_angle_deg"] == columns["stage_angle_deg"][3])] *= 1.25

    columns = columns_of(pa.table(make_table(17, moved, duts=1)))
    known = [library()[n] for n in ("detector.gain_temperature", "detector.dark_offset", "target.non_lambertian")]
    findings = diagnose(columns, effects=known)[0].findings
    assert [f.effect for f in findings] == ["detector.gain_temperature", "unknown"]
    assert "tof_temperature_c" not in findings[1].drivers


def test_a_product_of_a_place_and_a_ramp_is_held_near_what_was_seen(make_table):
    """A corner of the image drifts once it is warm: ten times hotter nobody knows what it does."""

    def warm_corner(columns, _rng):
        hot = np.maximum(columns["tof_temperature_c"] - 40.0, 0.0)
        columns["distance_m"] += 1e-4 * hot * (columns["pixel_v"] < 10.0)

    columns = columns_of(pa.table(make_table(19, warm_corner, duts=1)))
    law = next(f.law for f in diagnose(columns, effects=[])[0].findings if f.law is not None)
    seen = features_of(View(columns))
    beyond = {n: 10.0 * x if n.endswith("temperature_c") else x for n, x in seen.items()}
    largest = [float(np.max(np.abs(law.correction(x, np.ones(columns.n))))) for x in (seen, beyond)]
    assert 2e-3 < largest[0] < 8e-3
    assert largest[1] < 3.0 * largest[0]


def test_a_factor_that_costs_more_than_it_earns_leaves_a_law_again(make_table, monkeypatch):
    """A buffer that comes every second frame is late; the search has taken a ramp over the temperature with it."""

    def late_buffer(columns, _rng):
        frame = np.unique(columns["step"] * 100.0 + columns["stage_angle_deg"], return_inverse=True)[1]
        columns["buffer_id"] = np.asarray(frame % 2, dtype=float)
        columns["distance_m"] += 8e-4 * columns["buffer_id"]

    narrowed = law_search.narrowed

    def with_a_ramp(work, chosen, factors):
        chosen = narrowed(work, chosen, factors)
        if [t.basis.columns for t in chosen.terms] != [("buffer_id",)]:
            return chosen
        basis = chosen.terms[0].basis
        ramp = Axis(column="tof_temperature_c", kind="below", middle=40.0, width=100.0, at=110.0)
        more = replace(basis, axes=(*basis.axes, ramp), price=basis.price + law_search.PRICE_FACTOR)
        return joint(work, [weighed(work, more, work.residual)])

    monkeypatch.setattr(law_search, "narrowed", with_a_ramp)
    findings = diagnose(columns_of(pa.table(make_table(2, late_buffer, duts=1))), effects=[])[0].findings
    assert [(f.effect, f.drivers) for f in findings] == [("unknown", ["buffer_id"])]


def test_between_two_ratios_of_neighbours_lies_no_band(make_table):
    """A handful of places does, and quite others where the stage stops elsewhere."""

    def one_place(columns, _rng):
        there = (columns["pixel_u"] == columns["pixel_u"][3]) & (columns["stage_angle_deg"] == 0.0)
        columns["intensity_counts"][there] *= 1.25

    looker = Looker(Problem(columns_of(pa.table(make_table(17, one_place, duts=1)))))
    light = next(d for d in looker.problem.data if d.channel.name == "intensity_counts")
    work = Work(light, looker.problem.view.fresh_state(), looker.features, light.tau)
    beside = [name for name in work.features if name.startswith("~sweep")]
    assert beside
    assert {b.columns for b in bands_of(work, [*beside, "pixel_u"], [])} >= {("pixel_u",)}
    assert not any(set(b.columns) & set(beside) for b in bands_of(work, [*beside, "pixel_u"], []))
