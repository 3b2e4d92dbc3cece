"""Child pytest sessions on a small cycle: three steps, five angles."""

import json
import os
import select
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
WARM = """
import gc, importlib, json, os, pkgutil, sys
from importlib.metadata import entry_points

import pytest

for plugin in entry_points(group="pytest11"):
    plugin.load()
for name in {modules}:
    package = importlib.import_module(name)
    for module in pkgutil.iter_modules(getattr(package, "__path__", ())):
        importlib.import_module(f"{{name}}.{{module.name}}")
gc.freeze()
for line in sys.stdin:
    folder, arguments, *files = json.loads(line)
    pid = os.fork()
    if pid == 0:
        os.chdir(folder)
        for number, file in enumerate([os.devnull, *files]):
            os.dup2(os.open(file, os.O_RDWR | os.O_CREAT | os.O_TRUNC), number)
        sys.path[0], sys.argv[1:] = folder, arguments
        sys.exit(pytest.console_main())
    print(os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]), flush=True)
"""
IMPORTED = [
    "hypothesis",
    *(f"arl_fixtures.{n}" for n in ("bench", "emulators", "metrics.measures", "plugin", "reconcile.twin_model")),
]
"""What a session imports on its way, packages with their modules."""


class Warm:
    """A process that has imported what a session needs, and forks one at each call: most of a short one is that.

    What is run is what `python -m pytest` runs.
    """

    def __init__(self, folder, environment):
        self.files = [folder / "stdout", folder / "stderr"]
        self.process = subprocess.Popen(
            [sys.executable, "-c", WARM.format(modules=IMPORTED)], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
            text=True, env=environment,
        )  # fmt: skip

    def run(self, folder, arguments):
        order = [str(folder), arguments, *map(str, self.files)]
        self.process.stdin.write(json.dumps(order) + "\n")
        self.process.stdin.flush()
        assert select.select([self.process.stdout], [], [], PATIENCE_S)[0], "the session hung"
        status = int(self.process.stdout.readline())
        return subprocess.CompletedProcess(arguments, status, *(file.read_text() for file in self.files))

    def close(self):
        self.process.stdin.close()
        self.process.wait(timeout=PATIENCE_S)
        self.process.stdout.close()


@dataclass
class Session:
    """A folder in which child sessions run: forked from `warm`, or as programs where there is none."""

    folder: Path
    warm: Warm | None = None

    def command(self, *options):
        return [
            sys.executable, "-m", "pytest", "-m", "cycle", "-p", "no:cacheprovider", "-q", "--profile", "tiny.yaml",
            "--limits", "limits.yaml", "--out", "out", *options,
        ]  # fmt: skip

    @staticmethod
    def environment():
        # pytest shortens its summary unless it runs in CI; what the child says must not depend on where we run
        kept = {name: value for name, value in os.environ.items() if name not in {"CI", "BUILD_NUMBER"}}
        return {**kept, "OMP_NUM_THREADS": "1"}

    def run(self, *options, check=None, **how):
        if self.warm is not None and not how:
            done = self.warm.run(self.folder, self.command(*options)[3:])
        else:
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


def small_session(folder, warm=None):
    session = Session(folder, warm)
    session.write("tiny.yaml", PROFILE)
    session.write("limits.yaml", LIMITS)
    session.write("test_cycle_here.py", TEST)
    session.write("pytest.ini", "[pytest]\n")
    return session


@pytest.fixture(scope="session")
def warm(tmp_path_factory):
    process = Warm(tmp_path_factory.mktemp("warm"), Session.environment())
    yield process
    process.close()


@pytest.fixture
def session(tmp_path, warm):
    return small_session(tmp_path, warm)


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    """A session that ran a whole cycle as a program, and what it printed; its folder is only to be read."""
    session = small_session(tmp_path_factory.mktemp("undisturbed"))
    return session, session.run("--junitxml=out/junit.xml", check=0).stdout
