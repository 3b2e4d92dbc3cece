from __future__ import annotations

import itertools
import math
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from arl_fixtures.errors import ConfigError
from arl_fixtures.report.lifetime import (
    FatigueModel,
    RateModel,
    Stress,
    Use,
    acceleration,
    fatigue,
    load_lifetime,
    rate,
)

USE = Use(
    swing_k=(20, 40), swings_per_year=(500, 1000), temperature_c=(15, 35), hours_per_year=(300, 600), source="x"
)
FILE = Path(__file__).parents[2] / "reports" / "lifetime.yaml"


def test_coffin_manson_of_one_swing_is_the_ratio_to_the_exponent():
    found = fatigue(Stress(swings_k=(95.0,) * 10, dwell=()), FatigueModel(name="n", exponent=(2, 2), source="s"), USE)
    assert found.amount == pytest.approx((10 * (95 / 40) ** 2, 10 * (95 / 20) ** 2))
    assert found.years == pytest.approx((found.amount[0] / 1000, found.amount[1] / 500))


def test_arrhenius_at_the_temperature_of_use_is_worth_its_own_time():
    use = USE.model_copy(update={"temperature_c": (45.0, 45.0)})
    model = RateModel(name="n", activation_energy_ev=(0.3, 0.9), source="s")
    assert rate(Stress(swings_k=(), dwell=((7.0, 45.0),)), model, use).amount == pytest.approx((7.0, 7.0))


def test_arrhenius_gives_the_published_laser_lifetimes():
    # 15 000 h at 45 °C and 50 000 h at 25 °C, published with "about 0.5 eV"
    assert acceleration(45.0, 25.0, 0.49) == pytest.approx(50 / 15, rel=0.02)


@settings(deadline=None)
@given(
    swings=st.lists(st.floats(1, 150), min_size=1, max_size=5),
    dwell=st.lists(st.tuples(st.floats(0.01, 10), st.floats(-40, 125)), min_size=1, max_size=5),
    exponent=st.tuples(st.floats(1, 3), st.floats(3, 9)),
    energy=st.tuples(st.floats(0.2, 0.5), st.floats(0.5, 1.2)),
)
def test_ranges_hold_every_combination_of_parameters(swings, dwell, exponent, energy):
    stress = Stress(swings_k=tuple(swings), dwell=tuple(dwell))
    by_swings = fatigue(stress, FatigueModel(name="n", exponent=exponent, source="s"), USE).amount
    by_time = rate(stress, RateModel(name="n", activation_energy_ev=energy, source="s"), USE).amount
    for part, share in itertools.product((0.0, 0.3, 0.7, 1.0), repeat=2):
        use_k = 20 + part * 20
        q = exponent[0] + share * (exponent[1] - exponent[0])
        worth = sum((swing / use_k) ** q for swing in swings)
        assert by_swings[0] * (1 - 1e-6) <= worth <= by_swings[1] * (1 + 1e-6)
        use_c, ev = 15 + part * 20, energy[0] + share * (energy[1] - energy[0])
        worth = sum(hours * acceleration(at, use_c, ev) for hours, at in dwell)
        assert by_time[0] * (1 - 1e-6) <= worth <= by_time[1] * (1 + 1e-6)


def test_the_file_that_comes_along_is_valid_and_names_a_source_for_each_mechanism():
    model = load_lifetime(FILE)
    assert model.coffin_manson
    assert model.arrhenius
    assert all(math.isfinite(each.exponent[1]) for each in model.coffin_manson)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("exponent: [1.9, 2.65]", "exponent: [2.65, 1.9]", "is empty"),
        ("exponent: [1.9, 2.65]", "exponent: [0, 2.65]", "above 0"),
        ("    source: LV 124 / VW 80000, test L-02\n", "", "source"),
        ("swing_k:", "swings_k:", "did you mean 'swing_k'"),
    ],
)
def test_faults_of_the_file_are_named_with_their_line(tmp_path, old, new, said):
    path = tmp_path / "lifetime.yaml"
    text = FILE.read_text("utf-8")
    assert old in text
    path.write_text(text.replace(old, new, 1), "utf-8")
    with pytest.raises(ConfigError, match=r"lifetime\.yaml:\d+:\d+: ") as raised:
        load_lifetime(path)
    assert said in str(raised.value)
