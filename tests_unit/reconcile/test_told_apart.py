"""When two findings are one, and when two names are too alike to choose between."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from arl_fixtures.reconcile import rivals
from arl_fixtures.reconcile.acceptance import PRICE, is_repeat
from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.effect import Parameter, Variant
from arl_fixtures.reconcile.rivals import has_other_place, mends_the_same
from arl_fixtures.reconcile.roles import Role
from arl_fixtures.reconcile.terms import Term
from arl_fixtures.reconcile.told_apart import idle_price, is_undecided, reason_of, share_undecided


def acting(effect, *drivers):
    known = library()[effect]
    return Term(
        effect=known, values={},
        variant=Variant(effect=effect, parameters=(), channels=("intensity_counts",), drivers=drivers),
    )  # fmt: skip


@pytest.mark.parametrize(
    ("effect", "first", "second", "repeat"),
    [
        ("electronics.rail_coupling", "rail_1v8_v", "rail_12v0_v", True),  # one supply to a channel's gain
        ("optics.window_contamination", "azimuth_deg", "azimuth_deg", False),  # dirt lies at several places
        ("detector.gain_temperature", "tof_temperature_c", "tof_temperature_c", True),
        ("laser.power_decay", "cycle", "time_s", False),
    ],
)
def test_what_may_act_twice_on_a_channel(effect, first, second, repeat):
    base = SimpleNamespace(terms=(acting(effect, first),))
    assert is_repeat(base, SimpleNamespace(term=acting(effect, second))) == repeat


def test_the_more_alike_two_effects_are_the_more_it_takes_to_choose():
    known = library()
    zero, late = known["stage.zero_offset"], known["acquisition.frame_lag"]
    beam, passband, walk = known["beam.profile_change"], known["optics.filter_shift"], known["timing.range_walk"]
    strange = share_undecided(beam, walk, sampled=True)
    alike = share_undecided(beam, passband, sampled=True)
    assert strange < alike < share_undecided(zero, late, sampled=True)
    assert alike == share_undecided(passband, beam, sampled=True)
    # a bench that is rendered knows its edges
    assert share_undecided(zero, late, sampled=False) == alike


@pytest.mark.parametrize(
    ("other", "parameters", "undecided"),
    [
        ("optics.filter_shift", 4, True),  # alike: its three more parameters cost 6 and do not count
        ("timing.range_walk", 4, False),  # unlike: the simpler law is the answer
        ("optics.filter_shift", 1, False),  # as simple, and it fits worse by 10
    ],
)
def test_of_alike_effects_the_simpler_one_does_not_rule_out_the_other(other, parameters, undecided):
    def term(effect, count):
        names = [f"p{k}" for k in range(count)]
        free = tuple(Parameter(name=n, unit="1", low=-1.0, high=1.0, null=0.0, typical=0.1) for n in names)
        return replace(acting(effect), variant=replace(acting(effect).variant, parameters=free))

    named = term("beam.profile_change", 1)
    assert is_undecided(named, term(other, parameters), 10.0, 50.0, sampled=True) == undecided


@pytest.mark.parametrize(("other", "undecided"), [("optics.filter_shift", True), ("timing.range_walk", False)])
def test_chance_comes_on_top_of_what_alike_laws_get_wrong(other, undecided):
    """Where little is gained in all, a law that is an eighth off loses that and what the noise makes of it."""
    assert is_undecided(acting("beam.profile_change"), acting(other), 6.8, 38.5, sampled=True) == undecided


def shaped(effect, *spans):
    """A term with an amplitude and shapes, and a fit in which each shape changes so much over its range."""
    amplitude = Parameter(name="size", unit="1", low=-1.0, high=1.0, null=0.0, typical=0.1)
    shapes = [Parameter(name=f"s{k}", unit="1", low=0.0, high=2.0, starts=(1.0,)) for k in range(len(spans))]
    made = replace(acting(effect), variant=replace(acting(effect).variant, parameters=(amplitude, *shapes)))
    jacobian = np.array([[30.0, *(0.5 * span for span in spans)], np.zeros(1 + len(spans))])
    return made, SimpleNamespace(terms=(made,), keys=[(0, p) for p in made.free()], jacobian=jacobian)


@pytest.mark.parametrize(
    ("spans", "shapes", "price"),
    [
        ((0.2, 40.0), 0, PRICE),  # a tail that nothing shows costs the dead time its price, no evidence
        ((0.2, 0.1), 0, 2.0 * PRICE),
        ((0.2, 0.1), 1, PRICE),  # the finding has paid for as many
        ((5.0, 40.0), 0, 0.0),
    ],
)
def test_shapes_that_nothing_shows_do_not_decide_against_an_effect(spans, shapes, price):
    named, _ = shaped("target.reflectance_error", *(9.0 for _ in range(shapes)))
    assert idle_price(named, shaped("detector.pile_up", *spans)[1]) == price


def test_of_alike_effects_no_further_parameter_is_counted_twice():
    named, _ = shaped("detector.compression")
    assert idle_price(named, shaped("detector.pile_up", 0.2, 0.1)[1]) == 0.0


def test_a_large_loss_that_does_not_decide_says_why():
    """Six thousand units of log-likelihood look like a decision to whoever reads the page."""
    assert reason_of(6024.0, 200563.0, alike=True).endswith("3 %: a real effect may miss its own law by as much")
    assert reason_of(6024.0, 20056.0, alike=False) == "loses 6024.0 of 20056.0 in log-likelihood"
    assert "%" not in reason_of(1.2, 30.0, alike=True)


def test_only_what_mixes_or_moves_neighbours_may_leave_a_rest_at_edges():
    mixing, moving = acting("target.edge_mixing", "mixed"), acting("stage.zero_offset", "stage_angle_deg")
    warming = acting("detector.gain_temperature", "housing_temperature_c")
    at_edges, elsewhere = ["~edge(intensity_counts)", "mixed", "step"], ["housing_temperature_c", "mixed"]
    assert mends_the_same([mixing], at_edges)
    assert not mends_the_same([mixing], elsewhere)
    assert mends_the_same([mixing, moving], at_edges)
    assert not mends_the_same([mixing, warming], at_edges)


@pytest.mark.parametrize(
    ("effect", "columns", "other"),
    [
        ("detector.dead_pixels", ["~radius(field)"], False),  # a few pixels lie at some radius
        ("detector.dead_pixels", ["housing_temperature_c"], True),
        ("detector.pixel_response", ["~radius(field)"], True),
        ("detector.pixel_response", ["pixel_u", "step"], False),
    ],
)
def test_where_else_than_in_its_pixels_a_pattern_may_lie(monkeypatch, effect, columns, other):
    monkeypatch.setattr(rivals, "locate", lambda *_: SimpleNamespace(columns=columns, gain=100.0))
    channel = SimpleNamespace(name="intensity_counts", role=Role.INTENSITY)
    view = SimpleNamespace(fresh_state=dict)
    looker = SimpleNamespace(problem=SimpleNamespace(view=view, data=[SimpleNamespace(channel=channel)]))
    pattern = SimpleNamespace(term=acting(effect, "pixel_u"), gain=50.0)
    assert has_other_place(looker, (), pattern) == other
