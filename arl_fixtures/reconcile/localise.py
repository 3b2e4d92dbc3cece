"""Row by row: the mismatch that the model states, in standard errors, and which finding makes most of it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from arl_fixtures.reconcile.calibrated_units import calibrate_simulation
from arl_fixtures.reconcile.columns import Channel, Columns, FloatArray, IntArray
from arl_fixtures.reconcile.diagnosis import Finding
from arl_fixtures.reconcile.model_file import ModelFile
from arl_fixtures.reconcile.model_state import corrected_state, laws_of, terms_of
from arl_fixtures.reconcile.stated import stated_error
from arl_fixtures.reconcile.table import table_in_batches
from arl_fixtures.reconcile.terms import forward
from arl_fixtures.reconcile.turned import features_for
from arl_fixtures.reconcile.view import View

CHUNK = 250_000


def write_localisation(
    path: Path, table: Path, channels: Sequence[Channel], model: ModelFile, findings: Sequence[Finding], rows: int,
    *, progress: Callable[[float], None] = lambda _share: None,
) -> None:  # fmt: skip
    """Write `localisation.parquet` for all rows of a table, in their order, without holding the table in memory.

    Args:
        path: file to write.
        table: the observation table.
        channels: what was compared.
        model: found on the table, with the findings it came from.
        findings: strongest first.
        rows: of the table.
        progress: called with the share done.
    """
    fields = [
        field for c in channels for field in (
            pa.field(f"mismatch_{c.name}", pa.float64()), pa.field(f"finding_{c.name}", pa.int16()))
    ]  # fmt: skip
    result = [np.zeros(rows, dtype=field.type.to_pandas_dtype()) for field in fields]
    done = 0
    for numbers, columns in table_in_batches(table):
        columns.channels = tuple(channels)
        calibrate_simulation(columns, tuple(model.unit_columns), model.lines)
        for start in range(0, columns.n, CHUNK):
            part = np.arange(start, min(start + CHUNK, columns.n))
            for whole, values in zip(result, _piece(columns, part, model, findings, path), strict=True):
                whole[numbers[part]] = values
            done += len(part)
            progress(done / rows)
    pq.write_table(pa.table([pa.array(values) for values in result], schema=pa.schema(fields)), path)


def _piece(
    columns: Columns, rows: IntArray, model: ModelFile, findings: Sequence[Finding], path: Path
) -> list[FloatArray | NDArray[np.int16]]:
    view = View(columns, None if len(rows) == columns.n else rows)
    terms = terms_of(model, view, path)
    state = corrected_state(model, terms, view)
    shares: dict[str, list[tuple[int, FloatArray]]] = {c.name: [] for c in columns.channels}
    numbers = [k + 1 for k, f in enumerate(findings) for _ in f.terms]
    whole = forward(terms, view)
    for place, number in enumerate(numbers):
        without = forward([t for k, t in enumerate(terms) if k != place], view)
        for name in shares:
            if without[name] is not whole[name]:
                shares[name].append((number, np.abs(whole[name] - without[name])))
    laws = laws_of(model)
    if laws:
        features = features_for(view, laws)
        for law, number in zip(laws, [k + 1 for k, f in enumerate(findings) if f.law is not None], strict=True):
            if law.channel in shares:
                shares[law.channel].append((number, np.abs(law.correction(features, whole[law.channel]))))
    out: list[FloatArray | NDArray[np.int16]] = []
    for c in columns.channels:
        error, _ = stated_error(view, c)
        mismatch = (state[c.name] - view.sim[c.name]) / error
        out.append(mismatch)
        strongest = np.zeros(view.n, dtype=np.int16)
        most = np.full(view.n, 0.05) * error
        for k, size in shares[c.name]:
            larger = size > most
            strongest[larger] = k
            most = np.where(larger, size, most)
        out.append(strongest)
    return out
