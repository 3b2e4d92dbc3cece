"""What the terminal shows while a cycle runs: one status line on a terminal, plain lines elsewhere."""

from __future__ import annotations

import contextlib
import os
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Final, Protocol, TextIO, final

import pytest

from arl_fixtures.bench.bench import BenchReading
from arl_fixtures.bench.profile import CycleStep

FALLBACK_COLUMNS: Final = 80
BELOW: Final = "\x1bD\x1b[A\x1b7\r\n\x1b[2K"
"""Make sure that there is a line below, remember the place, go there and empty it."""
BACK: Final = "\x1b8"
REFRESH_S: Final = 0.2
PLAIN_EVERY_S: Final = 15.0


@dataclass(slots=True)
class TimeLeft:
    """Estimates the rest of the session from the steps done, on the wall clock and on the bench clock."""

    steps_total: int
    done: int = 0
    started_s: float = field(default_factory=time.monotonic)

    def seconds(self, now_s: float, part_of_step: float) -> float | None:
        """Wall seconds left; None while nothing is known. `part_of_step` is 0…1 of the step under way."""
        progress = self.done + min(max(part_of_step, 0.0), 1.0)
        if progress <= 0.05:
            return None
        return (now_s - self.started_s) / progress * (self.steps_total - progress)


class Screen(Protocol):
    """Where progress is shown."""

    @property
    def columns(self) -> int:
        """Width of a terminal, whose status line can be replaced; 0 elsewhere."""

    def show(self, line: str) -> None:
        """Replace the status line on a terminal, add a line elsewhere; an empty one takes the status line away."""


@final
class PytestScreen:
    """The terminal of a pytest session, past its capturing.

    The status line stands below the line that pytest is writing, and the cursor stays where pytest left it.

    Args:
        config: pytest's.
    """

    def __init__(self, config: pytest.Config) -> None:
        self._reporter: Any = config.pluginmanager.get_plugin("terminalreporter")
        self._capture: Any = config.pluginmanager.get_plugin("capturemanager")
        self._stream: TextIO = getattr(getattr(self._reporter, "_tw", None), "_file", None) or sys.stderr
        with self._uncaptured():
            # while pytest captures, its own terminal is a file
            self._terminal = self._stream.isatty()

    @property
    def columns(self) -> int:
        """Width of the terminal as it is now; 0 when the stream is none."""
        if not self._terminal:
            return 0
        with self._uncaptured():
            try:
                return os.get_terminal_size(self._stream.fileno()).columns or FALLBACK_COLUMNS
            except OSError:
                return FALLBACK_COLUMNS

    def show(self, line: str) -> None:
        """Replace the status line on a terminal, add a line elsewhere."""
        # a terminal that was closed, a pipe that nobody reads: no reason to end a cycle, nor not to say how it ended
        with contextlib.suppress(OSError), self._uncaptured():
            if self._terminal:
                self._stream.write(BELOW + line + BACK)
            elif line:
                if self._reporter is not None:
                    # pytest leaves its cursor behind the dots of the tests
                    self._reporter.ensure_newline()
                self._stream.write(line + "\n")
            self._stream.flush()

    def _uncaptured(self) -> contextlib.AbstractContextManager[None]:
        if self._capture is None:
            return contextlib.nullcontext()
        disabled: contextlib.AbstractContextManager[None] = self._capture.global_and_fixture_disabled()
        return disabled


@final
class Progress:
    """Shows how a cycle goes on.

    Args:
        screen: where.
        steps_total: steps of the session.
        wall_s: wall clock, for tests.
    """

    def __init__(
        self, screen: Screen, *, steps_total: int, wall_s: Callable[[], float] = time.monotonic
    ) -> None:
        self._screen, self._terminal, self._wall_s = screen, screen.columns > 0, wall_s
        self._left = TimeLeft(steps_total, started_s=wall_s())
        self._shown_s = float("-inf")
        self._step: CycleStep | None = None
        self._temperatures: dict[str, str] = {}
        self._verdicts: dict[str, int] = {}

    def begin(self, step: CycleStep) -> None:
        """A step begins; the sweep that references are made of is one more, and ends without a verdict."""
        if self._step is not None and self._step.index < 0:
            self._left.done += 1
        if step.index < 0:
            self._left.steps_total += 1
        self._step = step
        self._show("settling", 0.0, force=not self._terminal)

    def settling(self, reading: BenchReading, elapsed_s: float) -> None:
        """The housings are on their way."""
        self._note(reading)
        self._show(f"settling for {elapsed_s:.0f} s", 0.0)

    def soaking(self, reading: BenchReading) -> None:
        """The step rests at its temperature."""
        self._note(reading)
        self._show("soaking", 0.1)

    def angle(self, index: int, count: int, angle_deg: float) -> None:
        """One more angle is recorded."""
        phase = f"angle {index + 1} of {count} ({angle_deg:+.1f}°)"
        part = 0.15 + 0.8 * (index + 1) / max(count, 1)
        self._show(phase, part, short=f"angle {index + 1}/{count}", force=index == 0 and not self._terminal)

    def end(self, verdict: str) -> None:
        """The step has its verdict."""
        self._left.done += 1
        self._verdicts[verdict] = self._verdicts.get(verdict, 0) + 1
        self._show(verdict, 0.0, force=not self._terminal)
        self.clear()

    def clear(self) -> None:
        """Make room for whoever writes next."""
        if self._terminal:
            self._screen.show("")

    def _note(self, reading: BenchReading) -> None:
        housings = reading.housings_c.items()
        self._temperatures = {name: "--" if value is None else f"{value:.1f}" for name, value in housings}

    def _show(self, phase: str, part: float, *, short: str = "", force: bool = False) -> None:
        now_s = self._wall_s()
        every_s = REFRESH_S if self._terminal else PLAIN_EVERY_S
        if self._step is None or (not force and now_s - self._shown_s < every_s):
            return
        self._shown_s = now_s
        lines = self._lines(self._step, phase, short or phase, self._left.seconds(now_s, part))
        if self._terminal:
            # the last column stays free: there a terminal would wrap
            room = max(self._screen.columns - 1, 1)
            self._screen.show(next((line for line in lines if len(line) <= room), lines[-1][:room]))
        else:
            self._screen.show(lines[0])

    def _lines(self, step: CycleStep, phase: str, short: str, left_s: float | None) -> list[str]:
        """The same in words and, where there is no room for them, shorter."""
        left = f"{int(left_s // 60)}:{int(left_s % 60):02d}" if left_s is not None else ""
        so_far = " ".join(f"{count} {name}" for name, count in sorted(self._verdicts.items()))
        named = " ".join(f"{name} {value}" for name, value in self._temperatures.items())
        bare = " ".join(self._temperatures.values())
        set_to = f"set {step.set_temperature_c:g} °C"
        to_go = f"{left} left" if left else ""
        forms = (
            (f"cycle {step.cycle}", f"{step.id} {set_to}", named and f"{named} °C", phase, to_go, so_far),
            (f"{step.id} {set_to}", bare and f"{bare} °C", short, to_go, so_far),
            # the step's name tells cycle and set temperature
            (step.id, bare, short, left, so_far),
        )
        return [" | ".join(part for part in form if part) for form in forms]
