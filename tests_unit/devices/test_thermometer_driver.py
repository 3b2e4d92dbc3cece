from __future__ import annotations

import pytest

from arl_fixtures.bench.clock import VirtualClock
from arl_fixtures.devices.thermometer import DconSettings, DconThermometer
from arl_fixtures.errors import DeviceError, DeviceTimeoutError, RemoteProtocolError
from arl_fixtures.protocols import dcon
from tests_unit.line_bench import LineBench, Scripted, SerialPort


@pytest.mark.parametrize("checksum", [True, False])
def test_channels_come_in_order_with_and_without_checksum(checksum: bool):
    bench = LineBench(
        thermometer={"checksum": checksum},
        thermometer_emulator={"noise_k": 0.0, "offsets_k": (0.0, 10.0, 20.0, -30.0, 40.0)},
    )
    readings = bench.thermometer.read_c()
    assert [reading.value_c for reading in readings[:5]] == pytest.approx([23.0, 33.0, 43.0, -7.0, 63.0])
    assert all(reading.value_c is None and "open" in reading.fault for reading in readings[5:])


@pytest.mark.parametrize(("dialect", "offset_k"), [("adam", 0.0), ("icp", -60.0)])
def test_a_broken_wire_in_the_middle_does_not_shift_its_neighbours(dialect: str, offset_k: float):
    bench = LineBench(thermometer_emulator={"range_dialect": dialect, "offsets_k": (offset_k,) * 5, "noise_k": 0.0})
    bench.inject("thermometer", "open_thermocouple", channel=2)
    readings = bench.thermometer.read_c()
    assert readings[2].value_c is None
    expected_c = pytest.approx(23.0 + offset_k)
    assert [readings[channel].value_c for channel in (0, 1, 3, 4)] == [expected_c] * 4


def test_an_adam_module_cannot_read_below_zero():
    bench = LineBench(thermometer_emulator={"range_dialect": "adam", "offsets_k": (-40.0,)})
    assert bench.thermometer.read_c()[0].fault == "under range"


def test_the_open_wire_query_tells_open_from_over_range():
    bench = LineBench(thermometer={"open_wire_query": True}, thermometer_emulator={"open_wire_query": True})
    bench.inject("thermometer", "open_thermocouple", channel=4)
    assert bench.thermometer.read_c()[4].fault == "open"


def test_identity_and_configuration():
    identity = LineBench().thermometer.identify()
    assert (identity.name, identity.firmware) == ("7018", "B1.2")
    with pytest.raises(DeviceError, match="thermocouple type code is 0E, expected 0F"):
        LineBench(thermometer_emulator={"type_code": 0x0E}).thermometer.identify()


def test_checksum_switched_on_at_one_end_only_is_silence():
    clock = VirtualClock()
    bench = LineBench(thermometer={"checksum": True})
    plain = DconThermometer(
        SerialPort("line", bench.wires["thermometer"], clock), clock, DconSettings(checksum=False)
    )
    with pytest.raises(DeviceTimeoutError):
        plain.read_c()


def test_another_number_of_channels_is_refused():
    clock = VirtualClock()
    reply = dcon.encode(">+0025.1+0024.9", with_checksum=True)
    thermometer = DconThermometer(SerialPort("line", Scripted(*[[(0.1, reply)]] * 9), clock), clock)
    with pytest.raises(RemoteProtocolError, match="expected 8 channels, got 2"):
        thermometer.read_c()


def test_a_refusal_is_told():
    clock = VirtualClock()
    reply = dcon.encode("?01", with_checksum=True)
    thermometer = DconThermometer(SerialPort("line", Scripted(*[[(0.1, reply)]] * 9), clock), clock)
    with pytest.raises(RemoteProtocolError, match=r"thermometer at line: the module refused '#01'"):
        thermometer.read_c()


def test_a_late_reading_is_not_the_current_one():
    bench = LineBench(thermometer_emulator={"noise_k": 0.0, "sources": ("coolant",)})
    bench.chiller.start()
    bench.chiller.set_setpoint_c(90.0)
    bench.inject("thermometer", "late_reply", duration_s=0.6, value=2.0)
    with pytest.raises(DeviceTimeoutError):
        bench.thermometer.read_c()
    bench.clock.sleep(600.0)
    bench.plant.advance(bench.clock.now_s)
    now_c = bench.plant.coolant_c
    assert bench.thermometer.read_c()[0].value_c == pytest.approx(now_c, abs=0.2)
    assert now_c > 40.0


def test_names_from_outside_are_made_printable():
    clock = VirtualClock()
    name = dcon.checksum(b"!01\x1b[2J")
    script = [(0.1, b"!01\x1b[2J" + name + b"\r")]
    config = [(0.1, dcon.encode("!010F0640", with_checksum=True))]
    device = Scripted(script, script, config)
    assert DconThermometer(SerialPort("line", device, clock), clock).identify().name == "?[2J"
