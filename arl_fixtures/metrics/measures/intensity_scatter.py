"""σ_I: temporal scatter of the intensity, per reflectance target, and the part that a frame's pixels share."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy.typing as npt

from arl_fixtures.metrics.measurement import Measurement
from arl_fixtures.metrics.metric import Metric
from arl_fixtures.metrics.scatter_report import ScatterChannel, evaluate_channel, remember_channel
from arl_fixtures.metrics.step import StepData

CHANNEL = ScatterChannel(
    name="intensity",
    unit="counts",
    common_unit="1",
    variance=lambda sweep: sweep.intensity_variance,
    returns=lambda sweep: sweep.intensity_returns,
    common=lambda sweep: (sweep.intensity_common_variance, sweep.intensity_common_floor),
    step_size=lambda dut: 1.0,
)


def evaluate(step: StepData) -> list[Measurement]:
    """σ_I per target, its change against the reference, noisy pixels, common part."""
    return evaluate_channel(step, CHANNEL)


def remember(step: StepData) -> Mapping[str, npt.NDArray[Any]]:
    """Pooled variances per target."""
    return remember_channel(step, CHANNEL)


METRIC = Metric(
    names=CHANNEL.metric_names, evaluate=evaluate, remember=remember, units=CHANNEL.metric_units
)
