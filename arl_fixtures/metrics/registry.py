"""Which metrics there are, and how a step is measured with all of them.

A metric is one module in `arl_fixtures.metrics.measures` that holds `METRIC`, or an entry point of the group
`arl.metrics` that names such an object in another package. Nothing else has to be told of it.
"""

from __future__ import annotations

import functools
import importlib
import pkgutil
from collections.abc import Mapping
from importlib.metadata import entry_points
from typing import Any, Final

import numpy.typing as npt

from arl_fixtures.errors import ArlError, ConfigError
from arl_fixtures.metrics import measures
from arl_fixtures.metrics.geometry import Geometry
from arl_fixtures.metrics.instruments import EVERY_VALUE
from arl_fixtures.metrics.measurement import Measurement
from arl_fixtures.metrics.metric import Metric
from arl_fixtures.metrics.reference import NotMeasurableError, Reference
from arl_fixtures.metrics.step import NO_REFERENCE, StepData

GROUP: Final = "arl.metrics"


@functools.cache
def all_metrics() -> tuple[Metric, ...]:
    """Every metric found, own ones first, each group in the order of their names.

    Raises:
        ConfigError: an entry point cannot be loaded, or two metrics measure values of one name.
    """
    found: list[tuple[str, Metric]] = []
    for module in sorted(info.name for info in pkgutil.iter_modules(measures.__path__)):
        metric = getattr(importlib.import_module(f"{measures.__name__}.{module}"), "METRIC", None)
        if isinstance(metric, Metric):
            found.append((module, metric))
    for point in sorted(entry_points(group=GROUP), key=lambda point: point.name):
        try:
            metric = point.load()
        except (ImportError, AttributeError) as error:
            raise ConfigError(f"metric '{point.name}' ({point.value}) cannot be loaded: {error}") from None
        if not isinstance(metric, Metric):
            raise ConfigError(f"metric '{point.name}' ({point.value}) is not a Metric")
        found.append((point.name, metric))
    owner: dict[str, str] = {}
    for source, metric in found:
        for name in metric.names:
            if name in owner:
                raise ConfigError(f"metric '{name}' is measured by both '{owner[name]}' and '{source}'")
            owner[name] = source
    return tuple(metric for _, metric in found)


def metric_names() -> frozenset[str]:
    """Names that limits may refer to."""
    return frozenset(name for metric in all_metrics() for name in metric.names)


def metric_units() -> dict[str, str]:
    """Unit of every name that is always measured in one."""
    return {name: unit for metric in all_metrics() for name, unit in metric.units.items()}


@functools.cache
def metric_instruments() -> Mapping[str, tuple[str, ...]]:
    """Roles of the instruments that each name's values rest on."""
    return {name: metric.instruments for metric in all_metrics() for name in metric.names}


def expect(geometry: Geometry) -> None:
    """Derive what the metrics need of the twin's expectation alone; `measure` does it where nobody has before."""
    for metric in all_metrics():
        metric.expect(geometry)


def measure(step: StepData, metrics: tuple[Metric, ...] | None = None) -> list[Measurement]:
    """Measure a step with every metric; what cannot be measured says why, the rest is measured all the same.

    Args:
        step: one DUT in one step.
        metrics: which; all where not given.
    """
    measured: list[Measurement] = []
    for metric in all_metrics() if metrics is None else metrics:
        try:
            measured += metric.evaluate(step)
        except (NotMeasurableError, ArlError) as error:
            attempted = str(error) != NO_REFERENCE
            measured += [step.unmeasured(name, str(error), attempted=attempted) for name in metric.names]
    return measured


def remember(step: StepData, identity: str = "", *, valid_until_utc_ns: int = 0) -> Reference:
    """Make a reference of a step: everything that metrics will want to compare with.

    Args:
        step: one DUT in one step.
        identity: for the report; made from the step's conditions where not given.
        valid_until_utc_ns: when it expires; 0 for never.

    Raises:
        NotMeasurableError: nothing was recorded.
    """
    conditions = step.conditions
    arrays: dict[str, npt.NDArray[Any]] = {}
    for metric in all_metrics():
        try:
            arrays |= metric.remember(step)
        except NotMeasurableError:
            continue  # whoever misses it later says so
    place = f"cycle {conditions.cycle}, step {conditions.step_index}, {conditions.set_temperature_c:g} degC"
    return Reference(
        serial=step.dut.serial,
        identity=identity or place,
        set_temperature_c=conditions.set_temperature_c,
        recorded_utc_ns=int(step.sweep.time_ns.min()),
        valid_until_utc_ns=valid_until_utc_ns,
        doubt="; ".join(why for role, why in conditions.expired.items() if role in EVERY_VALUE),
        arrays=arrays,
    )
