"""Run a lab until somebody ends it: `arl emulate --lab SOCKET`, or `python -m arl_fixtures.lab`."""

from __future__ import annotations

import argparse
import signal
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from arl_fixtures.bench.build import Emulated
from arl_fixtures.bench.clock import VirtualClock
from arl_fixtures.bench.config import BenchConfig, load_bench
from arl_fixtures.emulators.faults import parse_fault
from arl_fixtures.errors import ArlError, ConfigError
from arl_fixtures.lab.server import LabServer


def run_lab(
    config: BenchConfig,
    path: Path,
    *,
    faults: Sequence[str] = (),
    grace_s: float = 2.0,
    ready: Callable[[str], None] = lambda _text: None,
) -> None:
    """Serve the emulated hardware of a bench at a Unix socket until SIGTERM or SIGINT.

    Args:
        config: a bench with every device emulated.
        path: the socket.
        faults: texts of `parse_fault`.
        grace_s: wall time for which a client that does not wait holds the clock.
        ready: told, in words, once clients can connect.

    Raises:
        ConfigError: a device is not emulated, or a fault does not exist.
        ArlError: the socket is taken.
    """
    real = [kind for kind, entry in config.devices().items() if not entry.emulated]
    if real:
        raise ConfigError(f"bench '{config.name}': {real[0]} is not emulated, so a lab cannot hold it")
    world = Emulated(config, VirtualClock())
    for fault in faults:
        world.plant.faults.inject(parse_fault(fault))
    server = LabServer(world, path, grace_s=grace_s)
    before = {number: signal.signal(number, lambda *_: server.stop()) for number in (signal.SIGTERM, signal.SIGINT)}
    try:
        ready(f"lab '{config.name}' at {path}")
        server.serve()
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def main(arguments: Sequence[str] | None = None) -> int:
    """Command line of `python -m arl_fixtures.lab`."""
    parser = argparse.ArgumentParser(prog="arl_fixtures.lab", description="emulated hardware in a process of its own")
    parser.add_argument("--bench", required=True, metavar="FILE", help="bench file, or the name of a built-in bench")
    parser.add_argument("--lab", required=True, type=Path, metavar="SOCKET", help="Unix socket to listen at")
    parser.add_argument("--fault", action="append", default=[], metavar="TEXT", help="DEVICE:KIND[@START_S]…")
    parser.add_argument("--grace", type=float, default=2.0, metavar="S", help="see docs/guard.md")
    options = parser.parse_args(arguments)

    def ready(text: str) -> None:
        sys.stdout.write(text + "\n")
        sys.stdout.flush()

    try:
        run_lab(
            load_bench(options.bench), options.lab, faults=options.fault, grace_s=options.grace, ready=ready
        )
    except ArlError as error:
        sys.stderr.write(f"{error}\n")
        return 2
    return 0
