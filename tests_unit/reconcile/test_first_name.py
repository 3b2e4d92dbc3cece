"""How much the first name of a table must gain: a share of what chance gives, all of it beside what else is there."""

from types import SimpleNamespace

import numpy as np
import pytest

from arl_fixtures.reconcile import near_miss
from arl_fixtures.reconcile.screen import FIRST_SHARE, LEAST_GAIN, Screening

DRAWS = np.sort(np.random.default_rng(4).gumbel(4.5, 1.0, 400))


def chance(scale=1.0):
    none = np.zeros(0)
    return Screening(candidates=(), chance=scale * DRAWS, wide=none, alone=none)


def test_the_first_name_pays_less_than_free_looks_but_never_next_to_nothing():
    assert LEAST_GAIN < chance().first(0.95) < chance().threshold(0.95)
    assert chance(0.2).first(0.95) == LEAST_GAIN


def test_a_gain_at_the_border_is_as_seldom_as_stated():
    border = chance().first(0.95)
    assert chance().p_value(border) == pytest.approx(0.05, abs=0.005)


def drops(monkeypatch, *, gain, pattern=(), law=()):
    """Whether a lone name that gains so much falls beside a pattern and a law of these channels."""
    monkeypatch.setattr(near_miss, "evidence", lambda ranked, _: ranked.gain)
    effect = SimpleNamespace(id="stage.eccentricity")
    term = SimpleNamespace(effect=effect, variant=SimpleNamespace(channels=("distance_m", "intensity_counts")))
    ranked = SimpleNamespace(gain=gain, fit=SimpleNamespace(terms=[term]))
    kept = []
    decision = SimpleNamespace(
        best=SimpleNamespace(terms=(term,)), keep=kept.append, search=SimpleNamespace(surcharge=None),
        found=SimpleNamespace(stages=[SimpleNamespace(ranked=[ranked])], screening=chance()),
        patterns=[SimpleNamespace(term=SimpleNamespace(variant=SimpleNamespace(channels=pattern)))],
        laws=[SimpleNamespace(channel=name) for name in law],
    )  # fmt: skip
    assert near_miss.drop_doubtful(decision) is (kept == [[]])
    return kept == [[]]


def test_a_doubtful_name_falls_beside_what_else_is_in_its_channels(monkeypatch):
    between = 0.5 * (1.0 + FIRST_SHARE) * chance().threshold(0.95)
    assert drops(monkeypatch, gain=between, pattern=("intensity_counts",))
    assert drops(monkeypatch, gain=between, law=("distance_m",))
    assert not drops(monkeypatch, gain=between, law=("signal_counts",))
    assert not drops(monkeypatch, gain=between)


def test_a_sure_one_does_not(monkeypatch):
    assert not drops(monkeypatch, gain=1.1 * chance().threshold(0.95), pattern=("intensity_counts",))
