"""Operating data: mean and scatter of each signal that a DUT reports about itself, over the angles of a step.

The mean's uncertainty is that of the scatter, with the effective number of independent readings after the lag-1
autocorrelation (a signal that drifts through the sweep has few); the instruments' own accuracy is not known to us.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
import numpy.typing as npt

from arl_fixtures.metrics.instruments import THERMOMETER
from arl_fixtures.metrics.measurement import Measurement
from arl_fixtures.metrics.metric import Metric
from arl_fixtures.metrics.reference import NotMeasurableError
from arl_fixtures.metrics.step import StepData
from arl_fixtures.quantity import Contribution, Kind, Quantity

Float64Array = npt.NDArray[np.float64]

UNITS: Final = {
    "c": "degC",
    "k": "K",
    "v": "V",
    "mv": "mV",
    "a": "A",
    "ma": "mA",
    "w": "W",
    "us": "us",
    "s": "s",
    "m": "m",
    "deg": "deg",
    "counts": "counts",
    "percent": "%",
}
FEWEST_READINGS: Final = 3


def unit_of(signal: str) -> str:
    """Unit of a signal by the last part of its name; dimensionless where that is no unit."""
    return UNITS.get(signal.rpartition("_")[2], "1")


def effective_readings(values: Float64Array) -> float:
    """Number of independent readings that tell as much of the mean as these, from the lag-1 autocorrelation."""
    deviation = values - values.mean()
    power = float(deviation @ deviation)
    if power == 0.0:
        return float(values.size)
    r1 = min(max(float(deviation[1:] @ deviation[:-1]) / power, 0.0), 0.99)
    return max(values.size * (1.0 - r1) / (1.0 + r1), 2.0)


def evaluate(step: StepData) -> list[Measurement]:
    """Mean and standard deviation of every signal."""
    sweep = step.require("operating")
    if not sweep.operating:
        raise NotMeasurableError("no operating data were recorded")
    in_time = np.argsort(sweep.angle_index)
    measured = []
    for signal, per_angle in sweep.operating.items():
        values = per_angle[in_time]
        values = values[np.isfinite(values)]
        if values.size < FEWEST_READINGS:
            reason = f"{values.size} readings of {signal}{step.shortfall}"
            measured += [step.unmeasured(name, reason, scope=signal) for name in METRIC.names]
            continue
        unit, n = unit_of(signal), effective_readings(values)
        deviation = float(values.std(ddof=1))
        mean = Contribution("repeatability", deviation / math.sqrt(n), Kind.A, n - 1.0)
        spread = Contribution("repeatability", deviation / math.sqrt(2.0 * (n - 1.0)), Kind.A, n - 1.0)
        # a scatter has no zero point: that of temperatures is in kelvin
        scatter_unit = "K" if unit == "degC" else unit
        measured += [
            step.measured("operating", Quantity.of(float(values.mean()), unit, mean), scope=signal),
            step.measured("operating_scatter", Quantity.of(deviation, scatter_unit, spread), scope=signal),
        ]
    return measured


METRIC = Metric(
    names=("operating", "operating_scatter"),
    evaluate=evaluate,
    instruments=(THERMOMETER,),
)
