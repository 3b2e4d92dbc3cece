"""What was recorded at one stage angle of one DUT: the unit that sweep, bag and metrics exchange."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

UInt16Array = npt.NDArray[np.uint16]
Float32Array = npt.NDArray[np.float32]
BoolArray = npt.NDArray[np.bool_]
Int64Array = npt.NDArray[np.int64]


@dataclass(frozen=True, slots=True, kw_only=True)
class AngleBlock:
    """Frames and operating data of one DUT at one stage angle.

    Attributes:
        dut: serial number.
        angle_index: position in the sweep as it was driven, from 0.
        stage_angle_deg: stage angle as the stage reported it at rest, degrees, clockwise positive.
        time_ns: (n,) exposure start of each frame, bench UTC nanoseconds.
        intensity_counts: (n, 2, H, W) both returns, counts; 0 where there is no return.
        distance_m: (n, 2, H, W) both returns, radial range in metres; NaN where there is no return.
        row_valid: (n, H) False for rows whose packet never came; their pixels are 0 and NaN.
        operating: signal name with unit suffix (as in the observation table) to value, at this angle.
    """

    dut: str
    angle_index: int
    stage_angle_deg: float
    time_ns: Int64Array
    intensity_counts: UInt16Array
    distance_m: Float32Array
    row_valid: BoolArray
    operating: Mapping[str, float] = field(default_factory=dict)
