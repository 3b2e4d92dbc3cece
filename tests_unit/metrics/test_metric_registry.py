"""A metric of another package is found by its entry point, and nonsense there is told."""

from __future__ import annotations

from importlib.metadata import EntryPoint

import pytest
from simulated_sweep import SimulatedBench

from arl_fixtures.errors import ConfigError
from arl_fixtures.metrics import registry
from arl_fixtures.metrics.metric import Metric
from arl_fixtures.quantity import Quantity
from arl_fixtures.twin.settings import DutSettings

FOREIGN = Metric(
    names=("foreign",), evaluate=lambda step: [step.measured("foreign", Quantity(float(len(step.sweep.frames)), "1"))]
)
CLASHING = Metric(names=("dead_pixels",), evaluate=lambda step: [])
NOTHING = object()


@pytest.fixture
def installed(monkeypatch):
    def install(attribute: str) -> None:
        point = EntryPoint(name="other", value=f"test_metric_registry:{attribute}", group=registry.GROUP)
        monkeypatch.setattr(registry, "entry_points", lambda group: [point])
        registry.all_metrics.cache_clear()

    yield install
    registry.all_metrics.cache_clear()


def test_a_metric_of_another_package_is_measured_with_the_own_ones(installed):
    installed("FOREIGN")
    bench = SimulatedBench(DutSettings(serial="A"), angles_deg=(0.0, 0.9, 1.8))
    measured = registry.measure(bench.step(seed=1))
    assert [one.quantity.value for one in measured if one.metric == "foreign"] == [3.0]
    assert "foreign" in registry.metric_names()
    assert len({one.metric for one in measured}) == len(registry.metric_names())


@pytest.mark.parametrize(
    ("attribute", "message"),
    [
        ("NOTHING", "is not a Metric"),
        ("MISSING", "cannot be loaded"),
        ("CLASHING", "'dead_pixels' is measured by both 'dead_pixels' and 'other'"),
    ],
)
def test_a_metric_that_is_none_is_refused(installed, attribute, message):
    installed(attribute)
    with pytest.raises(ConfigError, match=message):
        registry.all_metrics()
