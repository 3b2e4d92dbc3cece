"""The command `arl`."""

from __future__ import annotations

import importlib
import sys
from typing import Final

import click

import arl_fixtures
from arl_fixtures.errors import ArlError

COMMANDS: Final = {
    "ack": "arl_fixtures.cli.safety:ack",
    "cloud": "arl_fixtures.cli.bags:cloud",
    "doctor": "arl_fixtures.cli.doctor:doctor",
    "emulate": "arl_fixtures.cli.emulate:emulate",
    "guard": "arl_fixtures.cli.safety:guard",
    "history": "arl_fixtures.cli.results:history",
    "judge": "arl_fixtures.cli.results:judge",
    "lab": "arl_fixtures.cli.safety:lab",
    "measure": "arl_fixtures.cli.measure:measure_command",
    "observe": "arl_fixtures.cli.observe:observe_command",
    "predict": "arl_fixtures.reconcile.command:predict_command",
    "reconcile": "arl_fixtures.reconcile.command:reconcile_command",
    "recover": "arl_fixtures.cli.bags:recover",
    "report": "arl_fixtures.cli.results:report",
}
"""Command to the place it is loaded from when it is used, so that `arl --help` starts at once."""


class LazyGroup(click.Group):
    """A group that imports a command only when it is asked for."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """All names."""
        return sorted(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import one."""
        if cmd_name not in COMMANDS:
            return None
        module, _, attribute = COMMANDS[cmd_name].partition(":")
        command = getattr(importlib.import_module(module), attribute)
        assert isinstance(command, click.Command)
        return command


@click.group(cls=LazyGroup)
@click.version_option(arl_fixtures.__version__, prog_name="arl")
def arl() -> None:
    """Accelerated real-life testing of LiDAR sensors."""


def main() -> None:
    """Entry point: what goes wrong on purpose is one line on stderr and exit status 2."""
    try:
        arl.main(standalone_mode=False)
    except ArlError as error:
        click.echo(f"arl: {error}", err=True)
        sys.exit(2)
    except click.ClickException as error:
        error.show()
        sys.exit(2)
    except (click.Abort, KeyboardInterrupt):
        click.echo("arl: interrupted", err=True)
        sys.exit(130)
