"""`arl report`, `arl judge`, `arl history`: what is made of journals after the test."""

from __future__ import annotations

import csv
import hashlib
import sys
from pathlib import Path

import click
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from arl_fixtures.errors import ConfigError
from arl_fixtures.files import write_whole
from arl_fixtures.journal.index import HistoryRow, rebuild
from arl_fixtures.journal.index import history as read_history
from arl_fixtures.journal.record import read_journal
from arl_fixtures.journal.rejudge import rejudge
from arl_fixtures.metrics.limits import check_metrics, load_limits
from arl_fixtures.metrics.registry import metric_names, metric_units
from arl_fixtures.report.allure import write_allure
from arl_fixtures.report.cycles import load_cycles
from arl_fixtures.report.document import make_report
from arl_fixtures.report.junit import junit_xml
from arl_fixtures.report.lifetime import load_lifetime
from arl_fixtures.report.text import no_formula, rounded, shown, with_unit
from arl_fixtures.report.write import map_maker, report_name, write_report

PATH = click.Path(path_type=Path)
LIFETIME = Path("reports/lifetime.yaml")
LONGEST_LINE = 100_000


@click.command()
@click.argument("cycles", type=PATH, nargs=-1, required=True, metavar="CYCLE…")
@click.option("--out", type=PATH, metavar="FOLDER", help="where the report goes (default: beside the first journal)")
@click.option("--bench", metavar="FILE", default="", help="bench file of the session, for the maps")
@click.option(
    "--maps",
    metavar="STEPS",
    default="",
    help="steps with maps: ids separated by commas, or 'all' (default: coldest, reference temperature, hottest)",
)
@click.option(
    "--lifetime",
    type=PATH,
    metavar="FILE",
    help=f"what cycles are worth in use (default: {LIFETIME}, if it is there)",
)
@click.option("--junit", type=PATH, metavar="FILE", help="also rebuild the JUnit results of the journals")
@click.option("--allure", type=PATH, metavar="FOLDER", help="also rebuild the Allure results of the journals")
def report(
    cycles: tuple[Path, ...],
    out: Path | None,
    bench: str,
    maps: str,
    lifetime: Path | None,
    junit: Path | None,
    allure: Path | None,
) -> None:
    """Write the sign-off report of output folders or journals, as PDF and as one HTML page."""
    loaded = load_cycles(cycles)
    records = list({cycle.record.path: cycle.record for cycle in loaded}.values())
    folder = out or loaded[0].record.path.parent
    if lifetime is None and LIFETIME.is_file():
        lifetime = LIFETIME
    made = make_report(
        loaded,
        map_maker(loaded[-1].record, bench),
        load_lifetime(lifetime) if lifetime else None,
        [step.strip() for step in maps.split(",") if step.strip()],
    )
    for path in write_report(made, folder, report_name(loaded)):
        click.echo(str(path))
    if junit is not None:
        write_whole(junit, junit_xml(records))
        click.echo(str(junit))
    if allure is not None:
        for record in records:
            write_allure(record, allure)
        click.echo(str(allure))
    click.echo(f"{made.verdict.text}{': ' * bool(made.decided_by)}{made.decided_by}")


@click.command()
@click.argument("journal", type=PATH)
@click.option("--limits", type=PATH, required=True, metavar="FILE", help="the new limits")
def judge(journal: Path, limits: Path) -> None:
    """Judge the measurements of an old journal anew, into a new journal beside it; the old one stays as it is."""
    wanted = load_limits(limits)
    check_metrics(wanted, metric_names(), metric_units(), limits)
    try:
        digest = hashlib.sha256(limits.read_bytes()).hexdigest()
    except OSError as error:
        raise ConfigError(f"cannot read: {error.strerror}", path=limits) from None
    old = read_journal(journal)
    new = rejudge(old, wanted, digest)
    click.echo(str(new.path))
    click.echo(
        f"RE-JUDGEMENT of {journal.name} against '{wanted.name}' version {wanted.version}: "
        f"{new.end.verdict if new.end else 'INVALID'} (was {old.end.verdict if old.end else 'not ended'})"
    )


@click.command()
@click.argument("folder", type=PATH)
@click.option("--metric", metavar="NAME", help="one metric only")
@click.option("--dut", metavar="SERIAL", help="one DUT only")
@click.option("--step", metavar="ID", help="one step only, e.g. c0003-07-up+25C")
@click.option("--rejudged", is_flag=True, help="re-judgements instead of the sessions themselves")
@click.option("--csv", "as_csv", is_flag=True, help="comma-separated, everything the index knows of each value")
@click.option("--most", type=click.IntRange(min=1), default=1000, show_default=True, help="most rows")
def history(
    folder: Path, metric: str | None, dut: str | None, step: str | None, rejudged: bool, as_csv: bool, most: int
) -> None:
    """List the values of all journals below a folder; rebuilds their index."""
    # one more than is shown, to know whether some are left out
    rows = read_history(
        rebuild(folder),
        metric=metric,
        dut=dut,
        step_id=step,
        rejudged=rejudged,
        limit=sys.maxsize if as_csv else most + 1,
    )
    if as_csv:
        writer = csv.writer(sys.stdout, lineterminator="\n")
        names = tuple(HistoryRow.__dataclass_fields__)
        writer.writerow(names)
        writer.writerows([no_formula(getattr(row, name)) for name in names] for row in rows)
        return
    table = Table(box=None, header_style="bold")
    for title in ("step", "try", "DUT", "metric", "value", "verdict", "reason"):
        table.add_column(title, overflow="fold", no_wrap=title in {"step", "DUT", "verdict"})
    for row in rows[:most]:
        table.add_row(*(escape(cell) for cell in _cells(row)))
    # what is piped is read by a program or searched: one line a value
    Console(width=None if sys.stdout.isatty() else LONGEST_LINE).print(table)
    if len(rows) > most:
        click.echo(f"the first {most} values; more with --most, all with --csv", err=True)


def _cells(row: HistoryRow) -> tuple[str, ...]:
    value = "–" if row.value is None else with_unit(rounded(row.value, row.uncertainty or 0.0), row.unit)
    name = f"{row.metric}[{row.scope}]" if row.scope else row.metric
    texts = (row.step_id, str(row.attempt), row.dut, name, value, row.verdict, row.reason)
    return tuple(shown(text) for text in texts)
