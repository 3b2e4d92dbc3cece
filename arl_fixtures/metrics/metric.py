"""The interface of a metric: the one thing a new metric's file has to hold is a `METRIC` of this type."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy.typing as npt

from arl_fixtures.metrics.geometry import Geometry
from arl_fixtures.metrics.instruments import EVERY_VALUE
from arl_fixtures.metrics.measurement import Measurement
from arl_fixtures.metrics.step import StepData


def _nothing(_: StepData) -> Mapping[str, npt.NDArray[Any]]:
    return {}


def _no_expectation(_: Geometry) -> None:
    return None


@dataclass(frozen=True, slots=True, kw_only=True)
class Metric:
    """One metric of the bench.

    Attributes:
        names: names of the values it measures, as limits refer to them.
        evaluate: measures one DUT in one step. It may raise NotMeasurableError when none of its values can be had;
            a value that alone cannot be had is returned by `StepData.unmeasured`.
        remember: arrays to keep in a reference for later steps.
        expect: derives what it needs of the twin's expectation alone, so that it can be had before there is a value.
        instruments: roles of the bench's instruments that its values rest on; INVALID where one has expired.
        units: unit of each name that is always measured in one; limits in a foreign dimension are refused at once.
    """

    names: tuple[str, ...]
    evaluate: Callable[[StepData], list[Measurement]]
    remember: Callable[[StepData], Mapping[str, npt.NDArray[Any]]] = _nothing
    expect: Callable[[Geometry], object] = _no_expectation
    instruments: tuple[str, ...] = EVERY_VALUE
    units: Mapping[str, str] = field(default_factory=dict)
