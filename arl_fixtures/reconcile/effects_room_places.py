"""Where a sensor stood for each row of a table, as its own ranges tell: it was moved, or what it looks at."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from arl_fixtures.reconcile.effects_still import apart, both
from arl_fixtures.reconcile.still_scene import ALIKE
from arl_fixtures.reconcile.view import View

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_SAME_RAY = 1e-4
"""Radians within which rays are one: a hundredth of a degree is finer than scanners point."""
_MOVED_BETWEEN: tuple[tuple[str, ...], ...] = (("step",), ("cycle", "step"))
"""Columns between whose values a scanner may have been moved, those tried first that part a table least."""
_MOVED = 0.1
"""Logarithm of the factor between ranges by which a target has been moved."""
_STATIONS = ("position", "station", "pose", "place")
"""How names of columns begin that say where a sensor stands; a rail that carries the target has its range."""
_MOST_STATIONS = 100


def places_and_rays(view: View, rays: FloatArray, far: FloatArray) -> tuple[IntArray, IntArray, bool]:
    """Where each row's scanner stands, and which rows look from there along one ray, as numbers of the whole table.

    A device stands still but where its rays see other ranges at another step: it was moved between them. And whether
    no column says between what it, or what it sees, was moved.
    """
    seen = np.isfinite(far) & (far > 0.0)
    log = np.log(np.where(seen, far, 1.0))
    still = view.columns.group("dut")
    first = _alike(still, rays)
    if not seen.any() or apart(first, log, seen) <= ALIKE:
        return still, first, False
    stations = _stations(view)
    for moved in (*((name,) for name in stations), *_MOVED_BETWEEN, *(("step", name) for name in stations)):
        place = view.columns.group("dut", *moved)
        code = _alike(place, rays)
        if apart(code, log, seen) <= ALIKE:
            return place, code, False
    place = both(still, _moved_targets(view, log, seen))
    code = _alike(place, rays)
    return (place, code, True) if apart(code, log, seen) <= ALIKE else (still, first, False)


def _moved_targets(view: View, log: FloatArray, seen: NDArray[np.bool_]) -> IntArray:
    """Which of the distances of its surface each row sees, where targets are moved and no column says when.

    A target that stands at a few distances has ranges with gaps between them; each is a room of its own.
    """
    if "surface" not in view.columns.categories:
        return np.zeros(view.columns.n, dtype=np.int64)
    surface, found = view.columns.group("surface"), np.zeros(view.columns.n, dtype=np.int64)
    for code in range(int(surface.max()) + 1):
        rows = np.flatnonzero((surface == code) & seen)
        order = rows[np.argsort(log[rows], kind="stable")]
        found[order] = np.cumsum(np.diff(log[order], prepend=log[order[:1]]) > _MOVED)
    return both(surface, found)


def _stations(view: View) -> list[str]:
    """Columns that say where a sensor stands, as a length, a number or a name: of few levels."""
    table = view.columns
    told = sorted(n for n in (*table.numbers, *table.categories) if n.startswith(_STATIONS))
    return [name for name in told if 1 < int(table.group(name).max()) + 1 <= _MOST_STATIONS]


def _alike(place: IntArray, rays: FloatArray) -> IntArray:
    key = np.column_stack([place, np.rint(rays / _SAME_RAY)])
    return np.asarray(np.unique(key, axis=0, return_inverse=True)[1].ravel(), dtype=np.int64)
