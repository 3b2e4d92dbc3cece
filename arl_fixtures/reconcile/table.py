"""Observation table from disk: one Parquet file to `Columns`, every fault told in one line.

What can be used is used. A column that cannot is left out with a reason (`Columns.ignored`), a table without anything
to compare is a `DataError`.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from arl_fixtures.errors import DataError
from arl_fixtures.reconcile.columns import Columns, FloatArray, IntArray, find_channels
from arl_fixtures.reconcile.parcels import batches_of_parcels, drawn_rows, read_rows

ALWAYS_CATEGORY = frozenset({"dut", "surface", "mixed"})
MAX_ROWS_IN_MEMORY = 2_500_000
"""Larger tables are searched in part: whole cycles, steps or images, so that what lies next to a row survives."""


def sha256_of(path: Path) -> str:
    """Digest of a file, read in pieces."""
    digest = hashlib.sha256()
    with path.open("rb") as stream:
        while piece := stream.read(1 << 20):
            digest.update(piece)
    return digest.hexdigest()


def open_table(path: Path) -> pq.ParquetFile:
    """Open a Parquet file.

    Raises:
        DataError: no such file, not Parquet, no rows, or a column name twice.
    """
    if not path.is_file():
        raise DataError(f"{path}: no such file")
    try:
        file = pq.ParquetFile(path)
    except (pa.ArrowException, OSError) as error:
        raise DataError(f"{path}: is not a Parquet file ({str(error).splitlines()[0]})") from None
    names = file.schema_arrow.names
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise DataError(f"{path}: column '{twice[0]}' stands twice")
    return file


def load_table(path: Path, *, for_prediction: bool = False, limit: int = MAX_ROWS_IN_MEMORY) -> Columns:
    """Read an observation table.

    Args:
        path: Parquet file in the form of the observation table.
        for_prediction: measured columns may be absent; a channel is then whatever has a `sim_` column.
        limit: rows kept in memory; of a larger table whole cycles, steps or images are drawn.

    Raises:
        DataError: the file cannot be read, has no channel, or fewer than two rows can be compared.
    """
    file = open_table(path)
    rows = file.metadata.num_rows
    if rows == 0:
        raise DataError(f"{path}: has no rows")
    kept = _read(path, file, limit)
    columns = columns_of(kept, path=path, for_prediction=for_prediction)
    if rows > columns.n:
        columns.ignored["(rows)"] = (
            f"{columns.n} of {rows} were searched (whole cycles, steps or images, evenly drawn)"
        )
    return columns


def _read(path: Path, file: pq.ParquetFile, limit: int) -> pa.Table:
    try:
        if file.metadata.num_rows <= limit:
            return file.read()
        return read_rows(path, file, drawn_rows(file, limit))
    except (pa.ArrowException, OSError) as error:
        raise DataError(f"{path}: cannot be read ({str(error).splitlines()[0]})") from None


def table_in_batches(path: Path) -> Iterator[tuple[IntArray, Columns]]:
    """A table for prediction, in batches of rows that belong together: their numbers in the file, and their columns.

    Tables that fit into memory come as one batch.

    Raises:
        DataError: see `load_table`.
    """
    file = open_table(path)
    if file.metadata.num_rows <= MAX_ROWS_IN_MEMORY:
        columns = load_table(path, for_prediction=True)
        yield np.arange(columns.n), columns
        return
    for rows in batches_of_parcels(file):
        yield rows, columns_of(read_rows(path, file, rows), path=path, for_prediction=True)


def columns_of(table: pa.Table, *, path: Path | str = "table", for_prediction: bool = False) -> Columns:
    """Turn an Arrow table into columns.

    Raises:
        DataError: see `load_table`.
    """
    numbers: dict[str, FloatArray] = {}
    categories: dict[str, tuple[IntArray, tuple[str, ...]]] = {}
    ignored: dict[str, str] = {}
    for name in table.column_names:
        column = table[name]
        kind = column.type.value_type if pa.types.is_dictionary(column.type) else column.type
        if pa.types.is_null(kind):
            numbers[name] = np.full(table.num_rows, np.nan)
        elif name in ALWAYS_CATEGORY or pa.types.is_boolean(kind) or _is_text(kind):
            categories[name] = _category(column)
        elif pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_decimal(kind):
            numbers[name] = _number(name, column, ignored)
        elif pa.types.is_timestamp(kind) or pa.types.is_duration(kind):
            ignored[name] = f"is of type {kind}; only numbers, text and booleans are used"
        else:
            ignored[name] = f"is of type {kind}; only numbers, text and booleans are used"
    _rename_for_prediction(numbers, for_prediction=for_prediction)
    _check_text(numbers, categories, ignored)
    _check_pairs(numbers, ignored, for_prediction=for_prediction)
    channels = find_channels(set(numbers))
    if not channels:
        raise DataError(f"{path}: {_why_no_channel(table.column_names, ignored)}")
    columns = Columns(table.num_rows, numbers, categories, channels, ignored)
    if not for_prediction and columns.n < 2:
        raise DataError(f"{path}: has 1 row; a comparison needs at least 2")
    return columns


def _is_text(kind: pa.DataType) -> bool:
    return bool(pa.types.is_string(kind) or pa.types.is_large_string(kind) or pa.types.is_string_view(kind))


def _category(column: pa.ChunkedArray) -> tuple[IntArray, tuple[str, ...]]:
    if pa.types.is_dictionary(column.type):
        column = column.cast(column.type.value_type)
    if pa.types.is_floating(column.type):
        column = column.cast(pa.float64())
    encoded = column.combine_chunks().dictionary_encode()
    if isinstance(encoded, pa.ChunkedArray):
        encoded = encoded.combine_chunks()
    raw = [_label(value) for value in encoded.dictionary.to_pylist()]
    labels = tuple(sorted(set(raw)))
    lookup = np.array([labels.index(text) for text in raw] + [-1], dtype=np.int64)
    codes = encoded.indices.fill_null(len(raw)).to_numpy(zero_copy_only=False).astype(np.int64)
    return lookup[codes], labels


def _label(value: object) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float) and value.is_integer():
        return str(int(value))
    return str(value)


def _number(name: str, column: pa.ChunkedArray, ignored: dict[str, str]) -> FloatArray:
    values = np.array(column.cast(pa.float64(), safe=False).to_numpy(zero_copy_only=False), dtype=np.float64)
    infinite = np.isinf(values)
    if infinite.any():
        values[infinite] = np.nan
        ignored[f"{name} (rows)"] = f"{int(infinite.sum())} infinite values are taken as not observed"
    return values


def _rename_for_prediction(numbers: dict[str, FloatArray], *, for_prediction: bool) -> None:
    """A prediction table carries no measured columns: give every simulated quantity an empty measured one."""
    if for_prediction:
        for name in [n for n in numbers if n.startswith("sim_") and not n.endswith("_repeat_std")]:
            bare = name.removeprefix("sim_")
            if bare not in numbers and not (bare.endswith("_std") and f"sim_{bare.removesuffix('_std')}" in numbers):
                numbers[bare] = np.full(len(numbers[name]), np.nan)


def _check_text(
    numbers: dict[str, FloatArray], categories: dict[str, tuple[IntArray, tuple[str, ...]]], ignored: dict[str, str]
) -> None:
    for name in sorted(categories):
        if name.startswith("sim_") or f"sim_{name}" in numbers or f"sim_{name}" in categories:
            ignored[name] = "holds text where numbers belong"
            del categories[name]


def _check_pairs(numbers: dict[str, FloatArray], ignored: dict[str, str], *, for_prediction: bool) -> None:
    for name in sorted(n for n in numbers if n.startswith("sim_")):
        bare = name.removeprefix("sim_")
        if name.endswith("_repeat_std") or (name.endswith("_std") and f"sim_{bare.removesuffix('_std')}" in numbers):
            continue
        if bare not in numbers:
            ignored[name] = f"has no measured column '{bare}' beside it"
        elif not for_prediction and not np.any(np.isfinite(numbers[bare]) & np.isfinite(numbers[name])):
            ignored[bare] = "is nowhere observed together with its simulation"
            del numbers[bare]
        elif for_prediction and not np.any(np.isfinite(numbers[name])):
            ignored[name] = "holds no value"


def _why_no_channel(names: list[str], ignored: dict[str, str]) -> str:
    for name in names:
        bare = name.removeprefix("sim_")
        for asked in (name, bare):
            if (name.startswith("sim_") or f"sim_{name}" in names) and asked in ignored:
                return f"no channel to compare: column '{asked}' {ignored[asked]}"
    return "no channel to compare: expected a measured column X with its simulation sim_X beside it"
