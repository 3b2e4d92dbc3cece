"""Pixels without a return in all their last rows, in a table that has no share of frames with one: they see no light.

A row without a return is not observed and compares nothing. Where a pixel stops answering, though, that is all there
is to see of it: its light is then nothing, from that step or cycle on.
"""

from __future__ import annotations

import numpy as np

from arl_fixtures.reconcile.columns import BoolArray, Columns, FloatArray, IntArray
from arl_fixtures.reconcile.roles import Role

FEWEST = 4
"""Rows that a pixel must lack, its last."""
MOST = 0.2
"""Share of rows above which these are no few pixels."""
SURE = 1e-4
"""Probability, over all pixels and all moments at which one could have stopped, below which it is no chance."""
BRIGHTNESSES = 20
"""Parts of equally many rows by simulated light: the dim ones have no return more often."""
SEEN = 0.5
"""Share of the rows of a device in a step that must have a return: else the step has none, not the pixel."""


def take_for_dark(columns: Columns) -> None:
    """Set the light of pixels that stopped answering to nothing where it is not given, with a note."""
    numbers, channels = columns.numbers, columns.channels
    if any(c.role is Role.FRACTION for c in channels) or not {"pixel_u", "pixel_v"} & set(numbers):
        return
    optical = [c.name for c in channels if c.role in {Role.INTENSITY, Role.DISTANCE}]
    light = next((c.name for c in channels if c.role is Role.INTENSITY), None)
    if light is None:
        return
    due = np.isfinite(numbers[f"sim_{light}"]) & _placed(numbers)
    silent = due & np.all([~np.isfinite(numbers[name]) for name in optical], axis=0)
    if not silent.any():
        return
    pixel, stay = columns.group("dut", "pixel_u", "pixel_v"), columns.group("dut", "cycle", "step")
    visit = columns.group("cycle", "step")  # in their order
    stopped = _stopped(pixel, visit, stay, silent, due, numbers[f"sim_{light}"])
    if not stopped.any() or np.mean(stopped) > MOST:
        return
    numbers[light] = np.where(stopped, 0.0, numbers[light])
    count = int(np.unique(pixel[stopped]).size)
    columns.ignored[f"{light} (no return)"] = (
        f"{count} pixel{'s' if count > 1 else ''} without a return in all last rows; taken for dark there"
    )


def _stopped(
    pixel: IntArray, visit: IntArray, stay: IntArray, silent: BoolArray, due: BoolArray, light: FloatArray
) -> BoolArray:
    """Rows of pixels that lack all returns from a visit on, as chance would not let them."""
    answers = due & ~silent
    count = np.maximum(np.bincount(stay[due], minlength=int(stay.max()) + 1), 1)
    seen = np.bincount(stay[answers], minlength=len(count)) / count
    asked = due & (seen > SEEN)[stay]
    if not asked.any():
        return asked
    last = np.full(int(pixel.max()) + 1, -1, dtype=np.int64)  # visit of each pixel's last return
    np.maximum.at(last, pixel[asked & ~silent], visit[asked & ~silent])
    tail = asked & (visit > last[pixel])
    lacking = np.bincount(pixel[tail], minlength=len(last))
    edges = np.unique(np.quantile(light[asked], np.linspace(0.0, 1.0, BRIGHTNESSES + 1)[1:-1]))
    part = np.searchsorted(edges, light)
    # how often other pixels lack a return in such light
    cell = pixel * BRIGHTNESSES + part
    rows, lost = (_others(part[some], cell[some], len(last)) for some in (asked, asked & silent))
    log_chance = np.log((lost + 1.0) / (rows + 2.0))[cell]
    told = np.bincount(pixel[tail], log_chance[tail], minlength=len(last))
    moments = np.log(max(len(last) * (int(visit.max()) + 1), 1))
    return np.asarray(tail & ((lacking >= FEWEST) & (told + moments < np.log(SURE)))[pixel])


def _others(part: IntArray, cell: IntArray, pixels: int) -> FloatArray:
    """Rows of a part that are of other pixels, (pixels x parts,)."""
    whole, own = np.bincount(part, minlength=BRIGHTNESSES), np.bincount(cell, minlength=pixels * BRIGHTNESSES)
    return np.asarray(np.tile(whole, pixels) - own, dtype=np.float64)


def _placed(numbers: dict[str, FloatArray]) -> BoolArray:
    places = [np.isfinite(numbers[name]) for name in ("pixel_u", "pixel_v") if name in numbers]
    return np.asarray(np.all(places, axis=0))
