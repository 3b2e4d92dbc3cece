"""The bench on mocked devices: the way into the safe state, control without sensors, and what a sweep asks for."""

import socket

import pytest

from arl_fixtures.bench.bench import SAFE_ATTEMPTS
from arl_fixtures.bench.clock import RealClock
from arl_fixtures.bench.ports import UdpPort, host_and_port, open_stream
from arl_fixtures.bench.sweep import sweep
from arl_fixtures.errors import ConfigError, DeviceLostError, DeviceTimeoutError


def names(mock):
    return [call[0] for call in mock.calls]


def test_safe_state_is_power_then_coolant_then_stage(bench, relays, chiller, stage):
    order = []
    for name, mock in (("relays", relays), ("chiller", chiller), ("stage", stage)):
        mock.calls = Recorder(order, name)
    bench.start()
    order.clear()
    assert bench.make_safe() == []
    assert [name for name, _ in order] == ["relays", "chiller", "stage"]
    assert set(relays.on.values()) == {False}
    assert chiller.setpoint == bench.config.safe_temperature_c


class Recorder(list):
    """A call log that also notes the order over several mocks."""

    def __init__(self, order, name):
        self._order, self._name = order, name

    def append(self, call):
        self._order.append((self._name, call[0]))
        super().append(call)


def test_one_dead_device_does_not_keep_the_others_from_being_made_safe(bench, relays, chiller, stage):
    bench.start()
    relays.fails_with = DeviceTimeoutError("relays: no answer")
    faults = bench.make_safe()
    assert len(faults) == 1
    assert "power off failed" in faults[0]
    assert "no answer" in faults[0]
    assert names(relays).count("all_off") == SAFE_ATTEMPTS
    assert chiller.setpoint == bench.config.safe_temperature_c
    assert "stop" in names(stage)


def test_a_chiller_that_clamps_the_safe_setpoint_is_reported(bench, chiller):
    bench.start()
    chiller.set_setpoint_c = lambda setpoint_c: setpoint_c + 5
    (fault,) = bench.make_safe()
    assert "chiller took 28 °C instead of 23 °C" in fault


def test_closing_twice_makes_safe_once(bench, relays):
    bench.start()
    bench.close()
    calls = len(relays.calls)
    assert bench.close() == []
    assert len(relays.calls) == calls
    assert relays.closed


def test_the_loop_holds_its_setpoint_when_no_housing_can_be_read(bench, chiller, thermometer, clock):
    bench.start()
    bench.set_temperature_c = 60.0
    bench.turn()
    clock.sleep(bench.config.control.period_s)
    bench.turn()
    held = chiller.setpoint
    assert held > 23.0
    thermometer.values_c = [23.0, 23.0, None, None, None]
    for _ in range(20):
        clock.sleep(bench.config.control.period_s)
        bench.turn()
    assert chiller.setpoint == held


def test_an_open_thermocouple_makes_the_step_unsettled_not_the_bench_hot(bench, thermometer, chiller):
    bench.start()
    thermometer.values_c = [23.0, 23.0, 25.0, None, 25.0]
    report = bench.settle(25.0)
    assert not report.settled
    assert "T3 gives no value" in report.reason
    assert chiller.setpoint <= bench.config.control.setpoint_maximum_c


def test_a_sweep_asks_for_frames_after_the_stage_stood_and_returns_to_its_start(bench, stage, duts, clock):
    bench.start()
    records = list(sweep(bench, (-5.0, 0.0, 5.0), frames=7))
    assert [record.stage_angle_deg for record in records] == [-5.0, 0.0, 5.0]
    assert stage.angle_deg == -5.0
    asked = [call for call in duts.calls if call[0] == "collect"]
    assert all(call[1] == bench.serials and call[2] == 7 and call[3] <= clock.now_s for call in asked)


def test_a_udp_port_in_use_says_so():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", 0))
        number = other.getsockname()[1]
        with pytest.raises(DeviceLostError, match=f"cannot listen on 127.0.0.1:{number}: Address already in use"):
            UdpPort("udp://127.0.0.1", "127.0.0.1", number, RealClock())


@pytest.mark.parametrize("url", ["serial://", "serial:///dev/ttyUSB0?speed=9600", "tcp://host", "http://host:1", "x"])
def test_a_url_of_another_form_is_refused(url):
    with pytest.raises(ConfigError, match="expected"):
        open_stream(url)


def test_a_serial_line_that_is_not_there_is_named():
    with pytest.raises(DeviceLostError, match="serial:///dev/no-such-line"):
        open_stream("serial:///dev/no-such-line?baud=9600")


def test_host_and_port_are_taken_from_the_url():
    assert host_and_port("tcp://10.0.0.7:8101") == ("10.0.0.7", 8101)
