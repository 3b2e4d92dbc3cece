"""What happens under one condition only is one thing, however many terms it takes to say it.

A firmware that forgets to interpolate makes steps over a temperature and leaves a slope. A drift of all devices says
the slope, and the steps alone would stand beside it.
"""

from types import SimpleNamespace

import numpy as np
import pytest

from arl_fixtures.reconcile import standing
from arl_fixtures.reconcile.law import Axis
from arl_fixtures.reconcile.law_basis import Basis
from arl_fixtures.reconcile.law_fit import Chosen
from arl_fixtures.reconcile.law_work import Candidate

MARK = Axis(column="firmware", kind="is", label="2.1")
OTHER = Axis(column="firmware", kind="is", label="1.9")
SLOPE = Axis(column="fpga_temperature_c", kind="linear", middle=25.0, width=80.0)
STEPS = Axis(column="set_temperature_c", kind="above", at=25.0, width=80.0)
WAVE = Axis(column="set_temperature_c", kind="sin", width=8.0)


def stands(monkeypatch, *products, only=""):
    """Whether names stand beside a law of these terms, of which what they do not tell gains all that is needed."""
    monkeypatch.setattr(standing, "forward", lambda *_: {})
    monkeypatch.setattr(standing, "gain_of_others", lambda *_: 50.0)
    empty = np.zeros((1, 1))
    terms = [
        Candidate(basis=Basis(axes=p) if isinstance(p, tuple) else p, vectors=empty, gram=empty, gain=1.0, width=1.0)
        for p in products
    ]
    chosen = Chosen(terms=terms)
    chosen.plain = 40.0
    here = standing.Standing.__new__(standing.Standing)
    here.decision = SimpleNamespace(best=SimpleNamespace(terms=()))
    here.problem, here.looker = SimpleNamespace(view=None), None
    name = SimpleNamespace(unit_column=only, variant=SimpleNamespace(drivers=("fpga_temperature_c",)))
    return here._stands_beside(None, [name], standing._Rival(None, chosen, lambda others: 8.0 + others))


def test_names_of_all_rows_do_not_stand_beside_what_one_firmware_does(monkeypatch):
    assert not stands(monkeypatch, (STEPS, MARK), (SLOPE, MARK))
    assert not stands(monkeypatch, Basis(waves=((WAVE, MARK),)), (SLOPE, MARK))


@pytest.mark.parametrize("products", [[(STEPS, MARK), (SLOPE,)], [(STEPS, MARK)], [(STEPS, MARK), (SLOPE, OTHER)]])
def test_they_do_beside_what_happens_there_or_elsewhere_too(monkeypatch, products):
    assert stands(monkeypatch, *products)


def test_a_name_of_that_firmware_alone_does(monkeypatch):
    assert stands(monkeypatch, (STEPS, MARK), (SLOPE, MARK), only="firmware")


@pytest.mark.parametrize(("plain", "needed", "beats"), [(1.4, -0.3, False), (9.0, -0.3, True), (9.0, 12.0, False)])
def test_a_law_of_next_to_nothing_beats_no_name_that_acts_in_another_channel(plain, needed, beats):
    chosen = Chosen(terms=[])
    chosen.plain, chosen.z = plain, 2.4
    assert standing.is_rival(chosen, needed) is beats
