"""The lab's clock: who holds it, when it jumps, and that nobody can freeze it."""

import contextlib
import os
import signal
import subprocess
import sys
import threading

import pytest

from arl_fixtures.bench.build import Emulated
from arl_fixtures.bench.clock import VirtualClock
from arl_fixtures.bench.config import load_bench
from arl_fixtures.bench.drivers import find_driver
from arl_fixtures.errors import DeviceLostError, LocalProtocolError
from arl_fixtures.lab.client import LabClient
from arl_fixtures.lab.server import LabServer

GRACE_S = 0.1
PATIENCE_S = 300.0


@pytest.fixture
def lab(tmp_path):
    """A lab that serves the built-in bench in a thread; gives its socket."""
    path = tmp_path / "lab.sock"
    server = LabServer(Emulated(load_bench("emulated"), VirtualClock()), path, grace_s=GRACE_S)
    thread = threading.Thread(target=server.serve)
    thread.start()
    yield path
    server.stop()
    thread.join(timeout=PATIENCE_S)
    assert not thread.is_alive()


@pytest.fixture
def connect(lab):
    with contextlib.ExitStack() as stack:

        def connected(name="test", role="driver"):
            client = LabClient.connect(lab, name, role=role)
            stack.callback(client.close)
            return client

        yield connected


def test_time_jumps_for_a_driver_that_waits(connect):
    driver = connect()
    driver.clock.sleep(3600.0)
    assert driver.clock.now_s == pytest.approx(3600.0, abs=0.05)
    assert driver.clock.utc_ns() == 1_767_225_600_000_000_000 + round(driver.clock.now_s * 1e9)


def test_bytes_arrive_after_the_devices_own_delay(connect):
    driver = connect()
    chiller = driver.port("chiller")
    chiller.write(b"{M01****\r\n")
    before_s = driver.clock.now_s
    assert chiller.read(0.01) == b""
    assert chiller.read(0.5).startswith(b"{S01")
    assert driver.clock.now_s - before_s == pytest.approx(0.02, abs=1e-6)


def test_time_waits_for_the_slowest_waiter(connect):
    first, second = connect("first"), connect("second")
    order = []

    def run(client, steps):
        for step_s in steps:
            client.clock.sleep(step_s)
            order.append((round(client.clock.now_s, 6), client))

    start_s = first.clock.now_s
    threads = [threading.Thread(target=run, args=(c, s)) for c, s in ((first, [10, 10, 10]), (second, [15, 15]))]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    times = [time_s for time_s, _ in order]
    assert times == sorted(times)
    assert times[-1] == pytest.approx(start_s + 30, abs=2 * GRACE_S)


def test_without_a_driver_time_passes_as_on_the_wall(connect):
    guard = connect("guard", role="follower")
    start_s = guard.clock.now_s
    guard.clock.sleep(0.3)
    assert guard.clock.now_s - start_s == pytest.approx(0.3, abs=0.05)
    driver = connect("test")
    # the driver computes: after the grace the guard's time goes on, as on the wall
    guard.clock.sleep(0.2)
    assert guard.clock.now_s - start_s == pytest.approx(0.5, abs=0.1)
    guard.close()
    driver.clock.sleep(1000.0)
    assert driver.clock.now_s > 1000.0


def test_a_line_has_one_owner_and_is_free_when_that_one_is_gone(connect):
    first, second = connect("first"), connect("second")
    port = first.port("relays")
    with pytest.raises(DeviceLostError, match="emulated relays: the line is owned by 'first'"):
        second.port("relays")
    port.close()
    again = second.port("relays")
    second.close()
    with pytest.raises(DeviceLostError, match="closed"):
        port.write(b"x")
    # the lab sees the end of the connection a moment after we made it
    for _ in range(200):
        if first.inspect()["clients"] == ["first"]:
            break
    first.port("relays")
    assert again.name == "emulated relays"


def test_acting_for_another_moves_time_though_that_one_does_not_wait_at_the_lab(connect):
    test, guard = connect("test"), connect("guard", role="follower")
    start_s = guard.clock.now_s
    guard.adopt(test.number)
    guard.clock.sleep(500.0)  # would take 500 s on the wall if the test held the clock
    assert guard.clock.now_s >= start_s + 500.0
    guard.release(test.number)
    assert test.ask("now").header["now_s"] == pytest.approx(guard.clock.now_s, abs=2 * GRACE_S)


def test_a_wait_ends_when_somebody_else_speaks(connect):
    guard = connect("guard", "follower")
    reader, writer = os.pipe()
    heard = []

    def attend():
        heard.append(os.read(reader, 1))
        return heard[-1] == b"!"

    try:
        now_s = guard.clock.now_s
        os.write(writer, b"x")
        threading.Timer(0.05, os.write, (writer, b"!")).start()
        answer = guard.ask_attentively("sleep", {"until_s": now_s + 1e6}, lambda: [reader], attend)
        assert answer.header["cancelled"]
        assert heard == [b"x", b"!"]
        assert guard.clock.now_s < now_s + 60
        answer = guard.ask_attentively("sleep", {"until_s": guard.clock.now_s + 0.05}, lambda: [reader], attend)
        assert "cancelled" not in answer.header
    finally:
        os.close(reader)
        os.close(writer)


def test_an_onlooker_never_holds_the_clock(connect):
    onlooker, driver = connect("onlooker", "onlooker"), connect()
    driver.clock.sleep(1000.0)
    assert onlooker.inspect()["state"]["now_s"] == driver.clock.now_s


def test_nonsense_is_answered_not_obeyed(connect):
    client = connect()
    with pytest.raises(LocalProtocolError, match="unknown request 'format_disk'"):
        client.ask("format_disk")
    with pytest.raises(LocalProtocolError, match="bad request"):
        client.ask("sleep", until_s="soon")
    with pytest.raises(DeviceLostError, match="closed"):
        client.ask("write", b"x", line="chiller")
    assert client.inspect()["clients"] == ["test"]


STOPPED = """
import os, signal, sys
from pathlib import Path
from arl_fixtures.lab.client import LabClient
client = LabClient.connect(Path(sys.argv[1]), "victim", role="driver")
print(client.number, flush=True)
os.kill(os.getpid(), signal.SIGSTOP)
client.clock.sleep(1.0)
print(client.clock.now_s, flush=True)
"""


def test_a_stopped_driver_cannot_freeze_time_and_goes_on_when_continued(lab, connect):
    guard = connect("guard", role="follower")
    with subprocess.Popen([sys.executable, "-c", STOPPED, str(lab)], stdout=subprocess.PIPE, text=True) as victim:
        assert victim.stdout is not None
        assert int(victim.stdout.readline()) > 0
        os.waitid(os.P_PID, victim.pid, os.WSTOPPED)
        start_s = guard.clock.now_s
        guard.clock.sleep(0.5)
        assert guard.clock.now_s >= start_s + 0.5
        os.kill(victim.pid, signal.SIGCONT)
        assert float(victim.stdout.readline()) >= start_s + 1.0
        assert victim.wait(timeout=PATIENCE_S) == 0


def test_frames_come_in_bursts_and_only_with_power(connect):
    config = load_bench("emulated")
    client = connect()
    settings = config.device_settings("relays")
    relays = find_driver("conrad", "relays").make(client.port("relays"), client.clock, settings)
    ports = find_driver("hfl110", "duts").udp_ports(config.device_settings("duts"))
    frames = client.datagrams(next(iter(ports.values())))
    assert frames.receive(1.0) == []
    relays.set("dut_1", True)
    relays.set("laser_1", True)
    frames.discard()
    seen = []
    deadline_s = client.clock.now_s + 30.0
    while not seen and client.clock.now_s < deadline_s:
        seen = frames.receive(1.0)
    assert len({datagram.sender for datagram in seen}) == 1
    assert len(seen) > 10
    assert seen[0].time_s <= client.clock.now_s
    state = client.inspect()["state"]
    assert (state["dut_1"], state["laser_1"], state["dut_2"]) == (True, True, False)
