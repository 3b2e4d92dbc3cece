"""Child pytest sessions on a small cycle: three steps, five angles."""

import json
import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

PATIENCE_S = 600.0
PROFILE = """
name: tiny
load_cycle: {temperatures_c: [24, 26, 24]}
angles: {from_deg: -9, to_deg: 9, step_deg: 4.5}
frames: 4
reference_c: 23
"""
LIMITS = """
name: tiny
version: 1
limits:
  - {metric: dead_pixels, unit: "1", upper: 4000, reason: few}
"""
STOPS = """
import os, signal
from arl_fixtures.journal.journal import Journal

append_many, seen = Journal.append_many, []

def append_and_stop(journal, entries):
    number = append_many(journal, entries)
    for entry in entries:
        seen.append(entry.type)
        if entry.type == "{kind}" and seen.count("{kind}") == {count}:
            os.kill(os.getpid(), signal.SIGSTOP)
    return number

Journal.append_many = append_and_stop
"""
TEST = """
import pytest
from arl_fixtures.plugin.outcome import raise_for

@pytest.mark.cycle
@pytest.mark.usefixtures("cycle_step")
def test_step(step_outcome):
    raise_for(step_outcome.verdict, step_outcome.rows, step_outcome.reason)
"""


@dataclass
class Session:
    """A folder in which child sessions run."""

    folder: Path

    def command(self, *options):
        return [
            sys.executable, "-m", "pytest", "-m", "cycle", "-p", "no:cacheprovider", "-q", "--profile", "tiny.yaml",
            "--limits", "limits.yaml", "--out", "out", *options,
        ]  # fmt: skip

    def environment(self):
        # pytest shortens its summary unless it runs in CI; what the child says must not depend on where we run
        kept = {name: value for name, value in os.environ.items() if name not in {"CI", "BUILD_NUMBER"}}
        return {**kept, "OMP_NUM_THREADS": "1"}

    def run(self, *options, check=None, **how):
        done = subprocess.run(
            self.command(*options), cwd=self.folder, env=self.environment(), capture_output=True, text=True,
            timeout=PATIENCE_S, check=False, **how,
        )  # fmt: skip
        if check is not None:
            assert done.returncode == check, done.stdout + done.stderr
        return done

    def write(self, name, text):
        (self.folder / name).write_text(text, encoding="utf-8")

    def lengthen(self):
        """So many steps that whoever interrupts the session has time to, were he held up for a minute."""
        self.write("tiny.yaml", PROFILE.replace("[24, 26, 24]", str([24, 26] * 120)))

    def stop_itself(self, kind, count):
        """Its process stops (SIGSTOP) as soon as the journal holds so many lines of a type, and goes no further."""
        self.write("conftest.py", STOPS.format(kind=kind, count=count))

    def limit(self, text):
        """A limits file with one limit."""
        self.write("limits.yaml", f"name: one\nversion: 1\nlimits:\n  - {{{text}, reason: test}}\n")

    def bench(self, extra):
        """A bench file: the embedded one with some lines more."""
        source = Path(__file__).parents[2] / "arl_fixtures/data/benches/emulated.yaml"
        text = source.read_text(encoding="utf-8").replace("../duts/", str(source.parent.parent / "duts") + "/")
        head, _, _ = text.partition("emulation:")
        self.write("bench.yaml", head + extra)
        return "--bench=bench.yaml"

    def journal(self, number=1):
        lines = (self.folder / f"out/session-{number:04d}.jsonl").read_text(encoding="utf-8").splitlines()
        return [json.loads(line) for line in lines]

    def of_type(self, kind, number=1):
        return [line for line in self.journal(number) if line["type"] == kind]


def small_session(folder):
    session = Session(folder)
    session.write("tiny.yaml", PROFILE)
    session.write("limits.yaml", LIMITS)
    session.write("test_cycle_here.py", TEST)
    session.write("pytest.ini", "[pytest]\n")
    return session


@pytest.fixture
def session(tmp_path):
    return small_session(tmp_path)


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    """A session that ran a whole cycle, and what it printed; its folder is only to be read."""
    session = small_session(tmp_path_factory.mktemp("undisturbed"))
    return session, session.run("--junitxml=out/junit.xml", check=0).stdout
