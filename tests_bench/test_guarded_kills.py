"""SIGKILL to test, guard, both, or both and the sentinel at random instants of a whole cycle, then `--resume`.

Real processes, as on hardware: the plant outlives whoever dies, and says itself whether and when the bench was
safe. Then the cycle goes on and must be what an undisturbed one is.
"""

from __future__ import annotations

import contextlib
import os
import random
import signal
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

import pytest

from arl_fixtures.journal.record import SessionRecord, read_journal
from arl_fixtures.plugin.setup import SessionFiles
from tests_bench.guarded_cycle import OVER, Kill, Laboratory, drive, laboratory, until
from tests_bench.killed_cycles import check_equal, count_ways, fork, journals, storage_calls, wait_for, whole_lines
from tests_bench.plant_words import check_next_guard, check_safe, energised, guard_was_called, lost_s
from tests_bench.small_cycle import BENCH, fast, files_for, run_cycle, write_files

SAFE_S = 2.0
"""After the loss of the test, of the test and its guard, or once the loss of the guard alone is noticed."""
NOTICED_S = 1.0
"""A test that only waits gives a sign of life each second, and by that notices the death of its guard."""
SECOND_KILL = 0.3
LARGEST_DEATHS = 4
"""Two by each of two kills: one of two victims may die when the other is on its way already."""
LATER_S = 0.5
"""While one makes safe, the other may die, too."""
MODES = ("bench time", "wall clock", "storage call")
"""A storage call kills whoever comes to that number first."""
ALL = "test and guard and sentinel"
VICTIMS = ("test", "guard", "test and guard", ALL, "test then guard", "guard then test")
AT_ONCE = VICTIMS[:4]
PROGRAM_EACH = 25
"""One cycle in so many has its guard started as a program; the others fork it, which takes no second."""


@dataclass
class Stand:
    """Where cycles run and die.

    Attributes:
        whole: the undisturbed cycle.
        bench_s, wall_s, storage_calls: how long it took, and how often it touched the disk.
        rooms: makes files and folder for another one.
        safe_s: how soon the bench was safe after each loss, by what was lost.
    """

    whole: SessionRecord
    bench_s: float
    wall_s: float
    storage_calls: int
    rooms: Callable[[], tuple[SessionFiles, Path]]
    safe_s: dict[str, list[float]] = field(default_factory=dict)


@pytest.fixture(scope="module")
def stand(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stand]:
    """An undisturbed cycle, and room for others."""
    folder = tmp_path_factory.mktemp("g")
    # a record with each frame: with every other one it depends on the phase whether a sweep has enough of them
    text = BENCH.replace("operating_every_frames: 2", "operating_every_frames: 1")
    # whoever is slow because the machine is has not died of it
    guard = "guard: {{poll_s: 1.0, heartbeat_timeout_s: 300, reply_timeout_s: 300, lease_s: 600}}\n"
    options = write_files(folder, bench=text + guard)
    known: dict[str, SessionFiles] = {}
    numbers = iter(range(1_000_000))

    def rooms() -> tuple[SessionFiles, Path]:
        number = next(numbers)
        return files_for(options, folder / f"out-{number}", known), folder / f"l{number}"

    with fast():
        # what is rendered here the lab need not render
        run_cycle(files_for(options, folder / "warm", known))
        files, room = rooms()

        def counted() -> None:
            with storage_calls() as calls:
                drive(files, lab)
            (folder / "calls").write_text(str(calls[0]))

        with laboratory(room, files) as lab:
            start_s = time.monotonic()
            assert wait_for(fork(counted)) == 0
            wall_s = time.monotonic() - start_s
            bench_s = lab.inspect()["state"]["now_s"]
        whole = read_journal(journals(files.options.out)[-1])
        assert len(whole.steps) == 3
        yield Stand(whole, bench_s, wall_s, int((folder / "calls").read_text()), rooms)


@dataclass
class Trial:
    """One cycle that is killed until it comes to its end."""

    stand: Stand
    files: SessionFiles
    lab: Laboratory
    chance: random.Random
    sentinel_may_die: bool = False
    deaths: list[str] = field(default_factory=list)
    orphaned: list[int] = field(default_factory=list)

    def session(self, *, mode: str, victims: str, program: bool) -> bool:
        """One session, new or resumed; looks at the plant afterwards; says whether it came to its end."""
        lab, chance = self.lab, self.chance
        since = len(lab.events())
        call = chance.randint(1, self.stand.storage_calls) if mode == "storage call" else -1

        def work() -> None:
            with storage_calls(call):
                drive(self.files, lab, own_program=program)

        with lab.witness():
            pid = fork(work)
            if mode == "wall clock":
                kill_outside(lab, pid, chance, self.stand.wall_s, victims)
            status = wait_for(pid)
            if status == 0:
                return True
            assert status in {OVER, -signal.SIGKILL}, f"status {status}"
            whom = "guard" if status == OVER else "test"
            somebody_left = lab.wait_for_safety()
        found, events = lab.inspect(), lab.events()
        if whom == "test" and not somebody_left:
            # before a sentinel is posted nothing is driven
            assert self.sentinel_may_die or not energised(events), "nobody came"
            # the next guard must make safe before anything else
            self.deaths.append("all")
            self.orphaned.append(len(events))
            return False
        events = events[since:]
        since_s = lost_s(events, whom)
        if whom == "test" and guard_was_called(events):
            whom = "both"
            since_s = max(since_s, lost_s(events, "guard"))
        self.deaths.append(whom)
        limit_s = NOTICED_S + SAFE_S if whom == "guard" else SAFE_S
        took_s = check_safe(found["state"], events, since_s=since_s, limit_s=limit_s)
        self.stand.safe_s.setdefault(whom, []).append(took_s)
        return False

    def check_end(self) -> None:
        """The plant is safe, and whoever came after all had died has made it so first."""
        events = self.lab.events()
        for place in self.orphaned:
            took_s = check_next_guard(events, place, limit_s=SAFE_S)
            self.stand.safe_s.setdefault("all, after the next guard came", []).append(took_s)
        check_safe(self.lab.inspect()["state"], events, since_s=float("inf"), limit_s=0.0)


def trial(stand: Stand, seed: int) -> str:
    """Kill, look at the plant, perhaps kill again, go on, compare; returns who died, and how."""
    chance = random.Random(seed)
    mode = MODES[seed % len(MODES)]
    victims = "test" if mode == "storage call" else VICTIMS[seed // len(MODES) % len(VICTIMS)]
    files, room = stand.rooms()
    kills = planned(stand, chance, victims if mode == "bench time" else "")
    lines = b""
    done = False
    with laboratory(room, files, kills) as lab:
        drawn = [victims, *(name for kill in kills for name in kill.victims)]
        each = Trial(stand, files, lab, chance, sentinel_may_die=any("sentinel" in names for names in drawn))
        while not done:
            done = each.session(mode=mode, victims=victims, program=seed % PROGRAM_EACH == 0)
            said = whole_lines(files.options.out)
            assert said.startswith(lines), "a line of the journal was changed"
            assert len(each.deaths) <= LARGEST_DEATHS, f"the cycle never comes to its end: {lab.over()}"
            lines, mode = said, "planned"
        each.check_end()
    check_equal(stand.whole, read_journal(journals(files.options.out)[-1]), untouched=set())
    return ", then ".join(each.deaths) or "not at all"


def planned(stand: Stand, chance: random.Random, victims: str) -> list[Kill]:
    """Kills at exact bench times: of the victims named, and three in ten times of somebody later."""
    kills = []
    at_s = 0.0
    if victims:
        at_s = chance.uniform(0.0, stand.bench_s)
        first, _, second = victims.partition(" then ")
        kills.append(Kill(at_s, tuple(first.split(" and "))))
        if second:
            kills.append(Kill(at_s + chance.uniform(0.0, LATER_S), (second,)))
    if chance.random() < SECOND_KILL:
        later_s = at_s + chance.uniform(1.0, stand.bench_s)
        kills.append(Kill(later_s, tuple(chance.choice(AT_ONCE).split(" and "))))
    return kills


def kill_outside(lab: Laboratory, pid: int, chance: random.Random, wall_s: float, victims: str) -> None:
    """SIGKILL from outside after a while on the wall clock."""
    pause(chance.uniform(0.0, wall_s))
    names = victims.replace(" then ", " and ").split(" and ")
    # the sentinel first: else it would act on the death of the others
    for place, name in enumerate(sorted(names, key=lambda name: name != "sentinel")):
        if place and "then" in victims:
            pause(chance.uniform(0.0, 0.1 * LATER_S))
        number = {"test": lambda: pid, "guard": lab.guard_pid, "sentinel": lab.sentinel_pid}[name]()
        if number:
            with contextlib.suppress(ProcessLookupError):
                os.kill(number, signal.SIGKILL)


def pause(wall_s: float) -> None:
    """Let others go on for a while."""
    end_s = time.monotonic() + wall_s
    until(lambda: time.monotonic() >= end_s, "time passes")


@pytest.mark.parametrize("seed", [0, 3, 6, 9, 12, 15, 4, 7, 2])
def test_whoever_dies_the_bench_is_safe_and_the_cycle_becomes_whole(stand: Stand, seed: int) -> None:
    """A sample: each choice of victims at a bench time, two on the wall clock, one in a call to the disk."""
    trial(stand, seed)


def test_the_hosts_clock_may_jump_within_a_session_and_between_two(stand: Stand) -> None:
    """Under way UTC goes on as it was; the next session begins a day earlier, and the cycle is the same."""
    files, room = stand.rooms()
    middle_s = 0.6 * stand.bench_s
    with laboratory(room, files, [Kill(middle_s, ("test",))]) as lab:
        lab.inject(f"bench:clock_jump@{0.3 * stand.bench_s}=-86400")
        each = Trial(stand, files, lab, random.Random(0))
        assert not each.session(mode="planned", victims="", program=False)
        assert each.session(mode="planned", victims="", program=False)
    record = read_journal(journals(files.options.out)[-1])
    steps_s = [
        (after.utc_ns - before.utc_ns) * 1e-9 - (after.time_s - before.time_s)
        for before, after in pairwise(record.lines)
    ]
    (jump,) = [number for number, step_s in enumerate(steps_s, start=1) if abs(step_s) > 1e-3]
    assert record.lines[jump].entry.type == "session_resume"
    assert steps_s[jump - 1] == pytest.approx(-86400.0, abs=1e-3)
    check_equal(stand.whole, record, untouched=set())


@pytest.mark.slow
def test_two_hundred_guarded_cycles(stand: Stand) -> None:
    """All of them; how soon the bench was safe is printed with -s."""
    count_ways(lambda seed: trial(stand, seed), range(2000, 2200))
    for whom, took_s in stand.safe_s.items():
        ordered = sorted(took_s)
        middle_s = ordered[len(ordered) // 2]
        sys.stdout.write(f"safe after the loss of {whom}: {len(ordered)} times, median {middle_s:.2f} s, ")
        sys.stdout.write(f"longest {ordered[-1]:.2f} s\n")
