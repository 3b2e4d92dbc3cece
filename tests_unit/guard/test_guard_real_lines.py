"""The same on real lines in real time: a TCP connection and three serial lines (ptys), no lab."""

import os
import select
import signal
import subprocess
import sys

import pytest
from real_processes import PATIENCE_S, until

from arl_fixtures.bench.build import CONTROL_LINES, make_line
from arl_fixtures.bench.config import load_bench
from arl_fixtures.bench.emulated_file import bench_file_for
from arl_fixtures.bench.serve import EmulatorServer
from arl_fixtures.emulators.plant import Plant, PlantSettings
from arl_fixtures.guard.runtime import Places, lease_holder, read_stop
from arl_fixtures.lab.framing import Link

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
    stage.home(30.0)
    stage.move_to_deg(60.0)
    print("ready", flush=True)
    while True:
        assert thermometer.read_c()[0].value_c is not None
        guard.check()
        guard.lines.clock.sleep(0.05)
"""


@pytest.fixture
def hardware(tmp_path):
    """Emulators on real lines; gives plant, clock and the bench file that points at them."""
    config = load_bench("emulated")
    plant = Plant(PlantSettings(stage_start_deg=-70.0))
    server = EmulatorServer()
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
    with server:
        yield plant, server.clock, file


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
    guard = lease_holder(places.lease, lease_s=10.0)
    link = Link.connect(places.socket)
    assert link.ask({"op": "status"}, timeout_s=PATIENCE_S).header["state"] == "idle"
    link.close()
    os.kill(guard, signal.SIGTERM)
    until(lambda: not lease_holder(places.lease, lease_s=1e9), "the guard ends")


def test_a_test_that_dies_with_its_guard_on_real_lines(hardware, victim, tmp_path):
    plant, clock, _ = hardware
    places = Places.of("emulated", tmp_path / "r")
    guard = lease_holder(places.lease, lease_s=10.0)
    since_s = clock.now_s
    for pid in (guard, victim.pid):
        os.kill(pid, signal.SIGKILL)
    stop = until(lambda: settled_stop(places), "somebody has verified everything")
    took_s = clock.now_s - since_s
    assert_safe_now(plant, clock)
    assert took_s < 2.0
    assert "the guard died while a test" in stop.cause
    until(lambda: not lease_holder(places.lease, lease_s=1e9), "whoever came has gone home")
