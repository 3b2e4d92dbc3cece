"""The one line of a law of trees alone names their columns and nothing that is not there."""

import numpy as np
import pytest

from arl_fixtures.reconcile.boosting import Tree
from arl_fixtures.reconcile.law import Law


@pytest.mark.parametrize(
    ("columns", "told"),
    [
        (("cycle", "pixel_v"), "intensity_counts *= 1 + trees(cycle, pixel_v)"),
        (("a", "b", "c", "d", "e"), "intensity_counts *= 1 + trees(a, b, c, d, ...)"),
    ],
)
def test_law_of_trees_alone(columns, told):
    tree = Tree(features=(0,), thresholds=(1,), values=np.array([-0.01, 0.02]))
    law = Law(
        channel="intensity_counts", relative=True, terms=[], drivers=list(columns[:1]), trees=[tree],
        binned_names=columns, edges=[np.array([1.0])] * len(columns),
    )  # fmt: skip
    assert law.expression == told
