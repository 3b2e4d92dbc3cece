"""Examples in docstrings say what the code does."""

import doctest
import importlib
from pathlib import Path

import pytest

import arl_fixtures

PACKAGE = Path(arl_fixtures.__file__).parent
SHOWN = sorted(
    ".".join(path.relative_to(PACKAGE.parent).with_suffix("").parts)
    for path in PACKAGE.rglob("*.py")
    if ">>> " in path.read_text(encoding="utf-8")
)


@pytest.mark.parametrize("name", SHOWN)
def test_examples_hold(name):
    failed, tried = doctest.testmod(importlib.import_module(name))
    assert tried
    assert not failed
