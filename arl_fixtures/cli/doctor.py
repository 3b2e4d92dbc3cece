"""`arl doctor`: connect to each device, say who it is, what it reads and what is wrong, all in one report."""

from __future__ import annotations

import sys

import click

from arl_fixtures.bench.config import load_bench
from arl_fixtures.bench.doctor import examine


@click.command()
@click.option("--bench", "bench_file", default="emulated", show_default=True, metavar="FILE", help="bench file")
def doctor(bench_file: str) -> None:
    """Connect to every device of a bench and report identity, firmware, a reading and what is wrong.

    Nothing is moved, heated or powered. Exit status 1 when anything is wrong.
    """
    findings = examine(load_bench(bench_file))
    for finding in findings:
        mark = "ok " if not finding.fault else "BAD"
        click.echo(f"{mark}  {finding.device:<12} {finding.driver:<10} {finding.url}")
        for line in (finding.identity, finding.reading, finding.fault):
            if line:
                click.echo(f"       {line}")
    sys.exit(1 if any(finding.fault for finding in findings) else 0)
