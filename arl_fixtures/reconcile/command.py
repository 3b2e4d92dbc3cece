"""`arl reconcile TABLE --out DIR` and `arl predict DIR TABLE --out FILE`."""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path

import click
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from threadpoolctl import threadpool_limits

from arl_fixtures.errors import ArlError, DataError
from arl_fixtures.reconcile.calibrated_units import calibrate_simulation
from arl_fixtures.reconcile.columns import Columns, FloatArray
from arl_fixtures.reconcile.context import CONTEXT_FILE, beside, read_context, write_context
from arl_fixtures.reconcile.diagnosis import Diagnosis
from arl_fixtures.reconcile.localise import write_localisation
from arl_fixtures.reconcile.model_file import read_model, write_model
from arl_fixtures.reconcile.model_state import corrected_state, terms_of
from arl_fixtures.reconcile.own_words import in_own_words
from arl_fixtures.reconcile.page import write_page
from arl_fixtures.reconcile.progress_bar import Bar
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.report_json import write_json
from arl_fixtures.reconcile.roles import Role
from arl_fixtures.reconcile.search import Progress as ProgressCall
from arl_fixtures.reconcile.shared_work import cores, processes
from arl_fixtures.reconcile.table import load_table, open_table, sha256_of, table_in_batches
from arl_fixtures.reconcile.view import View
from arl_fixtures.reconcile.visibility import invisible_effects

CHUNK = 250_000
SELF_CONTAINED = 300_000
"""Rows of a table to predict above which it holds its own surroundings."""
WRITING = 0.9
"""Share of the work that is done when the answer is known."""


def reconcile(table_path: Path, out_dir: Path, progress: ProgressCall | None = None) -> Diagnosis:
    """Compare a table and write `diagnosis.json`, `diagnosis.html`, `model.yaml` and `localisation.parquet`.

    Beside a model lies `context.parquet`, what `predict` needs of this table. The folder appears as a whole or not at
    all; a context of an earlier model in it is removed.

    Raises:
        DataError: the table cannot be used, or the folder cannot be written.
    """
    table_path, out_dir = Path(table_path), Path(out_dir)
    if out_dir.exists() and not out_dir.is_dir():
        raise DataError(f"{out_dir}: is a file; expected a folder to write into")
    columns = load_table(table_path)
    rows = open_table(table_path).metadata.num_rows
    # sums over several threads round otherwise, and a fit may end elsewhere: one thread says the same on any machine
    with threadpool_limits(1, user_api="blas"):
        diagnosis, model, decision = diagnose(columns, sha256=sha256_of(table_path), rows=rows, progress=progress)
    diagnosis.invisible.update(invisible_effects(decision))
    told = in_own_words(diagnosis, columns.given)
    report: ProgressCall = progress or (lambda _text, _share: None)
    report("writing", WRITING)
    try:
        out_dir.parent.mkdir(parents=True, exist_ok=True)
        work = Path(tempfile.mkdtemp(prefix=f".{out_dir.name}.", dir=out_dir.parent))
    except OSError as error:
        raise DataError(f"{out_dir}: cannot be written ({error.strerror})") from None
    try:
        write_json(work / "diagnosis.json", told)
        write_model(work / "model.yaml", model)
        write_page(work / "diagnosis.html", told, decision, pictured=diagnosis)
        channels = columns.channels
        if model.effects or model.unknown:
            write_context(work / CONTEXT_FILE, columns)
        del decision, columns  # a large table is read again in batches: room for them
        write_localisation(
            work / "localisation.parquet", table_path, channels, model, diagnosis.findings, rows,
            progress=lambda share: report("writing", WRITING + (1.0 - WRITING) * share),
        )  # fmt: skip
        out_dir.mkdir(exist_ok=True)
        (out_dir / CONTEXT_FILE).unlink(missing_ok=True)
        for file in sorted(work.iterdir()):
            file.replace(out_dir / file.name)
    except OSError as error:
        raise DataError(f"{out_dir}: cannot be written ({error.strerror})") from None
    finally:
        shutil.rmtree(work, ignore_errors=True)
    return told


def predict(model_dir: Path, table_path: Path, out_file: Path, progress: ProgressCall | None = None) -> None:
    """Write the corrected simulation of a table's rows, in their order.

    Args:
        model_dir: folder with `model.yaml`.
        table_path: an observation table, measured columns or not.
        out_file: Parquet file to write; it appears whole or not at all.
        progress: called with a sentence and the share done.

    Raises:
        ConfigError: there is no usable `model.yaml`.
        DataError: the table lacks a column that the model needs, or cannot be read.
    """
    model_path = Path(model_dir) / "model.yaml"
    model = read_model(model_path)
    out_file = Path(out_file)
    rows = open_table(Path(table_path)).metadata.num_rows
    context = read_context(Path(model_dir))
    whole: dict[str, FloatArray] = {}
    done = 0
    for numbers, columns in table_in_batches(Path(table_path)):
        own = columns.n
        names = [c.name for c in columns.channels if c.role is not Role.SCATTER]
        names += _scatter_channels(columns)
        calibrate_simulation(columns, tuple(model.unit_columns), model.lines)
        if context is not None and own <= SELF_CONTAINED:
            columns = beside(columns, context)
        for start in range(0, own, CHUNK):
            part = np.arange(start, min(start + CHUNK, own))
            view = View(columns, None if columns.n <= CHUNK else part)
            try:
                state = corrected_state(model, terms_of(model, view, model_path), view)
            except DataError as error:
                raise DataError(f"{table_path}: {error}") from None
            for name in names:
                if name in state:
                    values = whole.setdefault(f"corrected_{name}", np.full(rows, np.nan))
                    values[numbers[part]] = state[name][: len(part)]
            done += len(part)
            if progress is not None:
                progress("predicting", done / rows)
    table = pa.table({name: pa.array(values) for name, values in whole.items()})
    try:
        out_file.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=out_file.parent, prefix=f".{out_file.name}.") as work:
            pq.write_table(table, Path(work) / "table")
            (Path(work) / "table").replace(out_file)
    except OSError as error:
        raise DataError(f"{out_file}: cannot be written ({error.strerror})") from None


def _scatter_channels(columns: Columns) -> list[str]:
    """Scatter columns to predict: wherever the simulation states one that may be measured."""
    return [
        f"{c.name}_std" for c in columns.channels
        if c.role is not Role.SCATTER and f"sim_{c.name}_std" in columns.numbers
    ]  # fmt: skip


@click.command("reconcile")
@click.argument("table", type=click.Path(path_type=Path))
@click.option("--out", required=True, type=click.Path(path_type=Path), help="Folder for the diagnosis.")
def reconcile_command(table: Path, out: Path) -> None:
    """Find and name what the simulation left out of an observation TABLE."""
    try:
        with Bar() as progress, processes(cores()):
            diagnosis = reconcile(table, out, progress)
    except ArlError as error:
        click.echo(str(error), err=True)
        raise SystemExit(2) from None
    click.echo(f"{diagnosis.verdict} ({diagnosis.rows} rows, {', '.join(diagnosis.channels)})")
    for finding in diagnosis.findings:
        click.echo(f"- {finding.effect}: {finding.statement}")


@click.command("predict")
@click.argument("model", type=click.Path(path_type=Path))
@click.argument("table", type=click.Path(path_type=Path))
@click.option("--out", required=True, type=click.Path(path_type=Path), help="Parquet file to write.")
def predict_command(model: Path, table: Path, out: Path) -> None:
    """Apply the model found in folder MODEL to the rows of TABLE."""
    try:
        with Bar() as progress:
            predict(model, table, out, progress)
    except ArlError as error:
        click.echo(str(error), err=True)
        raise SystemExit(2) from None
