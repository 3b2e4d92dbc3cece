"""The receiver of all DUTs on a scripted network: which frames count, and what is said of those that do not."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from arl_fixtures.bench.clock import VIRTUAL_EPOCH_NS, VirtualClock
from arl_fixtures.devices.dut import HflPorts, HflReceiver, HflSettings
from arl_fixtures.devices.dut_status import DutSilentError, FrozenFrameError
from arl_fixtures.devices.port import Datagram
from arl_fixtures.errors import DeviceTimeoutError, LocalProtocolError, RemoteProtocolError
from arl_fixtures.protocols.hfl110 import Calibration, FrameEncoder
from arl_fixtures.protocols.hfl110_telemetry import Telemetry, encode_telemetry
from arl_fixtures.protocols.operating_record import OperatingRecord, encode_record

PERIOD_S, SPACING_S, LEAD_S = 0.040, 0.0004, 0.012
SENDERS = {"SN-A": "192.168.10.21", "SN-B": "192.168.10.22", "SN-C": "192.168.10.23"}
SETTINGS = HflSettings(exposure_lead_s=LEAD_S)


class ScriptedPort:
    """Datagrams that arrive at given times on a virtual clock."""

    def __init__(self, clock, datagrams, name="udp://test"):
        self.name, self.clock, self.closed = name, clock, False
        self.coming = sorted(datagrams, key=lambda datagram: datagram.time_s)

    def receive(self, timeout_s):
        deadline_s = self.clock.now_s + timeout_s
        if self.coming and self.coming[0].time_s <= deadline_s:
            self.clock.sleep(max(0.0, self.coming[0].time_s + 0.005 - self.clock.now_s))
        else:
            self.clock.sleep(timeout_s)
        now_s = self.clock.now_s
        taken = [datagram for datagram in self.coming if datagram.time_s <= now_s]
        self.coming = self.coming[len(taken) :]
        return taken

    def discard(self, before_s=float("inf")):
        limit_s = min(before_s, self.clock.now_s)
        kept = [datagram for datagram in self.coming if datagram.time_s >= limit_s]
        lost, self.coming = len(self.coming) - len(kept), kept
        return lost

    def close(self):
        self.closed = True


class StallingPort(ScriptedPort):
    """The host stalls once for 0.4 s when it has read only the first few of what has arrived."""

    stalls_after = 0

    def receive(self, timeout_s):
        taken = super().receive(timeout_s)
        if self.stalls_after is not None and self.clock.now_s > 0.1 and len(taken) > self.stalls_after:
            taken, unread = taken[: self.stalls_after], taken[self.stalls_after :]
            self.coming, self.stalls_after = unread + self.coming, None
            self.clock.sleep(0.4)
        return taken


def frames_of(address, *, count=40, phase_s=0.0, level=0, frozen=False, dark=False, first_number=0):
    """A free-running sensor: frame k is exposed at phase + k · period, and its intensity says k."""
    encoder = FrameEncoder(SETTINGS, Calibration(fx=58.0))
    datagrams = []
    for index in range(count):
        shown = 0 if frozen else index
        value = 0 if dark else 1000 + level + shown
        rows = encoder.encode(
            frame_number=first_number + index,
            timestamp=index,
            intensity_counts=np.full((32, 128), value, np.uint16),
            range_codes=np.full((32, 128), 0xFFFF if dark else 281 + shown, np.uint16),
        )
        start_s = phase_s + index * PERIOD_S + LEAD_S
        datagrams += [Datagram(row, address, start_s + number * SPACING_S) for number, row in enumerate(rows)]
    return datagrams


def receiver(datagrams, *, settings=SETTINGS, senders=SENDERS, telemetry=None, operating=None, start_s=0.0):
    clock = VirtualClock(start_s=start_s)
    ports = HflPorts(
        frames=ScriptedPort(clock, datagrams),
        telemetry=None if telemetry is None else ScriptedPort(clock, telemetry),
        operating=None if operating is None else ScriptedPort(clock, operating),
    )
    return HflReceiver(ports, clock, senders, settings), clock


def all_three(**more):
    return [
        datagram
        for position, address in enumerate(SENDERS.values())
        for datagram in frames_of(address, phase_s=0.003 * position, level=200 * position, **more)
    ]


def shown(block):
    return (block.intensity_counts[:, 0, 3, 4] - 1000).tolist()


def test_each_dut_gets_its_own_frames_in_order():
    duts, _ = receiver(all_three())
    blocks = duts.collect(list(SENDERS), 3, not_before_s=0.0, timeout_s=2.0, angle_index=5, stage_angle_deg=-4.5)
    assert {serial: shown(block) for serial, block in blocks.items()} == {
        "SN-A": [0, 1, 2],
        "SN-B": [200, 201, 202],
        "SN-C": [400, 401, 402],
    }
    block = blocks["SN-B"]
    assert (block.dut, block.angle_index, block.stage_angle_deg) == ("SN-B", 5, -4.5)
    assert block.intensity_counts.shape == (3, 2, 32, 128)
    assert block.intensity_counts.dtype == np.uint16
    assert block.distance_m.dtype == np.float32
    assert block.row_valid.all()
    assert np.isnan(block.distance_m[:, 1]).all()
    assert ((block.time_ns - VIRTUAL_EPOCH_NS) / 1e9).tolist() == pytest.approx([0.003, 0.043, 0.083])


@pytest.mark.parametrize("read", [0, 1, 3])
def test_a_host_that_stalls_in_the_middle_of_a_frame_loses_nothing(read):
    duts, clock = receiver([])
    object.__setattr__(duts._ports, "frames", StallingPort(clock, all_three()))
    duts._ports.frames.stalls_after = read
    blocks = duts.collect(list(SENDERS), 10, not_before_s=0.0, timeout_s=2.0)
    assert duts._ports.frames.stalls_after is None
    assert all(block.row_valid.all() for block in blocks.values())
    counts = [status.counts for status in duts.status().values()]
    assert [(each.incomplete_frames, each.late_packets) for each in counts] == [(0, 0)] * 3


@pytest.mark.parametrize("not_before_s", [0.0801, 0.095, 0.1199])
def test_frames_count_only_if_their_exposure_began_at_rest(not_before_s):
    duts, clock = receiver(frames_of("192.168.10.21"), senders={"SN-A": "192.168.10.21"})
    clock.sleep(not_before_s + 0.001)
    blocks = duts.collect(["SN-A"], 2, not_before_s=not_before_s, timeout_s=2.0)
    assert shown(blocks["SN-A"]) == [3, 4]


def test_a_frame_exposed_at_the_very_moment_counts():
    duts, _ = receiver(frames_of("192.168.10.21", phase_s=0.5), senders={"SN-A": "192.168.10.21"}, start_s=0.5)
    assert shown(duts.collect(["SN-A"], 1, not_before_s=0.5, timeout_s=1.0)["SN-A"]) == [0]


def test_a_late_caller_loses_no_frame_that_lies_in_the_buffer():
    duts, clock = receiver(frames_of("192.168.10.21"), senders={"SN-A": "192.168.10.21"})
    clock.sleep(0.5)
    assert shown(duts.collect(["SN-A"], 2, not_before_s=0.30, timeout_s=1.0)["SN-A"]) == [8, 9]


def test_a_long_backlog_is_not_worth_reading():
    duts, clock = receiver(frames_of("192.168.10.21", count=100), senders={"SN-A": "192.168.10.21"})
    clock.sleep(3.0)
    assert shown(duts.collect(["SN-A"], 1, not_before_s=0.0, timeout_s=1.0)["SN-A"])[0] >= 50


def test_frames_with_missing_rows_are_delivered_masked_and_counted():
    datagrams = frames_of("192.168.10.21")
    del datagrams[32 + 10]
    duts, _ = receiver(datagrams, senders={"SN-A": "192.168.10.21"})
    block = duts.collect(["SN-A"], 3, not_before_s=0.0, timeout_s=2.0)["SN-A"]
    assert np.argwhere(~block.row_valid).tolist() == [[1, 31 - 10]]
    assert not block.intensity_counts[1, :, 21].any()
    assert shown(block) == [0, 1, 2]
    assert duts.status()["SN-A"].counts.lost_rows == 1


def test_a_frame_with_hardly_any_row_is_dropped_and_counted():
    datagrams = frames_of("192.168.10.21")
    del datagrams[32 + 3 : 64]
    duts, _ = receiver(datagrams, senders={"SN-A": "192.168.10.21"})
    assert shown(duts.collect(["SN-A"], 2, not_before_s=0.0, timeout_s=2.0)["SN-A"]) == [0, 2]
    assert duts.status()["SN-A"].dropped_frames == 1


def test_strangers_are_dropped_and_counted():
    duts, _ = receiver(all_three() + frames_of("10.0.0.66", level=3000))
    blocks = duts.collect(list(SENDERS), 2, not_before_s=0.0, timeout_s=2.0)
    assert max(max(shown(block)) for block in blocks.values()) < 1000
    assert duts.unknown_senders["10.0.0.66"] >= 64


def test_a_silent_dut_is_named_and_the_others_are_kept():
    datagrams = [d for d in all_three(count=200) if d.sender != "192.168.10.22"]
    duts, clock = receiver(datagrams)
    with pytest.raises(
        DutSilentError, match=r"DUT SN-B at 192\.168\.10\.22: silent, no packet on udp://test"
    ) as error:
        duts.collect(list(SENDERS), 4, not_before_s=0.0, timeout_s=9.0)
    assert isinstance(error.value, DeviceTimeoutError)
    assert error.value.serials == ("SN-B",)
    assert sorted(error.value.blocks) == ["SN-A", "SN-C"]
    assert clock.now_s < 4.0
    assert duts.status()["SN-B"].complaint == "no packet yet"


def test_a_dut_that_falls_silent_is_told_from_one_that_is_slow():
    duts, _ = receiver(frames_of("192.168.10.21", count=3), senders={"SN-A": "192.168.10.21"})
    with pytest.raises(DutSilentError, match=r"SN-A at 192\.168\.10\.21: 3 of 5 frames in"):
        duts.collect(["SN-A"], 5, not_before_s=0.0, timeout_s=5.0)
    assert duts.status()["SN-A"].complaint.startswith("silent for")


def test_a_wrong_address_in_a_dut_file_is_hinted_at():
    duts, _ = receiver(frames_of("192.168.10.29", count=200), senders={"SN-A": "192.168.10.21"})
    with pytest.raises(DutSilentError, match=r"packets came from 192\.168\.10\.29, which is no configured DUT"):
        duts.collect(["SN-A"], 1, not_before_s=0.0, timeout_s=9.0)


def test_an_unknown_layout_is_hinted_at():
    short = [d._replace(payload=d.payload[:1116]) for d in frames_of("192.168.10.21", count=200)]
    duts, _ = receiver(short, senders={"SN-A": "192.168.10.21"})
    with pytest.raises(DutSilentError, match=r"0 of 1 frames .* malformed .*, the last packet has 1116 bytes"):
        duts.collect(["SN-A"], 1, not_before_s=0.0, timeout_s=1.0)


@settings(max_examples=25, deadline=None)
@given(st.lists(st.tuples(st.binary(max_size=50) | st.just(bytes(1372)) | st.just(b"\xff" * 1372), st.booleans())))
def test_garbage_among_the_packets_never_crashes_and_costs_no_frame(garbage):
    nonsense = [
        Datagram(payload, "192.168.10.21" if mine else "10.0.0.66", 0.001 * index)
        for index, (payload, mine) in enumerate(garbage)
    ]
    duts, _ = receiver(
        nonsense + frames_of("192.168.10.21", first_number=77),
        senders={"SN-A": "192.168.10.21"},
        telemetry=nonsense,
        operating=nonsense,
    )
    block = duts.collect(["SN-A"], 3, not_before_s=0.0, timeout_s=2.0)["SN-A"]
    assert shown(block) == [0, 1, 2]
    assert block.row_valid.all()


def test_the_time_out_holds_on_the_bench_clock():
    trickle = [d for d in frames_of("192.168.10.21", count=400) if d.payload[19] == 0]
    duts, clock = receiver(trickle, senders={"SN-A": "192.168.10.21"})
    with pytest.raises(DutSilentError, match="0 of 1 frames"):
        duts.collect(["SN-A"], 1, not_before_s=0.0, timeout_s=3.0)
    assert clock.now_s == pytest.approx(3.0, abs=0.1)


def test_a_frozen_dut_is_an_error_and_the_others_are_kept():
    datagrams = frames_of("192.168.10.21", frozen=True) + frames_of("192.168.10.22")
    duts, _ = receiver(datagrams)
    with pytest.raises(FrozenFrameError, match=r"SN-A at 192\.168\.10\.21: frozen") as error:
        duts.collect(["SN-A", "SN-B"], 3, not_before_s=0.0, timeout_s=2.0)
    assert isinstance(error.value, RemoteProtocolError)
    assert list(error.value.blocks) == ["SN-B"]


def test_a_dut_that_thaws_within_a_set_shows_nothing_of_where_it_froze():
    alive, after = frames_of("192.168.10.21", count=10), frames_of("192.168.10.21", count=40)[20 * 32 :]
    # frames 10 … 19 repeat the pixels of frame 9
    stuck = [
        Datagram(row.payload[:92] + old.payload[92:1116] + row.payload[1116:], row.sender, row.time_s)
        for row, old in zip(frames_of("192.168.10.21", count=20)[10 * 32 :], alive[9 * 32 :] * 10, strict=True)
    ]
    duts, _ = receiver(alive + stuck + after, senders={"SN-A": "192.168.10.21"})
    assert shown(duts.collect(["SN-A"], 3, not_before_s=0.27, timeout_s=2.0)["SN-A"]) == [7, 8, 9]
    with pytest.raises(FrozenFrameError):
        duts.collect(["SN-A"], 2, not_before_s=0.75, timeout_s=2.0)
    assert shown(duts.collect(["SN-A"], 2, not_before_s=0.9, timeout_s=2.0)["SN-A"]) == [23, 24]


def test_a_frame_whose_first_rows_were_lost_is_not_taken_for_a_later_one():
    datagrams = frames_of("192.168.10.21")
    # the exposure of frame 2 began 2 ms before the stage stood; of its rows the first eight never came
    heard = [each for number, each in enumerate(datagrams) if not 64 <= number < 72]
    duts, _ = receiver(heard, senders={"SN-A": "192.168.10.21"})
    assert shown(duts.collect(["SN-A"], 2, not_before_s=0.082, timeout_s=2.0)["SN-A"]) == [3, 4]


@pytest.mark.parametrize(
    ("settings", "more"),
    [(SETTINGS, {"dark": True}), (SETTINGS.model_copy(update={"refuse_frozen": False}), {"frozen": True})],
    ids=["laser off", "allowed by setting"],
)
def test_equal_frames_that_are_no_error(settings, more):
    duts, _ = receiver(frames_of("192.168.10.21", **more), settings=settings, senders={"SN-A": "192.168.10.21"})
    assert len(duts.collect(["SN-A"], 3, not_before_s=0.0, timeout_s=2.0)["SN-A"].time_ns) == 3


def test_nothing_of_one_angle_gets_into_the_next():
    duts, clock = receiver(all_three(count=100))
    first = duts.collect(list(SENDERS), 3, not_before_s=0.0, timeout_s=2.0)
    clock.sleep(0.2)
    rest_s = clock.now_s
    second = duts.collect(list(SENDERS), 3, not_before_s=rest_s, timeout_s=2.0)
    for serial in SENDERS:
        assert (second[serial].time_ns - VIRTUAL_EPOCH_NS).min() / 1e9 >= rest_s
        assert set(shown(first[serial])).isdisjoint(shown(second[serial]))


def test_operating_data_are_the_latest_of_each_dut():
    def record(address, volts, time_s):
        values = {"rail_1v8_v": volts}
        data = encode_record(OperatingRecord(serial="S", frame_counter=0, timestamp_us=0, values=values))
        return Datagram(data, address, time_s)

    operating = [
        record("192.168.10.21", 1.75, 0.02),
        record("192.168.10.21", 1.8125, 0.05),
        record("192.168.10.22", 1.875, 0.05),
        Datagram(b"rubbish", "192.168.10.23", 0.05),
        record("10.0.0.66", 9.0, 0.05),
    ]
    duts, clock = receiver(all_three(count=100), operating=operating)
    blocks = duts.collect(list(SENDERS), 3, not_before_s=0.0, timeout_s=2.0)
    assert blocks["SN-A"].operating == {"rail_1v8_v": 1.8125}
    assert blocks["SN-B"].operating == {"rail_1v8_v": 1.875}
    assert blocks["SN-C"].operating == {}
    assert duts.malformed_records == 1
    clock.sleep(1.5)
    later = duts.collect(list(SENDERS), 3, not_before_s=clock.now_s, timeout_s=2.0)
    assert later["SN-A"].operating == {}


def test_status_tells_who_answers():
    telemetry = [
        Datagram(encode_telemetry(Telemetry(serial="SN-A", hardware_revision=3), SETTINGS), "192.168.10.21", 0.01),
        Datagram(encode_telemetry(Telemetry(serial="SN-X", hardware_revision=3), SETTINGS), "192.168.10.22", 0.01),
    ]
    duts, _ = receiver(all_three(), telemetry=telemetry)
    status = duts.listen(0.3)
    assert status["SN-A"].complaint == ""
    assert status["SN-A"].counts.frames >= 5
    assert status["SN-B"].complaint == "calls itself 'SN-X'"
    assert status["SN-A"].telemetry.hardware_revision == 3
    assert duts.identify().serial == "SN-A, SN-X"


def test_what_is_not_configured_is_our_fault():
    duts, _ = receiver([])
    with pytest.raises(LocalProtocolError, match="no DUT 'SN-Z' is configured"):
        duts.collect(["SN-Z"], 1, not_before_s=0.0, timeout_s=1.0)
    with pytest.raises(LocalProtocolError, match="at least 1"):
        duts.collect(["SN-A"], 0, not_before_s=0.0, timeout_s=1.0)
    with pytest.raises(LocalProtocolError, match="same address"):
        receiver([], senders={"A": "1.1.1.1", "B": "1.1.1.1"})


def test_close_releases_all_ports():
    duts, _ = receiver([], telemetry=[], operating=[])
    duts.close()
    assert all(port.closed for port in (duts._ports.frames, duts._ports.telemetry, duts._ports.operating))


def test_frames_that_lay_unread_for_long_are_no_sign_of_life_now():
    duts, clock = receiver(frames_of("192.168.10.21", count=100) + frames_of("192.168.10.22", count=130))
    clock.sleep(5.5)
    status = duts.listen(0.3)
    assert status["SN-A"].counts.packets == 0  # its last is 1.5 s old
    assert 0 < status["SN-B"].counts.frames <= 25
    assert status["SN-B"].last_packet_s == pytest.approx(129 * PERIOD_S + LEAD_S + 31 * SPACING_S)
