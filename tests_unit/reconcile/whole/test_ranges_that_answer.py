"""A comparator at a fixed level: what dims the pulse before it makes it late as well, not what rescales a number.

Pulses are drawn and crossed here; the simulation has the same comparator.
"""

import numpy as np
import pytest

from arl_fixtures.reconcile.columns import Columns
from arl_fixtures.reconcile.command import reconcile
from arl_fixtures.reconcile.range_answer import answers
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.view import View
from tests_unit.reconcile.foretold import share_told
from tests_unit.reconcile.whole.test_seldom_names import columns_of

LIGHT, FAR = "intensity_counts", "distance_m"
TIME_NS = np.arange(-8.0, 8.0, 0.01)
RISE = np.exp(-0.5 * (TIME_NS / 1.6) ** 2)
LEVEL, METRES_PER_NS = 30.0, 0.149896229
LADDER = np.geomspace(40.0, 6000.0, 300)
EARLY = np.argmax(RISE)
CROSSED = np.array([np.interp(LEVEL, h * RISE[:EARLY], TIME_NS[:EARLY]) for h in LADDER]) * METRES_PER_NS


def bench(amplifier=0.0, number=0.0, *, walks=True, seed=4):
    """Eight targets on a bench whose board warms: an amplifier before, and a number behind, the comparator."""
    rng = np.random.default_rng(seed)
    step, target, _ = (a.ravel() for a in np.meshgrid(np.arange(14), np.arange(8), np.arange(6), indexing="ij"))
    warm = np.linspace(-15.0, 55.0, 14)[step] + rng.normal(0.0, 0.3, step.size)
    paint = np.array([0.1, 0.8, 0.3, 0.9, 0.2, 0.6, 0.4, 0.15])[target]
    true = np.array([2.0, 3.0, 2.4, 1.6, 2.8, 1.9, 3.4, 2.2])[target]
    height = 9e3 * paint / true**2
    seen = height * (1.0 + amplifier * (warm - 25.0))
    late = np.interp([height, seen], LADDER, CROSSED) if walks else np.zeros((2, step.size))
    real = {LIGHT: seen * (1.0 + number * (warm - 25.0)), FAR: true + late[1]}
    spread = {LIGHT: np.sqrt(60.0 + height), FAR: np.full(step.size, 6e-3)}
    made = {
        "step": step, "tof_temperature_c": warm, "true_range_m": true, "reflectance": paint,
        "n_frames": np.full(step.size, 50.0),
    }  # fmt: skip
    for name, nominal in {LIGHT: height, FAR: true + late[0]}.items():
        made |= {f"sim_{name}": nominal, f"sim_{name}_std": spread[name],
                 f"sim_{name}_repeat_std": 2e-4 * nominal if name == LIGHT else np.full(step.size, 1e-4),
                 name: real[name] + spread[name] / np.sqrt(50.0) * rng.normal(size=step.size)}  # fmt: skip
    return made, real


def table(**bench_of) -> Columns:
    return columns_of(bench(**bench_of)[0])


def test_an_amplifier_before_the_comparator_moves_ranges_too():
    findings = diagnose(table(amplifier=-2e-3))[0].findings
    assert [found.effect for found in findings] == ["detector.gain_temperature"]
    assert set(findings[0].channels) == {LIGHT, FAR}


def test_a_number_behind_the_comparator_does_not():
    findings = diagnose(table(number=-2e-3))[0].findings
    assert [found.effect for found in findings] == ["detector.gain_temperature"]
    assert findings[0].channels == [LIGHT]


def test_a_model_that_was_read_again_foretells_the_range(tmp_path, save, foretell):
    diagnosis = reconcile(save(tmp_path / "table.parquet", bench(amplifier=-2e-3)[0]), tmp_path / "out")
    assert [found.effect for found in diagnosis.findings] == ["detector.gain_temperature"]
    unseen, real = bench(amplifier=-2e-3, seed=5)
    assert share_told(real[FAR] - unseen[f"sim_{FAR}"], real[FAR] - foretell(unseen, FAR)) > 0.95


@pytest.mark.parametrize("walks", [True, False])
def test_a_simulation_tells_its_walk(walks):
    found = answers(View(table(walks=walks)))
    assert bool(found) is walks
    if walks:
        before, after = ({LIGHT: h, FAR: np.zeros(2)} for h in (np.array([200.0, 2000.0]), np.array([150.0, 1500.0])))
        found[0].to(before, after)
        expected = np.diff(np.interp([before[LIGHT], after[LIGHT]], LADDER, CROSSED), axis=0)[0]
        assert after[FAR] == pytest.approx(expected, rel=0.15)


def test_panels_at_one_range_tell_the_walk_as_well():
    columns, _ = bench()
    one = columns["true_range_m"] == 2.2
    few = {name: np.tile(values[one], 4) for name, values in columns.items()}
    height = np.repeat([60.0, 300.0, 1200.0, 4000.0], np.count_nonzero(one))
    few |= {f"sim_{LIGHT}": height, f"sim_{FAR}": 2.2 + np.interp(height, LADDER, CROSSED)}
    (found,) = answers(View(columns_of(few)))
    assert np.diff(found.range).max() < 0.0


def test_a_curve_does_not_go_on_to_where_no_light_was_simulated():
    """Light that an effect takes to nothing in rows never seen moves their range by what the curve spans at most."""
    (found,) = answers(View(table()))
    before, after = ({LIGHT: np.array([light]), FAR: np.zeros(1)} for light in (300.0, 1e-3))
    found.to(before, after)
    assert 0.0 < after[FAR][0] < 1.5 * np.ptp(found.range)
