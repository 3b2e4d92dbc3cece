"""`arl measure`: the values and verdicts of recorded steps, from their bags alone."""

from __future__ import annotations

import csv
import sys
from collections.abc import Iterator
from pathlib import Path

import click
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from arl_fixtures.bench.config import BenchConfig, load_bench
from arl_fixtures.bench.keep import kept_bench, kept_file
from arl_fixtures.bench.profile import load_profile
from arl_fixtures.errors import DataError
from arl_fixtures.journal.bridge import measurement_entry
from arl_fixtures.metrics.geometry_store import EXPECTATIONS
from arl_fixtures.metrics.judge import Judgement, judge, overall
from arl_fixtures.metrics.limits import LimitSet, check_metrics, load_limits
from arl_fixtures.metrics.registry import measure, metric_names, metric_units
from arl_fixtures.metrics.verdict import Verdict, worst
from arl_fixtures.recording.bags import bags_in
from arl_fixtures.recording.metadata import StepMetadata
from arl_fixtures.recording.reader import StepBag
from arl_fixtures.recording.remeasure import RecordedStep, Remeasurer
from arl_fixtures.report.text import no_formula, shown, value_text

PATH = click.Path(path_type=Path)
LONGEST_LINE = 100_000
COLUMNS = ("step", "attempt", "dut", "metric", "scope", "value", "unit", "u", "verdict", "limit", "reason")


@click.command("measure")
@click.argument("cycles", type=PATH, nargs=-1, required=True, metavar="CYCLE…")
@click.option("--bench", metavar="FILE", default="", help="bench file (default: the copy that the session kept)")
@click.option("--limits", type=PATH, metavar="FILE", help="limits (default: the copy that the session kept)")
@click.option("--references", type=PATH, metavar="FOLDER", help="references (default: those of the session)")
@click.option("--all", "everything", is_flag=True, help="also the values that pass")
@click.option("--csv", "as_csv", is_flag=True, help="comma-separated, every value")
def measure_command(
    cycles: tuple[Path, ...],
    bench: str,
    limits: Path | None,
    references: Path | None,
    everything: bool,
    as_csv: bool,
) -> None:
    """Measure the bags of CYCLES anew and judge them: output folders, folders of bags, or bags."""
    bags = [bag for folder in cycles for bag in bags_in(folder)]
    session = _Sessions(bench, limits, references)
    writer = csv.writer(sys.stdout, lineterminator="\n")
    if as_csv:
        writer.writerow(COLUMNS)
    verdicts = []
    for bag in bags:
        try:
            step, judgements = session.judged(bag)
        except DataError as error:
            verdicts.append(Verdict.INVALID)
            click.echo(f"{shown(bag.name)} INVALID: {shown(str(error))}", err=as_csv)
            continue
        verdict, decisive = overall(judgements)
        verdicts.append(verdict)
        if as_csv:
            writer.writerows(_row(step.metadata, each) for each in judgements)
            continue
        click.echo(_headline(step, verdict, decisive))
        wanted = [each for each in judgements if everything or each.verdict is not Verdict.PASS]
        rows = [each for each in wanted if each.measurement.quantity is not None]
        if rows:
            Console(width=None if sys.stdout.isatty() else LONGEST_LINE).print(_table(step.metadata, rows))
        for line in _without_value([each for each in wanted if each.measurement.quantity is None]):
            click.echo(line)
    if not as_csv:
        click.echo(f"{worst(verdicts).value}: {len(bags)} step{'s' * (len(bags) != 1)}")


class _Sessions:
    """Bench, limits and references of the sessions that bags come from, each read once.

    Args:
        bench, limits, references: as given by the user, who knows better; empty or None for what the session kept.
    """

    def __init__(self, bench: str, limits: Path | None, references: Path | None) -> None:
        self._bench = load_bench(bench) if bench else None
        self._limits = _checked(limits) if limits is not None else None
        self._references = references
        self._remeasurers: dict[tuple[Path, str, str], Remeasurer] = {}
        self._kept_limits: dict[tuple[Path, str], LimitSet] = {}

    def judged(self, path: Path) -> tuple[RecordedStep, list[Judgement]]:
        """A bag, measured and judged."""
        metadata = StepBag(path).metadata
        out = path.resolve().parent.parent
        key = out, metadata.bench_sha256, metadata.profile_sha256
        if key not in self._remeasurers:
            self._remeasurers[key] = self._remeasurer(out, metadata)
        limits = self._limits or self._limits_of(out, metadata)
        step = self._remeasurers[key].step(path)
        measured = [value for data in step.steps.values() for value in measure(data)]
        types = {data.dut.serial: data.dut.model for data in step.steps.values()}
        return step, judge(measured, limits, step.conditions, types)

    def _remeasurer(self, out: Path, metadata: StepMetadata) -> Remeasurer:
        profile = kept_file(metadata.profile_sha256, "profile", out)
        store = out / EXPECTATIONS
        return Remeasurer(
            self._bench or _bench_of(out, metadata),
            references=self._references or out / "references",
            expected_angles=0 if profile is None else len(load_profile(str(profile)).angles.angles_deg(1)),
            store=store if store.is_dir() else None,
        )

    def _limits_of(self, out: Path, metadata: StepMetadata) -> LimitSet:
        key = out, metadata.limits_sha256
        if key not in self._kept_limits:
            path = kept_file(metadata.limits_sha256, "limits", out)
            if path is None:
                raise DataError(f"{out}: the limits that the bag names are not kept there (--limits FILE)")
            self._kept_limits[key] = _checked(path)
        return self._kept_limits[key]


def _bench_of(out: Path, metadata: StepMetadata) -> BenchConfig:
    found = kept_bench(out, metadata.bench_sha256)
    if found is None:
        raise DataError(f"{out}: the bench file that the bag names is not kept there (--bench FILE)")
    return found


def _checked(path: Path) -> LimitSet:
    limits = load_limits(path)
    check_metrics(limits, metric_names(), metric_units(), path)
    return limits


def _headline(step: RecordedStep, verdict: Verdict, decisive: Judgement | None) -> str:
    metadata = step.metadata
    name = metadata.step_id if metadata.attempt == 1 else f"{metadata.step_id} attempt {metadata.attempt}"
    why = ""
    if decisive is not None and verdict is not Verdict.PASS:
        of = decisive.measurement
        why = f": {shown(of.dut)} {of.name}: {shown(decisive.reason)}"
    fault = f"\n  {shown(step.fault)}" if step.fault and shown(step.fault) not in why else ""
    return f"{shown(name)} {verdict.value}{why}{fault}"


def _table(metadata: StepMetadata, judgements: list[Judgement]) -> Table:
    table = Table(box=None, header_style="bold", padding=(0, 2, 0, 2))
    for title in ("DUT", "metric", "value", "verdict", "reason"):
        table.add_column(title, overflow="fold", no_wrap=title in {"DUT", "verdict"})
    for each in judgements:
        of = each.measurement
        entry = measurement_entry(metadata.step_id, metadata.attempt, of)
        value = value_text(entry, each.limit.unit if each.limit else "")
        table.add_row(*(escape(shown(cell)) for cell in (of.dut, of.name, value, each.verdict.value, each.reason)))
    return table


def _without_value(judgements: list[Judgement]) -> Iterator[str]:
    """Two lines for all values of a DUT that are missing for the same reason."""
    names: dict[str, dict[str, None]] = {}
    for each in judgements:
        line = f"  {shown(each.measurement.dut)} {each.verdict.value}: {shown(each.reason)}"
        names.setdefault(line, {})[each.measurement.name] = None
    for line, found in names.items():
        yield line
        yield f"    {', '.join(found)}"


def _row(metadata: StepMetadata, judgement: Judgement) -> tuple[object, ...]:
    of = judgement.measurement
    quantity = of.quantity
    numbers = ("", "", "") if quantity is None else (float(quantity.value), quantity.unit, float(quantity.u))
    limit = "" if judgement.limit is None else str(judgement.limit)
    named = (metadata.step_id, metadata.attempt, of.dut, of.metric, of.scope)
    return tuple(no_formula(cell) for cell in (*named, *numbers, judgement.verdict.value, limit, judgement.reason))
