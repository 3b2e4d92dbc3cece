"""What the terminal shows while a cycle runs: one status line on a terminal, plain lines elsewhere."""

from __future__ import annotations

import contextlib
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Final, Protocol, TextIO, final

import pytest

from arl_fixtures.bench.bench import BenchReading
from arl_fixtures.bench.profile import CycleStep

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

    def write(self, text: str) -> None:
        """Show `text` at once."""

    @property
    def terminal(self) -> bool:
        """Whether the last line can be rewritten."""


@final
class PytestScreen:
    """The terminal of a pytest session, past its capturing.

    Args:
        config: pytest's.
    """

    def __init__(self, config: pytest.Config) -> None:
        reporter: Any = config.pluginmanager.get_plugin("terminalreporter")
        self._capture: Any = config.pluginmanager.get_plugin("capturemanager")
        self._stream: TextIO = getattr(getattr(reporter, "_tw", None), "_file", None) or sys.stderr
        self._fresh = False

    @property
    def terminal(self) -> bool:
        """Whether the stream is a terminal."""
        return self._stream.isatty()

    def write(self, text: str) -> None:
        """Show `text` at once."""
        with self._capture.global_and_fixture_disabled() if self._capture else contextlib.nullcontext():
            # pytest leaves its cursor behind the dots of the tests
            self._stream.write(text if self._fresh or self.terminal else "\n" + text)
            self._stream.flush()
        self._fresh = True


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
        self._screen, self._terminal, self._wall_s = screen, screen.terminal, wall_s
        self._left = TimeLeft(steps_total, started_s=wall_s())
        self._shown_s = float("-inf")
        self._width = 0
        self._step: CycleStep | None = None
        self._temperatures = ""
        self._verdicts: dict[str, int] = {}

    def begin(self, step: CycleStep) -> None:
        """A step begins."""
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
        self._show(f"angle {index + 1} of {count} ({angle_deg:+.1f}°)", 0.15 + 0.8 * (index + 1) / max(count, 1))

    def end(self, verdict: str) -> None:
        """The step has its verdict."""
        self._left.done += 1
        self._verdicts[verdict] = self._verdicts.get(verdict, 0) + 1
        self._show(verdict, 0.0, force=not self._terminal)
        self.clear()

    def clear(self) -> None:
        """Make room for whoever writes next."""
        if self._terminal and self._width:
            self._screen.write("\r" + " " * self._width + "\r")
            self._width = 0

    def _note(self, reading: BenchReading) -> None:
        shown = {name: "--" if value is None else f"{value:.1f}" for name, value in reading.housings_c.items()}
        self._temperatures = " ".join(f"{name} {value}" for name, value in shown.items()) + " °C"

    def _show(self, phase: str, part: float, *, force: bool = False) -> None:
        now_s = self._wall_s()
        every_s = REFRESH_S if self._terminal else PLAIN_EVERY_S
        if self._step is None or (not force and now_s - self._shown_s < every_s):
            return
        self._shown_s = now_s
        left_s = self._left.seconds(now_s, part)
        left = f"{int(left_s // 60)}:{int(left_s % 60):02d} left" if left_s is not None else ""
        so_far = " ".join(f"{count} {name}" for name, count in sorted(self._verdicts.items()))
        parts = (
            f"cycle {self._step.cycle}",
            f"{self._step.id} set {self._step.set_temperature_c:g} °C",
            self._temperatures,
            phase,
            left,
            so_far,
        )
        line = " | ".join(part for part in parts if part)
        if self._terminal:
            self._screen.write("\r" + line.ljust(self._width))
            self._width = len(line)
        else:
            self._screen.write(line + "\n")
