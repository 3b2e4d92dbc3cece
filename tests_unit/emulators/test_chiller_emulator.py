from __future__ import annotations

import pytest

from arl_fixtures.emulators.chiller import ChillerEmulator, ChillerEmulatorSettings
from arl_fixtures.emulators.faults import Fault
from arl_fixtures.emulators.plant import Plant
from arl_fixtures.protocols import huber_pb as pb
from arl_fixtures.protocols.huber_pb import PbWire
from tests_unit.line_bench import ask_raw


def chiller(wire: PbWire | None = None, **settings: object) -> tuple[ChillerEmulator, Plant]:
    plant = Plant()
    return ChillerEmulator(plant, wire, ChillerEmulatorSettings(**({"bath_noise_k": 0.0} | settings))), plant


def word(device: ChillerEmulator, address: int, now_s: float = 0.0, write: int | None = None) -> int:
    found = pb.find_reply(ask_raw(device, pb.encode_request(address, write), now_s), address)
    assert found is not None
    return found


def inject(plant: Plant, kind: str, now_s: float, **more: float) -> None:
    plant.faults.inject(Fault(device="chiller", kind=kind, start_s=now_s, **more))
    plant.advance(now_s)


def test_the_published_bytes():
    device, _ = chiller(setpoint_start_c=25.0)
    assert ask_raw(device, b"{M00****\r\n") == b"{S0009C4\r\n"


def test_a_write_is_answered_with_the_value_after_it():
    device, _ = chiller(setpoint_min_c=-20.0, setpoint_max_c=85.0)
    assert ask_raw(device, b"{M00EC78\r\n") == b"{S00F830\r\n", "-50 °C is clamped to -20 °C"
    assert ask_raw(device, b"{M0030D4\r\n") == b"{S002134\r\n", "125 °C is clamped to 85 °C"
    assert (word(device, 0x30), word(device, 0x31)) == (0xF830, 0x2134)


@pytest.mark.parametrize(
    "request_", [b"{M00***\r\n", b"{m00****\r\n", b"{M0009C4\n", b"hello\r\n", b"{M009C4\r\n", b"\r\n"]
)
def test_malformed_requests_get_no_answer(request_: bytes):
    device, _ = chiller()
    assert ask_raw(device, request_) == b""
    assert ask_raw(device, b"\r\n{M0A****\r\n") != b"", "and do not spoil the next"


def test_a_request_may_come_in_pieces_but_not_over_two_connections():
    device, _ = chiller()
    assert ask_raw(device, b"{M00**") == b""
    assert ask_raw(device, b"**\r\n") != b""
    assert ask_raw(device, b"{M00**") == b""
    device.disconnect(1.0)
    assert ask_raw(device, b"**\r\n") == b""


def test_what_the_model_does_not_have_is_7fff_and_a_missing_sensor_is_minus_151():
    device, _ = chiller()
    assert word(device, 0x6F) == 0x7FFF
    assert word(device, 0x07) == pb.SENSOR_MISSING
    assert word(device, 0x3A) == 0x7FFF
    other, _ = chiller(PbWire(process_address=0x3A))
    assert word(other, 0x3A) == pb.SENSOR_MISSING


def test_answers_may_be_in_lower_case():
    device, _ = chiller(lower_case=True, setpoint_start_c=25.0)
    assert ask_raw(device, b"{M00****\r\n") == b"{S0009c4\r\n"


def test_the_bath_follows_the_setpoint_only_under_control():
    device, plant = chiller()
    word(device, 0x00, write=pb.encode_temperature(60.0))
    word(device, 0x16, write=1)
    assert pb.decode_temperature(word(device, 0x01, 1200.0)) == pytest.approx(23.0, abs=0.5)
    word(device, 0x14, 1200.0, write=1)
    assert pb.decode_temperature(word(device, 0x01, 3600.0)) == pytest.approx(60.0, abs=0.1)
    assert plant.plate_c == pytest.approx(60.0, abs=2.0)


def test_the_ramp_limits_how_fast_the_bath_may_follow():
    device, _ = chiller(setpoint_ramp_k_per_min=0.5)
    word(device, 0x14, write=1)
    word(device, 0x00, write=pb.encode_temperature(60.0))
    first_c, second_c = (pb.decode_temperature(word(device, 0x01, now_s)) for now_s in (1200.0, 2400.0))
    assert second_c - first_c == pytest.approx(10.0, abs=0.1)
    assert word(device, 0x00, 2400.0) == 6000, "the set-point itself is what was written"


def test_pump_and_pressure_belong_together():
    device, _ = chiller(pump_rpm=3000, pump_head_mbar=400.0)
    assert (word(device, 0x03), word(device, 0x26)) == (1000, 0)
    word(device, 0x16, write=1)
    assert (word(device, 0x03), word(device, 0x26)) == (1400, 3000)
    word(device, 0x48, write=1500)
    assert (word(device, 0x03), word(device, 0x26)) == (1100, 1500), "head grows with the square of the speed"


def test_a_stopped_pump_raises_no_error_and_couples_nothing():
    device, plant = chiller()
    word(device, 0x14, write=1)
    inject(plant, "pump_stop", 10.0)
    assert (word(device, 0x03, 11.0), word(device, 0x26, 11.0), word(device, 0x05, 11.0)) == (1000, 0, 0)
    status = pb.decode_status(word(device, 0x0A, 11.0))
    assert pb.Status.CIRCULATING in status
    assert pb.Status.PUMPING not in status
    assert not plant.circulating


def test_low_level_warns_then_stops():
    device, plant = chiller()
    word(device, 0x14, write=1)
    inject(plant, "low_level", 10.0, value=8.0)
    assert (word(device, 0x0F, 11.0), pb.to_signed(word(device, 0x06, 11.0))) == (80, -2098)
    assert plant.circulating
    plant.faults.clear()
    inject(plant, "low_level", 20.0)
    assert pb.to_signed(word(device, 0x05, 21.0)) == -75
    assert not plant.circulating
    status = pb.decode_status(word(device, 0x0A, 21.0))
    assert pb.Status.ERROR in status
    assert pb.Status.CONTROLLING not in status
    assert word(device, 0x16, 22.0, write=1) == 0, "it will not pump without coolant"


@pytest.mark.parametrize(("value", "answer"), [(0, 6000), (1, 2000)])
def test_an_ignored_setpoint(value: int, answer: int):
    device, plant = chiller()
    word(device, 0x14, write=1)
    inject(plant, "setpoint_ignored", 10.0, value=value)
    assert word(device, 0x00, 11.0, write=6000) == answer
    plant.advance(3600.0)
    assert plant.coolant_c == pytest.approx(20.0, abs=0.1)
    plant.faults.clear()
    plant.advance(2 * 3600.0)
    assert plant.coolant_c == pytest.approx(answer / 100.0, abs=0.1)


def test_a_stuck_and_a_drifting_bath():
    device, plant = chiller()
    word(device, 0x14, write=1)
    word(device, 0x00, write=9000)
    inject(plant, "stuck_value", 600.0)
    stuck = word(device, 0x01, 600.0)
    assert word(device, 0x01, 3600.0) == stuck
    plant.faults.clear()
    assert word(device, 0x01, 3600.0) == 9000
    inject(plant, "drift", 3600.0, value=10.0)
    assert word(device, 0x01, 3600.0 + 1800.0) == 9500


def test_after_a_reset_the_panel_rules():
    device, plant = chiller(setpoint_start_c=21.0)
    word(device, 0x00, write=6000)
    word(device, 0x14, write=1)
    device.reset(10.0)
    assert (word(device, 0x00, 20.0), word(device, 0x14, 20.0), word(device, 0x16, 20.0)) == (2100, 0, 0)
    assert not plant.circulating
