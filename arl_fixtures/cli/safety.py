"""`arl guard`, `arl ack`, `arl lab`: who keeps the bench safe, and emulated hardware that outlives a test."""

from __future__ import annotations

import getpass
from pathlib import Path

import click

from arl_fixtures.bench.config import load_bench
from arl_fixtures.errors import ConfigError, InterlockError

BENCH = click.option("--bench", "bench_file", default="emulated", show_default=True, metavar="FILE", help="its file")
RUNTIME = click.option(
    "--runtime", type=click.Path(path_type=Path), metavar="FOLDER", help="where guards keep their files"
)
LAB = click.option("--lab", type=click.Path(path_type=Path), metavar="SOCKET", help="lab with the emulated hardware")


@click.command()
@BENCH
@LAB
@RUNTIME
@click.option("--status", "only_status", is_flag=True, help="say what the guard of the bench does, and end")
def guard(bench_file: str, lab: Path | None, runtime: Path | None, only_status: bool) -> None:
    """Guard a bench until SIGTERM. A test starts a guard by itself; this one stays when the test has ended."""
    from arl_fixtures.guard.run import run_guard
    from arl_fixtures.guard.runtime import Places
    from arl_fixtures.guard.status import guard_status

    config = load_bench(bench_file)
    places = Places.of(config.name, runtime)
    if only_status:
        click.echo(guard_status(places, lease_s=config.guard.lease_s))
        return
    if lab is None and any(entry.emulated for entry in config.devices().values()):
        raise ConfigError(f"bench '{config.name}' is emulated: a guard of its own needs --lab SOCKET")
    click.echo(f"guarding bench '{config.name}'; SIGTERM ends it")
    run_guard(config, places, lab=lab)


@click.command()
@BENCH
@RUNTIME
@click.option("--note", default="", metavar="TEXT", help="what was found and done")
@click.option("--by", metavar="NAME", help="who has looked; by default the user's name")
@click.option("--yes", is_flag=True, help="do not ask")
def ack(bench_file: str, runtime: Path | None, note: str, by: str | None, yes: bool) -> None:
    """Show why the bench was stopped, and allow it to be driven again."""
    from arl_fixtures.guard.acknowledge import acknowledge
    from arl_fixtures.guard.runtime import Places, read_stop

    places = Places.of(load_bench(bench_file).name, runtime)
    report = read_stop(places)
    if report is None or not report.blocks:
        raise InterlockError("nothing to acknowledge")
    click.echo(str(report))
    for action in report.actions:
        click.echo(f"  {action['time_s']:.3f} s  {action['step']}: {action['fault'] or 'verified'}")
    if not (yes or _agreed("Has somebody looked at the bench, and may it be driven again?")):
        raise InterlockError("not acknowledged; the bench stays as it is (--yes where nobody can be asked)")
    acknowledge(places, who=by or getpass.getuser(), note=note)
    click.echo("acknowledged")


def _agreed(question: str) -> bool:
    try:
        return click.confirm(question)
    except click.Abort:
        click.echo()
        return False


@click.command()
@BENCH
@click.argument("socket", type=click.Path(path_type=Path))
@click.option("--fault", "faults", multiple=True, metavar="FAULT", help="DEVICE:KIND[@START_S][/DURATION_S][=VALUE]")
@click.option("--grace", "grace_s", default=2.0, show_default=True, metavar="S", help="see docs/guard.md")
def lab(bench_file: str, socket: Path, faults: tuple[str, ...], grace_s: float) -> None:
    """Hold a bench's emulated hardware in virtual time at a Unix SOCKET, for tests that may be killed."""
    from arl_fixtures.lab.run import run_lab

    run_lab(load_bench(bench_file), socket, faults=faults, grace_s=grace_s, ready=click.echo)
