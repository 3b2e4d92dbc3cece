"""Observation table from disk: one Parquet file to `Columns`, every fault told in one line.

What can be used is used. A column that cannot is left out with a reason (`Columns.ignored`), a table without anything
to compare is a `DataError`.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from arl_fixtures.errors import DataError
from arl_fixtures.reconcile.ceilings import leave_out_ceilings
from arl_fixtures.reconcile.columns import Columns, FloatArray, IntArray, find_channels
from arl_fixtures.reconcile.parcels import batches_of_parcels, drawn_rows, read_rows
from arl_fixtures.reconcile.roles import unit_of
from arl_fixtures.reconcile.synonyms import read_as_known
from arl_fixtures.reconcile.unanswered import take_for_dark
from arl_fixtures.reconcile.unknown_units import leave_out_unknown_units

ALWAYS_CATEGORY = frozenset({"dut", "surface", "mixed"})
_TRUTHS = {"true", "false"}
FEWEST_ROWS = 4
"""Rows that a channel must have, measured and simulated."""
LARGEST, SMALLEST = 1e30, 1e-30
"""No quantity is larger or smaller: what is beyond counts as infinite, what is below as nothing."""
IDENTITY = frozenset({"time_s", "stage_angle_deg", "pixel_u", "pixel_v", "true_range_m"})
"""Columns of which each tells observations apart."""
OFTENER = 10.0
"""How many times oftener than chance has it rows without such a column repeat if they are copies."""
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
    if path.is_dir():
        raise DataError(f"{path}: is a folder; expected a Parquet file")
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
        DataError: the file cannot be read, or has no channel with enough rows to compare.
    """
    file = open_table(path)
    rows = file.metadata.num_rows
    if rows == 0:
        raise DataError(f"{path}: has no rows")
    kept = _read(path, file, limit)
    columns = columns_of(kept, path=path, for_prediction=for_prediction)
    if rows > kept.num_rows:
        columns.ignored["(rows)"] = (
            f"{kept.num_rows} of {rows} were searched (whole cycles, steps or images, evenly drawn)"
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
    given = read_as_known(numbers, categories)
    _rename_for_prediction(numbers, for_prediction=for_prediction)
    _check_text(numbers, categories, ignored)
    leave_out_unknown_units(numbers, ignored)
    _check_stated(numbers, ignored)
    _check_pairs(numbers, ignored, for_prediction=for_prediction)
    channels = find_channels(set(numbers))
    if not channels:
        raise DataError(f"{path}: {_why_no_channel(table.column_names, ignored)}")
    _note_empty(numbers, ignored, keep=for_prediction)
    ceilings: dict[str, float] = {}
    if not for_prediction:
        _drop_repeats(numbers, categories, [numbers[channel.name] for channel in channels], ignored)
        ceilings = leave_out_ceilings(numbers, tuple(c.name for c in channels), ignored)
    columns = Columns(len(numbers[channels[0].name]), numbers, categories, channels, ignored, ceilings, given=given)
    if not for_prediction:
        take_for_dark(columns)
    return columns


def _note_empty(numbers: dict[str, FloatArray], ignored: dict[str, str], *, keep: bool) -> None:
    for name in sorted(numbers):
        if not np.any(np.isfinite(numbers[name])):
            ignored.setdefault(name, "holds no value")
            if not (keep or name.startswith("sim_") or f"sim_{name}" in numbers):
                del numbers[name]
    frames = numbers.get("n_frames")
    if frames is not None and np.any(frames < 1):
        ignored["n_frames (rows)"] = f"{int(np.sum(frames < 1))} rows count fewer than one frame; taken as one"


def _drop_repeats(
    numbers: dict[str, FloatArray], categories: dict[str, tuple[IntArray, tuple[str, ...]]],
    readings: Sequence[FloatArray], ignored: dict[str, str],
) -> None:  # fmt: skip
    """Use rows that stand twice once: a copy is no second witness.

    Only where a column says which observation a row is, or readings are too fine: coarse ones repeat by themselves.
    """
    mixed = np.zeros(len(next(iter(numbers.values()))), dtype=np.uint64)
    for values in [*numbers.values(), *(codes for codes, _ in categories.values())]:
        mixed = (mixed ^ np.ascontiguousarray(values).view(np.uint64)) * np.uint64(0x9E3779B97F4A7C15)
        mixed ^= mixed >> np.uint64(29)
    first = np.sort(np.unique(mixed, return_index=True)[1])
    repeated = len(mixed) - len(first)
    if repeated and (
        IDENTITY & set(numbers) or repeated > OFTENER * (1.0 + min(map(_alike_by_chance, readings)))
    ):
        ignored["(repeated rows)"] = f"{repeated} rows repeat another in all columns; used once"
        for name in numbers:
            numbers[name] = numbers[name][first]
        for name, (codes, labels) in categories.items():
            categories[name] = codes[first], labels


def _alike_by_chance(reading: FloatArray) -> float:
    """Pairs of rows that have the same value by chance, as fine as a reading is: n² / 2 over its levels."""
    known = reading[np.isfinite(reading)]
    values = np.unique(known)
    if len(values) < 2:
        return np.inf
    levels = float(values[-1] - values[0]) / float(np.min(np.diff(values)))
    return 0.5 * len(known) ** 2 / levels


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
    place = {text: k for k, text in enumerate(labels)}
    lookup = np.array([place[text] for text in raw] + [-1], dtype=np.int64)
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
    values[np.abs(values) < SMALLEST] = 0.0
    wild = np.abs(values) > LARGEST
    if wild.any():
        values[wild] = np.nan
        ignored[f"{name} (rows)"] = f"{int(wild.sum())} infinite values are taken as not observed"
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
        measured = unit_of(name) != "1" and name not in ALWAYS_CATEGORY and not set(categories[name][1]) <= _TRUTHS
        if measured or name.startswith("sim_") or f"sim_{name}" in numbers or f"sim_{name}" in categories:
            ignored[name] = "holds text where numbers belong"
            del categories[name]


def _check_stated(numbers: dict[str, FloatArray], ignored: dict[str, str]) -> None:
    """Take standard deviations below nil as not stated: a row's noise is then that of the others, or of the data."""
    for name in sorted(n for n in numbers if n.startswith("sim_") and n.endswith("_std")):
        below = numbers[name] < 0.0
        if below.any():
            numbers[name] = np.where(below, np.nan, numbers[name])
            ignored[f"{name} (rows)"] = f"{int(below.sum())} standard deviations below nil are taken as not stated"


def _check_pairs(numbers: dict[str, FloatArray], ignored: dict[str, str], *, for_prediction: bool) -> None:
    for name in sorted(n for n in numbers if n.startswith("sim_")):
        bare = name.removeprefix("sim_")
        scatter = name.endswith("_std") and f"sim_{bare.removesuffix('_std')}" in numbers
        if name.endswith("_repeat_std") or (scatter and bare not in numbers):
            continue
        if bare not in numbers:
            ignored[name] = f"has no measured column '{bare}' beside it"
        elif not for_prediction:
            both = int(np.sum(np.isfinite(numbers[bare]) & np.isfinite(numbers[name])))
            if both < FEWEST_ROWS:
                where = f"in only {both} row{'s' if both > 1 else ''}" if both else "nowhere"
                ignored[bare] = f"is {where} observed together with its simulation; {FEWEST_ROWS} rows are needed"
                del numbers[bare]
        elif not np.any(np.isfinite(numbers[name])):
            ignored[name] = "holds no value"


def _why_no_channel(names: list[str], ignored: dict[str, str]) -> str:
    for name in sorted(names, key=lambda n: n.endswith("_std")):  # a quantity's own fault before its scatter's
        bare = name.removeprefix("sim_")
        for asked in (bare, name):
            if (name.startswith("sim_") or f"sim_{name}" in names) and asked in ignored:
                return f"no channel to compare: column '{asked}' {ignored[asked]}"
    return "no channel to compare: expected a measured column X with its simulation sim_X beside it"
