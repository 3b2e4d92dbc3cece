"""Dead, hot and stuck pixels, found from the frames of a whole sweep.

A pixel is judged only by what it should have seen: one that looks at nothing bright enough is undecided, not dead.
Over a sweep every pixel passes the bright stripes, so few stay undecided.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from arl_fixtures.metrics.reference import NotMeasurableError
from arl_fixtures.metrics.step import StepData

BoolArray = npt.NDArray[np.bool_]

VISIBLE_FACTOR: Final = 2.0
"""A pixel should answer where the expected intensity is at least this many times the detection threshold."""
FEWEST_CHANCES: Final = 20
"""Frames in which a pixel should have answered, for it to be decided."""
DEAD_SHARE: Final = 0.01
"""A pixel is dead that answers in less than this share of the frames in which it should."""
HOT_COUNTS: Final = 200.0
"""A pixel is hot that reads this much above the expectation at (almost) every angle."""
HOT_QUANTILE: Final = 0.05
HOT_STRIDE: Final = 3
MOST_FROZEN: Final = 0.5
"""More stuck pixels than this share are a frozen frame, not pixels."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PixelFaults:
    """Faulty pixels of a sweep, (H, W) each; `undecided` ones could not be judged."""

    dead: BoolArray
    hot: BoolArray
    stuck: BoolArray
    undecided: BoolArray

    @property
    def faulty(self) -> BoolArray:
        """Dead, hot or stuck."""
        return self.dead | self.hot | self.stuck


def pixel_faults(step: StepData) -> PixelFaults:
    """Find dead, hot and stuck pixels.

    Raises:
        NotMeasurableError: no frames or twin, or the frames themselves stand still.
    """
    sweep, geometry = step.require("intensity", "distance"), step.geometry
    threshold = VISIBLE_FACTOR * step.dut.noise.detection_counts
    should = (geometry.intensity_counts >= threshold) * sweep.arrived.astype(np.int32)
    answers = np.maximum(sweep.intensity_returns, sweep.distance_returns)
    chances = should.sum(axis=0)
    answered = np.minimum(answers, should).sum(axis=0)
    undecided = chances < FEWEST_CHANCES
    dead = ~undecided & (answered < DEAD_SHARE * chances)

    level = sweep.intensity_counts
    seen = np.isfinite(level)
    # a pixel that never moves although its scene does, in any frame of any angle
    low = np.where(seen, level, np.inf).min(axis=0)
    high = np.where(seen, level, -np.inf).max(axis=0)
    expected_span = np.ptp(geometry.intensity_counts, axis=0)
    stuck = ~dead & ~undecided & (high <= low) & sweep.constant.all(axis=0) & (expected_span > threshold)
    if stuck.mean() > MOST_FROZEN:
        raise NotMeasurableError(f"{int(stuck.sum())} pixels never change: the DUT repeats a frozen frame")

    # a share of the angles is as good as all of them for "at every angle", and sorting is what costs here
    some = slice(None, None, HOT_STRIDE)
    excess = np.where(seen[some], level[some] - geometry.intensity_counts[some], np.inf)
    rank = int(HOT_QUANTILE * len(excess))
    always = np.partition(excess, rank, axis=0)[rank]
    hot = ~dead & ~undecided & ~stuck & (always > HOT_COUNTS) & np.isfinite(always)
    return PixelFaults(dead=dead, hot=hot, stuck=stuck, undecided=undecided)
