"""`arl emulate`: the emulators of a bench, stand-alone and in real time, for any client to be pointed at."""

from __future__ import annotations

import signal
from pathlib import Path

import click

from arl_fixtures.bench.build import CONTROL_LINES, make_duts, make_line
from arl_fixtures.bench.config import load_bench
from arl_fixtures.bench.emulated_file import bench_file_for
from arl_fixtures.bench.serve import LOOPBACK, EmulatorServer
from arl_fixtures.emulators.faults import FaultBook, parse_fault
from arl_fixtures.emulators.plant import Plant
from arl_fixtures.errors import ConfigError

FAULT_FORM = "DEVICE:KIND[@START_S][/DURATION_S][=VALUE][#CHANNEL], may be repeated"


@click.command()
@click.option("--bench", "bench_file", default="emulated", show_default=True, metavar="FILE", help="bench file")
@click.option("--line", type=click.Choice(["tcp", "pty"]), default="tcp", show_default=True, help="control lines on")
@click.option(
    "--write-bench",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="write a bench file that points at these emulators",
)
@click.option("--fault", "faults", multiple=True, metavar="FAULT", help=FAULT_FORM)
@click.option("--destination", default=LOOPBACK, show_default=True, metavar="HOST", help="where the DUTs send to")
def emulate(bench_file: str, line: str, write_bench: Path | None, faults: tuple[str, ...], destination: str) -> None:
    """Run a bench's emulated devices in real time until Ctrl-C. They listen on loopback only.

    With --write-bench a bench that is partly there can be used: devices with an address of their own keep it.
    """
    config = load_bench(bench_file)
    emulated = {kind for kind, entry in config.devices().items() if entry.emulated}
    if not emulated:
        raise ConfigError(f"bench '{config.name}': no device is emulated, there is nothing to run")
    book = FaultBook([*config.emulation.faults, *(parse_fault(text) for text in faults)])
    plant = Plant(config.emulation.plant, faults=book)
    server = EmulatorServer(destination=destination)
    places: dict[str, str] = {}
    for kind in CONTROL_LINES:
        if kind not in emulated:
            continue
        device = make_line(config, kind, plant)
        if line == "pty" and kind != "chiller":
            places[kind] = f"serial://{server.add_pty(kind, device)}"
        else:
            host, port = server.add_tcp(kind, device)
            places[kind] = f"tcp://{host}:{port}"
    if "duts" in emulated:
        for number, dut in enumerate(make_duts(config, plant), start=1):
            server.add_udp(f"dut_{number}", dut)
    for name, place in places.items():
        click.echo(f"{name:<12} {place}")
    for unit in config.dut_settings if "duts" in emulated else ():
        click.echo(f"{'dut':<12} {unit.serial} sends from {unit.sender_address} to {destination}")
    if write_bench is not None:
        try:
            write_bench.write_text(bench_file_for(bench_file, places, duts="duts" in emulated), encoding="utf-8")
        except OSError as error:
            raise ConfigError(f"cannot write: {error.strerror}", path=write_bench) from None
        click.echo(f"bench file   {write_bench}")
    if ("chiller" in emulated) != ("thermometer" in emulated):
        click.echo("take care: chiller and thermometer do not feel each other; a cycle would heat to the limit")
    click.echo("running; Ctrl-C ends it")
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: server.stop())
    server.run()
