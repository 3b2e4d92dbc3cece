"""For each control line and fault of the wire: what the driver does, in bounded time, and that it recovers.

The table of `docs/faults.md` says the same in words.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from arl_fixtures.emulators.fault_kinds import FAULT_KINDS, FaultKind
from arl_fixtures.errors import DeviceError, DeviceLostError, DeviceTimeoutError, RemoteProtocolError
from tests_unit.line_bench import LineBench

ASK: Final[dict[str, Callable[[LineBench], object]]] = {
    "chiller": lambda bench: bench.chiller.bath_c(),
    "thermometer": lambda bench: bench.thermometer.read_c(),
    "stage": lambda bench: bench.stage.position_deg(),
    "relays": lambda bench: bench.relays.states(),
}
LONGEST_S: Final = {"chiller": 1.0, "thermometer": 1.0, "stage": 0.5, "relays": 1.5}
"""(1 + retries) × time-out: no question to a sick line takes longer."""

WIRE: Final[dict[FaultKind, type[DeviceError]]] = {
    FaultKind.SILENCE: DeviceTimeoutError,
    FaultKind.LATE_REPLY: DeviceTimeoutError,
    FaultKind.MERGED_REPLIES: DeviceError,
    FaultKind.GARBAGE: RemoteProtocolError,
    FaultKind.TRUNCATED_REPLY: RemoteProtocolError,
    FaultKind.WRONG_CHECKSUM: RemoteProtocolError,
    FaultKind.DISCONNECT: DeviceLostError,
}
CASES: Final = [
    (device, kind, error) for kind, error in WIRE.items() for device in ASK if device in FAULT_KINDS[kind].devices
]


@pytest.mark.parametrize(("device", "kind", "error"), CASES, ids=[f"{d}-{k.value}" for d, k, _ in CASES])
def test_a_lasting_fault_of_the_wire_is_named_in_time_and_survived(
    device: str, kind: FaultKind, error: type[DeviceError]
):
    bench = LineBench()
    bench.stage.home(60.0)
    healthy = ASK[device](bench)
    bench.inject(device, kind.value)
    for _ in range(3):
        start_s = bench.clock.now_s
        with pytest.raises(error, match=f"{device} at emulated {device}|emulated {device}: the line is cut"):
            ASK[device](bench)
        # a third silence in a row leaves no fence on the poorer lines: then it waits for quiet
        assert bench.clock.now_s - start_s <= LONGEST_S[device] + 3.0 + 1e-6
    bench.clear()
    bench.clock.sleep(10.0)
    again = ASK[device](bench)
    if device in {"stage", "relays"}:
        assert again == healthy


@pytest.mark.parametrize(("device", "kind", "error"), CASES, ids=[f"{d}-{k.value}" for d, k, _ in CASES])
def test_a_short_fault_of_the_wire_is_outlived_by_the_retry(device: str, kind: FaultKind, error: type[DeviceError]):
    del error
    bench = LineBench()
    healthy = ASK[device](bench)
    value = 0.4 * LONGEST_S[device] if kind is FaultKind.LATE_REPLY else None
    bench.inject(device, kind.value, duration_s=0.001, value=value)
    again = ASK[device](bench)
    if device in {"stage", "relays"}:
        assert again == healthy


wire_faults = st.tuples(
    st.sampled_from([kind.value for kind in WIRE] + ["reset", "brown_out"]),
    st.floats(0.0, 20.0),
    st.floats(0.0, 3.0),
    st.none() | st.integers(0, 9),
)


@given(st.sampled_from(sorted(ASK)), st.lists(wire_faults, max_size=5), st.integers(0, 3))
@settings(max_examples=60, deadline=None)
def test_whatever_happens_on_the_wire_an_answer_is_true(
    device: str, schedule: list[tuple[str, float, float, int | None]], seed: int
):
    """Every value a driver returns is what the emulator holds at that time; else it raises, in bounded time."""
    bench = LineBench(
        seed=seed,
        thermometer_emulator={"noise_k": 0.0, "sources": ("coolant",)},
        chiller_emulator={"bath_noise_k": 0.0},
    )
    bench.chiller.start()
    bench.chiller.set_setpoint_c(90.0)
    if device == "stage":
        bench.stage.home(60.0)
        bench.stage.move_to_deg(70.0)
    bench.clock.sleep(0.5)
    start_s = bench.clock.now_s
    for kind, after_s, duration_s, value in schedule:
        if FaultKind(kind) in FAULT_KINDS and device in FAULT_KINDS[FaultKind(kind)].devices:
            bench.inject(device, kind, start_s=start_s + after_s, duration_s=duration_s, value=value)
    for turn in range(12):
        asked_s = bench.clock.now_s
        wanted = bool(turn % 2)
        try:
            if device == "relays":
                bench.relays.set("dut_1", wanted)
                held = bool(bench.emulators["relays"].contacts & 1)
                reset_since = any(fault[0] in {"reset", "brown_out"} for fault in schedule)
                assert held == wanted or reset_since
            elif device == "stage":
                angle_deg = bench.stage.position_deg()
                latest_deg = bench.plant.stage_angle_deg(bench.clock.now_s)
                reset_since = any(fault[0] in {"reset", "brown_out"} for fault in schedule)
                assert angle_deg == pytest.approx(latest_deg, abs=0.5) or reset_since
            else:
                value_c = bench.chiller.bath_c() if device == "chiller" else bench.thermometer.read_c()[0].value_c
                bench.plant.advance(bench.clock.now_s)
                # the bath moves at most 3 K/min, so an answer from another question would stand out
                assert value_c == pytest.approx(bench.plant.coolant_c, abs=0.12)
        except DeviceError:
            pass
        assert bench.clock.now_s - asked_s <= 3 * LONGEST_S[device] + 2 * 3.0
        bench.clock.sleep(1.7)
