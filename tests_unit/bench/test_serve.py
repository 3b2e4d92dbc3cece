"""Our emulators answer other people's clients, over real sockets on loopback."""

from __future__ import annotations

import asyncio
import math
import re
import socket
import time
from collections.abc import Iterable
from pathlib import Path

import pytest

from arl_fixtures.bench.clock import RealClock
from arl_fixtures.bench.ports import SerialPort, TcpPort
from arl_fixtures.bench.serve import EmulatorServer
from arl_fixtures.devices.chiller import HuberChiller, HuberSettings
from arl_fixtures.devices.relays import DEFAULT_LOADS, ConradRelays, ConradSettings
from arl_fixtures.devices.stage import TmclSettings, TmclStage
from arl_fixtures.devices.thermometer import DconSettings, DconThermometer
from arl_fixtures.emulators.chiller import ChillerEmulator, ChillerEmulatorSettings
from arl_fixtures.emulators.device import Outgoing, StreamDevice
from arl_fixtures.emulators.faults import Fault
from arl_fixtures.emulators.faulty_wire import FaultyWire
from arl_fixtures.emulators.plant import Plant
from arl_fixtures.emulators.relays import RelaysEmulator
from arl_fixtures.emulators.stage import StageEmulator
from arl_fixtures.emulators.thermometer import ThermometerEmulator
from arl_fixtures.errors import DeviceLostError, DeviceTimeoutError
from arl_fixtures.protocols import tmcl
from arl_fixtures.protocols.tmcl import Axis, Command

PATIENCE_S = 300.0
"""However busy the machine is: an answer that is late is none that is missing."""


class BriskClock:
    """Real time, in which nobody sleeps for long."""

    def __init__(self) -> None:
        self._real = RealClock()

    @property
    def now_s(self) -> float:
        return self._real.now_s

    def utc_ns(self) -> int:
        return self._real.utc_ns()

    def sleep(self, duration_s: float) -> None:
        self._real.sleep(min(duration_s, 0.5))


class FastClock:
    """Real time, `factor` times as fast: nobody waits for a motor in a test."""

    def __init__(self, factor: float) -> None:
        self._real, self._factor = RealClock(), factor

    @property
    def now_s(self) -> float:
        return self._real.now_s * self._factor

    def utc_ns(self) -> int:
        return self._real.utc_ns()

    def sleep(self, duration_s: float) -> None:
        self._real.sleep(duration_s / self._factor)


def test_the_huber_library_reads_and_sets_our_chiller(monkeypatch: pytest.MonkeyPatch):
    huber = pytest.importorskip("huber")
    plant, server = Plant(), EmulatorServer()
    emulator = ChillerEmulator(plant, settings=ChillerEmulatorSettings(setpoint_start_c=20.0, reply_delay_s=0.0))
    # the library takes raw/100 for mbar and refuses more than 320: 1350 mbar absolute reads as 13.5 there
    host, port = server.add_tcp("chiller", emulator)
    monkeypatch.setattr(huber.Bath, "port", port)

    async def converse() -> tuple[dict, dict]:
        async with huber.Bath(host, comm_timeout=PATIENCE_S) as bath:
            before = await bath.get()
            await bath.start()
            await bath.set_setpoint(-10.0)
            await bath.set_pump_speed(2000)
            after = await bath.get()
            with pytest.raises(OSError, match="did not change"):
                await bath.set_setpoint(200.0)
            await bath.stop()
            return before, after

    with server:
        before, after = asyncio.run(converse())
    assert (before["on"], after["on"]) == (False, True)
    assert before["temperature"]["setpoint"] == 20.0
    assert after["temperature"]["setpoint"] == -10.0
    assert before["temperature"]["bath"] == pytest.approx(23.0, abs=0.2)
    assert before["status"] == {
        "controlling": False, "circulating": False, "pumping": False, "error": False, "warning": False,
    }  # fmt: skip
    assert after["status"]["controlling"]
    assert after["status"]["pumping"]
    assert after["pump"]["speed"] == 2000
    assert after["fill"] == pytest.approx(0.82)
    assert not plant.circulating


def test_the_huber_library_sees_our_alarm(monkeypatch: pytest.MonkeyPatch):
    huber = pytest.importorskip("huber")
    plant, server = Plant(), EmulatorServer()
    plant.faults.inject(Fault(device="chiller", kind="chiller_alarm", value=-4))
    host, port = server.add_tcp("chiller", ChillerEmulator(plant))
    monkeypatch.setattr(huber.Bath, "port", port)

    async def converse() -> dict:
        async with huber.Bath(host, comm_timeout=PATIENCE_S) as bath:
            return await bath.get()

    with server:
        data = asyncio.run(converse())
    assert data["status"]["error"]
    assert data["error"]["code"] == -4


def test_pytrinamic_homes_and_moves_our_stage():
    pytest.importorskip("pytrinamic")
    from pytrinamic.connections.socket_tmcl_interface import SocketTmclInterface
    from pytrinamic.modules.TMCM1240 import TMCM1240

    clock = FastClock(200.0)
    plant, server = Plant(), EmulatorServer(clock)
    host, port = server.add_tcp("stage", StageEmulator(plant))
    with server, SocketTmclInterface(f"{host}:{port}") as connection:
        assert connection.get_version_string() == "1240V105"
        motor = TMCM1240(connection).motors[0]
        motor.set_axis_parameter(motor.AP.ReferenceSearchMode, 1)
        connection.reference_search(0, 0)
        deadline_s = time.monotonic() + PATIENCE_S
        while connection.reference_search(2, 0):
            assert time.monotonic() < deadline_s
        assert motor.get_actual_position() == 0
        assert motor.get_axis_parameter(motor.AP.LeftEndstop) == 1
        assert plant.stage_angle_deg(clock.now_s) == pytest.approx(-75.0)
        motor.move_to(100 * 10_240)
        while not motor.get_position_reached():
            assert time.monotonic() < deadline_s
        assert plant.stage_angle_deg(clock.now_s) == pytest.approx(25.0)
        motor.move_by(-51_200)
        while not motor.get_position_reached():
            assert time.monotonic() < deadline_s
        assert motor.get_actual_position() == 100 * 10_240 - 51_200
        assert plant.stage_angle_deg(clock.now_s) == pytest.approx(20.0)


def test_our_drivers_meet_our_emulators_on_terminals_and_tcp():
    clock = RealClock()
    plant, server = Plant(), EmulatorServer(clock)
    stage_line = server.add_pty("stage", StageEmulator(plant))
    thermometer_line = server.add_pty("thermometer", ThermometerEmulator(plant))
    relays_line = server.add_pty("relays", RelaysEmulator(plant, DEFAULT_LOADS))
    host, port = server.add_tcp("chiller", ChillerEmulator(plant))
    with server:
        stage = TmclStage(
            SerialPort("stage", stage_line, baud=115200), clock, TmclSettings(timeout_s=PATIENCE_S)
        )
        thermometer = DconThermometer(
            SerialPort("thermometer", thermometer_line, baud=9600), clock, DconSettings(timeout_s=PATIENCE_S)
        )
        relays = ConradRelays(
            SerialPort("relays", relays_line, baud=19200), clock, ConradSettings(timeout_s=PATIENCE_S)
        )
        chiller = HuberChiller(TcpPort("chiller", host, port), clock, HuberSettings(timeout_s=PATIENCE_S))
        assert stage.identify().name == "TMCM-1240"
        assert thermometer.identify().name == "7018"
        assert thermometer.read_c()[2].value_c == pytest.approx(23.0, abs=0.6)
        relays.set("dut_1", True)
        assert chiller.set_setpoint_c(30.0) == 30.0
        for device in (stage, thermometer, relays, chiller):
            device.close()
    assert plant.powered(0)


def test_a_line_opened_again_is_served_again():
    clock, plant = RealClock(), Plant()
    server = EmulatorServer(clock)
    line = server.add_pty("thermometer", ThermometerEmulator(plant))
    with server:
        for _ in range(2):
            port = SerialPort("line", line, baud=9600)
            thermometer = DconThermometer(port, clock, DconSettings(timeout_s=PATIENCE_S))
            assert len(thermometer.read_c()) == 8
            thermometer.close()


def test_a_fault_cuts_the_connection_and_the_driver_comes_back():
    clock, plant = BriskClock(), Plant()
    server = EmulatorServer(clock)
    wire = FaultyWire("chiller", ChillerEmulator(plant), plant)
    host, port = server.add_tcp("chiller", wire)
    with server:
        chiller = HuberChiller(TcpPort("chiller", host, port), clock, HuberSettings(timeout_s=PATIENCE_S))
        chiller.bath_c()
        plant.faults.inject(Fault(device="chiller", kind="disconnect", start_s=clock.now_s))
        with pytest.raises((DeviceLostError, DeviceTimeoutError), match="chiller"):
            chiller.bath_c()
        plant.faults.clear()
        assert chiller.bath_c() == pytest.approx(23.0, abs=0.2)
        chiller.close()


class Ticker:
    """Sends its address once every 5 ms to two ports."""

    def __init__(self, address: str, ports: tuple[int, int]) -> None:
        self.address, self._ports = address, ports

    def next_time_s(self, now_s: float) -> float:
        return -(-now_s // 0.005) * 0.005

    def send(self, now_s: float, until_s: float) -> list[tuple[int, Outgoing]]:
        first, last = int(now_s // 0.005) + 1, int(until_s // 0.005)
        return [
            (port, Outgoing(n * 0.005, self.address.encode())) for n in range(first, last + 1) for port in self._ports
        ]


def test_sensors_send_from_their_own_addresses():
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as first,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as second,
    ):
        for listener in (first, second):
            listener.bind(("127.0.0.1", 0))
            listener.settimeout(PATIENCE_S)
        ports = (first.getsockname()[1], second.getsockname()[1])
        server = EmulatorServer()
        for address in ("127.0.0.2", "127.0.0.3"):
            server.add_udp(address, Ticker(address, ports))
        with server:
            heard = [listener.recvfrom(2000) for _ in range(20) for listener in (first, second)]
    assert {sender[0] for _, sender in heard} == {"127.0.0.2", "127.0.0.3"}
    assert all(payload.decode() == sender[0] for payload, sender in heard)


def test_an_address_in_use_is_one_line():
    server, second = EmulatorServer(), EmulatorServer()
    host, port = server.add_tcp("chiller", ChillerEmulator(Plant()))
    with pytest.raises(DeviceLostError, match=f"chiller: cannot use {host}:{port}: ") as caught:
        second.add_tcp("chiller", ChillerEmulator(Plant()), port=port)
    assert "\n" not in str(caught.value)
    with pytest.raises(DeviceLostError, match=r"dut: cannot use 192\.0\.2\.1:0"):
        second.add_udp("dut", Ticker("192.0.2.1", (1, 1)))
    for unused in (server, second):
        unused.stop()
        unused.run()


def test_stopping_releases_everything():
    open_files = Path("/proc/self/fd")
    if not open_files.is_dir():
        pytest.skip("no /proc to count open files in")
    before = len(list(open_files.iterdir()))
    server = EmulatorServer()
    server.add_pty("stage", StageEmulator(Plant()))
    host, port = server.add_tcp("chiller", ChillerEmulator(Plant()))
    with server:
        HuberChiller(TcpPort("chiller", host, port), RealClock()).close()
    assert len(list(open_files.iterdir())) == before
    with pytest.raises(DeviceLostError, match="cannot connect"):
        TcpPort("chiller", host, port)


def test_a_failure_of_an_emulator_is_raised_where_the_server_is_used():
    class Broken(Ticker):
        def send(self, now_s: float, until_s: float) -> list[tuple[int, Outgoing]]:
            raise RuntimeError("boom")

    server = EmulatorServer()
    server.add_udp("dut", Broken("127.0.0.2", (1, 1)))
    with pytest.raises(RuntimeError, match="boom"), server:
        server.wait()


AXES = {Axis.REACHED: "r", Axis.ACTUAL_SPEED: "s", Axis.ACTUAL: "a", Axis.ENCODER: "e"}


class Asked:
    """A stage, and a letter for each question that it was asked."""

    def __init__(self, device: StreamDevice) -> None:
        self._device = device
        self.questions = ""

    def receive(self, data: bytes, now_s: float) -> Iterable[Outgoing]:
        request = tmcl.decode_request(data)
        assert request is not None
        axis = AXES.get(Axis(request.type), "?") if request.command == Command.GET_AXIS else ""
        self.questions += axis or {Command.GET_GLOBAL: "g", Command.MOVE: "m"}.get(Command(request.command), "?")
        return self._device.receive(data, now_s)

    def disconnect(self, now_s: float) -> None:
        self._device.disconnect(now_s)


def test_a_real_sweep_step_asks_nothing_in_vain_and_no_answer_is_slept_over(monkeypatch: pytest.MonkeyPatch):
    """However busy the machine is: how long a step takes is for `python -m benchmarks.realtime` to say."""
    clock = RealClock()
    plant, server = Plant(), EmulatorServer(clock)
    asked = Asked(StageEmulator(plant))
    line = server.add_pty("stage", asked)
    slept_over_s = [0.0]
    wait_s = server._wait_s

    def watched_wait_s() -> float:
        began_s, waits_s = clock.now_s, wait_s()
        due_s = min((entry[0] for entry in server._due), default=math.inf)
        # an answer that is late already is delivered at once
        slept_over_s.append(began_s + waits_s - due_s if waits_s else 0.0)
        return waits_s

    monkeypatch.setattr(server, "_wait_s", watched_wait_s)
    # a reference right here keeps the homing short
    settings = TmclSettings(search_mode=5, reference_angle_deg=0.0, timeout_s=PATIENCE_S)
    with server:
        stage = TmclStage(SerialPort("stage", line, baud=115200), clock, settings)
        stage.home(PATIENCE_S)
        for step in range(1, 6):
            asked.questions = ""
            began_s = clock.now_s
            stage.move_to_deg(0.9 * step)
            told_s = clock.now_s - began_s
            foretold_s = stage._arrival_s
            stage.wait_until_reached(PATIENCE_S)
            # it set off somewhere between question and answer
            wrong_s = abs(plant.stage_track.end_s - foretold_s)
            assert wrong_s < told_s
            # marker, move; reached; where by counter and by encoder; in vain: not reached, but moving, or just then
            # no longer moving, and so reached
            found = re.fullmatch(r"gm((?:rs)*?)(?:rsr)?rae", asked.questions)
            assert found, asked.questions
            in_vain = asked.questions.count("s")
            assert in_vain <= 1 + wrong_s / settings.poll_s
        stage.close()
    assert max(slept_over_s) <= 1e-9
