"""The physics-free model: finds what is there on unseen blocks, and nothing where there is nothing."""

import numpy as np
import pytest

from arl_fixtures.reconcile.boosting import bin_columns, ceiling
from arl_fixtures.reconcile.law import Axis, axes_of


def setup(seed: int) -> tuple[np.random.Generator, dict[str, np.ndarray], np.ndarray]:
    rng = np.random.default_rng(seed)
    columns = {name: rng.uniform(-1.0, 1.0, 3000) for name in ("a", "b", "c")}
    return rng, columns, rng.integers(0, 5, 3000)


def test_an_interaction_is_predicted_on_unseen_folds_and_its_columns_are_told():
    rng, columns, fold = setup(1)
    signal = np.where(columns["a"] > 0.0, columns["b"], 0.0)
    found = ceiling(bin_columns(columns), signal + 0.3 * rng.normal(size=3000), np.full(3000, 1.0 / 0.09), fold)
    assert found.after == pytest.approx(1.0, abs=0.25)
    assert found.before > 2.0
    assert found.importance["c"] < 0.1


def test_noise_gains_nothing_on_unseen_folds():
    gains = []
    for seed in range(6):
        rng, columns, fold = setup(seed)
        gains.append(ceiling(bin_columns(columns), rng.normal(size=3000), np.ones(3000), fold).gain)
    assert max(gains) < 6.0


@pytest.mark.parametrize("kind", ["linear", "square", "above", "step", "exp", "sin", "parity"])
def test_axis_functions_are_free_of_units(kind):
    metres = np.linspace(1.0, 3.0, 50)
    in_metres = [a for a in axes_of("pixel_u", metres, ()) if a.kind == kind]
    in_millimetres = [a for a in axes_of("pixel_u", 1000.0 * metres, ()) if a.kind == kind]
    if kind == "parity":
        assert Axis(column="x", kind="parity")({"x": np.array([0.0, 1.0, 2.0])}) == pytest.approx([1.0, -1.0, 1.0])
        return
    for first, second in zip(in_metres, in_millimetres, strict=True):
        assert first({"pixel_u": metres}) == pytest.approx(second({"pixel_u": 1000.0 * metres}), abs=1e-9)
