"""From journals to files: the report as HTML and PDF."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from arl_fixtures.bench.config import BenchConfig, load_bench
from arl_fixtures.bench.keep import kept_bench
from arl_fixtures.errors import ConfigError
from arl_fixtures.files import write_whole
from arl_fixtures.journal.record import SessionRecord
from arl_fixtures.metrics.geometry_store import EXPECTATIONS
from arl_fixtures.report.blocks import Report
from arl_fixtures.report.cycles import Cycle
from arl_fixtures.report.html import html_page
from arl_fixtures.report.maps import MapMaker
from arl_fixtures.report.pdf import pdf_bytes


def map_maker(record: SessionRecord, bench: str = "") -> MapMaker:
    """Maps need the bench's geometry: from the bench file the session was run with.

    Args:
        record: the journal.
        bench: a bench file, or the name of a bench that comes with the package; by default the copy that the session
            kept, or the bench that the journal names if it has not changed since.

    Raises:
        ConfigError: a bench file that was given is wrong.
    """
    identity = record.identity
    if bench:
        return MapMaker(load_bench(bench))
    try:
        kept = kept_bench(record.path.parent, identity.bench_sha256)
    except ConfigError as error:
        why = str(error).replace(f"{record.path.parent}/", "")
        return MapMaker(None, f"the bench file that the session kept cannot be used here: {why}")
    store = record.path.parent / EXPECTATIONS
    if kept is not None:
        return MapMaker(kept, store=store if store.is_dir() else None)
    known = _bench_of(identity.bench_name)
    if known is not None and known.sha256 == identity.bench_sha256:
        return MapMaker(known)
    return MapMaker(None, f"the bench file with SHA-256 {identity.bench_sha256[:12]}… is not at hand (--bench FILE)")


def _bench_of(name: str) -> BenchConfig | None:
    try:
        return load_bench(name) if name and not name.endswith((".yaml", ".yml")) else None
    except ConfigError:
        return None


def report_name(cycles: Sequence[Cycle]) -> str:
    """File name without suffix: `report-session-0001` for one journal, `report-cycles-0000-0012` for several."""
    paths = {cycle.record.path for cycle in cycles}
    if len(paths) == 1:
        return f"report-{cycles[0].record.path.stem}"
    return f"report-cycles-{cycles[0].number:04d}-{cycles[-1].number:04d}"


def write_report(report: Report, folder: Path, name: str) -> tuple[Path, Path]:
    """Write `NAME.html` and `NAME.pdf`, each whole or not at all; older ones are replaced.

    Raises:
        StorageError: they cannot be written.
    """
    written = folder / f"{name}.html", folder / f"{name}.pdf"
    write_whole(written[0], html_page(report).encode())
    write_whole(written[1], pdf_bytes(report))
    return written
