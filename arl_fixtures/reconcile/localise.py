"""Row by row: the mismatch that the model states, in standard errors, and which finding makes most of it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from arl_fixtures.reconcile.columns import Columns, FloatArray, IntArray
from arl_fixtures.reconcile.diagnosis import Finding
from arl_fixtures.reconcile.features import features_of
from arl_fixtures.reconcile.model_file import ModelFile, corrected_state, laws_of, terms_of
from arl_fixtures.reconcile.problem import stated_error
from arl_fixtures.reconcile.terms import forward
from arl_fixtures.reconcile.view import View

CHUNK = 250_000


def write_localisation(path: Path, columns: Columns, model: ModelFile, findings: Sequence[Finding]) -> None:
    """Write `localisation.parquet` for the rows of a table, piece by piece."""
    schema = pa.schema(
        [field for c in columns.channels for field in (
            pa.field(f"mismatch_{c.name}", pa.float64()), pa.field(f"finding_{c.name}", pa.int16()))]
    )  # fmt: skip
    with pq.ParquetWriter(path, schema) as writer:
        for start in range(0, columns.n, CHUNK):
            rows = np.arange(start, min(start + CHUNK, columns.n))
            writer.write_table(_piece(columns, rows, model, findings, path, schema))


def _piece(
    columns: Columns, rows: IntArray, model: ModelFile, findings: Sequence[Finding], path: Path, schema: pa.Schema
) -> pa.Table:
    view = View(columns, None if len(rows) == columns.n else rows)
    terms = terms_of(model, view, path)
    state = corrected_state(model, terms, view)
    shares: dict[str, list[tuple[int, FloatArray]]] = {c.name: [] for c in columns.channels}
    numbers = [k + 1 for k, f in enumerate(findings) if f.term is not None]
    whole = forward(terms, view)
    for place, number in enumerate(numbers):
        without = forward([t for k, t in enumerate(terms) if k != place], view)
        for name in shares:
            if without[name] is not whole[name]:
                shares[name].append((number, np.abs(whole[name] - without[name])))
    laws = laws_of(model)
    if laws:
        features = features_of(view)
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
    return pa.table([pa.array(column) for column in out], schema=schema)
