"""What a forked process found comes back as it was; nothing else is made of what it sends."""

import dataclasses
import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from arl_fixtures.reconcile.effect import Parameter
from arl_fixtures.reconcile.effects_common import amplitude, shape
from arl_fixtures.reconcile.scores import Scored
from arl_fixtures.reconcile.side_scatter import Side
from arl_fixtures.reconcile.told_results import told_as, told_from

PLAIN = st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text()
ARRAYS = hnp.arrays(
    st.sampled_from([np.float64, np.float32, np.int64, np.bool_]), hnp.array_shapes(min_dims=0, min_side=0),
    elements={"allow_nan": False},
)  # fmt: skip
NESTED = st.recursive(
    PLAIN | ARRAYS | st.sampled_from(list(Side)),
    lambda inner: (
        st.lists(inner) | st.tuples(inner, inner) | st.dictionaries(st.text() | st.tuples(st.text()), inner)
    ),
)


def alike(one, other):
    if isinstance(one, np.ndarray):
        return one.dtype == other.dtype and one.shape == other.shape and np.array_equal(one, other)
    if isinstance(one, dict):
        return list(one) == list(other) and all(map(alike, one.values(), other.values()))
    if isinstance(one, list | tuple):
        return type(one) is type(other) and len(one) == len(other) and all(map(alike, one, other))
    return type(one) is type(other) and one == other


@given(NESTED)
def test_values_arrays_and_containers_come_back(found):
    assert alike(told_from(told_as(found, ()), {}), found)


def test_records_come_back_and_held_objects_are_the_same():
    held = amplitude("gain", "1", -1.0, np.inf, 0.1)
    scored = Scored(({"p": held, "q": shape("tau", "s", 0.0, 9.0, 1.0, 2.0)},), np.zeros(2), np.ones(3), np.zeros(0))
    back = told_from(told_as(scored, {id(held)}), {id(held): held})
    assert isinstance(back, Scored)
    assert back.candidates[0]["p"] is held
    other = back.candidates[0]["q"]
    assert isinstance(other, Parameter)
    assert repr(other) == repr(scored.candidates[0]["q"])
    assert np.isnan(told_from(told_as(np.float64(np.nan), ()), {}))


@dataclasses.dataclass
class Foreign:
    """A record that is not of the package."""

    value: int


@pytest.mark.parametrize("found", [Foreign(1), lambda: 1, {1, 2}, np.array([object()]), b"bytes"])
def test_what_cannot_be_told_is_refused(found):
    with pytest.raises(TypeError):
        told_as(found, ())


def test_nothing_else_is_made_of_what_is_sent():
    text = json.dumps({"made": ["os", "system"], "of": {"command": "true"}}).encode()
    with pytest.raises((TypeError, KeyError)):
        told_from(len(text).to_bytes(8, "little") + text, {})
