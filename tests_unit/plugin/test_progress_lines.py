"""What the terminal shows: all where there is room, the essential where there is little, plain lines elsewhere."""

import pytest

from arl_fixtures.bench.bench import BenchReading
from arl_fixtures.bench.profile import CycleStep
from arl_fixtures.plugin.progress import Progress

HOUSINGS_C = {"T2": 24.9, "T3": None, "T4": 25.04}


class Screen:
    """Remembers what it was told to show."""

    def __init__(self, columns):
        self.columns, self.lines = columns, []

    def show(self, line):
        self.lines.append(line)


def shown(columns, angles=134):
    """A step from settling to its verdict, one second of wall clock between any two events."""
    screen, seconds = Screen(columns), iter(range(10_000))
    progress = Progress(screen, steps_total=39, wall_s=lambda: next(seconds))
    progress.begin(CycleStep(3, 7, 25.0, 1))
    names = tuple(HOUSINGS_C)
    progress.settling(BenchReading(time_s=0, time_ns=0, temperatures_c=HOUSINGS_C, faults={}, housings=names), 17.0)
    for index in range(angles):
        progress.angle(index, angles, -60.0 + 0.9 * index)
    progress.end("PASS")
    return screen.lines


def test_a_wide_terminal_shows_everything():
    lines = shown(200)
    assert lines[1] == "cycle 3 | c0003-07-up+25C set 25 °C | T2 24.9 T3 -- T4 25.0 °C | settling for 17 s"
    assert lines[13].startswith(lines[1].replace("settling for 17 s", "angle 12 of 134 (-50.1°) | "))
    assert lines[13].endswith(" left")
    assert lines[-2].endswith("| 1 PASS")
    assert lines[-1] == ""


@pytest.mark.parametrize("columns", [80, 60, 20])
def test_no_line_is_wider_than_the_terminal(columns):
    assert max(map(len, shown(columns))) < columns


def test_eighty_columns_tell_step_temperatures_angle_and_time_left():
    line = shown(80)[13]
    assert line.startswith("c0003-07-up+25C set 25 °C | 24.9 -- 25.0 °C | angle 12/134 | ")
    assert line.endswith(" left")


def test_elsewhere_there_are_lines_for_each_phase_and_now_and_then():
    lines = shown(0)
    assert "settling" in lines[0]
    assert "angle 1 of 134" in lines[1]
    assert 134 / 15 < len(lines) < 134 / 15 + 5
    assert "PASS" in lines[-1]


def test_the_reference_sweep_counts_as_a_step_of_its_own():
    screen, now = Screen(0), [0.0]
    progress = Progress(screen, steps_total=4, wall_s=lambda: now[0])
    progress.begin(CycleStep(0, -1, 25.0, 1))
    now[0] = 60.0
    progress.begin(CycleStep(0, 0, 20.0, -1))
    assert "| 4:00 left" in screen.lines[-1]
