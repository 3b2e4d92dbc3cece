from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from arl_fixtures.bench.clock import VirtualClock
from arl_fixtures.bench.links import VirtualStreamPort
from arl_fixtures.devices.chiller import HuberChiller, HuberSettings
from arl_fixtures.errors import (
    DeviceError,
    DeviceLostError,
    DeviceTimeoutError,
    LocalProtocolError,
    RemoteProtocolError,
)
from tests_unit.line_bench import LineBench, Scripted, SerialPort


def test_a_setpoint_is_written_rounded_and_read_back():
    bench = LineBench()
    assert bench.chiller.set_setpoint_c(19.996) == 20.0
    assert bench.chiller.set_setpoint_c(-10.0) == -10.0
    assert bench.chiller.setpoint_c() == -10.0


def test_the_value_after_the_write_tells_of_the_clamp():
    bench = LineBench(chiller_emulator={"setpoint_min_c": -30.0, "setpoint_max_c": 90.0})
    assert bench.chiller.set_setpoint_c(200.0) == 90.0
    assert bench.chiller.set_setpoint_c(-80.0) == -30.0
    assert bench.chiller.setpoint_limits_c() == (-30.0, 90.0)


def test_a_setpoint_that_cannot_be_coded_is_our_fault():
    with pytest.raises(LocalProtocolError):
        LineBench().chiller.set_setpoint_c(1000.0)


def test_start_circulates_before_it_controls():
    bench = LineBench(chiller={"pause_after_circulation_s": 5.0, "pause_after_start_s": 10.0})
    bench.chiller.start()
    status = bench.chiller.status()
    assert (status.circulating, status.pumping, status.controlling) == (True, True, True)
    assert status.pump_mbar == 1350.0
    assert status.pump_rpm == 3500
    assert status.level_percent == 82.0
    assert bench.clock.now_s > 15.0
    bench.chiller.stop()
    status = bench.chiller.status()
    assert (status.circulating, status.pumping, status.controlling) == (False, False, False)
    assert status.pump_mbar == 1000.0


def test_a_petite_fleur_needs_its_pauses():
    """It goes silent after a start; a driver that knows waits, one that does not meets the silence."""
    quirks = {"silent_after_start_s": 10.0, "silent_after_circulation_s": 5.0}
    patient = LineBench(
        chiller={"pause_after_circulation_s": 5.0, "pause_after_start_s": 10.0}, chiller_emulator=quirks
    )
    patient.chiller.start()
    assert patient.chiller.status().controlling
    with pytest.raises(DeviceTimeoutError):
        LineBench(chiller_emulator=quirks).chiller.start()


@pytest.mark.parametrize("dialect", [
    {"status_bit_order": "msb16"}, {"status_bit_order": "msb15"}, {"serial_word_order": "1c_high"},
    {"pressure_mbar_per_count": 0.1}, {"process_address": 0x3A},
])  # fmt: skip
def test_disputed_facts_are_settings(dialect: dict[str, object]):
    bench = LineBench(chiller=dialect)
    bench.chiller.start()
    status = bench.chiller.status()
    assert (status.circulating, status.controlling, status.error_code) == (True, True, 0)
    assert status.pump_mbar == 1350.0
    assert bench.chiller.identify().serial == "423117"
    assert bench.chiller.process_c() is None


def test_a_missing_sensor_is_an_error_and_not_minus_151_degrees():
    clock = VirtualClock()
    for word, why in ((b"C504", "sensor missing"), (b"7FFF", "not available")):
        port = VirtualStreamPort("tcp://chiller", Scripted([(0.1, b"{S01" + word + b"\r\n")]), clock)
        with pytest.raises(DeviceError, match=f"chiller at tcp://chiller: no value of 'bath': {why}"):
            HuberChiller(port, clock).bath_c()


def test_an_alarm_is_told_and_stays_until_its_cause_is_gone():
    bench = LineBench()
    bench.chiller.start()
    bench.inject("chiller", "chiller_alarm", value=-4)
    bench.clock.sleep(1.0)
    status = bench.chiller.status()
    assert status.error_code == -4
    assert not status.controlling
    with pytest.raises(DeviceError, match="temperature control stays off"):
        bench.chiller.start()
    bench.chiller.clear_error()
    assert bench.chiller.status().error_code == -4
    bench.clear()
    assert bench.chiller.status().error_code == -4, "it is kept until it is acknowledged"
    bench.chiller.clear_error()
    bench.chiller.start()
    assert bench.chiller.status().error_code == 0


late = st.lists(st.floats(0.0, 3.0), min_size=1, max_size=6)


@given(late, st.booleans())
@settings(max_examples=60, deadline=None)
def test_a_late_answer_is_never_the_current_value(delays_s: list[float], tcp: bool):
    """The fault of the other drivers: after a time-out they read the previous answer for ever."""
    clock = VirtualClock()
    replies = {b"{M00****\r\n": 0, b"{M0A****\r\n": 0}

    class Counting(Scripted):
        last_s = 0.0

        def receive(self, data, now_s):
            replies[data] = replies.get(data, 0) + 1
            word = b"%04X" % replies[data]
            delay_s = delays_s.pop(0) if delays_s else 0.0
            self.last_s = max(self.last_s, now_s + delay_s)
            return [type(self).answer(self.last_s, data, word)]

        @staticmethod
        def answer(time_s, data, word):
            from arl_fixtures.emulators.device import Outgoing

            return Outgoing(time_s, b"{S" + data[2:4] + word + b"\r\n")

    device = Counting()
    port = VirtualStreamPort("tcp", device, clock) if tcp else SerialPort("serial", device, clock)
    chiller = HuberChiller(port, clock, HuberSettings(reopen_after_timeout=tcp, quiet_s=4.0))
    for _ in range(5):
        before = replies[b"{M00****\r\n"]
        try:
            value = round(chiller.setpoint_c() * 100.0)
        except (DeviceTimeoutError, RemoteProtocolError):
            continue
        assert value > before


def test_a_cut_connection_is_lost_and_comes_back():
    bench = LineBench()
    assert bench.chiller.bath_c() == pytest.approx(23.0, abs=0.1)
    bench.inject("chiller", "disconnect", duration_s=10.0)
    with pytest.raises(DeviceLostError, match="emulated chiller"):
        bench.chiller.bath_c()
    bench.clock.sleep(10.0)
    assert bench.chiller.bath_c() == pytest.approx(23.0, abs=0.1)
