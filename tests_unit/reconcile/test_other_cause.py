"""Two causes, of which one is no effect, against one law of all that a channel has."""

from types import SimpleNamespace

import numpy as np
import pytest

from arl_fixtures.reconcile import other_cause
from arl_fixtures.reconcile.law import Law
from arl_fixtures.reconcile.law_fit import Chosen

LEFT, ALL = 586.0, 3221.0
"""Log-likelihoods of a law of what a name leaves and of one of all: a gain that was switched between two signals."""


@pytest.fixture
def stands(monkeypatch):
    """Whether a name of so much stands beside a law of the signal, where one law of the signal says all."""

    def term(gain, likelihood):
        basis = SimpleNamespace(columns=("sim_intensity_counts",))
        return Chosen(
            terms=[SimpleNamespace(basis=basis)], values=[np.ones(1)], held=gain, rows=50.0, z=9.0,
            likelier=likelihood, plain=likelihood,
        )  # fmt: skip

    rest = Law(channel="intensity_counts", relative=True, terms=[], drivers=["sim_intensity_counts"], gain=LEFT)
    rest.law_gain = LEFT
    monkeypatch.setattr(Law, "correction", lambda *_: np.zeros(4))
    monkeypatch.setattr(other_cause, "forward", lambda terms, _: {"intensity_counts": np.full(4, float(len(terms)))})

    def ask(named):
        found = {1.0: (rest, term(LEFT, LEFT)), 0.0: (rest, term(ALL, ALL))}
        monkeypatch.setattr(other_cause, "search_law", lambda _l, _d, state, _n: found[state["intensity_counts"][0]])
        variant = SimpleNamespace(drivers=("incidence_deg",), options={})
        name = SimpleNamespace(variant=variant, free=lambda: (), effect=SimpleNamespace(id="target.non_lambertian"))
        channel = SimpleNamespace(
            channel=SimpleNamespace(name="intensity_counts"), use=np.arange(4), scale=np.ones(4),
            residual=lambda state: state["intensity_counts"][0], fit_scatter=lambda left: (named * left, None),
        )  # fmt: skip
        looker = SimpleNamespace(features={}, problem=SimpleNamespace(view=SimpleNamespace(has=lambda _: False)))
        left = SimpleNamespace(gain=600.0, leading=lambda: [])
        state = {"intensity_counts": np.ones(4)}
        bare = {"intensity_counts": np.zeros(4)}
        return other_cause.has_another_cause(looker, channel, state, bare, left, [name])

    return ask


def test_a_name_beside_a_law_must_do_clearly_better_than_one_law_that_knows_nothing_of_the_name(stands):
    assert not stands(ALL - LEFT + 40.0)  # 1 % more: no shape is quite that of the cause
    assert stands(ALL - LEFT + 200.0)
