"""Start a guard process: by hand with `arl guard --bench FILE`, or from the test with `start_guard`."""

from __future__ import annotations

import argparse
import os
import signal
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from arl_fixtures.bench.config import BenchConfig, load_bench
from arl_fixtures.errors import ArlError, ConfigError, InterlockError
from arl_fixtures.guard.host import Host, LabHost, RealHost
from arl_fixtures.guard.process import GuardProcess
from arl_fixtures.guard.runtime import Lease, NoGuardError, Places
from arl_fixtures.guard.sentinel import Sentinel
from arl_fixtures.lab.client import LabClient

LINGER_S: Final = 300.0
TAKEN: Final = 3
"""Exit status of a guard that was refused its lease."""


def run_guard(
    config: BenchConfig,
    places: Places,
    *,
    lab: Path | None = None,
    linger_s: float | None = None,
    ready_fd: int | None = None,
) -> None:
    """Guard a bench until SIGTERM, or until no test needs it any more. Ctrl-C and a closed terminal do not end it.

    Args:
        config: the bench file.
        places: its files.
        lab: socket of the lab that holds the hardware; None for real hardware.
        linger_s: how long it stays without a test; None: for ever.
        ready_fd: written to and closed once tests can connect.

    Raises:
        InterlockError: another guard holds the bench.
        DeviceError: a line cannot be opened.
    """
    lease = Lease(places.lease, lease_s=config.guard.lease_s)

    def next_guard() -> None:
        # it makes safe what it finds, and goes: nobody has asked for one that stays
        run_guard(config, places, lab=lab, linger_s=0.0)

    sentinel = Sentinel(places, config.guard, next_guard)
    try:
        host: Host = RealHost(config) if lab is None else LabHost(LabClient.connect(lab, "guard", role="follower"))
        guard = GuardProcess(config, host, places, lease, sentinel, linger_s=linger_s)
    except BaseException:
        lease.release()
        raise
    signal.signal(signal.SIGTERM, lambda *_: guard.stop())
    for number in (signal.SIGINT, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    if ready_fd is not None:
        os.write(ready_fd, b"ready\n")
        os.close(ready_fd)
    guard.run()


def start_guard(bench_file: str, places: Places, *, lab: Path | None, linger_s: float = LINGER_S) -> int:
    """Start a guard in a session of its own and wait until tests can connect; returns its process number.

    Raises:
        NoGuardError: another guard has come first.
        InterlockError: it did not start; the message is its own.
    """
    reader, writer = os.pipe()
    command = [sys.executable, "-m", "arl_fixtures.guard", "--bench", bench_file]
    command += ["--runtime", str(places.folder.parent), "--ready-fd", str(writer), "--linger", str(linger_s)]
    command += ["--lab", str(lab)] if lab is not None else []
    try:
        with places.errors.open("wb") as errors:
            process = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=errors,
                pass_fds=(writer,),
                # neither Ctrl-C nor a closed terminal of the test may reach it
                start_new_session=True,
            )
        os.close(writer)
        # ends with its word, or with its death
        with os.fdopen(reader, "rb") as pipe:
            said = pipe.read()
    except OSError as error:
        raise InterlockError(f"the guard cannot be started: {error.strerror}") from None
    if said != b"ready\n":
        status = process.wait()
        text = "; ".join(places.errors.read_text(errors="replace").split("\n")).strip("; ")
        raise (NoGuardError if status == TAKEN else InterlockError)(f"the guard did not start: {text[-600:]}")
    # it outlives this process on purpose; nobody is to warn that it was not waited for
    process.returncode = 0
    return process.pid


def main(arguments: Sequence[str] | None = None) -> int:
    """Command line of `python -m arl_fixtures.guard`."""
    parser = argparse.ArgumentParser(prog="arl_fixtures.guard", description="whoever dies, the bench ends safe")
    parser.add_argument("--bench", required=True, metavar="FILE", help="bench file, or the name of a built-in bench")
    parser.add_argument("--lab", type=Path, metavar="SOCKET", help="the lab that holds the emulated hardware")
    parser.add_argument("--runtime", type=Path, metavar="FOLDER", help="where guards keep their files")
    parser.add_argument("--linger", type=float, metavar="S", help="end after so long without a test")
    parser.add_argument("--ready-fd", type=int, help=argparse.SUPPRESS)
    options = parser.parse_args(arguments)
    try:
        config = load_bench(options.bench)
        if options.lab is None and any(entry.emulated for entry in config.devices().values()):
            raise ConfigError(f"bench '{config.name}' is emulated: a guard of its own needs --lab SOCKET")
        places = Places.of(config.name, options.runtime)
        run_guard(config, places, lab=options.lab, linger_s=options.linger, ready_fd=options.ready_fd)
    except ArlError as error:
        sys.stderr.write(f"{error}\n")
        return TAKEN if isinstance(error, InterlockError) else 2
    return 0
