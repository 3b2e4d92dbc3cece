"""The emulated sensor in its plant: power, time, what it sees, its faults, and bytes that nothing else can change."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from arl_fixtures.bench.clock import VirtualClock
from arl_fixtures.bench.links import VirtualNetwork
from arl_fixtures.devices.dut import HflPorts, HflReceiver, HflSettings
from arl_fixtures.devices.dut_status import DutSilentError, FrozenFrameError
from arl_fixtures.emulators.dut import DutEmulator, DutEmulatorSettings
from arl_fixtures.emulators.fault_kinds import FaultKind
from arl_fixtures.emulators.faults import Fault, FaultBook
from arl_fixtures.emulators.motion import plan_move
from arl_fixtures.emulators.plant import Plant, PlantSettings
from arl_fixtures.errors import ConfigError
from arl_fixtures.protocols.hfl110 import Hfl110Wire, PixelFlag, decode_frames, decode_header
from arl_fixtures.protocols.hfl110_telemetry import decode_telemetry
from arl_fixtures.protocols.operating_record import decode_record
from arl_fixtures.twin.aging import AgingSettings
from arl_fixtures.twin.frame import Renderer
from arl_fixtures.twin.noise import scatter
from arl_fixtures.twin.operating import OperatingSettings
from arl_fixtures.twin.settings import DutSettings

FRAMES, TELEMETRY, OPERATING = 57410, 57413, 57420
WIRE = Hfl110Wire()
DUT = DutSettings(serial="EMU-1", sender_address="127.0.0.21", seed=3, dead_pixels=((4, 5),))
TIMES = DutEmulatorSettings()
FIRST_EXPOSURE_S = TIMES.boot_s
FIRST_PACKET_S = TIMES.boot_s + TIMES.readout_delay_s


def switched_on(*faults, at_s=0.0, seed=0, laser=True, **more):
    plant = Plant(PlantSettings(seed=seed), faults=FaultBook(list(faults)))
    emulator = DutEmulator(plant, 0, DUT, **more)
    plant.switch("dut_1", True, at_s)
    if laser:
        plant.switch("laser_1", True, at_s)
    return plant, emulator


_, ON_ALL_THE_TIME = switched_on()


def sent_to(port, sent):
    return [outgoing for destination, outgoing in sent if destination == port]


def frames_in(emulator, start_s, end_s):
    rows = [outgoing.data for outgoing in sent_to(FRAMES, emulator.send(start_s, end_s))]
    assert len(rows) % 32 == 0
    return decode_frames(rows, WIRE)


def frame_span(count):
    """A time before frame `count`'s first packet and one after its last."""
    start_s = FIRST_PACKET_S + count * TIMES.frame_period_s
    return start_s - 1e-4, start_s + TIMES.readout_s - 1e-6


def test_sends_only_while_powered_and_after_booting():
    plant, emulator = switched_on(at_s=1.0)
    assert emulator.send(0.0, 1.0 + FIRST_PACKET_S - 0.001) == []
    assert emulator.next_time_s(1.5) == pytest.approx(1.0 + FIRST_PACKET_S)
    assert sent_to(FRAMES, emulator.send(1.0, 4.0))
    plant.switch("dut_1", False, 4.0)
    assert emulator.send(4.0, 5.0) == []
    assert emulator.next_time_s(4.0) == math.inf
    plant.switch("dut_1", True, 6.0)
    assert emulator.next_time_s(6.0) == pytest.approx(6.0 + FIRST_PACKET_S)


def test_twenty_five_frames_a_second_of_32_packets_each():
    _, emulator = switched_on()
    start_s = FIRST_PACKET_S - 1e-6
    packets = sent_to(FRAMES, emulator.send(start_s, start_s + 2.0))
    assert len(packets) == 2 * 25 * 32
    headers = [decode_header(packet.data) for packet in packets]
    assert [header.row_number for header in headers[:64]] == [*range(32), *range(32)]
    assert [header.packet_number for header in headers[::32]] == list(range(50))
    first = headers[0]
    assert first.timestamp == pytest.approx(FIRST_EXPOSURE_S * 1e6)
    assert headers[32].timestamp - first.timestamp == 40_000
    assert first.calibration.fx == pytest.approx(58.1)
    assert first.calibration.r4 == pytest.approx(0.198)
    times = [packet.time_s for packet in packets]
    assert times == sorted(times)


def test_frames_are_the_twins_with_its_noise():
    plant, emulator = switched_on()
    plant.stage_track.replace(0.0, [*plan_move_to(12.6)])
    expected = Renderer(DUT).expected(12.6)
    spread = scatter(expected, DUT.noise)
    start_s, _ = frame_span(0)
    frames = frames_in(emulator, start_s, frame_span(39)[1])
    seen = spread.returns
    intensity = frames.intensity_counts[:, 0].mean(axis=0)
    z = (intensity - spread.intensity_counts)[seen] / (spread.intensity_std_counts[seen] / np.sqrt(40))
    assert np.std(z) == pytest.approx(1.0, abs=0.05)
    z = (frames.distance_m[:, 0].mean(axis=0) - spread.distance_m)[seen] / (spread.distance_std_m[seen] / np.sqrt(40))
    assert np.abs(np.mean(z)) < 0.1
    assert np.array_equal(np.isfinite(frames.distance_m[:, 0]), np.broadcast_to(seen, (40, 32, 128)))
    assert np.isnan(frames.distance_m[:, 1]).all()
    assert np.array_equal(frames.flags[0] == PixelFlag.VALID, seen)


def plan_move_to(angle_deg, start_s=0.0, position_deg=0.0):
    return plan_move(
        start_s=start_s,
        position_deg=position_deg,
        velocity_deg_s=0.0,
        target_deg=angle_deg,
        speed_deg_s=30.0,
        acceleration_deg_s2=90.0,
    )


def test_without_laser_nothing_returns():
    plant, emulator = switched_on(laser=False)
    dark = frames_in(emulator, *frame_span(2))
    assert not dark.intensity_counts.any()
    assert np.isnan(dark.distance_m).all()
    plant.switch("laser_1", True, 3.0)
    assert frames_in(emulator, *frame_span(40)).intensity_counts.any()


def test_an_exposure_sees_the_angle_at_its_middle():
    plant, emulator = switched_on()
    middle_s = FIRST_EXPOSURE_S + 10 * TIMES.frame_period_s + TIMES.exposure_s / 2
    plant.stage_track.replace(middle_s - 0.3, plan_move_to(-60.0, start_s=middle_s - 0.3))
    angle_deg = plant.stage_angle_deg(middle_s)
    assert -55 < angle_deg < -2
    frames = frames_in(emulator, *frame_span(10))
    expected = Renderer(DUT).expected(angle_deg)
    miss = (frames.intensity_counts[0, 0] - expected.intensity_counts)[~expected.dead]
    assert np.sqrt(np.mean((miss / scatter(expected, DUT.noise).intensity_std_counts[~expected.dead]) ** 2)) < 1.05


def test_same_seed_same_bytes_and_another_seed_others():
    span = frame_span(0)[0], frame_span(3)[1]
    first, again, other = (switched_on(seed=seed)[1].send(*span) for seed in (1, 1, 2))
    assert first == again
    assert first != other


def test_frames_that_nobody_hears_change_nothing():
    span = frame_span(50)
    _, fresh = switched_on()
    _, busy = switched_on()
    busy.send(0.0, frame_span(30)[1])
    assert fresh.send(*span) == busy.send(*span)


@settings(max_examples=12, deadline=None)
@given(cuts=st.lists(st.floats(0.0, 0.3), max_size=8))
def test_windows_may_be_cut_anywhere(cuts):
    start_s = FIRST_PACKET_S - 0.05
    whole, (_, pieces) = ON_ALL_THE_TIME, switched_on()
    edges = [start_s, *sorted(start_s + cut for cut in cuts), start_s + 0.3]
    sent = [item for begin_s, end_s in pairwise(edges) for item in pieces.send(begin_s, end_s)]
    assert sorted(sent) == sorted(whole.send(start_s, start_s + 0.3))


@settings(max_examples=50, deadline=None)
@given(st.floats(0.0, 5.0))
def test_next_time_is_when_something_is_sent(now_s):
    emulator = ON_ALL_THE_TIME
    next_s = emulator.next_time_s(now_s)
    assert next_s >= now_s
    packets = sent_to(FRAMES, emulator.send(now_s - 1e-9, next_s + 1e-9))
    assert packets
    assert packets[0].time_s == pytest.approx(next_s, abs=1e-8)


def test_telemetry_and_operating_data_follow_the_housing():
    plant, emulator = switched_on()
    sent = emulator.send(FIRST_PACKET_S - 1e-6, FIRST_PACKET_S + 3.0 - 1e-6)
    telemetry = [decode_telemetry(outgoing.data, WIRE) for outgoing in sent_to(TELEMETRY, sent)]
    assert len(telemetry) == 3
    assert {packet.serial for packet in telemetry} == {"EMU-1"}
    assert telemetry[-1].sensor_temperature_c == pytest.approx(plant.housing_c[0] + 9, abs=0.01)
    records = [decode_record(outgoing.data) for outgoing in sent_to(OPERATING, sent)]
    assert len(records) == 75
    fpga = [record.values["fpga_temperature_c"] for record in records]
    assert np.mean(fpga) == pytest.approx(plant.housing_c[0] + 14, abs=0.1)
    assert np.std(fpga) == pytest.approx(0.1, rel=0.4)


def test_aging_shows_with_the_cycle_but_the_calibration_it_reports_is_the_factorys():
    fading = DUT.model_copy(update={"aging": AgingSettings(power_per_cycle=-0.002, fx_per_cycle=1e-5)})
    plant = Plant()
    emulator = DutEmulator(plant, 0, fading)
    for load in ("dut_1", "laser_1"):
        plant.switch(load, True, 0.0)
    new = frames_in(emulator, *frame_span(5))
    emulator.enter_cycle(100, 10.0)
    old = frames_in(emulator, *frame_span(300))
    assert emulator.renderer.dut.gain == pytest.approx(0.998**100)
    centre = (slice(None), 0, slice(12, 20), slice(60, 68))
    assert old.intensity_counts[centre].mean() / new.intensity_counts[centre].mean() == pytest.approx(0.82, abs=0.03)
    row = sent_to(FRAMES, emulator.send(*frame_span(301)))[0].data
    assert decode_header(row).calibration.fx == pytest.approx(58.1)


def test_frame_models_see_the_circumstances_and_change_the_frames():
    seen = []

    class Rolloff:
        def alter(self, expected, conditions):
            seen.append(conditions)
            return expected

    plant, emulator = switched_on(models=(Rolloff(),), cycle=7)
    emulator.enter_step(4, set_temperature_c=25.0, ramp=-1)
    emulator.send(*frame_span(0))
    emulator.send(*frame_span(1))
    emulator.send(*frame_span(60))
    assert len(seen) == 2
    conditions = seen[-1]
    assert (conditions.dut, conditions.cycle, conditions.step, conditions.ramp) == ("EMU-1", 7, 4, -1)
    assert conditions.housing_temperature_c == plant.housing_c[0]
    assert conditions.time_s == pytest.approx(FIRST_EXPOSURE_S + 60 * 0.04 + 0.005)
    assert conditions.operating["fpga_temperature_c"] == pytest.approx(plant.housing_c[0] + 14, abs=0.1)


# -- faults, seen by the receiver


def bench(*faults, count=2):
    clock = VirtualClock()
    plant = Plant(faults=FaultBook(list(faults)))
    units = [
        DutSettings(serial=f"EMU-{i + 1}", sender_address=f"127.0.0.{21 + i}", seed=i, height_m=0.1 - 0.1 * i)
        for i in range(count)
    ]
    network = VirtualNetwork([DutEmulator(plant, i, unit) for i, unit in enumerate(units)], clock)
    ports = HflPorts(
        frames=network.listen(FRAMES), telemetry=network.listen(TELEMETRY), operating=network.listen(OPERATING)
    )
    for i in range(count):
        plant.switch(f"dut_{i + 1}", True, 0.0)
        plant.switch(f"laser_{i + 1}", True, 0.0)
    settings = HflSettings(exposure_lead_s=TIMES.readout_delay_s)
    receiver = HflReceiver(ports, clock, {unit.serial: unit.sender_address for unit in units}, settings)
    clock.sleep(5.0)
    return receiver, clock, plant


def collect(receiver, clock, n=10):
    return receiver.collect(list(receiver.serials), n, not_before_s=clock.now_s, timeout_s=n * 0.04 + 3.0)


def test_a_sweep_takes_frames_at_rest_only_and_wastes_no_time():
    receiver, clock, plant = bench()
    for target_deg in (0.9, 8.1, -30.0):
        now_s = clock.now_s
        plant.stage_track.replace(now_s, plan_move_to(target_deg, now_s, plant.stage_angle_deg(now_s)))
        clock.sleep(plant.stage_track.end_s - now_s)
        start_s = clock.now_s
        blocks = collect(receiver, clock, 5)
        assert clock.now_s - start_s < 0.040 + 4 * 0.040 + 0.050 + 0.041
        for unit, block in enumerate(blocks.values()):
            dut = DutSettings(serial=block.dut, height_m=0.1 - 0.1 * unit)
            expected = Renderer(dut).expected(target_deg)
            spread = scatter(expected, dut.noise)
            miss = (block.intensity_counts[:, 0] - expected.intensity_counts) / spread.intensity_std_counts
            assert np.sqrt(np.mean(miss**2, axis=(1, 2))) == pytest.approx([1.0] * 5, abs=0.05)
            assert block.operating["laser_current_a"] == pytest.approx(90, rel=0.01)
    assert all(status.counts.lost_rows == 0 for status in receiver.status().values())


def test_whoever_reads_records_lets_no_frame_be_rendered(monkeypatch):
    receiver, clock, _ = bench()
    exposed, expose = [], DutEmulator._expose
    monkeypatch.setattr(DutEmulator, "_expose", lambda dut, time_s: exposed.append(time_s) or expose(dut, time_s))
    telemetry = [status.telemetry for status in receiver.listen(0.0).values()]
    assert [each.serial for each in telemetry] == ["EMU-1", "EMU-2"]
    assert exposed == []
    collect(receiver, clock, 2)
    assert min(exposed) > 4.9


def test_a_silent_dut_and_a_healthy_one():
    receiver, clock, _ = bench(Fault(device="dut_1", kind=FaultKind.DUT_SILENT, start_s=4.0))
    with pytest.raises(DutSilentError) as error:
        collect(receiver, clock)
    assert error.value.serials == ("EMU-1",)
    assert list(error.value.blocks) == ["EMU-2"]


def test_a_frozen_frame_is_noticed():
    receiver, clock, _ = bench(Fault(device="dut_2", kind=FaultKind.FROZEN_FRAME, start_s=4.0))
    with pytest.raises(FrozenFrameError) as error:
        collect(receiver, clock)
    assert error.value.serials == ("EMU-2",)


def test_lost_rows_are_masked():
    receiver, clock, _ = bench(Fault(device="dut_1", kind=FaultKind.LOST_ROWS, value=0.1))
    blocks = collect(receiver, clock, 20)
    share = 1 - blocks["EMU-1"].row_valid.mean()
    assert share == pytest.approx(0.1, abs=0.04)
    assert blocks["EMU-2"].row_valid.all()
    assert receiver.status()["EMU-1"].counts.lost_rows >= round(share * 640)


@pytest.mark.parametrize("kind", [FaultKind.REORDERED_ROWS, FaultKind.DUPLICATED_ROWS])
def test_disorder_costs_nothing(kind):
    receiver, clock, _ = bench(Fault(device="dut_1", kind=kind, value=0.3))
    disturbed = collect(receiver, clock)["EMU-1"]
    receiver, clock, _ = bench()
    healthy = collect(receiver, clock)["EMU-1"]
    assert disturbed.row_valid.all()
    assert np.array_equal(disturbed.intensity_counts, healthy.intensity_counts)
    assert np.array_equal(disturbed.distance_m, healthy.distance_m, equal_nan=True)


def test_corrupted_rows_are_mostly_noticed():
    receiver, clock, _ = bench(Fault(device="dut_1", kind=FaultKind.CORRUPTED_ROWS, value=0.2))
    block = collect(receiver, clock, 20)["EMU-1"]
    status = receiver.status()["EMU-1"]
    assert status.corrupt_rows + status.counts.malformed > 20
    assert block.intensity_counts.max() <= 8191


@pytest.mark.parametrize(
    ("fault", "silent_until_s"),
    [
        (Fault(device="dut_1", kind=FaultKind.RESET, start_s=4.9), 4.9),
        (Fault(device="dut_1", kind=FaultKind.BROWN_OUT, start_s=4.9, duration_s=0.5), 5.4),
    ],
    ids=["reset", "brown-out"],
)
def test_after_a_restart_it_boots_again(fault, silent_until_s):
    receiver, clock, plant = bench(fault)
    plant.advance(clock.now_s)
    blocks = collect(receiver, clock, 2)
    began_s = (blocks["EMU-1"].time_ns[0] - clock.utc_ns()) / 1e9 + clock.now_s
    assert began_s == pytest.approx(silent_until_s + TIMES.boot_s, abs=0.002)


def test_a_unit_with_other_pixels_is_refused():
    with pytest.raises(ConfigError, match="DUT EMU-1: an HFL110 has 128 x 32 pixels, not 64 x 32"):
        DutEmulator(Plant(), 0, DUT.model_copy(update={"columns": 64}))


def test_a_unit_with_an_unknown_supply_rail_is_refused():
    odd = DUT.model_copy(update={"operating": OperatingSettings(rails_v={"rail_9v9_v": 9.9})})
    with pytest.raises(ConfigError, match="DUT EMU-1: no operating record can carry a signal 'rail_9v9_v'"):
        DutEmulator(Plant(), 0, odd)


@pytest.mark.parametrize(
    ("key", "value"), [("exposure_s", 0.02), ("readout_s", 0.05), ("boot_s", -1), ("frame_ports", 1)]
)
def test_impossible_timing_is_refused(key, value):
    with pytest.raises(ValidationError):
        DutEmulatorSettings(**{key: value})
