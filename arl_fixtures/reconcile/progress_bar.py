"""Progress with the time left, on a terminal; silent elsewhere."""

from __future__ import annotations

from collections.abc import Callable
from types import TracebackType
from typing import final

from rich.console import Console
from rich.progress import BarColumn, Progress, ProgressColumn, Task, TextColumn
from rich.text import Text

SURE_SHARE = 0.08
"""Share of the work before which no time is foretold."""


class TimeLeft(ProgressColumn):
    """Time left by the pace so far; counts down between two reports, which may be far apart."""

    def render(self, task: Task) -> Text:
        """`1:20 left`, or the time that has passed while nothing can be foretold."""
        passed = task.elapsed or 0.0
        known = float(task.fields.get("reported_at") or 0.0)
        if task.completed < SURE_SHARE or known <= 0.0:
            return Text(f"{_clock(passed)} so far")
        total = known / task.completed
        return Text(f"{_clock(total - passed)} left" if total - passed > 1.0 else "a moment left")


def _clock(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes}:{rest:02d}"


@final
class Bar:
    """A bar that lives as long as the work; entering it gives the call that reports a sentence and the share done."""

    def __init__(self) -> None:
        console = Console(stderr=True)
        self._bar = Progress(
            TextColumn("{task.description}"), BarColumn(), TimeLeft(), transient=True, console=console,
            disable=not console.is_terminal,
        )  # fmt: skip
        self._task = self._bar.add_task("reading", total=1.0, reported_at=0.0)

    def __enter__(self) -> Callable[[str, float], None]:
        self._bar.start()
        return self._report

    def _report(self, text: str, share: float) -> None:
        passed = next(task.elapsed or 0.0 for task in self._bar.tasks)
        self._bar.update(self._task, description=text, completed=share, reported_at=passed)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._bar.stop()
