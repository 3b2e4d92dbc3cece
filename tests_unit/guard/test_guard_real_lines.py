"""The same on real lines in real time: a TCP connection and three serial lines (ptys), no lab.

The plant's time is that of the processes involved (`OwnTime`): the stage does not run on while a busy machine lets
none of them run, and the two seconds are theirs.
"""

import os
import select
import signal
import subprocess
import sys

import pytest
from real_processes import LEASE_S, PATIENCE_S, until
from ruamel.yaml import YAML

from arl_fixtures.bench.build import CONTROL_LINES, make_line
from arl_fixtures.bench.config import load_bench
from arl_fixtures.bench.emulated_file import bench_file_for
from arl_fixtures.bench.serve import EmulatorServer
from arl_fixtures.emulators.plant import Plant, PlantSettings
from arl_fixtures.guard.runtime import Places, lease_holder, read_stop
from arl_fixtures.lab.framing import Link
from arl_fixtures.lab.own_time import OwnTime
from arl_fixtures.yaml_model import load_yaml

DRIVE = """
import sys
from pathlib import Path
from arl_fixtures.bench.config import load_bench
from arl_fixtures.bench.drivers import find_driver
from arl_fixtures.guard.guarding import open_guard

config = load_bench(sys.argv[1])
with open_guard(config, bench_file=sys.argv[1], runtime=Path(sys.argv[2])) as guard:
    def device(kind):
        driver = find_driver(config.devices()[kind].driver, kind)
        return driver.make(guard.lines.port(kind), guard.lines.clock, config.device_settings(kind))
    relays, chiller, stage, thermometer = (device(k) for k in ("relays", "chiller", "stage", "thermometer"))
    for load in relays.loads():
        relays.set(load, True)
    chiller.set_setpoint_c(60.0)
    chiller.start()
    stage.home(300.0)
    stage.move_to_deg(60.0)
    print("ready", flush=True)
    while True:
        assert thermometer.read_c()[0].value_c is not None
        guard.check()
        guard.lines.clock.sleep(0.05)
"""


class OwnClock:
    """What `OwnTime` says of this process and all that it has started."""

    def __init__(self):
        self.own = OwnTime(lambda: [os.getpid()])

    @property
    def now_s(self):
        return self.own()


@pytest.fixture
def clock():
    clock = OwnClock()
    clock.own.start()
    yield clock
    clock.own.stop()


@pytest.fixture
def hardware(tmp_path, clock):
    """Emulators on real lines; gives plant, clock and the bench file that points at them."""
    config = load_bench("emulated")
    plant = Plant(PlantSettings(stage_start_deg=-70.0))
    server = EmulatorServer(clock)
    urls = {}
    for kind in CONTROL_LINES:
        device = make_line(config, kind, plant)
        if kind == "chiller":
            host, port = server.add_tcp(kind, device)
            urls[kind] = f"tcp://{host}:{port}"
        else:
            urls[kind] = f"serial://{server.add_pty(kind, device)}"
    file = tmp_path / "bench.yaml"
    file.write_text(bench_file_for("emulated", urls))
    be_patient(file)
    with server:
        yield plant, clock, file


def be_patient(file):
    """No process that is only slow is taken for one that hangs."""
    tree = load_yaml(file)
    for kind in CONTROL_LINES:
        tree[kind].setdefault("settings", {})["timeout_s"] = PATIENCE_S
    tree["guard"] = {"reply_timeout_s": PATIENCE_S, "lease_s": LEASE_S, "heartbeat_timeout_s": PATIENCE_S}
    YAML(typ="rt", pure=True).dump(tree, file)


@pytest.fixture
def victim(hardware, tmp_path):
    """A test process that drives the bench with everything on and the stage turning."""
    plant, _, file = hardware
    process = subprocess.Popen(
        [sys.executable, "-c", DRIVE, str(file), str(tmp_path / "r")], stdout=subprocess.PIPE, text=True
    )
    with process:
        try:
            assert process.stdout is not None
            assert select.select([process.stdout], [], [], PATIENCE_S)[0]
            assert process.stdout.readline() == "ready\n"
            assert all(plant.laser_on(dut) for dut in range(3))
            yield process
        finally:
            process.kill()


def settled_stop(places):
    stop = read_stop(places)
    return stop is not None and not stop.unverified and stop


def assert_safe_now(plant, clock):
    assert not any(plant.powered(dut) or plant.laser_on(dut) for dut in range(3))
    assert plant.setpoint_c == 23.0
    assert plant.stage_track.at(clock.now_s)[1] == 0.0
    assert plant.stage_track.end_deg < 59.0  # it was stopped, it did not arrive


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_a_test_that_dies_on_real_lines(hardware, victim, tmp_path, number):
    plant, clock, _ = hardware
    os.kill(victim.pid, number)
    places = Places.of("emulated", tmp_path / "r")
    stop = until(lambda: settled_stop(places), "the guard has verified everything")
    assert_safe_now(plant, clock)
    assert ("died" in stop.cause) == (number == signal.SIGKILL)
    assert ("was stopped" in stop.cause) == (number == signal.SIGSTOP)
    steps = [action["step"] for action in stop.actions]
    assert steps[:3] == ["laser and DUT power off", "safe set-point", "stage stopped"]
    # on these lines, too, the guard stays for the next test, and goes when it is told to
    guard = lease_holder(places.lease, lease_s=LEASE_S)
    assert guard
    link = Link.connect(places.socket)
    assert link.ask({"op": "status"}, timeout_s=PATIENCE_S).header["state"] == "idle"
    link.close()
    os.kill(guard, signal.SIGTERM)
    until(lambda: not lease_holder(places.lease, lease_s=1e9), "the guard ends")


def test_a_test_that_dies_with_its_guard_on_real_lines(hardware, victim, tmp_path):
    plant, clock, _ = hardware
    places = Places.of("emulated", tmp_path / "r")
    guard = lease_holder(places.lease, lease_s=LEASE_S)
    assert guard
    since_s = clock.now_s
    for pid in (guard, victim.pid):
        os.kill(pid, signal.SIGKILL)
    stop = until(lambda: settled_stop(places), "somebody has verified everything")
    took_s = clock.now_s - since_s
    assert_safe_now(plant, clock)
    assert took_s < 2.0
    assert "the guard died while a test" in stop.cause
    until(lambda: not lease_holder(places.lease, lease_s=1e9), "whoever came has gone home")
