from __future__ import annotations

import pytest
from pydantic import ValidationError

from arl_fixtures.devices.relays import ConradSettings
from arl_fixtures.errors import DeviceError, DeviceTimeoutError, LocalProtocolError
from tests_unit.line_bench import LineBench


def test_loads_are_switched_and_read_back():
    bench = LineBench()
    assert bench.relays.loads() == ("dut_1", "dut_2", "dut_3", "laser_1", "laser_2", "laser_3")
    bench.relays.set("dut_2", True)
    bench.relays.set(5, True)
    states = bench.relays.states()
    assert [load for load, on in states.items() if on] == ["dut_2", "laser_2"]
    assert [bench.plant.powered(dut) for dut in range(3)] == [False, True, False]
    assert bench.plant.laser_on(1)
    bench.relays.set("dut_2", False)
    assert not bench.plant.laser_on(1), "no supply, no light"


def test_all_off_leaves_relays_alone_that_are_no_loads():
    bench = LineBench(relays={"loads": {"dut_1": 1, "laser_1": 4}})
    bench.relays.set(8, True)
    bench.relays.set("dut_1", True)
    bench.relays.all_off()
    assert bench.relays.port_state() == 0b1000_0000
    bench.relays.all_off([8])
    assert bench.relays.port_state() == 0


def test_a_load_nobody_knows_is_our_fault():
    with pytest.raises(LocalProtocolError, match="no load 'dut_9'; known are dut_1"):
        LineBench().relays.set("dut_9", True)


@pytest.mark.parametrize(("loads", "complaint"), [
    ({"dut_1": 9}, "expected 1 to 8"), ({"dut_1": 1, "dut_2": 1}, "two loads are on one relay"),
])  # fmt: skip
def test_impossible_wiring_is_refused(loads: dict[str, int], complaint: str):
    with pytest.raises(ValidationError, match=complaint):
        ConradSettings(loads=loads)


def test_after_a_reset_nothing_is_closed_that_nobody_asked_for():
    bench = LineBench()
    bench.relays.set("dut_1", True)
    bench.relays.set("dut_2", True)
    bench.inject("relays", "reset")
    bench.clock.sleep(2.0)
    assert not any(bench.relays.states().values())
    assert bench.relays.resets_seen == 1
    bench.relays.set("dut_1", True)
    assert [load for load, on in bench.relays.states().items() if on] == ["dut_1"]


def test_a_board_is_deaf_while_it_restarts():
    bench = LineBench(relays={"retries": 0})
    bench.relays.set("dut_1", True)
    bench.inject("relays", "reset")
    with pytest.raises(DeviceTimeoutError):
        bench.relays.states()
    assert not bench.plant.powered(0)


def test_retries_outlast_a_reset():
    bench = LineBench()
    bench.relays.set("dut_1", True)
    bench.inject("relays", "reset")
    bench.clock.sleep(0.2)
    assert bench.relays.states()["dut_1"] is False


def test_a_welded_contact_is_not_seen_in_the_read_back():
    bench = LineBench()
    bench.relays.set("dut_1", True)
    bench.inject("relays", "relay_welded", channel=1)
    bench.relays.set("dut_1", False)
    assert bench.relays.states()["dut_1"] is False
    assert bench.plant.powered(0)
    bench.clear()
    bench.plant.advance(bench.clock.now_s)
    assert not bench.plant.powered(0)


def test_garbage_on_the_line_is_outlived():
    bench = LineBench()
    bench.inject("relays", "garbage", value=3)
    bench.relays.set("dut_3", True)
    assert bench.relays.states()["dut_3"]


def test_a_late_read_back_is_not_the_current_one():
    bench = LineBench()
    bench.relays.set("dut_1", True)
    bench.inject("relays", "late_reply", duration_s=0.3, value=0.7)
    try:
        before = bench.relays.states()
    except DeviceError:
        before = {"dut_1": True}
    bench.relays.set("dut_1", False)
    assert before["dut_1"]
    assert not bench.relays.states()["dut_1"]


def test_identity():
    assert LineBench().relays.identify().firmware == "16"
