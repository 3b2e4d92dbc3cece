"""A lab, a guard and test processes that really die. Nothing here sleeps: it waits for something, in bounds."""

import contextlib
import json
import os
import select
import signal
import sys
import time
import traceback
from dataclasses import dataclass
from pathlib import Path

import pytest

from arl_fixtures.bench.build import open_bench
from arl_fixtures.bench.config import BUILT_IN, load_bench
from arl_fixtures.bench.drivers import find_driver
from arl_fixtures.errors import InterlockError
from arl_fixtures.guard import guarding
from arl_fixtures.guard.guarding import open_guard
from arl_fixtures.guard.run import LINGER_S, TAKEN, main
from arl_fixtures.guard.runtime import NoGuardError, Places, lease_holder
from arl_fixtures.lab.client import LabClient
from arl_fixtures.lab.framing import Link, PeerLostError
from arl_fixtures.lab.run import run_lab

PATIENCE_S = 300.0
LEASE_S = 600.0
"""Longer than any machine is busy: who hangs here was made to."""

BENCH = """
name: {name}
clock: virtual
chiller: {{driver: huber_pb, url: emulated}}
thermometer: {{driver: dcon, url: emulated, ambient: 0, plate: 1, housings: [2, 3, 4]}}
stage: {{driver: tmcl, url: emulated}}
relays: {{driver: conrad, url: emulated}}
duts:
  driver: hfl110
  url: emulated
  units: [{duts}/emulated-top.yaml, {duts}/emulated-middle.yaml, {duts}/emulated-bottom.yaml]
guard: {{reply_timeout_s: {patience_s:g}, lease_s: {lease_s:g}, watch_stopped: {watch_stopped}{guard}}}
{extra}
"""


def until(condition, what):
    """Wait until `condition()` is true, and return what it gave."""
    deadline_s = time.monotonic() + PATIENCE_S
    while not (found := condition()):
        assert time.monotonic() < deadline_s, f"never happened: {what}"
        select.select([], [], [], 0.01)
    return found


def fork(child):
    """Run `child` in a process of its own; returns its number."""
    pid = os.fork()
    if pid:
        return pid
    status = 70
    try:
        for number in (signal.SIGTERM, signal.SIGHUP):
            signal.signal(number, signal.SIG_DFL)
        signal.signal(signal.SIGINT, signal.default_int_handler)
        status = child() or 0
    except BaseException:
        traceback.print_exc()
    finally:
        os._exit(status)


def reap(pid):
    """Exit status of a child, or minus the signal that killed it; kills it if it does not end."""
    deadline_s = time.monotonic() + PATIENCE_S
    while time.monotonic() < deadline_s:
        done, status = os.waitpid(pid, os.WNOHANG)
        if done:
            return os.waitstatus_to_exitcode(status)
        select.select([], [], [], 0.01)
    os.kill(pid, signal.SIGKILL)
    os.waitpid(pid, 0)
    pytest.fail(f"process {pid} did not end")


def fork_guard(bench_file, places, *, lab):
    """Instead of `start_guard`: the same program, forked from here without the second that Python's imports take."""
    reader, writer = os.pipe()
    options = ["--bench", bench_file, "--lab", str(lab), "--runtime", str(places.folder.parent)]
    options += ["--ready-fd", "3", "--linger", str(LINGER_S)]

    def guard():
        os.setsid()
        null, errors = os.open(os.devnull, os.O_RDWR), os.open(places.errors, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        for number, file in enumerate((null, null, errors, writer)):
            os.dup2(file, number)
        # nothing of the test may live on in it, its connection to the lab least of all
        os.closerange(4, 256)
        sys.stderr = os.fdopen(2, "w", buffering=1)
        return main(options)

    pid = fork(guard)
    os.close(writer)
    with os.fdopen(reader, "rb") as pipe:
        said = pipe.read()
    if said != b"ready\n":
        raised = NoGuardError if reap(pid) == TAKEN else InterlockError
        raise raised(f"the guard did not start: {places.errors.read_text()}")
    return pid


@pytest.fixture
def forked_guards(monkeypatch):
    """Guards are forked: for tests of what they do, not of how one starts."""
    monkeypatch.setattr(guarding, "start_guard", fork_guard)


def write_bench(file, name, *, guard="", watch_stopped=False, extra=""):
    """A bench file with these settings of the guard, as `poll_s: 1.0`, and lines more.

    Whoever runs these tests may be stopped for a moment as well as kept waiting: that is no loss of the test, but
    where just this is tried.
    """
    text = BENCH.format(
        name=name, duts=BUILT_IN.parent / "duts", patience_s=PATIENCE_S, lease_s=LEASE_S,
        watch_stopped=str(watch_stopped).lower(), guard=f", {guard}" if guard else "", extra=extra,
    )  # fmt: skip
    file.write_text(text)


@dataclass
class Stand:
    """A bench in a lab, with a folder for its guards."""

    bench_file: str
    lab: Path
    runtime: Path

    @property
    def config(self):
        return load_bench(self.bench_file)

    @property
    def places(self):
        return Places.of(self.config.name, self.runtime)

    def open_guard(self):
        return open_guard(self.config, bench_file=self.bench_file, lab=self.lab, runtime=self.runtime)

    def ask(self, **header):
        """Ask the guard something from outside; None if none is there."""
        try:
            link = Link.connect(self.places.socket)
        except PeerLostError:
            return None
        try:
            return link.ask(header, timeout_s=PATIENCE_S).header
        except PeerLostError:
            return None
        finally:
            link.close()

    def guard_pid(self):
        return lease_holder(self.places.lease, lease_s=1e9)

    def end_lease(self):
        """Its guard, which is stopped, has not renewed its lease for as long as that lasts."""
        holder = json.loads(self.places.lease.read_text())
        holder["renewed_s"] -= LEASE_S
        self.places.lease.write_text(json.dumps(holder))

    def inspect(self):
        onlooker = LabClient.connect(self.lab, "onlooker", role="onlooker")
        try:
            return onlooker.inspect()
        finally:
            onlooker.close()

    @contextlib.contextmanager
    def witness(self):
        """Somebody looks on, so that bench time passes, as on the wall, also while nobody else is left."""
        onlooker = LabClient.connect(self.lab, "witness", role="onlooker")
        try:
            yield
        finally:
            onlooker.close()

    def inject(self, fault):
        """Let a fault happen; returns the bench time since when it is known to the plant."""
        onlooker = LabClient.connect(self.lab, "onlooker", role="onlooker")
        onlooker.inject(fault)
        since_s = onlooker.clock.now_s
        onlooker.close()
        return since_s

    def clear_alarm(self):
        """What an engineer does at the thermostat's panel."""
        self.clear_faults()
        client = LabClient.connect(self.lab, "engineer", role="driver")
        settings = self.config.device_settings("chiller")
        find_driver("huber_pb", "chiller").make(client.port("chiller"), client.clock, settings).clear_error()
        client.close()

    def clear_faults(self):
        onlooker = LabClient.connect(self.lab, "onlooker", role="onlooker")
        onlooker.clear_faults()
        onlooker.close()

    def wait_for_state(self, *states):
        return until(lambda: (a := self.ask(op="status")) and a["state"] in states and a, f"guard is {states}")


def is_safe(state):
    """Whether power is off, the set-point safe and the stage at rest, by the plant itself."""
    power = [state[f"{kind}_{n}"] for kind in ("dut", "laser") for n in (1, 2, 3)]
    return not any(power) and state["setpoint_c"] == 23.0 and not state["stage_moving"]


def comes_to_rest(stand):
    """Power is off at once; a stage that was stopped takes its way to rest."""
    state = stand.inspect()["state"]
    assert not any(state[f"{kind}_{n}"] for kind in ("dut", "laser") for n in (1, 2, 3)), state
    until(lambda: is_safe(stand.inspect()["state"]), f"a bench at rest; it was left at {state}")


def assert_safe_within(found, since_s, limit_s=2.0, *, not_before_s=None):
    """Everything that was energised at `since_s` was off `limit_s` later, in the right order.

    Where bench time went on between what happened and the look at it, `not_before_s` is the last time known before.
    """
    state = found["state"]
    assert is_safe(state), state
    changes = [(time_s, name) for time_s, name, _ in found["events"] if not name.startswith("client")]
    late = [change for change in changes if change[0] > since_s + limit_s]
    assert not late, f"changed later than {limit_s:g} s after {since_s:.2f} s: {late}"
    assert state["stage_stands_from_s"] <= since_s + limit_s
    after = [change for change in changes if change[0] >= (since_s if not_before_s is None else not_before_s)]
    power = [time_s for time_s, name in after if name.startswith(("dut", "laser"))]
    setpoint = [time_s for time_s, name in after if name == "setpoint_c"]
    assert power
    assert setpoint
    assert max(power) <= max(setpoint), "power goes first"


@pytest.fixture(scope="module")
def lab(tmp_path_factory):
    """A lab in a process of its own; gives its socket."""
    path = tmp_path_factory.mktemp("lab") / "s"
    file = path.with_name("bench.yaml")
    # near the reference, so that homing takes little time
    write_bench(file, "lab", extra="emulation: {plant: {stage_start_deg: -70}}")
    config = load_bench(str(file))
    pid = fork(lambda: run_lab(config, path, grace_s=1.5))
    until(path.is_socket, "the lab listens")
    yield path
    os.kill(pid, signal.SIGTERM)
    assert reap(pid) == 0


@contextlib.contextmanager
def stands_on(lab, tmp_path_factory):
    """Makes benches, each with guards of its own, on one lab; ends the guards afterwards."""
    stands = []

    def made(guard="", *, watch_stopped=False):
        folder = tmp_path_factory.mktemp("b")
        file = folder / "bench.yaml"
        write_bench(file, f"bench{len(stands)}", guard=guard, watch_stopped=watch_stopped)
        stands.append(Stand(str(file), lab, folder / "r"))
        return stands[-1]

    try:
        yield made
    finally:
        for stand in stands:
            if pid := stand.guard_pid():
                os.kill(pid, signal.SIGTERM)
                until(lambda pid=pid: not Path(f"/proc/{pid}").exists() or zombie(pid), "the guard ends when told to")
        onlooker = LabClient.connect(lab, "onlooker", role="onlooker")
        onlooker.clear_faults()
        until(lambda: onlooker.inspect()["clients"] == ["onlooker"], "all lines are free again")
        onlooker.close()


@pytest.fixture(scope="module")
def make_module_stand(lab, tmp_path_factory):
    """Benches for all tests of a module."""
    with stands_on(lab, tmp_path_factory) as made:
        yield made


@pytest.fixture
def make_stand(lab, tmp_path_factory):
    """Benches for one test."""
    with stands_on(lab, tmp_path_factory) as made:
        yield made


def zombie(pid):
    """Whether a process is dead but not yet buried."""
    with contextlib.suppress(OSError):
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] == "Z"
    return True


@pytest.fixture
def run_test():
    """Starts a test process that drives the bench hot with the stage turning, then does `then(guard, bench)`."""
    children = []

    def started(stand, then):
        reader, writer = os.pipe()

        def child():
            os.close(reader)
            with stand.open_guard() as guard:
                bench = open_bench(stand.config, lines=guard.lines)
                guard.attach(bench)
                bench.start()
                bench.chiller.set_setpoint_c(60.0)
                bench.stage.move_to_deg(-30.0)
                os.write(writer, b"ready\n")
                os.close(writer)
                try:
                    return then(guard, bench)
                except InterlockError as error:
                    (stand.runtime / "heard").write_text(str(error))
                    return 3
                finally:
                    bench.close()

        pid = fork(child)
        os.close(writer)
        children.append(pid)
        with os.fdopen(reader, "rb") as pipe:
            ready = select.select([pipe], [], [], PATIENCE_S)[0]
            assert ready, "the test process never got ready"
            assert pipe.readline() == b"ready\n", "the test process died before it was ready"
        return pid

    yield started
    for pid in children:
        with contextlib.suppress(ProcessLookupError, ChildProcessError):
            os.kill(pid, signal.SIGKILL)
            os.waitpid(pid, 0)


def go_on(guard, bench):
    """Drive the bench for ever, as a cycle does."""
    to_deg = -65.0
    while True:
        bench.stage.move_to_deg(to_deg)
        bench.soak(1.8)
        to_deg = -95.0 - to_deg
