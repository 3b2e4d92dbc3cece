from __future__ import annotations

import statistics

import pytest

from arl_fixtures.emulators.faults import Fault
from arl_fixtures.emulators.plant import Plant, PlantSettings
from arl_fixtures.emulators.thermometer import ThermometerEmulator, ThermometerEmulatorSettings
from arl_fixtures.errors import ConfigError
from arl_fixtures.protocols import dcon
from arl_fixtures.protocols.dcon import DconWire
from tests_unit.line_bench import ask_raw


def module(*, seed: int = 0, checksum: bool = False, **settings: object) -> tuple[ThermometerEmulator, Plant]:
    plant = Plant(PlantSettings(seed=seed))
    return ThermometerEmulator(plant, DconWire(checksum=checksum), ThermometerEmulatorSettings(**settings)), plant


def read_c(device: ThermometerEmulator, now_s: float) -> list[float | None]:
    reply = ask_raw(device, b"#01\r", now_s)
    return [value.value_c for value in dcon.parse_values(reply[1:-1].decode())]


def inject(plant: Plant, kind: str, now_s: float, **more: float) -> None:
    plant.faults.inject(Fault(device="thermometer", kind=kind, start_s=now_s, **more))
    plant.advance(now_s)


@pytest.mark.parametrize(("request_", "reply"), [
    (b"$01M\r", b"!017018\r"), (b"$012\r", b"!010F0600\r"), (b"~010\r", b"!0100\r"), (b"$016\r", b"!01FF\r"),
    (b"#018\r", b"?01\r"), (b"$01B\r", b"?01\r"), (b"$014\r", b"?01\r"), (b"%01010F0A00\r", b"?01\r"),
])  # fmt: skip
def test_commands_without_checksum(request_: bytes, reply: bytes):
    assert ask_raw(module()[0], request_) == reply


@pytest.mark.parametrize(("request_", "reply"), [(b"$01MD2\r", b"!01701852\r"), (b"$012B7\r", b"!010F0640C2\r")])
def test_commands_with_checksum(request_: bytes, reply: bytes):
    assert ask_raw(module(checksum=True)[0], request_) == reply


@pytest.mark.parametrize("request_", [b"#02\r", b"$01X\r", b"#01", b"#0z\r", b"\r", b"#01\n", b"~**\r", b"$01m\r"])
def test_wrong_syntax_or_address_is_silence(request_: bytes):
    assert ask_raw(module()[0], request_) == b""


def test_a_wrong_checksum_is_silence():
    device, _ = module(checksum=True)
    assert ask_raw(device, b"#01\r") == b""
    assert ask_raw(device, b"#0185\r") == b""
    assert ask_raw(device, b"#0184\r") != b""


def test_the_answer_takes_its_time_on_the_line():
    device, _ = module()
    (answer,) = device.receive(b"#01\r", 100.0)
    assert len(answer.data) == 58
    assert answer.time_s == pytest.approx(100.0 + 0.005 + 58 * 10 / 9600)


def test_single_channels_and_the_whole_agree():
    device, _ = module()
    whole = read_c(device, 3.0)
    assert float(ask_raw(device, b"#012\r", 3.0)[1:-1]) == whole[2]


def test_noise_and_resolution_are_a_tenth_of_a_kelvin():
    device, _ = module(sources=("ambient",))
    values = [read_c(device, float(second))[0] for second in range(1000)]
    assert statistics.fmean(values) == pytest.approx(23.0, abs=0.02)
    # 0.1 K of noise plus rounding to 0.1 K
    assert statistics.stdev(values) == pytest.approx((0.1**2 + 0.1**2 / 12) ** 0.5, rel=0.1)
    assert all(abs(value * 10 - round(value * 10)) < 1e-9 for value in values)


def test_the_same_seed_gives_the_same_bytes_and_another_does_not():
    first, again, other = (module(seed=seed)[0] for seed in (4, 4, 5))
    times_s = [n * 0.7 for n in range(20)]
    bytes_of_first = [ask_raw(first, b"#01\r", now_s) for now_s in times_s]
    ask_raw(again, b"#01\r", 0.3)
    assert [ask_raw(again, b"#01\r", now_s) for now_s in times_s] == bytes_of_first
    assert [ask_raw(other, b"#01\r", now_s) for now_s in times_s] != bytes_of_first


def test_a_synchronous_sample_is_kept_and_told_once_as_new():
    device, plant = module(noise_k=0.0, sources=("coolant",))
    plant.drive_coolant(0.0, target_c=80.0, controlling=True, circulating=True)
    assert ask_raw(device, b"#**\r", 60.0) == b""
    first, second = (ask_raw(device, b"$014\r", now_s) for now_s in (1000.0, 2000.0))
    assert first[:4] == b">011"
    assert second[:4] == b">010"
    assert first[4:] == second[4:]
    assert read_c(device, 2000.0)[0] > float(first[4:11]) + 10.0


def test_address_and_type_can_be_changed_but_not_baud_or_checksum():
    device, _ = module()
    assert ask_raw(device, b"%01050E0600\r") == b"!05\r"
    assert ask_raw(device, b"$052\r") == b"!050E0600\r"
    assert ask_raw(device, b"$012\r") == b""
    assert ask_raw(device, b"%05050F0640\r") == b"?05\r"


def test_drift_and_stuck_values_of_one_channel():
    device, plant = module(noise_k=0.0)
    inject(plant, "drift", 0.0, value=20.0, channel=1)
    inject(plant, "stuck_value", 1800.0, channel=0)
    plant.drive_coolant(1800.0, target_c=23.0, controlling=True, circulating=True)
    values = read_c(device, 3600.0)
    assert values[0] == 23.0
    assert values[1] == pytest.approx(43.0)
    assert values[2] == pytest.approx(23.0)


def test_a_stuck_value_stays_while_the_plant_moves():
    device, plant = module(sources=("coolant", "coolant"))
    plant.drive_coolant(0.0, target_c=80.0, controlling=True, circulating=True)
    inject(plant, "stuck_value", 60.0, channel=1)
    stuck = {read_c(device, 60.0 * n)[1] for n in range(1, 20)}
    assert len(stuck) == 1
    assert read_c(device, 1200.0)[0] > stuck.pop() + 10.0


def test_sensors_plugged_one_channel_further():
    device, plant = module(noise_k=0.0)
    for dut in (1, 2, 3):
        plant.switch(f"dut_{dut}", dut == 2, 0.0)
    plant.drive_coolant(0.0, target_c=60.0, controlling=True, circulating=True)
    right = read_c(device, 7200.0)
    inject(plant, "wrong_channel_order", 7200.0)
    assert read_c(device, 7200.0)[:5] == [right[4], *right[:4]]


def test_an_open_wire_in_each_dialect():
    for dialect, text in (("adam", b"+9999+"), ("icp", b"+9999.9+")):
        device, plant = module(range_dialect=dialect)
        inject(plant, "open_thermocouple", 0.0, channel=0)
        assert ask_raw(device, b"#01\r", 1.0)[1:].startswith(text)


def test_the_open_wire_mask():
    device, plant = module(open_wire_query=True)
    inject(plant, "open_thermocouple", 0.0, channel=1)
    assert ask_raw(device, b"$01B\r") == b"!01E2\r"


def test_a_source_that_is_not_there_is_refused():
    with pytest.raises(ConfigError, match="no source 'housing_4' on a plant with 3 DUTs"):
        module(sources=("housing_4",))
