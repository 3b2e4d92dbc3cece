"""Rough targets by adding up their facets: what they send back obliquely, all of them or one of several."""

import numpy as np
import pyarrow as pa
import pytest

from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of


def facets(incidence_deg, slope_rad, draws=20_000):
    """Light of Lambertian facets of Gaussian slopes, source and eye together, against a flat surface's; 1 at 0°."""
    rng = np.random.default_rng(5)
    p, q = np.tan(slope_rad) * rng.normal(size=(2, draws))
    a = np.radians(np.append(incidence_deg, 0.0))[:, None]
    facing = np.maximum(np.cos(a) + p * np.sin(a), 0.0) / np.sqrt(1.0 + p * p + q * q)
    area = np.sqrt(1.0 + p * p + q * q)  # of a facet over one of the base
    light = np.mean(facing**2 * area, axis=1) / np.cos(a[:, 0]) ** 2
    return light[:-1] / light[-1]


def panels(rng, rows=900):
    """A single ray before three panels that turn."""
    panel = np.array(["felt", "painted", "spectralon"])[rng.integers(0, 3, rows)]
    incidence = rng.uniform(0.0, 70.0, rows)
    distance = rng.uniform(0.6, 6.0, rows)
    albedo = np.choose(np.searchsorted(["felt", "painted", "spectralon"], panel), [0.05, 0.5, 0.9])
    light = 2.0 * albedo * np.cos(np.radians(incidence)) / distance**2
    std = np.hypot(1e-3, 0.01 * light)
    return {
        "target": panel, "incidence_deg": incidence, "true_range_m": distance, "reflectance": albedo,
        "board_c": rng.uniform(10.0, 60.0, rows), "supply_v": 5.0 + 0.02 * rng.normal(size=rows),
        "run": np.arange(rows) * 10 // rows, "n_frames": np.full(rows, 10),
        "sim_amplitude_v": light, "sim_amplitude_v_std": std,
    }  # fmt: skip


@pytest.mark.parametrize("rough", ["painted", "all"])
def test_facets_that_stand_up_to_the_light_are_named(rough):
    rng = np.random.default_rng(31)
    columns = panels(rng)
    there = np.ones(900, dtype=bool) if rough == "all" else columns["target"] == rough
    bright = np.where(there, facets(columns["incidence_deg"], 0.12), 1.0)
    noise = columns["sim_amplitude_v_std"] / np.sqrt(10.0) * rng.normal(size=900)
    columns["amplitude_v"] = columns["sim_amplitude_v"] * bright + noise
    findings = diagnose(columns_of(pa.table(columns)))[0].findings
    assert [f.effect for f in findings] == ["target.non_lambertian"]
    assert findings[0].where.get("target", ["all"]) == [rough]
    squared = next(p for p in findings[0].parameters if p.name == "facets").value
    assert squared == pytest.approx(np.tan(0.12) ** 2, rel=0.25)


def test_a_target_that_is_merely_darker_keeps_its_name():
    rng = np.random.default_rng(33)
    columns = panels(rng)
    columns["amplitude_v"] = columns["sim_amplitude_v"] * np.where(columns["target"] == "painted", 0.985, 1.0)
    columns["amplitude_v"] += columns["sim_amplitude_v_std"] / np.sqrt(10.0) * rng.normal(size=900)
    findings = diagnose(columns_of(pa.table(columns)))[0].findings
    assert [f.effect for f in findings] == ["target.reflectance_error"]


def oren_nayar(incidence_deg, sigma_rad):
    """Their qualitative model, source and eye together, against its value at normal incidence."""
    a, variance = np.radians(incidence_deg), sigma_rad**2
    level = 1.0 - 0.5 * variance / (variance + 0.33)
    rise = 0.45 * variance / (variance + 0.09)
    return (level + rise * np.sin(a) * np.tan(a)) / level


def test_oren_and_nayar_s_rough_paint_is_told_with_its_strength():
    rng = np.random.default_rng(37)
    columns = panels(rng)
    bright = oren_nayar(columns["incidence_deg"], 0.05)
    noise = columns["sim_amplitude_v_std"] / np.sqrt(10.0) * rng.normal(size=900)
    columns["amplitude_v"] = columns["sim_amplitude_v"] * bright + noise
    (found,) = diagnose(columns_of(pa.table(columns)))[0].findings
    assert found.effect == "target.non_lambertian"
    (rough,) = found.parameters
    angle = np.radians(60.0)
    true = (oren_nayar(60.0, 0.05) - 1.0) / (np.sin(angle) * np.tan(angle))
    assert rough.low < true < rough.high
    assert true > 2.0 * (rough.high - rough.low)
