"""Walls whose distance was logged, rims that cut off from an angle on, beams that soften, rails that drop out."""

import numpy as np
import pyarrow as pa
import pytest

from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of


def by_the_wall(beside, ahead, albedo):
    """Light sensor - wall - spot over that sent to the spot, and its extra one-way path, summed over facets.

    The wall runs beside the beam from the sensor to the board; each spot is `beside` from it, `ahead` of the sensor.
    """
    up, along = np.meshgrid(np.linspace(-1.5, 1.5, 31), (np.arange(60) + 0.5) / 60.0)
    share, longer = np.zeros(beside.size), np.zeros(beside.size)
    for k, (x, z) in enumerate(zip(beside, ahead, strict=True)):
        place = np.stack([np.zeros(up.size), up.ravel(), along.ravel() * z])
        sensor, spot = np.array([[0.9], [0.0], [0.0]]), np.array([[x], [0.0], [z]])
        there, on = np.linalg.norm(place - sensor, axis=0), np.linalg.norm(spot - place, axis=0)
        straight = float(np.linalg.norm(spot - sensor))
        lit = (0.9 / there) / there**2
        gives = (x / on) * ((z - place[2]) / on) / (np.pi * on**2 + 1e-3)
        weight = albedo[k] * lit * gives * (z / 60.0) * (3.0 / 30.0) / ((z / straight) / straight**2)
        share[k] = weight.sum()
        longer[k] = np.sum(weight * 0.5 * (there + on - straight)) / max(weight.sum(), 1e-12)
    return share, longer


@pytest.mark.parametrize("white", [False, True])
def test_light_by_way_of_a_wall_whose_distance_was_logged(white):
    rng = np.random.default_rng(3)
    n = 400
    beside, ahead = rng.uniform(0.06, 1.4, n), rng.choice([1.2, 1.8, 2.5], n)
    albedo = rng.choice([0.05, 0.5, 0.9], n) if white else np.full(n, 0.5)
    share, longer = by_the_wall(beside, ahead, albedo)
    far = np.hypot(beside - 0.9, ahead)
    light = 4000.0 / far**2
    blur, error = np.full(n, 0.12), np.sqrt(900.0 + 30.0 * light)
    made = columns_of(pa.table({
        "step": np.arange(n) // 40, ("gap_to_sidewall_m" if white else "corner_distance_m"): beside,
        "true_range_m": far,
        **({"sidewall_reflectance": albedo} if white else {}), "n_frames": np.full(n, 30.0),
        "sim_distance_m": far, "sim_distance_m_std": blur, "sim_intensity_counts": light,
        "sim_intensity_counts_std": error,
        "distance_m": far + share / (1.0 + share) * longer + blur * rng.normal(size=n) / np.sqrt(30.0),
        "intensity_counts": light * (1.0 + share) + error * rng.normal(size=n) / np.sqrt(30.0),
    }))  # fmt: skip
    found = diagnose(made)[0].findings
    assert [f.effect for f in found] == ["air.multipath"]
    assert found[0].drivers[0] == ("gap_to_sidewall_m" if white else "corner_distance_m")


def test_a_wall_that_is_the_target_itself_is_not_beside_it():
    """A clock that runs slow, on a bench that logs how far its wall stands."""
    rng = np.random.default_rng(14)
    away = np.repeat(np.linspace(0.8, 3.4, 20), 40)
    slant = np.tile(np.linspace(-20.0, 20.0, 40), 20)
    far = away / np.cos(np.radians(slant))
    ticks = np.floor(far / 0.00015 / 1.0006 + rng.random(far.size)) * 0.00015  # counted by the slow clock
    made = columns_of(pa.table({
        "step": np.repeat(np.arange(20), 40), "azimuth_deg": slant, "wall_distance_m": away, "true_range_m": far,
        "n_frames": np.full(far.size, 10.0), "sim_distance_m": far, "sim_distance_m_std": np.full(far.size, 0.002),
        "distance_m": ticks + 0.002 * rng.normal(size=far.size) / np.sqrt(10.0),
    }))  # fmt: skip
    (found,) = diagnose(made)[0].findings
    assert found.effect == "timing.clock_scale"
    assert "air.multipath" not in found.equivalent_to


def test_a_rim_that_cuts_off_from_an_angle_on_is_vignetting():
    """Rays through a stop and a lens' rim behind it, counted on the stop; nothing is cut off near the axis."""
    rng = np.random.default_rng(4)
    across, along, dome = (
        a.ravel() for a in np.meshgrid(np.arange(0, 64, 2), np.arange(0, 48, 2), [1.0, 1.7, 2.6], indexing="ij")
    )
    azimuth, elevation = (across - 31.5) * 1.35, (23.5 - along) * 1.35
    cosine = np.cos(np.radians(azimuth)) * np.cos(np.radians(elevation))
    disc = np.sqrt((np.arange(6000) + 0.5) / 6000.0) * np.exp(2.399963j * np.arange(6000))  # an even sunflower
    angle = np.linspace(0.0, 75.0, 76)
    passed = [np.mean(np.abs(disc + 0.2 * np.tan(np.radians(a))) < 1.18) for a in angle]
    kept = np.interp(np.degrees(np.arccos(cosine)), angle, passed)
    light = 9000.0 * cosine / dome**2
    error = np.sqrt(100.0 + 1.1 * light + (0.004 * light) ** 2)
    made = columns_of(pa.table({
        "pixel_u": across, "pixel_v": along, "azimuth_deg": azimuth, "elevation_deg": elevation,
        "true_range_m": dome, "n_frames": np.full(across.size, 8.0), "sim_intensity_counts": light,
        "sim_intensity_counts_std": error,
        "intensity_counts": light * kept**2 + error * rng.normal(size=across.size) / np.sqrt(8.0),
    }))  # fmt: skip
    (found,) = diagnose(made)[0].findings
    assert found.effect == "optics.vignetting"


@pytest.mark.parametrize("strength", [0.004, 0.02])
def test_a_diffuser_that_softens_with_heat_widens_the_beam(strength):
    """Each grain of the diffuser throws its rays wider by Arrhenius' law, hardly so below room temperature."""
    rng = np.random.default_rng(5)
    axes = np.meshgrid(np.arange(12), np.arange(6), np.arange(0, 128, 16), np.arange(1, 32, 3), indexing="ij")
    step, stage, u, v = (a.ravel() for a in axes)
    housing = rng.permutation(np.linspace(-10.0, 85.0, 12))
    azimuth, elevation = (u - 63.5) * 0.94, (15.5 - v) * 0.86
    thrown = np.linspace(-60.0, 60.0, 200_001)
    cold = np.cumsum(np.exp(-((thrown / 18.0) ** 4)))  # rays below an elevation
    across = 4000.0 * np.array([0.18, 0.5, 0.8])[(stage + u // 32) % 3] * np.exp(-((azimuth / 75.0) ** 4))

    def caught(wider, on):
        ends = [np.interp(elevation[on] + half, thrown * wider, cold) for half in (-0.43, 0.43)]
        return across[on] * (ends[1] - ends[0]) * (thrown[1] - thrown[0]) / 0.86

    seen, sim = np.zeros(u.size), caught(1.0, np.arange(u.size))
    for number, warm in enumerate(housing + 273.15):
        on = np.flatnonzero(step == number)
        seen[on] = caught(1.0 + strength * np.exp(-0.35 / 8.617e-5 * (1.0 / warm - 1.0 / 358.15)), on)
    error = np.sqrt(36.0 + 0.25 * sim)
    made = columns_of(pa.table({
        "step": step, "stage_angle_deg": 6.0 * stage, "pixel_u": u, "pixel_v": v, "azimuth_deg": azimuth,
        "elevation_deg": elevation, "housing_temperature_c": housing[step], "n_frames": np.full(sim.size, 10.0),
        "sim_intensity_counts": sim, "sim_intensity_counts_std": error,
        "intensity_counts": seen + error * rng.normal(size=sim.size) / np.sqrt(10.0),
    }))  # fmt: skip
    (found,) = diagnose(made)[0].findings
    assert found.effect == "beam.profile_change"
    assert "housing_temperature_c" in found.drivers


@pytest.mark.parametrize("below_v", [4.975, 4.9])
def test_a_regulator_that_drops_out_couples_its_rail_below_a_knee_only(below_v):
    rng = np.random.default_rng(6)
    step, row = (a.ravel() for a in np.meshgrid(np.arange(60), np.arange(30), indexing="ij"))
    rail = rng.uniform(4.8, 5.1, 60)[step]
    head = (rail - below_v) / 0.005  # a pass transistor that saturates: the output follows once no head is left
    output = 3.3 - np.where(head < 40.0, 0.005 * np.log1p(np.exp(-np.clip(head, -500.0, 500.0))), 0.0)
    light = 300.0 + 60.0 * row
    error = np.sqrt(30.0 + 0.3 * light)
    made = columns_of(pa.table({
        "step": step, "pixel_u": row, "rail_5v0_v": rail, "rail_1v8_v": rng.uniform(1.78, 1.82, 60)[step],
        "housing_temperature_c": rng.uniform(0.0, 80.0, 60)[step], "n_frames": np.full(step.size, 10.0),
        "sim_intensity_counts": light, "sim_intensity_counts_std": error,
        "intensity_counts": light * output / 3.3 + error * rng.normal(size=step.size) / np.sqrt(10.0),
    }))  # fmt: skip
    (found,) = diagnose(made)[0].findings
    assert found.effect == "electronics.rail_coupling"
    assert found.drivers == ["rail_5v0_v"]
    knee = next(p for p in found.parameters if p.name == "knee")
    assert knee.value == pytest.approx(below_v, abs=0.02)
