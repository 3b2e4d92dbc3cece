from __future__ import annotations

import pytest

from arl_fixtures.emulators.plant import Plant
from arl_fixtures.emulators.relays import RelaysEmulator, RelaysEmulatorSettings
from tests_unit.line_bench import ask_raw

LOADS = {"dut_1": 1, "laser_1": 4}


def board(*, set_up: bool = True, **settings: object) -> tuple[RelaysEmulator, Plant]:
    plant = Plant()
    device = RelaysEmulator(plant, LOADS, RelaysEmulatorSettings(**settings))
    if set_up:
        ask_raw(device, bytes.fromhex("01 01 00 00"))
    return device, plant


def said(device: RelaysEmulator, request: str, now_s: float = 0.0) -> str:
    return ask_raw(device, bytes.fromhex(request), now_s).hex(" ").upper()


def test_the_published_conversation():
    device, _ = board(set_up=False)
    assert said(device, "01 01 00 00") == "FE 01 10 EF 01 02 00 03"
    said(device, "03 01 31 33")
    assert said(device, "02 01 00 03") == "FD 01 31 CD"
    assert said(device, "03 01 A4 A6") == "FC 01 00 FD"
    assert said(device, "06 01 01 06") == "F9 01 01 F9"
    assert said(device, "07 01 01 07") == "F8 01 01 F8"
    assert said(device, "08 01 30 39") == "F7 01 30 C6"
    assert said(device, "02 01 00 03") == "FD 01 94 68"


def test_a_frame_for_a_board_that_is_not_there_comes_back():
    device, _ = board()
    assert said(device, "02 05 00 07") == "02 05 00 07"
    unnumbered, _ = board(set_up=False)
    assert said(unnumbered, "02 01 00 03") == "02 01 00 03"


def test_a_wrong_check_byte_is_complained_about():
    assert said(board()[0], "02 01 00 04") == "FF 01 00 FE"


def test_broadcast_is_answered_and_passed_on():
    device, plant = board()
    assert said(device, "06 00 01 07") == "F9 01 01 F9 06 00 01 07"
    assert plant.powered(0)
    said(device, "05 01 00 04")
    assert said(device, "07 00 01 06") == "07 00 01 06"
    assert plant.powered(0), "with the option off a broadcast is not executed"
    said(device, "05 01 03 07")
    assert said(device, "07 00 01 06") == "F8 01 01 F8"


def test_contacts_power_the_plant():
    device, plant = board()
    said(device, "06 01 09 0E", 5.0)
    assert plant.powered_since_s(0) == 5.0
    assert plant.laser_on(0)
    said(device, "07 01 01 07", 9.0)
    assert not plant.powered(0)


def test_an_unknown_command_gets_no_answer():
    assert said(board()[0], "55 01 00 54") == ""


def test_half_a_frame_is_forgotten_after_a_while():
    device, _ = board()
    assert said(device, "02 01", 1.0) == ""
    assert said(device, "00 03", 1.05) == "FD 01 00 FC"
    assert said(device, "02 01", 2.0) == ""
    assert said(device, "02 01 00 03", 2.5) == "FD 01 00 FC"


def test_a_reset_loses_states_and_address():
    device, plant = board()
    said(device, "06 01 01 06")
    device.reset(10.0)
    assert not plant.powered(0)
    assert said(device, "02 01 00 03", 11.0) == "02 01 00 03"


@pytest.mark.parametrize("wiring", [{"dut_1": 8}, {"dut_1": 8, "fan": 2}])
def test_the_board_may_be_wired_otherwise_than_the_driver_believes(wiring: dict[str, int]):
    device, plant = board(loads=wiring)
    said(device, "06 01 01 06")
    assert not plant.powered(0)
    said(device, "06 01 80 87")
    assert plant.powered(0)


def test_the_answer_takes_its_time():
    device, _ = board()
    (answer,) = device.receive(bytes.fromhex("02 01 00 03"), 100.0)
    assert answer.time_s == pytest.approx(100.0 + 0.02 + 4 * 10 / 19200)
