"""Shapes are tried from every start that their effect has chosen: a local optimum is not left for a better one."""

import math

import pytest
from traced_bench import table

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.scores import starts_of
from arl_fixtures.reconcile.view import View


@pytest.fixture(scope="module")
def view():
    return View(table(angles=9))


@pytest.mark.parametrize("effect", sorted(library()))
def test_no_product_of_starts_is_left_out(view, effect):
    for variant in library()[effect].variants(view):
        chosen = math.prod(len(shape.starts) for shape in variant.shapes())
        assert len(list(starts_of(variant))) == chosen
