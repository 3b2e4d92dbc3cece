"""Whether a sensor sends one frame again and again: noise makes any two frames of a living one differ."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from arl_fixtures.protocols.frame_assembly import AssembledFrame

PIXELS: Final = slice(92, 1116)
"""Bytes of a packet that hold ranges and intensities."""


def repeats(previous: AssembledFrame | None, frames: Sequence[AssembledFrame]) -> bool:
    """Whether any frame carries the pixels of the one before it; `previous` was the last of the set before."""
    pairs = zip([previous, *frames[:-1]], frames, strict=True)
    return any(first is not None and _same_pixels(first, second) for first, second in pairs)


def _same_pixels(first: AssembledFrame, second: AssembledFrame) -> bool:
    """Whether two frames carry the same pixels, in the rows that both have."""
    compared = False
    for one, other in zip(first.rows, second.rows, strict=True):
        if one is None or other is None:
            continue
        # noise makes the very first row differ in a sensor that is alive, so this ends there
        if one[PIXELS] != other[PIXELS]:
            return False
        compared = True
    return compared
