"""How light and range change along a surface within an image, by the pixels that see nothing else.

Beam, lens and lean change them slowly: ln of either is a polynomial of column and row. What a pixel at a border would
see of a surface alone is told better by it than by the nearest pixel that sees it, which may lie some pixels away.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from arl_fixtures.reconcile.effects_common import FloatArray, per_table, pure_rows
from arl_fixtures.reconcile.view import View

IntArray = NDArray[np.int64]
_POWERS = tuple((i, j) for order in range(1, 5) for i, j in ((order - k, k) for k in range(order + 1)))
_FEWEST, _PER_POWER = 12, 5
"""Pixels of a surface in an image from which a polynomial is told, and for each of its coefficients."""
_HIGHEST, _PLACES = 4, 2
"""Power of a polynomial along an axis, and how many columns or rows of pixels each power needs."""
_SMOOTH = 0.03
"""Standard deviation of what is left of ln light, or of ln range, at most: else the surface has a texture."""
_UNIT_PX = 10.0
"""Pixels in which places are told, so that powers stay alike in size."""
_BEYOND_PX = 2.0
"""Pixels beyond those that show a surface up to which its polynomial goes on: pixels at a border."""


@dataclass(frozen=True, slots=True)
class _Trends:
    """Polynomials of ln of a column along surfaces; arrays of all rows of a table.

    Attributes:
        image: number of each row's image; place: column and row of its pixel, (n, 2).
        first, last: ends of the pixels that show its surface alone there, (n, 2); middle: of them, (n, 2).
        powers: coefficients of `_POWERS` about the middle, zero where nothing is told, (n, 14).
    """

    image: IntArray
    place: FloatArray
    first: FloatArray
    last: FloatArray
    middle: FloatArray
    powers: FloatArray

    def ratio(self, here: IntArray, there: IntArray) -> FloatArray:
        """What a surface seen by rows `there` would show to rows `here` of the same image, over what it shows."""
        level = [self._level(rows, there) for rows in (here, there)]
        return np.where(self.image[here] == self.image[there], np.exp(level[0] - level[1]), 1.0)

    def _level(self, rows: IntArray, of: IntArray) -> FloatArray:
        at = np.clip(self.place[rows], self.first[of] - _BEYOND_PX, self.last[of] + _BEYOND_PX) - self.middle[of]
        return np.asarray(np.sum(self.powers[of] * _powers(at / _UNIT_PX), axis=1))


def along_surface(view: View, name: str, place: IntArray) -> FloatArray:
    """A column at rows of the whole table, as the rows under work would show it of the same surface, (n,).

    Args:
        view: rows under work; name: of a positive column.
        place: row of the whole table where each row's surface was seen, −1 where nowhere (NaN then).
    """
    trends = per_table(view, ("along surfaces", name), partial(_find, view, name))
    return view.take_number(name, place) * trends.ratio(view.rows, np.maximum(place, 0))


def _powers(at: FloatArray) -> FloatArray:
    x, y = at.T
    return np.column_stack([x**i * y**j for i, j in _POWERS])


def _find(view: View, name: str) -> _Trends:
    table = view.columns
    place = np.column_stack([
        np.nan_to_num(table.numbers[axis]) if view.varies(axis) else np.zeros(table.n)
        for axis in ("pixel_u", "pixel_v")
    ])  # fmt: skip
    found = _Trends(
        table.group(*table.image_columns), place, place.copy(), place.copy(), place.copy(),
        np.zeros((table.n, len(_POWERS))),
    )  # fmt: skip
    if "surface" not in table.categories or not np.ptp(place):
        return found
    values, codes = table.numbers[name], table.categories["surface"][0]
    rows = np.flatnonzero(pure_rows(view) & (codes >= 0) & np.isfinite(values) & (values > 0.0))
    whole = table.group(*table.image_columns, "surface")
    order = rows[np.argsort(whole[rows], kind="stable")]
    for part in np.split(order, np.flatnonzero(np.diff(whole[order])) + 1):
        if part.size >= _FEWEST:
            at = place[part]
            middle = at.mean(axis=0)
            found.powers[part] = _polynomial((at - middle) / _UNIT_PX, np.log(values[part]))
            found.middle[part], found.first[part], found.last[part] = middle, at.min(axis=0), at.max(axis=0)
    return found


def _polynomial(at: FloatArray, target: FloatArray) -> FloatArray:
    """Coefficients of the powers that columns and rows of pixels tell; zeros where the target is no such function."""
    most = [min(_HIGHEST, (np.unique(axis).size - 1) // _PLACES + (np.unique(axis).size > 1)) for axis in at.T]
    told = [
        k for k, (i, j) in enumerate(_POWERS)
        if i <= most[0] and j <= most[1] and _PER_POWER * (k + 1) <= len(target)
    ]  # fmt: skip
    design = _powers(at)[:, told]
    around = design - design.mean(axis=0)
    found = np.linalg.lstsq(around, target - target.mean(), rcond=1e-4)[0]
    coefficients = np.zeros(len(_POWERS))
    if float(np.std(target - target.mean() - around @ found)) < _SMOOTH:
        coefficients[told] = found
    return coefficients
