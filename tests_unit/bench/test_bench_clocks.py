"""Bench clocks and the host's wall clock, which anybody may set at any time."""

import time

import pytest

from arl_fixtures.bench.build import Emulated, open_bench
from arl_fixtures.bench.clock import RealClock, VirtualClock
from arl_fixtures.bench.config import load_bench
from arl_fixtures.emulators.faults import parse_fault
from arl_fixtures.protocols.hfl110 import decode_header


@pytest.mark.parametrize("jump_s", [-86_400.0, 3600.0])
def test_bench_utc_goes_on_when_the_hosts_clock_is_set(monkeypatch, jump_s):
    host_ns, monotonic_s = time.time_ns(), [1000.0]
    monkeypatch.setattr(time, "monotonic", lambda: monotonic_s[0])
    monkeypatch.setattr(time, "time_ns", lambda: host_ns)
    clock = RealClock()
    before_ns, before_s = clock.utc_ns(), clock.now_s
    monotonic_s[0] += 7.0
    now_ns = host_ns + round((7.0 + jump_s) * 1e9)
    monkeypatch.setattr(time, "time_ns", lambda: now_ns)
    monkeypatch.setattr(time, "time", lambda: now_ns * 1e-9)
    assert clock.now_s - before_s == 7.0
    assert clock.utc_ns() - before_ns == 7_000_000_000
    # the next session takes the host's word
    assert RealClock().utc_ns() == now_ns


def test_the_emulated_hosts_clock_jumps_for_clocks_to_come_alone():
    world = Emulated(load_bench("emulated"), VirtualClock())
    epoch_ns = world.clock.host_epoch_ns
    world.plant.faults.inject(parse_fault("bench:clock_jump@10/20=-3600"))
    seen = []
    for now_s in (5.0, 15.0, 40.0):
        world.clock.sleep(now_s - world.clock.now_s)
        world.plant.advance(now_s)
        assert world.clock.utc_ns() == epoch_ns + round(now_s * 1e9)
        seen.append((world.clock.host_epoch_ns - epoch_ns) * 1e-9)
    assert seen == [0.0, -3600.0, 0.0]


def test_the_time_stamps_of_a_dut_jump_and_its_frames_are_timed_by_arrival_all_the_same():
    config = load_bench("emulated")
    world = Emulated(config, VirtualClock())
    bench = open_bench(config, lines=world)
    bench.start()
    bench.soak(20.0)
    jump_s = bench.clock.now_s + 1.0
    world.plant.faults.inject(parse_fault(f"dut_1:clock_jump@{jump_s}=-3600"))
    blocks = []
    for _ in range(2):
        now_s = bench.clock.now_s
        blocks.append(bench.duts.collect(bench.serials[:1], 3, not_before_s=now_s, timeout_s=5.0)[bench.serials[0]])
        bench.clock.sleep(2.0)
    utc_s = (blocks[1].time_ns[0] - blocks[0].time_ns[-1]) * 1e-9
    assert 1.5 < utc_s < 2.5
    rows = [sent.data for _, sent in world.duts[0].send(jump_s - 0.2, jump_s + 0.2) if len(sent.data) > 500]
    stamps_s = [decode_header(row).timestamp * 1e-6 for row in rows]
    # it counts from its start: an hour before that is as many microseconds below the end of 64 bits
    assert max(stamps_s) - min(stamps_s) == pytest.approx(2**64 * 1e-6, rel=1e-6)
