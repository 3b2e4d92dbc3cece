"""Quantities: units by dimension, GUM arithmetic."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from arl_fixtures.errors import UnitError
from arl_fixtures.quantity import Contribution, Kind, Quantity, convert, coverage_factor, effective_dof

FINITE = st.floats(-1e6, 1e6)
SMALL = st.floats(1e-6, 1e3)


@pytest.mark.parametrize(
    ("value", "source", "target", "expected"),
    [
        (1.0, "m", "mm", 1000.0),
        (25.0, "degC", "K", 298.15),
        (25.0, "°C", "degF", 77.0),
        (1.0, "%", "1", 0.01),
        (180.0, "deg", "rad", math.pi),
        (180.0, "us", "ms", 0.18),
        (1.0, "V/A", "ohm", 1.0),
        (3.0, "counts", "counts", 3.0),
    ],
)
def test_scales_of_one_dimension_convert(value, source, target, expected):
    assert convert(value, source, target) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize(
    ("source", "target"),
    [("deg", "%"), ("counts", "1"), ("px", "m"), ("rad", "1"), ("m", "s"), ("degC", "V"), ("px", "counts")],
)
def test_a_foreign_dimension_is_refused(source, target):
    with pytest.raises(UnitError, match="another dimension"):
        convert(1.0, source, target)


@pytest.mark.parametrize("text", ["bogus", "m +", "3*m", "5", "[", "__import__('os')", "m**m"])
def test_text_that_is_no_unit_is_refused(text):
    with pytest.raises(UnitError, match="unknown unit"):
        Quantity(1.0, text)


def test_a_temperature_keeps_its_uncertainty_as_a_difference():
    warm = Quantity.of(25.0, "degC", Contribution("sensor", 0.5, Kind.B)).to("degF")
    assert (warm.value, warm.u) == (pytest.approx(77.0), pytest.approx(0.9))
    assert warm.contributions[0].u == pytest.approx(0.9)


def test_temperatures_subtract_to_kelvin_and_do_not_add():
    warm, cold = Quantity(85.0, "degC", 0.3), Quantity(14.0, "degF", 0.9)
    difference = warm - cold
    assert (difference.value, difference.unit) == (pytest.approx(95.0), "K")
    assert difference.u == pytest.approx(math.hypot(0.3, 0.5))
    with pytest.raises(UnitError, match="use K"):
        warm + cold
    with pytest.raises(UnitError, match="use K"):
        warm * 2.0
    with pytest.raises(UnitError, match="use K"):
        warm.relative_to(cold)


def test_welch_satterthwaite_of_the_gum_example():
    # GUM H.1.6: contributions in nm with degrees of freedom 18, 24, 5, 8 and one with 50 give 16 (truncated)
    parts = [
        Contribution("standard", 25.0, Kind.B, 18),
        Contribution("repeatability", 5.8, Kind.A, 24),
        Contribution("random", 3.9, Kind.A, 5),
        Contribution("systematic", 6.7, Kind.A, 8),
        Contribution("expansion", 2.9, Kind.B, 50),
        Contribution("temperature", 16.6, Kind.B, 2),
    ]
    assert math.floor(effective_dof(parts)) == 16
    assert Quantity.of(50_000_838.0, "nm", *parts).u == pytest.approx(32.0, abs=0.5)


@given(st.floats(1.0, 1e6), st.floats(0.6, 0.999))
def test_coverage_factor_is_students_t(dof, coverage):
    assert coverage_factor(dof, coverage) == pytest.approx(stats.t.ppf((1 + coverage) / 2, dof), rel=1e-9)


def test_coverage_factor_of_known_uncertainty_is_the_normal_one():
    assert coverage_factor(math.inf) == pytest.approx(1.959963985, rel=1e-8)


@given(FINITE, FINITE, SMALL, SMALL)
def test_sum_and_difference_share_their_uncertainty(a, b, u_a, u_b):
    left = Quantity.of(a, "m", Contribution("x", u_a))
    right = Quantity.of(b, "m", Contribution("y", u_b, Kind.B))
    assert (left + right).u == pytest.approx((left - right).u)
    assert (left - right).u == pytest.approx(math.hypot(u_a, u_b))
    assert (left - right).value == pytest.approx(a - b)
    assert {part.name for part in (left + right).contributions} == {"x", "y"}


@given(st.floats(0.1, 1e3), st.floats(0.1, 1e3), st.floats(1e-6, 1e-3), st.floats(1e-6, 1e-3))
def test_relative_deviation_propagates_linearly(a, b, r_a, r_b):
    change = Quantity(a, "V", r_a * a).relative_to(Quantity(b * 1000.0, "mV", r_b * b * 1000.0))
    assert change.value == pytest.approx(a / b - 1.0, abs=1e-12)
    assert change.u == pytest.approx(a / b * math.hypot(r_a, r_b), rel=1e-9)


@given(FINITE, SMALL)
def test_conversion_there_and_back_changes_nothing(value, u):
    there = Quantity.of(value, "degC", Contribution("x", u)).to("degF")
    back = there.to("degC")
    assert back.value == pytest.approx(value, rel=1e-9, abs=1e-9)
    assert back.u == pytest.approx(u, rel=1e-9)
    assert math.hypot(*(part.u for part in back.contributions)) == pytest.approx(back.u)


def test_text_shows_value_and_uncertainty_to_two_digits_of_the_latter():
    assert str(Quantity(1.234567, "m", 0.00321)) == "(1.2346 ± 0.0032) m"
    assert str(Quantity(8.0, "1")) == "8"
    assert str(Quantity(123456.0, "counts", 2500.0)) == "(123456 ± 2.5e+03) counts"
    assert "repeatability A 0.1" in repr(Quantity.of(1.0, "m", Contribution("repeatability", 0.1)))


@pytest.mark.parametrize("u", [-1.0, math.nan])
def test_an_impossible_uncertainty_is_refused(u):
    with pytest.raises(ValueError, match="standard uncertainty"):
        Quantity(1.0, "m", u)
    with pytest.raises(ValueError, match="standard uncertainty"):
        Contribution("x", u)
