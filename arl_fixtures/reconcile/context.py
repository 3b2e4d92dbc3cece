"""What surrounded the rows that a model was found on, kept for `arl predict` in `context.parquet`.

Many effects need more than a row: the scene on both sides of a pixel, the beam's profile, the pixel that a ghost
comes from, what the temperature was an hour ago. Rows to predict may be few (one stage angle, one step, a block of
pixels), and then these lie in the table that was reconciled. Its simulated values and conditions stand beside the
predicted rows; measured values are not kept.

The scene, the beam and the camera of a device are the same in any record. The beam's profile is that of the kept
rows, as the model was found with it: rows before another scene would bend it. Neighbours in an image, a sweep or in
time are looked for in one record only: where the predicted rows bear the same device, cycle and step but cannot be
from that record (the same observation with other values, another condition in a step, other steps at the same time),
the kept rows count as a record of their own.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from arl_fixtures.reconcile.columns import BoolArray, Columns, FloatArray, IntArray
from arl_fixtures.reconcile.table import load_table

CONTEXT_FILE = "context.parquet"
MOST_ROWS = 100_000
"""Rows that are kept; of more, whole images, evenly drawn."""
SAME_CONDITION = 0.1
"""Share of a condition's range by which a step's values may lie beyond those that are kept of it."""
SAME = 1e-9

_RECORD = ("dut", "cycle")
_WHEN = ("dut", "cycle", "step")
_PLACE = ("set_temperature_c", "ramp", "stage_angle_deg", "time_s", "pixel_u", "pixel_v")


def write_context(path: Path, columns: Columns) -> None:
    """Keep the simulated values and conditions of a table: all rows, or whole images of a large one."""
    rows = _kept_rows(columns)
    measured = {c.name for c in columns.channels} - {n for n in columns.numbers if n.startswith("sim_")}
    measured |= {f"{name}_std" for name in measured}
    arrays: dict[str, pa.Array] = {
        name: pa.array(values[rows]) for name, values in columns.numbers.items() if name not in measured
    }
    for name, (codes, labels) in columns.categories.items():
        chosen = codes[rows]
        indices = pa.array(np.maximum(chosen, 0).astype(np.int32), mask=chosen < 0)
        arrays[name] = pa.DictionaryArray.from_arrays(indices, pa.array(labels, type=pa.string()))
    pq.write_table(pa.table(arrays), path, compression="zstd")


def read_context(folder: Path) -> Columns | None:
    """What was kept beside a model; None where nothing was.

    Raises:
        DataError: the file is there but cannot be read.
    """
    path = Path(folder) / CONTEXT_FILE
    return load_table(path, for_prediction=True) if path.is_file() else None


def _kept_rows(columns: Columns) -> IntArray:
    if columns.n <= MOST_ROWS:
        return np.arange(columns.n)
    image = columns.group(*columns.image_columns)
    images = int(image.max()) + 1
    part = max(int(images * MOST_ROWS / columns.n), 1)
    chosen = np.zeros(images, dtype=bool)
    chosen[np.linspace(0, images - 1, part).round().astype(np.int64)] = True
    return np.flatnonzero(chosen[image])[:MOST_ROWS]


def beside(columns: Columns, context: Columns) -> Columns:
    """The rows of `columns`, and after them what was kept: only columns that `columns` has."""
    joined = _joined(columns, context)
    own = np.arange(joined.n) < columns.n
    twice, other, again = _conflicts(joined, own)
    record = np.zeros(joined.n, dtype=np.int64)
    record[other & ~own] = 1
    keep = np.flatnonzero(own | ~(twice & ~other))
    return Columns(
        len(keep),
        {name: values[keep] for name, values in joined.numbers.items()},
        {name: (codes[keep], labels) for name, (codes, labels) in joined.categories.items()},
        columns.channels,
        columns.ignored,
        record=record[keep],
        found_on=(~own | again)[keep],
    )


def _joined(columns: Columns, context: Columns) -> Columns:
    numbers: dict[str, FloatArray] = {}
    categories: dict[str, tuple[IntArray, tuple[str, ...]]] = {}
    for name, values in columns.numbers.items():
        kept = context.numbers.get(name)
        numbers[name] = np.concatenate([values, np.full(context.n, np.nan) if kept is None else kept])
    for name, (codes, labels) in columns.categories.items():
        kept_codes, kept_labels = context.categories.get(name, (np.full(context.n, -1), ()))
        together = tuple(sorted({*labels, *kept_labels}))
        place = {label: k for k, label in enumerate(together)}
        own, others = (np.array([*(place[label] for label in part), -1]) for part in (labels, kept_labels))
        categories[name] = np.concatenate([own[codes], others[kept_codes]]).astype(np.int64), together
    return Columns(columns.n + context.n, numbers, categories, columns.channels)


def _conflicts(joined: Columns, own: BoolArray) -> tuple[BoolArray, BoolArray, BoolArray]:
    """Kept rows that stand among the own ones as well, those of records that cannot be these, and the own of both."""
    record = joined.group(*_RECORD)
    twice, wrong, again = _repeated(joined, own)
    wrong |= _another_condition(joined, own) | _another_time(joined, own) | _another_course(joined, own)
    bad = np.zeros(int(record.max()) + 1, dtype=bool)
    bad[record[wrong]] = True
    return twice, bad[record], again


def _repeated(joined: Columns, own: BoolArray) -> tuple[BoolArray, BoolArray, BoolArray]:
    """Kept rows with the identity of an own one: with the same values, and with others; and own rows of the first."""
    identity = joined.group(*_WHEN, *_PLACE, *joined.image_columns)
    first = np.full(int(identity.max()) + 1, -1)
    first[identity[own]] = np.flatnonzero(own)
    kept = np.flatnonzero(~own & (first[identity] >= 0))
    twin = first[identity[kept]]
    differ = np.zeros(kept.size, dtype=bool)
    measured = {c.name for c in joined.channels}
    for name, values in joined.numbers.items():
        if name in measured or (name.endswith("_std") and not name.startswith("sim_")) or name == "n_frames":
            continue
        a, b = values[kept], values[twin]
        differ |= np.abs(a - b) > SAME * np.maximum(np.abs(a), np.abs(b))
    same, others, again = (np.zeros(joined.n, dtype=bool) for _ in range(3))
    same[kept[~differ]] = True
    others[kept[differ]] = True
    again[twin[~differ]] = True
    return same, others, again


def _conditions(joined: Columns) -> Iterator[FloatArray]:
    """The temperatures that go with the rows."""
    measured = {c.name for c in joined.channels}
    for name, values in joined.numbers.items():
        if name.endswith("_c") and not name.startswith("sim_") and name not in measured and np.isfinite(values).any():
            yield values


def _margin(values: FloatArray) -> float:
    return SAME_CONDITION * float(np.nanmax(values) - np.nanmin(values))


def _another_course(joined: Columns, own: BoolArray) -> BoolArray:
    """Own rows at whose times it was warmer or colder in the kept record, where no step says when they were taken."""
    wrong = np.zeros(joined.n, dtype=bool)
    if "time_s" not in joined.numbers or "step" in joined.numbers:
        return wrong
    record, time = joined.group(*_RECORD), joined.numbers["time_s"]
    for values in _conditions(joined):
        good = np.isfinite(values) & np.isfinite(time)
        for k in np.unique(record[own]):
            mine, kept = (np.flatnonzero(good & (record == k) & part) for part in (own, ~own))
            if not (mine.size and kept.size):
                continue
            kept = kept[np.argsort(time[kept], kind="stable")]
            mine = mine[(time[mine] >= time[kept[0]]) & (time[mine] <= time[kept[-1]])]
            off = np.abs(values[mine] - np.interp(time[mine], time[kept], values[kept]))
            if mine.size and float(np.mean(off)) > _margin(values):
                wrong[mine] = True
    return wrong


def _another_condition(joined: Columns, own: BoolArray) -> BoolArray:
    """Rows of steps that bear one name but whose own rows were taken under other conditions than the kept ones."""
    step = joined.group(*_WHEN)
    wrong = np.zeros(int(step.max()) + 1, dtype=bool)
    if "step" not in joined.numbers:
        return wrong[step]
    for values in _conditions(joined):
        (low, high), (least, most) = (_ends(step, values, part, wrong.size) for part in (own, ~own))
        known = np.isfinite(low) & np.isfinite(least)
        if known.any():
            wrong |= known & ((low > most + _margin(values)) | (high < least - _margin(values)))
    return wrong[step]


def _another_time(joined: Columns, own: BoolArray) -> BoolArray:
    """Rows of records in which steps of different names, own and kept ones, were taken at the same time."""
    wrong = np.zeros(joined.n, dtype=bool)
    if "time_s" not in joined.numbers or "step" not in joined.numbers:
        return wrong
    record, step, time = joined.group(*_RECORD), joined.group(*_WHEN), joined.numbers["time_s"]
    count = int(step.max()) + 1
    place = np.zeros(count, dtype=np.int64)
    place[step] = record
    (low, high), (least, most) = (_ends(step, time, part, count) for part in (own, ~own))
    kept = np.flatnonzero(np.isfinite(least))
    for k in np.flatnonzero(np.isfinite(low)):
        rivals = kept[(place[kept] == place[k]) & (kept != k)]
        common = np.minimum(high[k], most[rivals]) - np.maximum(low[k], least[rivals])
        shorter = np.minimum(high[k] - low[k], most[rivals] - least[rivals])
        if np.any((common > 0.5 * shorter) & (common >= 0.0)):
            wrong[record == place[k]] = True
    return wrong


def _ends(code: IntArray, values: FloatArray, rows: BoolArray, count: int) -> tuple[FloatArray, FloatArray]:
    low, high = np.full(count, np.inf), np.full(count, -np.inf)
    good = rows & np.isfinite(values)
    np.minimum.at(low, code[good], values[good])
    np.maximum.at(high, code[good], values[good])
    nothing = ~np.isfinite(low)
    low[nothing] = high[nothing] = np.nan
    return low, high
