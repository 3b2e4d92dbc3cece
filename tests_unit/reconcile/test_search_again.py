"""Where a wrong name falls, who it hid is asked again; in the place of a name all that are like it are tried."""

from types import SimpleNamespace

import numpy as np
import pyarrow as pa
import pytest

from arl_fixtures.reconcile import search_again
from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.decide import Decision
from arl_fixtures.reconcile.fit import finish, fit
from arl_fixtures.reconcile.in_place import MOST_TRIED, _worth_trying
from arl_fixtures.reconcile.search import Search
from arl_fixtures.reconcile.search_again import name_who_was_hidden
from arl_fixtures.reconcile.table import columns_of

LIGHT_M_PER_S, TICKS_PER_S = 299_792_458.0, 2.0e12
WARM, CLOCK = "timing.temperature_offset", "timing.clock_scale"


def slow_clock_on_a_long_cable(slow=4e-4, seed=2):
    """A rangefinder that counts ticks of a clock `slow` by a share; its cable's delay grows with the temperature."""
    rng = np.random.default_rng(seed)
    step, row = (a.ravel() for a in np.meshgrid(np.arange(24), np.arange(120), indexing="ij"))
    celsius = (20.0 + 30.0 * np.sin(2.0 * np.pi * np.arange(24) / 24.0))[step]
    range_m = 2.0 + 18.0 * ((row * 37) % 120) / 119.0
    cable_s = 2.0e-12 * (celsius - 20.0)
    ticks = np.rint((2.0 * range_m / LIGHT_M_PER_S + cable_s) * TICKS_PER_S * (1.0 - slow))
    columns = {
        "step": step.astype(float), "time_s": 600.0 * step + row, "n_frames": np.full(step.size, 10.0),
        "tof_temperature_c": celsius, "true_range_m": range_m, "sim_distance_m": range_m,
        "sim_distance_m_std": np.full(step.size, 0.02),
        "distance_m": 0.5 * LIGHT_M_PER_S * ticks / TICKS_PER_S + rng.normal(0.0, 0.02 / np.sqrt(10.0), step.size),
    }  # fmt: skip
    return columns_of(pa.table(columns))


@pytest.mark.parametrize(("fell", "named"), [("air.multipath", {WARM, CLOCK}), ("", {WARM}), (CLOCK, {WARM})])
def test_what_a_fallen_name_had_hidden_is_found(fell, named):
    known = [library()[name] for name in (WARM, CLOCK)]
    search = Search(slow_clock_on_a_long_cable(), known)
    decision = Decision(search, search.run(), known)
    left = [t for t in decision.best.terms if t.effect.id == WARM]
    assert len(left) == 1
    decision.best = finish(decision.problem, fit(decision.problem, left))
    name_who_was_hidden(decision, frozenset({WARM, fell} - {""}))
    assert {t.effect.id for t in decision.best.terms} == named


def test_names_stand_as_before_where_nothing_of_a_further_look_does(monkeypatch):
    """What was found beside them falls by a law of its channel, and they with it."""
    known = [library()[name] for name in (WARM, CLOCK)]
    search = Search(slow_clock_on_a_long_cable(), known)
    decision = Decision(search, search.run(), known)
    both = decision.best.terms
    decision.best = finish(decision.problem, fit(decision.problem, [t for t in both if t.effect.id == WARM]))
    value = decision.best.terms[0].values["slope"]
    monkeypatch.setattr(search, "further", lambda *_, **__: finish(decision.problem, fit(decision.problem, both)))

    def all_fall(decision):
        if decision.best.terms:
            decision.keep(())
            return True
        return False

    monkeypatch.setattr(search_again, "drop_fallen", all_fall)
    name_who_was_hidden(decision, frozenset({WARM, "air.multipath"}))
    (left,) = decision.best.terms
    assert (left.effect.id, left.values["slope"]) == (WARM, pytest.approx(value, rel=1e-3))


def test_an_effect_known_to_be_like_a_name_is_tried_in_its_place_however_little_it_promises():
    def candidate(name):
        return SimpleNamespace(term=SimpleNamespace(effect=library()[name]))

    kinds = ("thermal.", "stage.", "mount.", "laser.", "readout.")
    others = [name for name in sorted(library()) if name.startswith(kinds)]
    assert len(others) > MOST_TRIED
    promising = [candidate(name) for name in others]
    last = [candidate("timing.tdc_nonlinearity"), candidate("detector.pile_up"), candidate("detector.pile_up")]
    tried = [c.term.effect.id for c in _worth_trying(candidate("timing.range_walk").term, [*promising, *last])]
    assert tried == [*others[:MOST_TRIED], "detector.pile_up"]
