"""N_dead: number of dead, hot and stuck pixels, also against the DUT's own list.

An undecided pixel counts as one half ± 1/√12: that is all that is known of it.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from arl_fixtures.metrics.instruments import THERMOMETER
from arl_fixtures.metrics.measurement import Measurement
from arl_fixtures.metrics.metric import Metric
from arl_fixtures.metrics.pixel_faults import pixel_faults
from arl_fixtures.metrics.reference import NotMeasurableError
from arl_fixtures.metrics.step import StepData
from arl_fixtures.quantity import Contribution, Kind, Quantity

BoolArray = npt.NDArray[np.bool_]

MOST_UNDECIDED = 0.01
"""With more undecided pixels than this share the count says nothing."""


def listed_dead(step: StepData) -> BoolArray:
    """The DUT's own list of dead pixels as a mask, (H, W)."""
    mask = np.zeros((step.dut.rows, step.dut.columns), dtype=bool)
    for u, v in step.dut.dead_pixels:
        if u < step.dut.columns and v < step.dut.rows:
            mask[v, u] = True
    return mask


def evaluate(step: StepData) -> list[Measurement]:
    """Count faulty pixels: all of them, by kind, and against the DUT's own list."""
    faults = step.derive(pixel_faults)
    listed = listed_dead(step)
    undecided = int(faults.undecided.sum())
    remark = f"{undecided} pixels undecided{step.shortfall}" if undecided else ""
    doubt = (Contribution("undecided pixels", math.sqrt(undecided / 12.0), Kind.B),) if undecided else ()
    if undecided > MOST_UNDECIDED * faults.undecided.size:
        raise NotMeasurableError(remark)
    count = float(faults.faulty.sum()) + 0.5 * undecided
    measured = [step.measured("dead_pixels", Quantity.of(count, "1", *doubt), reason=remark)]
    parts = {
        "dead": faults.dead,
        "hot": faults.hot,
        "stuck": faults.stuck,
        "not listed": faults.faulty & ~listed,
        "listed but alive": listed & ~faults.faulty & ~faults.undecided,
    }
    for scope, mask in parts.items():
        places = ", ".join(f"({u}, {v})" for v, u in np.argwhere(mask)[:8].tolist())
        measured.append(
            step.measured("dead_pixels_by_kind", Quantity(float(mask.sum()), "1"), scope=scope, reason=places)
        )
    return measured


METRIC = Metric(
    names=("dead_pixels", "dead_pixels_by_kind"),
    evaluate=evaluate,
    instruments=(THERMOMETER,),
    units={"dead_pixels": "1", "dead_pixels_by_kind": "1"},
)
