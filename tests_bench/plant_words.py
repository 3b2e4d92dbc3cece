"""What the plant itself says of a bench that somebody left: when what was switched, who came and went."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

Event = Sequence[Any]
"""(bench time, what, new value), as `PlantWatch.events` gives them."""


def lost_s(events: Sequence[Event], whom: str) -> float:
    """Bench time at which the lab first lost a client in these events; before all of them if it never did."""
    return min((time_s for time_s, what, value in events if (what, value) == ("client lost", whom)), default=0.0)


def guard_was_called(events: Sequence[Event]) -> bool:
    """Whether another guard came in these events after one was lost."""
    seen = [what for _, what, value in events if value == "guard"]
    return "client lost" in seen and "client joined" in seen[seen.index("client lost") :]


def energised(events: Sequence[Event]) -> set[str]:
    """Loads and lasers that are on after these events, which begin with a bench that is off."""
    on: set[str] = set()
    for _, what, value in events:
        if what.startswith(("dut_", "laser_")):
            (on.add if value else on.discard)(what)
    return on


def check_safe(state: dict[str, Any], events: Sequence[Event], *, since_s: float, limit_s: float) -> float:
    """The bench is safe now, and was `limit_s` after `since_s`; returns the seconds it took.

    A session that died before it had switched anything leaves the set-point of the panel.
    """
    on = [name for name, value in state.items() if name.startswith(("dut_", "laser_")) and value]
    assert not on, on
    assert not state["stage_moving"], "the stage turns"
    changes = [(time_s, what) for time_s, what, _ in events if not what.startswith("client")]
    if changes:
        assert state["setpoint_c"] == 23.0, state["setpoint_c"]
    late = [change for change in changes if change[0] > since_s + limit_s]
    assert not late, f"{late} changed later than {limit_s:g} s after {since_s:.2f} s"
    assert state["stage_stands_from_s"] <= since_s + limit_s, "the stage turned on"
    after = [time_s for time_s, _ in changes if time_s >= since_s]
    return max([since_s, state["stage_stands_from_s"], *after]) - since_s if after else 0.0


def check_next_guard(events: Sequence[Event], place: int, *, limit_s: float) -> float:
    """A guard that finds a bench nobody has ended makes it safe before it is driven again; returns the seconds.

    Args:
        events: all of them.
        place: how many there were when nobody was left.
        limit_s: after the guard has come.
    """
    on = energised(events[:place])
    came_s = next(time_s for time_s, what, value in events[place:] if (what, value) == ("client joined", "guard"))
    off_s = came_s
    for time_s, what, value in events[place:]:
        if on and what.startswith(("dut_", "laser_")):
            assert not value, f"{what} was switched on while {on} were on still"
            on.discard(what)
            off_s = max(off_s, time_s)
    assert not on
    assert off_s <= came_s + limit_s
    return off_s - came_s
