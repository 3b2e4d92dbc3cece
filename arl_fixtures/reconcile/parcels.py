"""Large tables piece by piece: which rows belong together, and reading them without holding the others in memory.

An effect looks at the neighbours of a row in its image, in its sweep and in its cycle's history. So a table is drawn
from, and worked through, in whole (`dut`, `cycle`), else in whole steps, else in whole images; rows may stand in any
order in the file.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from arl_fixtures.errors import DataError
from arl_fixtures.reconcile.columns import IntArray

PARCELS = (("dut", "cycle"), ("dut", "cycle", "step"), ("dut", "cycle", "step", "stage_angle_deg"))
"""What belongs together, the largest first."""
FEWEST_DRAWN = 60
"""A draw of fewer parcels than this would not stand for the table: smaller parcels are drawn then."""
ROWS_AT_ONCE = 1_000_000
BATCH = 200_000

Hashes = NDArray[np.uint64]
_ODD = np.uint64(0x9E3779B97F4A7C15)


def hashes(piece: pa.Table, names: tuple[str, ...]) -> Hashes:
    """A number per row that is the same for rows with the same values in these columns, in any file."""
    mixed = np.zeros(piece.num_rows, dtype=np.uint64)
    for name in names:
        column = piece[name]
        if pa.types.is_dictionary(column.type):
            column = column.cast(column.type.value_type)
        if pa.types.is_integer(column.type) or pa.types.is_floating(column.type):
            values = column.cast(pa.float64(), safe=False).to_numpy(zero_copy_only=False)
            bits = np.ascontiguousarray(values + 0.0).view(np.uint64)
        else:
            coded = column.combine_chunks().dictionary_encode()
            coded = coded.combine_chunks() if isinstance(coded, pa.ChunkedArray) else coded
            seeds = [_seed(str(value)) for value in coded.dictionary.to_pylist()] + [0]
            codes = coded.indices.fill_null(len(seeds) - 1).to_numpy(zero_copy_only=False)
            bits = np.array(seeds, dtype=np.uint64)[codes]
        mixed = (mixed ^ bits) * _ODD
        mixed ^= mixed >> np.uint64(29)
    return mixed


def _seed(text: str) -> int:
    return int.from_bytes(hashlib.sha256(text.encode()).digest()[:8], "little")


def _hashes_of(file: pq.ParquetFile, names: tuple[str, ...]) -> Hashes:
    """`hashes` of all rows; only these columns are read."""
    return np.concatenate([
        hashes(pa.Table.from_batches([batch]), names)
        for batch in file.iter_batches(batch_size=BATCH, columns=list(names))
    ])  # fmt: skip


def _levels(file: pq.ParquetFile) -> Iterator[tuple[str, ...]]:
    """Columns that make a parcel in this file, coarse before fine, without repetition."""
    present = set(file.schema_arrow.names)
    before: tuple[str, ...] = ()
    for names in PARCELS:
        known = tuple(name for name in names if name in present)
        if known and known != before:
            before = known
            yield known


def drawn_rows(file: pq.ParquetFile, limit: int) -> IntArray:
    """About `limit` rows of a file in whole parcels that a hash draws; without key columns spread evenly."""
    rows = file.metadata.num_rows
    share = limit / rows
    drawn: NDArray[np.bool_] | None = None
    for names in _levels(file):
        mixed = _hashes_of(file, names)
        picked = (mixed >> np.uint64(11)).astype(np.float64) / float(1 << 53) < share
        parcels = len(np.unique(mixed[picked]))
        if parcels and picked.sum() <= 1.3 * limit:
            drawn = picked
            if parcels >= FEWEST_DRAWN:
                break
    if drawn is None:
        return np.asarray(np.arange(limit) * rows // limit, dtype=np.int64)
    return np.flatnonzero(drawn)


def read_rows(path: Path, file: pq.ParquetFile, rows: IntArray) -> pa.Table:
    """The rows of a file with these numbers (rising); row groups without any are not read.

    Raises:
        DataError: the file cannot be read.
    """
    pieces: list[pa.Table] = []
    start = 0
    try:
        for group in range(file.num_row_groups):
            stop = start + file.metadata.row_group(group).num_rows
            inside = rows[np.searchsorted(rows, start) : np.searchsorted(rows, stop)]
            if len(inside):
                pieces += _read_group(file, group, inside - start)
            start = stop
        return pa.concat_tables(pieces)
    except (pa.ArrowException, OSError) as error:
        raise DataError(f"{path}: cannot be read ({str(error).splitlines()[0]})") from None


def _read_group(file: pq.ParquetFile, group: int, wanted: IntArray) -> list[pa.Table]:
    """Rows of one row group, numbered from its start."""
    pieces: list[pa.Table] = []
    start = 0
    for batch in file.iter_batches(batch_size=BATCH, row_groups=[group]):
        stop = start + batch.num_rows
        inside = wanted[np.searchsorted(wanted, start) : np.searchsorted(wanted, stop)] - start
        if len(inside):
            table = pa.Table.from_batches([batch])
            pieces.append(table if len(inside) == batch.num_rows else table.take(pa.array(inside)))
        start = stop
    return pieces


def batches_of_parcels(file: pq.ParquetFile, most: int = ROWS_AT_ONCE) -> list[IntArray]:
    """Row numbers of a file in batches of at most about `most` rows, each of whole parcels, in the file's order.

    A single parcel that is larger is cut at the next finer level; without key columns runs of rows are taken.
    """
    rows = file.metadata.num_rows
    if rows <= most:
        return [np.arange(rows)]
    best: IntArray | None = None
    for names in _levels(file):
        code = np.unique(_hashes_of(file, names), return_inverse=True)[1].astype(np.int64)
        size = np.bincount(code)
        best = code
        if size.max() <= most:
            break
    if best is None:
        return np.array_split(np.arange(rows), -(-rows // most))
    size = np.bincount(best)
    first = np.full(len(size), rows)
    np.minimum.at(first, best, np.arange(rows))
    order = np.argsort(first)
    batch = np.empty(len(size), dtype=np.int64)
    batch[order] = _filled(size[order], most)
    of_row = batch[best]
    return [np.flatnonzero(of_row == k) for k in range(int(batch.max()) + 1)]


def _filled(sizes: IntArray, most: int) -> IntArray:
    """Number of the batch of each parcel: batches are filled one after the other."""
    numbers = np.zeros(len(sizes), dtype=np.int64)
    number, filled = 0, 0
    for k, size in enumerate(sizes):
        if filled and filled + size > most:
            number, filled = number + 1, 0
        numbers[k] = number
        filled += int(size)
    return numbers
