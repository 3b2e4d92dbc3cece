"""Rows of a table by where their pixels stand: image, row and column on a raster."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt, gaussian_filter

from arl_fixtures.reconcile.columns import Columns

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_DENSE_CELLS = 20_000_000
_REACH_PX = 3.0
"""How far from a place a pixel may lie to stand for one that the table does not hold: less than a target's width."""


class ImageGrid:
    """The raster of a whole table.

    Args:
        columns: the table.
        image: picture that each row is in; the table's images where None.

    `u` and `v` are pixel column and row of each of its rows; 0 where a line sensor has none.
    """

    def __init__(self, columns: Columns, image: IntArray | None = None) -> None:
        self._image = columns.group(*columns.image_columns) if image is None else image
        self.u, self.v = (self._axis(columns, name) for name in ("pixel_u", "pixel_v"))
        self._low = float(np.nanmin(self.u)), float(np.nanmin(self.v))
        self._width, self._height = (
            int(np.nanmax(_places(x, low))) + 1 for x, low in zip((self.u, self.v), self._low, strict=True)
        )
        self._cells = (int(self._image.max()) + 1) * self._height * self._width
        self._grid: IntArray | None = None
        self._filled: IntArray | None = None
        self._sorted: tuple[IntArray, IntArray] | None = None

    @staticmethod
    def _axis(columns: Columns, name: str) -> FloatArray:
        values = columns.numbers.get(name)
        return np.zeros(columns.n) if values is None or not np.isfinite(values).any() else values

    def rows_at(self, image: IntArray, u: FloatArray, v: FloatArray, *, near: bool = False) -> IntArray:
        """Whole-table row of pixel (u, v) in an image; −1 where there is none.

        Args:
            image, u, v: of equal length; near: for a pixel that the table does not hold the nearest one within
                `_REACH_PX` (of rasters that are not too large).
        """
        across, down = _places(u, self._low[0]), _places(v, self._low[1])
        inside = (across >= 0) & (across < self._width) & (down >= 0) & (down < self._height)
        target = (image * self._height + down) * self._width + across
        wanted: IntArray = np.where(inside, np.nan_to_num(target, nan=0.0), 0.0).astype(np.int64)
        if self.is_dense:
            return np.where(inside, (self._neared() if near else self._dense())[wanted], -1)
        order, ranked = self._order()
        place = np.searchsorted(ranked, wanted)
        place[place == order.size] = 0
        return np.where((ranked[place] == wanted) & inside, order[place], -1)

    @property
    def is_dense(self) -> bool:
        """Whether its images are few and full enough to be held as such."""
        return self._cells <= _DENSE_CELLS

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of the raster that all images share."""
        return self._height, self._width

    @property
    def fullness(self) -> float:
        """Share of the raster's cells that the table has rows of."""
        return float(np.mean(self._dense() >= 0))

    def blurred(self, values: FloatArray, width_px: float) -> FloatArray:
        """A column of the whole table through a Gaussian over the pixels of each image, of those that it holds."""
        images = self._dense().reshape(-1, self._height, self._width)
        there = (images >= 0) & np.isfinite(values)[images]
        spread = (0.0, width_px, width_px)
        light, mass = (
            gaussian_filter(np.where(there, x, 0.0), spread, mode="constant")
            for x in (np.nan_to_num(values)[images], 1.0)
        )
        cell = self._cell()
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.where(cell >= 0, (light / mass).ravel()[cell], np.nan)

    def _cell(self) -> IntArray:
        """Cell (image, row, column) of every row of the whole table; −1 where the pixel is not known."""
        across, down = _places(self.u, self._low[0]), _places(self.v, self._low[1])
        return np.nan_to_num((self._image * self._height + down) * self._width + across, nan=-1.0).astype(np.int64)

    def _dense(self) -> IntArray:
        """Row of every cell, −1 where it is empty."""
        if self._grid is None:
            cell = self._cell()
            self._grid = np.full(self._cells, -1, dtype=np.int64)
            self._grid[cell[cell >= 0]] = np.flatnonzero(cell >= 0)
        return self._grid

    def _neared(self) -> IntArray:
        """The same, empty cells with the row of the nearest pixel of the same image within `_REACH_PX`."""
        if self._filled is None:
            images = self._dense().reshape(-1, self._height, self._width)
            filled = images.copy()
            for image, into in zip(images, filled, strict=True):
                empty = image < 0
                if empty.any() and not empty.all():
                    away, (row, column) = distance_transform_edt(empty, return_indices=True)
                    close = away <= _REACH_PX
                    into[close] = image[row[close], column[close]]
            self._filled = filled.ravel()
        return self._filled

    def _order(self) -> tuple[IntArray, IntArray]:
        """Rows sorted by cell, and their cells: for images too sparse for a grid."""
        if self._sorted is None:
            cell = self._cell()
            order = np.argsort(cell, kind="stable")
            self._sorted = order, cell[order]
        return self._sorted


def _places(values: FloatArray, low: float) -> FloatArray:
    """Whole pixels above the lowest: regions may lie half a pixel, or any part, off the raster."""
    return np.asarray(np.floor(values - low + 1e-6))
