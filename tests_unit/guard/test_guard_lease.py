"""One guard per bench; its own death, hanging and return."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from real_processes import LEASE_S, PATIENCE_S, assert_safe_within, comes_to_rest, go_on, is_safe, reap, until, zombie

from arl_fixtures.bench.build import open_bench
from arl_fixtures.errors import DataError, InterlockError, StorageError
from arl_fixtures.guard.guarding import open_guard
from arl_fixtures.guard.runtime import Lease, Places, StopReport, read_stop, write_stop


@pytest.fixture(scope="module")
def stand(make_module_stand):
    # a living test has that long, too, before a sentinel takes it for one that hangs
    return make_module_stand("poll_s: 1.0, heartbeat_timeout_s: 300")


def first_lost(events, name):
    return next(time_s for time_s, what, value in events if what == "client lost" and value == name)


def test_a_second_guard_and_a_second_test_are_refused(stand, run_test):
    pid = run_test(stand, go_on)
    guard = stand.guard_pid()
    command = [sys.executable, "-m", "arl_fixtures.guard", "--bench", stand.bench_file, "--lab", str(stand.lab)]
    command += ["--runtime", str(stand.runtime)]
    second = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S, check=False)
    assert second.returncode == 3
    assert second.stderr.count("\n") == 1
    assert f"another guard (process {guard}) holds this bench" in second.stderr
    with pytest.raises(InterlockError, match=f"another test \\(process {pid}\\) drives this bench"):
        stand.open_guard()
    # neither attempt has disturbed who was there
    assert stand.ask(op="status")["state"] == "armed"
    os.kill(pid, signal.SIGKILL)
    reap(pid)
    stand.wait_for_state("idle")


def test_a_killed_guard_is_noticed_by_the_test_which_makes_safe_itself(stand, run_test):
    pid = run_test(stand, go_on)
    before = len(stand.inspect()["events"])
    os.kill(stand.guard_pid(), signal.SIGKILL)
    assert reap(pid) == 3
    assert "is gone" in (stand.runtime / "heard").read_text()
    found = stand.inspect()
    # a beat, then the safe state
    assert_safe_within(found, first_lost(found["events"][before:], "guard"), limit_s=1.0 + 2.0)


def test_a_guard_that_hangs_is_killed_for_its_lines(stand, run_test):
    def go_on_without(guard, bench):
        assert guard._link._patience_s == stand.config.guard.reply_timeout_s
        guard._link._patience_s = 1.0
        (stand.runtime / "stopped").write_text(str(guard.pid))
        os.kill(guard.pid, signal.SIGSTOP)
        go_on(guard, bench)

    assert reap(run_test(stand, go_on_without)) == 3
    guard = int((stand.runtime / "stopped").read_text())
    assert "no answer to" in (stand.runtime / "heard").read_text()
    until(lambda: not Path(f"/proc/{guard}").exists() or zombie(guard), "the guard dies of it")
    comes_to_rest(stand)


def test_when_all_three_die_the_next_guard_finds_the_bench_and_makes_it_safe(stand, run_test):
    pid = run_test(stand, go_on)
    guard = stand.guard_pid()
    sentinel = stand.ask(op="status")["sentinel"]
    os.kill(guard, signal.SIGSTOP)  # so that no other's death can reach it
    for number in (sentinel, pid, guard):
        os.kill(number, signal.SIGKILL)
    assert reap(pid) == -signal.SIGKILL
    assert not is_safe(stand.inspect()["state"])
    with stand.open_guard() as again:
        assert "the guard died while a test" in again.last_stop
        comes_to_rest(stand)
        assert again.pid != guard
        bench = open_bench(stand.config, lines=again.lines)
        again.attach(bench)
        bench.relays.set("dut_1", True)
        assert bench.close() == []
    comes_to_rest(stand)


def test_another_version_of_the_bench_file_gets_another_guard(stand, run_test):
    pid = run_test(stand, go_on)
    os.kill(pid, signal.SIGKILL)
    reap(pid)
    stand.wait_for_state("idle")
    before = stand.guard_pid()
    file = Path(stand.bench_file)
    text = file.read_text()
    file.write_text(text + "safe_temperature_c: 22\n")
    try:
        with stand.open_guard() as guard:
            assert guard.pid != before
    finally:
        file.write_text(text)  # the other tests of this bench, whichever follow, know what is safe by the first file


def test_a_lease_is_renewed_while_it_is_held_and_over_when_its_holder_hangs(tmp_path):
    path = tmp_path / "lease.json"
    lease = Lease(path, lease_s=LEASE_S)
    with pytest.raises(InterlockError, match=f"process {os.getpid()}"):
        Lease(path, lease_s=LEASE_S)
    lease.release()
    holder = subprocess.Popen(
        [sys.executable, "-c", HOLD, str(path)], stdout=subprocess.PIPE, stdin=subprocess.PIPE, text=True
    )
    with holder:
        assert holder.stdout is not None
        assert holder.stdout.readline() == "held\n"
        until(lambda: can_take(path), "the lease of a holder that never renews is over")
        assert holder.wait(timeout=PATIENCE_S) == -signal.SIGKILL


HOLD = """
import sys
from pathlib import Path
from arl_fixtures.guard.runtime import Lease
lease = Lease(Path(sys.argv[1]), lease_s=1.1)
print("held", flush=True)
sys.stdin.read()
"""


def can_take(path):
    try:
        Lease(path, lease_s=1.1).release()
    except InterlockError:
        return False
    return True


def test_a_stop_survives_and_a_damaged_one_is_no_permission(tmp_path):
    places = Places.of("b", tmp_path)
    assert read_stop(places) is None
    report = StopReport(bench="b", cause="T2 reads 96.0 °C", utc="2026-01-01T00:00:00Z", bench_time_s=1.5)
    write_stop(places, report)
    assert read_stop(places) == report
    places.stop.write_text(places.stop.read_text()[:-20])
    with pytest.raises(DataError, match="is damaged"):
        read_stop(places)


def test_a_folder_that_others_could_forge_or_sockets_cannot_use_is_refused(tmp_path):
    with pytest.raises(StorageError, match="too long for a socket"):
        Places.of("b" * 120, tmp_path)
    (tmp_path / "file").write_text("")
    with pytest.raises(StorageError, match="cannot keep"):
        Places.of("b", tmp_path / "file")


def test_a_guard_of_its_own_for_hardware_inside_the_test_makes_no_sense(make_stand):
    stand = make_stand("process: true")
    with pytest.raises(Exception, match="needs hardware outside the test process"):
        open_guard(stand.config, bench_file=stand.bench_file)
