"""A recipe: which design shows an effect, and how the effect is drawn on it."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np


class Recipe(NamedTuple):
    """`design` draws the conditions; `make` the effect on the rows laid out (rng, rows, design)."""

    effect: str
    design: Callable[[np.random.Generator], Any]
    make: Callable[[np.random.Generator, Any, Any], Any]
    sensor: str = "flash"
