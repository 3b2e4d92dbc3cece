"""A stage against a reference encoder: what its gear does shows in an angle that is read, not in a scene."""

import numpy as np
import pyarrow as pa
import pytest

from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of


def read_out(seed, *, off_centre=0.0, backlash_deg=0.0):
    """Shaft angle at random positions, from both sides; a worm that turns off its centre beside a 40-tooth wheel."""
    rng = np.random.default_rng(seed)
    stage, way = rng.uniform(0.0, 360.0, 800), rng.choice([-1.0, 1.0], 800)
    shaft = stage.copy()
    for _ in range(20):  # the flank touches where the worm, turned 40 times as far, has pushed it to
        shaft = stage + np.degrees(off_centre * np.sin(np.radians(40.0 * shaft))) + 0.5 * backlash_deg * way
    std = 2.4e-3
    return {
        "step": np.arange(800) // 70, "stage_angle_deg": stage, "direction": way.astype(int),
        "ambient_temperature_c": 22.5 + 0.1 * rng.normal(size=800), "n_frames": np.full(800, 5),
        "sim_shaft_angle_deg": stage, "sim_shaft_angle_deg_std": np.full(800, std),
        "shaft_angle_deg": shaft + std / np.sqrt(5.0) * rng.normal(size=800),
    }  # fmt: skip


def test_the_worm_s_period_is_found_in_what_the_encoder_reads():
    findings = diagnose(columns_of(pa.table(read_out(3, off_centre=8e-6))))[0].findings
    assert [f.effect for f in findings] == ["stage.periodic_error"]
    assert next(p for p in findings[0].parameters if p.name == "period").value == pytest.approx(9.0, rel=0.01)


def test_an_encoder_shows_the_backlash():
    findings = diagnose(columns_of(pa.table(read_out(5, backlash_deg=6e-4))))[0].findings
    assert [f.effect for f in findings] == ["stage.zero_offset"]
    assert findings[0].parameters[0].low < 6e-4 < findings[0].parameters[0].high


def test_a_true_stage_is_consistent():
    assert diagnose(columns_of(pa.table(read_out(7))))[0].findings == []


def carried(seed, off_centre_mm):
    """A profiler above blocks on a linear stage: a screw of 15 mm pitch whose thread leans turns unevenly."""
    rng = np.random.default_rng(seed)
    fine = np.linspace(0.0, 40.0, 40001)
    lead = 1.0 + off_centre_mm * np.cos(2.0 * np.pi * fine / 15.0 + 0.7)
    nut = np.concatenate([[0.0], np.cumsum(0.5 * (lead[1:] + lead[:-1]) * np.diff(fine))])
    step, place, block = (
        a.ravel() for a in np.meshgrid(np.arange(12), np.arange(17), np.array([0.0, 3.0]), indexing="ij")
    )
    stage = place * 2.5
    std = np.full(step.size, 4e-3)
    return columns_of(pa.table({
        "step": step, "camera_temperature_c": 20.0 + 2.0 * step, "stage_height_mm": stage,
        "n_frames": np.full(step.size, 10), "sim_height_mm": stage + block, "sim_height_mm_std": std,
        "sim_height_mm_repeat_std": np.full(step.size, 3e-4),
        "height_mm": np.interp(stage, fine, nut) + block + std / np.sqrt(10.0) * rng.normal(size=step.size)
        + 3e-4 * rng.normal(size=12)[step],
    }))  # fmt: skip


def test_the_screw_of_a_linear_stage_shows_in_what_it_carries():
    (found,) = diagnose(carried(2, 1.5e-3))[0].findings
    assert (found.effect, found.drivers) == ("stage.periodic_error", ["stage_height_mm"])
    assert {p.name: p.value for p in found.parameters}["period"] == pytest.approx(15.0, rel=0.02)
    assert "mm" in found.statement
