"""A cycle as its user meets it: what passes, what fails, what is INVALID, and what is left behind."""

import os
import resource
import shutil
import signal
import subprocess
from xml.etree import ElementTree

import pytest

from arl_fixtures.plugin import pytest_keyboard_interrupt

PATIENCE_S = 600.0


def test_a_cycle_leaves_journal_bags_and_junit_and_the_next_one_counts_on(undisturbed, session):
    first, printed = undisturbed
    shutil.copytree(first.folder / "out", session.folder / "out")
    assert "c0000-01-up+26C" in printed
    assert [end["verdict"] for end in session.of_type("step_end")] == ["PASS"] * 4
    assert session.journal()[-1]["reason"] == "finished"
    bags = {path.name for path in (session.folder / "out/bags").iterdir()}
    assert bags == {"c0000-reference+23C", "c0000-00-up+24C", "c0000-01-up+26C", "c0000-02-down+24C"}
    cases = list(ElementTree.parse(session.folder / "out/junit.xml").iter("testcase"))
    names = [{each.get("name") for each in case.iter("property")} for case in cases]
    assert len(cases) == 3
    assert all("ARL-EMU-0001.dead_pixels" in found for found in names)
    session.run("-k", "00-up", check=0)
    assert session.of_type("session_begin", 2)[0]["cycles"] == [1]


def test_a_campaign_ends_by_its_own_rule_and_counts_its_cycles(session):
    rule = '{metric: dead_pixels, unit: "1", upper: 1, reason: more than one dead pixel}'
    session.write("campaign.yaml", f"cycles: 5\nstop:\n  wear_out:\n    - {rule}\n")
    done = session.run("--campaign=campaign.yaml", "-k", "00-up")
    assert "campaign ended after cycle 0: ARL-EMU-0001 dead_pixels is " in done.stdout
    (end,) = session.of_type("cycle_end")
    assert end["cycle"] == 0
    done = session.run("--campaign=campaign.yaml", "-k", "00-up", "--resume")
    assert "campaign ended after cycle 0: ARL-EMU-0001 dead_pixels is " in done.stdout, "the rule still holds"
    assert session.of_type("cycle_end") == [end]
    session.write("campaign.yaml", "cycles: 1\n")
    done = session.run("--campaign=campaign.yaml")
    assert done.returncode == 4
    assert "all 1 cycles of the campaign are done" in done.stderr


def test_same_seed_same_bytes(undisturbed, session):
    session.run(check=0)
    bags = [sorted(each.folder.glob("out/bags/*/*.mcap")) for each in (undisturbed[0], session)]
    first, second = ([path.read_bytes() for path in found] for found in bags)
    assert len(first) == 4
    assert first == second


def test_an_output_folder_that_is_a_file_is_told_in_one_line(session):
    session.write("out", "")
    done = session.run(check=2)
    assert "cannot be written: Not a directory" in done.stdout
    assert "Error: " not in done.stdout
    assert "Traceback" not in done.stdout


def test_all_exceeded_limits_stand_in_one_table(session):
    session.limit('metric: dead_pixels, unit: "1", upper: 0')
    done = session.run("-k", "00-up", "--junitxml=out/junit.xml", check=1)
    table = [line for line in done.stdout.splitlines() if "dead_pixels" in line and line.rstrip().count("FAIL")]
    assert {line.split()[0] for line in table} >= {"ARL-EMU-0001", "ARL-EMU-0002"}
    assert "Traceback" not in done.stdout
    assert len(list(ElementTree.parse(session.folder / "out/junit.xml").iter("failure"))) == 1


def test_a_step_that_does_not_settle_is_invalid_and_names_the_sensor(session):
    bench = session.bench("settle: {tolerance_k: 0.5, hold_s: 10, time_limit_s: 240}\n")
    session.write("tiny.yaml", (session.folder / "tiny.yaml").read_text().replace("[24, 26, 24]", "[23, 60]"))
    done = session.run(bench, "--junitxml=out/junit.xml", check=1)
    root = ElementTree.parse(session.folder / "out/junit.xml").getroot()
    assert len(list(root.iter("failure"))) == 0
    (error,) = root.iter("error")
    assert "INVALID" in error.get("message")
    assert "T" in done.stdout
    assert "from 60 °C" in done.stdout
    assert session.of_type("step_end")[-1]["verdict"] == "INVALID"


@pytest.mark.parametrize(
    ("extra", "place", "said"),
    [
        ("settel: {hold_s: 1}\n", "bench.yaml:22:1", "unknown key 'settel'; did you mean 'settle'?"),
        ("settle: {hold_s: -1}\n", "bench.yaml:22:18", "greater than or equal to 0"),
        ("settle: {hold_s: 1, hold_s: 2}\n", "bench.yaml:22", "duplicate key"),
    ],
)
def test_a_wrong_bench_file_is_one_line_with_its_place(session, extra, place, said):
    bench = session.bench(extra)
    lines = (session.folder / "bench.yaml").read_text().splitlines()
    place = place.replace(":22", f":{lines.index(extra.strip()) + 1}")
    done = session.run(bench)
    assert done.returncode == 4
    message = [line for line in done.stderr.splitlines() if place in line]
    assert message, done.stderr
    assert said in message[0]
    assert "Traceback" not in done.stderr + done.stdout
    assert not (session.folder / "out").exists()


def test_an_unknown_profile_is_one_line(session):
    done = session.run("--profile=nosuch")
    assert done.returncode == 4
    assert "no profile 'nosuch'; known are full" in done.stderr
    assert "Traceback" not in done.stdout + done.stderr
    assert "pluggy" not in done.stdout + done.stderr


def test_unknown_driver_and_foreign_unit_are_refused_before_anything_moves(session):
    bench = session.bench("")
    text = (session.folder / "bench.yaml").read_text().replace("huber_pb", "hubber_pb")
    session.write("bench.yaml", text)
    done = session.run(bench)
    assert done.returncode == 4
    assert "did you mean 'huber_pb'?" in done.stderr
    session.limit("metric: distance_scatter, unit: K, upper: 1")
    done = session.run()
    assert done.returncode != 0
    assert not (session.folder / "out/bags").exists()


def test_a_device_that_never_answers_ends_the_session_safely_and_the_rest_is_not_run(session):
    bench = session.bench("emulation:\n  faults: [{device: stage, kind: silence, start_s: 600}]\n")
    done = session.run(bench)
    assert done.returncode != 0
    assert "stage" in done.stdout
    assert "Traceback" not in done.stdout
    ends = session.of_type("step_end")
    assert any(not end["finished"] for end in ends)
    assert session.journal()[-1]["type"] == "session_end"
    assert session.journal()[-1]["verdict"] in {"NOT_RUN", "INVALID"}


def test_a_bag_that_is_already_there_is_told_before_anything_moves(session):
    there = session.folder / "out/bags/c0000-01-up+26C"
    there.mkdir(parents=True)
    (there / "precious").write_text("data")
    done = session.run(check=2)
    assert "out/bags/c0000-01-up+26C: a bag of this name exists already and is not overwritten" in done.stdout
    assert "Traceback" not in done.stdout
    assert [path.name for path in there.iterdir()] == ["precious"]
    # not even the reference before it was begun
    assert [path.name for path in there.parent.iterdir()] == [there.name]


def test_a_bench_that_is_not_there_is_said_once(session):
    bench = session.bench("")
    text = (session.folder / "bench.yaml").read_text()
    for make in ("huber_pb", "dcon", "tmcl", "conrad", "hfl110"):
        text = text.replace(f"driver: {make}, url: emulated", f'driver: {make}, url: "tcp://127.0.0.1:9"')
    text = text.replace("url: emulated", "url: udp://127.0.0.1").replace("clock: virtual", "clock: real")
    session.write("bench.yaml", text.replace("  emulator: {operating_every_frames: 5}\n", ""))
    done = session.run(bench)
    assert done.returncode != 0
    assert done.stdout.count("chiller: tcp://127.0.0.1:9: cannot connect: Connection refused") == 1
    assert "relays: tcp://127.0.0.1:9" in done.stdout
    assert "Traceback" not in done.stdout


def test_a_full_disk_is_one_line_and_leaves_nothing_that_looks_whole(session):
    def small_files():
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (300_000, 300_000))

    done = session.run(preexec_fn=small_files)
    assert done.returncode != 0
    assert "cannot write" in done.stdout
    assert "Traceback" not in done.stdout
    bags = list((session.folder / "out/bags").iterdir())
    assert all(path.name.endswith(".part") for path in bags)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP, signal.SIGINT])
def test_signals_end_the_session_with_its_journal_closed_and_the_bench_safe(session, number):
    session.lengthen()
    child = start_until(session, "settle", 2)
    child.send_signal(number)
    out, _ = child.communicate(timeout=PATIENCE_S)
    assert child.returncode == 2, out
    assert session.journal()[-1]["type"] == "session_end"
    assert session.journal()[-1]["reason"] != "finished"
    assert "could NOT be verified" not in out


def test_a_terminal_that_is_gone_does_not_keep_the_journal_from_its_end(session):
    session.lengthen()
    child = start_until(session, "settle", 2)
    child.stdout.close()
    child.send_signal(signal.SIGHUP)
    assert child.wait(timeout=PATIENCE_S) != 0
    assert session.journal()[-1]["type"] == "session_end"
    assert session.journal()[-1]["reason"] != "finished"


def test_resume_after_a_kill_gives_what_an_undisturbed_cycle_gives(undisturbed, session):
    session.stop_itself("settle", 3)
    child = start(session)
    os.waitid(os.P_PID, child.pid, os.WSTOPPED | os.WEXITED | os.WNOWAIT)
    child.kill()
    out, _ = child.communicate(timeout=PATIENCE_S)
    assert child.returncode == -signal.SIGKILL, out
    assert len(session.of_type("settle")) == 3
    (session.folder / "conftest.py").unlink()
    session.run("--resume", check=0)
    resumed = {line["step_id"]: line for line in session.of_type("bag")}
    assert set(resumed) == {path.name for path in (undisturbed[0].folder / "out/bags").iterdir()}
    ends = [line for line in session.of_type("step_end") if line["finished"]]
    assert len(ends) == len({line["step_id"] for line in ends}) == 4


def test_resume_refuses_another_profile_and_says_what_differs(session):
    session.run("-k", "00-up", check=0)
    session.write("tiny.yaml", (session.folder / "tiny.yaml").read_text().replace("frames: 4", "frames: 5"))
    done = session.run("--resume")
    assert done.returncode != 0
    assert "profile 'tiny' has changed" in done.stdout


def start(session):
    """Start a session that heeds every signal."""

    def heed():
        # whoever runs us in the background, or with nohup, has had signals ignored, and a child inherits that
        for number in (signal.SIGINT, signal.SIGHUP, signal.SIGTERM):
            signal.signal(number, signal.SIG_DFL)

    return subprocess.Popen(
        session.command("-s"), cwd=session.folder, env=session.environment(), stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT, text=True, preexec_fn=heed,  # noqa: PLW1509 no threads here
    )  # fmt: skip


def start_until(session, kind, count):
    """Start a session and return when its journal holds `count` lines of a type."""
    child = start(session)
    journal = session.folder / "out/session-0001.jsonl"
    # the child's own progress lines wake us: no line is read twice, nothing sleeps
    for _ in child.stdout:
        if journal.is_file() and journal.read_text(encoding="utf-8").count(f'"type":"{kind}"') >= count:
            break
    return child


def test_an_interrupt_between_two_lines_is_told_like_any_other():
    """A signal that comes where the code has no line: Python 3.11 then gives a frame without a line number."""

    def interrupted():
        raise KeyboardInterrupt("signal SIGHUP")

    interrupted.__code__ = interrupted.__code__.replace(co_linetable=b"")
    with pytest.raises(KeyboardInterrupt) as caught:
        interrupted()
    pytest_keyboard_interrupt(caught)
    assert "signal SIGHUP" in str(caught.getrepr(funcargs=True))
