"""A term that is tried beside others acts at its own stage, whatever was worked out before."""

import numpy as np
import pytest

from arl_fixtures.reconcile.boosting import BINS, Boosted, bin_columns
from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.table import load_table
from arl_fixtures.reconcile.terms import Term, beside, default_values, forward
from arl_fixtures.reconcile.view import View


@pytest.fixture
def view(make_table, save, tmp_path) -> View:
    return View(load_table(save(tmp_path / "table.parquet", make_table(3))))


def _terms(view: View, *ids: str) -> list[Term]:
    terms = []
    for name in ids:
        effect = library()[name]
        variant = next(iter(effect.variants(view)))
        terms.append(Term(effect=effect, variant=variant, values=default_values(variant, amplitude=1.0)))
    return terms


def test_what_a_later_stage_does_sees_the_term_that_is_tried(view: View) -> None:
    fade, bend, walk = _terms(view, "laser.power_decay", "detector.compression", "timing.range_walk")
    for tried, others in ((fade, [bend, walk]), (bend, [walk, fade]), (walk, [fade, bend])):
        whole = forward([fade, bend, walk], view)
        part = beside(others, tried, view)(tried)
        alone = forward([tried], view)
        for name in whole:
            np.testing.assert_array_equal(part[name], whole[name])
        assert any(not np.array_equal(alone[name], whole[name]) for name in whole)


def test_a_tree_splits_where_a_search_through_every_cut_of_every_column_splits() -> None:
    rng = np.random.default_rng(1)
    columns = {"a": rng.normal(size=400), "b": rng.integers(0, 5, 400).astype(float), "c": rng.normal(size=400)}
    binned = bin_columns(columns)
    target = np.where(columns["b"] > 2.5, 1.0, 0.0) + 0.3 * rng.normal(size=400)
    weight = rng.gamma(2.0, 1.0, 400)
    model = Boosted(depth=1)
    model.fit(binned.codes, target, weight, trees=1)
    prior = model.ridge * weight.mean()

    def gain(column: int, cut: int) -> float:
        above = binned.codes[column] > cut
        return sum(
            (weight[part] @ target[part]) ** 2 / (weight[part].sum() + prior) for part in (above, ~above)
        )  # fmt: skip

    best = max(((gain(k, cut), k, cut) for k in range(3) for cut in range(BINS - 1)), key=lambda item: item[0])
    tree = model.trees[0]
    assert gain(tree.features[0], tree.thresholds[0]) == pytest.approx(best[0])
    assert tree.features[0] == best[1] == 1
