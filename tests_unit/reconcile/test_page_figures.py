"""Pictures and numbers of the page: positions, colours, rounding."""

import base64
import re

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from arl_fixtures.reconcile.diagnosis import ParameterValue
from arl_fixtures.reconcile.page_data import NULL_Z, Axis, Profile
from arl_fixtures.reconcile.page_figures import (
    AFTER,
    BEFORE,
    HEIGHT,
    WIDTH,
    Field,
    bars,
    categories,
    colours,
    curve,
    heat_map,
    number,
    ticks,
)
from arl_fixtures.reconcile.page_words import bounds_text, plain, with_interval


def profile(before, after, error):
    return Profile(
        before=np.array(before),
        after=np.array(after),
        error=np.array(error),
        rows=np.ones(len(before), dtype=np.int64),
    )


def places(svg, style):
    points = re.search(rf'<polyline class="{style}" points="([^"]*)"', svg).group(1)
    return np.array([[float(x) for x in pair.split(",")] for pair in points.split()])


def test_a_curve_is_drawn_to_scale_and_stays_within_its_frame():
    axis = Axis(column="t_c", code=np.arange(3), at=np.array([0.0, 10.0, 40.0]))
    svg = curve(axis, profile([1.0, 2.0, -4.0], [0.0, 0.1, 0.0], [0.2, 0.2, 30.0]), factor=1000.0, label="t_c [°C]")
    before, after = places(svg, "before"), places(svg, "after")
    assert (before[2, 0] - before[0, 0]) / (before[1, 0] - before[0, 0]) == pytest.approx(4.0, abs=0.05)
    assert (before[0, 1] - before[2, 1]) / (before[0, 1] - before[1, 1]) == pytest.approx(-5.0, abs=0.1)
    assert after[0, 1] == after[2, 1]
    band = re.search(r'class="band" points="([^"]*)"', svg).group(1)
    corners = np.array([[float(x) for x in pair.split(",")] for pair in band.split()])
    for points in (before, after, corners):
        assert points.min() >= 0
        assert points[:, 0].max() <= WIDTH
        assert points[:, 1].max() <= HEIGHT
    assert (after[0, 1] - corners[0, 1]) / (after[0, 1] - before[0, 1]) == pytest.approx(NULL_Z * 0.2, abs=0.02)


def test_a_curve_that_findings_leave_alone_is_one_line():
    axis = Axis(column="x", code=np.arange(2), at=np.array([0.0, 1.0]))
    svg = curve(axis, profile([1.0, 2.0], [1.0, 2.0], [0.2, 0.2]), factor=1.0, label="x")
    assert svg.count('<polyline class="before"') == 1
    assert 'class="after"' not in svg


def test_names_of_categories_and_labels_are_escaped_and_whole_in_the_tooltip():
    name = "<b>" + "x" * 60
    axis = Axis(column="surface", code=np.arange(2), names=(name, "wall"))
    svg = categories(axis, profile([1.0, 2.0], [0.0, 0.0], [0.2, 0.2]), factor=1.0, label="<i>")
    assert "<b>" not in svg
    assert "<i>" not in svg
    assert f"<title>&lt;b&gt;{'x' * 60}</title>" in svg


def test_a_map_is_a_png_with_the_colours_of_its_cells():
    z = np.array([[0.0, 1.9, -1.9], [30.0, -30.0, np.nan]])
    svg = heat_map(Field(z=z, across="u", down="v", right=3.0, bottom=2.0), 10.0)
    found = base64.b64decode(re.search(r"base64,([^\"]*)", svg).group(1))
    image = cv2.cvtColor(cv2.imdecode(np.frombuffer(found, dtype=np.uint8), cv2.IMREAD_COLOR), cv2.COLOR_BGR2RGB)
    assert np.array_equal(image, colours(z, 10.0))
    white, hot, cold, none = image[0, 0], image[1, 0], image[1, 1], image[1, 2]
    assert np.array_equal(image[0, 1], white)
    assert np.array_equal(image[0, 2], white)
    assert hot[0] > hot[2] + 100
    assert cold[2] > cold[0] + 100
    assert white.min() > none.max() + 20


def test_before_and_after_differ_in_lightness_too():
    """For a reader without colour vision, or a black-and-white print."""
    light = [
        0.299 * int(c[1:3], 16) + 0.587 * int(c[3:5], 16) + 0.114 * int(c[5:7], 16) for c in (BEFORE, AFTER)
    ]  # fmt: skip
    assert abs(light[0] - light[1]) > 15


def test_bars_are_as_long_as_their_numbers():
    widths = [float(w) for w in re.findall(r'bar" x="[\d.]+" y="[\d.]+" width="([\d.]+)"', bars(12.0, 3.0, 1.5))]
    assert widths[0] / widths[1] == pytest.approx(4.0, rel=0.01)
    assert widths[1] / widths[2] == pytest.approx(2.0, rel=0.01)


@given(low=st.floats(-1e6, 1e6), size=st.floats(1e-6, 1e7))
def test_ticks_are_round_evenly_spaced_and_within_the_range(low, size):
    found = ticks(low, low + size)
    assert 1 <= len(found) <= 8
    slack = 1e-6 * size + 1e-9 * abs(low)
    assert min(found) >= low - slack
    assert max(found) <= low + size + slack
    steps = np.diff(found)
    assert np.allclose(steps, steps[0] if len(steps) else 0.0, rtol=1e-6, atol=slack)


@given(low=st.floats(1e-6, 1e3), ratio=st.floats(30.0, 1e9))
def test_ticks_of_a_logarithmic_axis_are_within_it_and_few(low, ratio):
    found = ticks(low, low * ratio, log=True)
    assert 1 <= len(found) <= 8
    assert min(found) >= low
    assert max(found) <= low * ratio


@given(
    value=st.floats(-1e5, 1e5).filter(lambda x: abs(x) > 1e-6),
    half=st.floats(1e-7, 1e4),
)
def test_a_value_and_its_interval_are_rounded_by_less_than_a_tenth_of_its_half_width(value, half):
    p = ParameterValue(name="a", value=value, unit="m", low=value - half, high=value + half)
    for text, exact in zip(with_interval(p), (p.value, p.low, p.high), strict=True):
        assert abs(float(text.replace("−", "-")) - exact) <= 0.1 * half + 1e-12 * abs(exact)


@given(value=st.floats(1e-4, 1e8), digits=st.integers(2, 5))
def test_plain_numbers_keep_their_digits_without_an_exponent(value, digits):
    text = plain(value, digits)
    assert "e" not in text
    assert float(text) == pytest.approx(value, rel=0.6 * 10.0 ** (1 - digits))


@pytest.mark.parametrize(
    ("bounds", "unit", "text"),
    [
        ([1.0, 2.5], "m", "1 to 2.5 m"),
        ([35.0, 35.0], "°C", "35 °C"),
        (["S1", "S2"], "1", "S1, S2"),
        ([3.0, 5.0, 9.0], "1", "3, 5, 9"),
    ],
)
def test_bounds_of_a_region_read_as_words(bounds, unit, text):
    assert bounds_text(bounds, unit) == text


@pytest.mark.parametrize(("value", "text"), [(0.0, "0"), (-0.25, "−0.25"), (1000.0, "1000"), (2.5e6, "2.5e6")])
def test_tick_labels_are_short(value, text):
    assert number(value) == text
