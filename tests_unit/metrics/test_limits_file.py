"""Limits files: what is refused, where, and what applies."""

from __future__ import annotations

from pathlib import Path

import pytest

from arl_fixtures.errors import ConfigError
from arl_fixtures.metrics.limits import check_metrics, load_limits
from arl_fixtures.metrics.registry import metric_names, metric_units

HEAD = "name: test\nversion: 1\nlimits:\n"


def written(tmp_path: Path, body: str) -> Path:
    path = tmp_path / "limits.yaml"
    path.write_text(HEAD + body, encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("body", "message"),
    [
        ("  - {metric: a, unit: m, lower: 2, upper: 1, reason: r}\n", r":4:5: .*lower 2 is above upper 1"),
        ("  - {metric: a, unit: furlong, upper: 1, reason: r}\n", r":4:23: .*unknown unit 'furlong'"),
        ("  - {metric: a, unit: m, reason: r}\n", r":4:5: .*neither lower nor upper"),
        ("  - {metric: a, unit: m, uper: 1, reason: r}\n", r":4:26: unknown key 'limits.0.uper'"),
        ("  - {metric: a, unit: m, upper: 1}\n", r":4:5: key 'limits.0.reason' is missing"),
        ("  - {metric: a, unit: m, upper: .inf, reason: r}\n", r":4:33: .*finite number"),
        (
            "  - {metric: a, unit: m, upper: 1, reason: r, where: {set_temperature_c: [85, -10]}}\n",
            r":4:\d+: .*from 85 to -10 is empty",
        ),
        ("  - {metric: a, unit: m, upper: 1, upper: 2, reason: r}\n", r":4:36: .*duplicate key"),
        ("  - {metric: a, unit: m, upper: 1, reason: r, decision: {rule: maybe}}\n", r":4:64: .*"),
    ],
)
def test_a_wrong_limit_is_refused_with_its_place(tmp_path, body, message):
    with pytest.raises(ConfigError, match=message) as caught:
        load_limits(written(tmp_path, body))
    assert len(str(caught.value).splitlines()) == 1


def test_every_fault_of_a_file_is_told_at_once(tmp_path):
    body = "  - {metric: a, unit: x, upper: 1, reason: r}\n  - {metric: b, unit: m, lower: 2, upper: 1, reason: r}\n"
    with pytest.raises(ConfigError) as caught:
        load_limits(written(tmp_path, body))
    assert len(str(caught.value).splitlines()) == 2


def test_a_limit_of_a_metric_that_does_not_exist_is_refused(tmp_path):
    path = written(tmp_path, "  - {metric: dead_pixles, unit: '1', upper: 1, reason: r}\n")
    limits = load_limits(path)
    with pytest.raises(ConfigError, match=r"yaml:4:14: .*no metric 'dead_pixles'; did you mean 'dead_pixels'\?"):
        check_metrics(limits, metric_names(), {}, path)
    with pytest.raises(ConfigError, match=r"^no metric 'dead_pixles'"):
        check_metrics(limits, metric_names(), {})


def test_a_limit_in_a_foreign_dimension_is_refused_where_it_stands(tmp_path):
    path = written(tmp_path, "  - {metric: distance_error, unit: mm, upper: 1, reason: r}\n")
    with pytest.raises(ConfigError, match=r"limits\.yaml:4:36: .*limit of 'distance_error': .*another dimension"):
        check_metrics(load_limits(path), metric_names(), metric_units(), path)


@pytest.mark.parametrize("path", sorted((Path(__file__).parents[2] / "limits").glob("*.yaml")), ids=lambda p: p.name)
def test_shipped_limits_are_of_metrics_that_exist(path):
    limits = load_limits(path)
    check_metrics(limits, metric_names(), metric_units(), path)
    assert limits.by_metric.keys() == {limit.metric for limit in limits.limits}
