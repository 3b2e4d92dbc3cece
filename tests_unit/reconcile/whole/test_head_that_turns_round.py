"""A scanner's head that turns round: its azimuth is no angle in a lens's field of view."""

import numpy as np
import pyarrow as pa
import pytest

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.fit import fit
from arl_fixtures.reconcile.pilot import Looker
from arl_fixtures.reconcile.problem import Problem
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.steadiness import is_unsteady
from arl_fixtures.reconcile.table import columns_of
from arl_fixtures.reconcile.terms import Term

TURNS = ("mount.tilt", "stage.zero_offset", "stage.periodic_error", "stage.eccentricity", "timing.range_walk",
         "timing.clock_scale", "air.multipath", "target.edge_mixing")  # fmt: skip


def scanner(seed, polarised):
    """Four beams round a hall; its mirror, at half a right angle, passes two polarisations unlike."""
    rng = np.random.default_rng(seed)
    step, around, beam = (x.ravel() for x in np.meshgrid(np.arange(10), np.arange(20), np.arange(4), indexing="ij"))
    azimuth, elevation = 18.0 * around, np.array([-8.0, -3.0, 3.0, 8.0])[beam]
    walls = rng.integers(0, 8, 20)[around]
    far = rng.uniform(3.0, 10.0, 20)[around]
    sim = 6e4 * np.linspace(0.15, 0.85, 8)[walls] / far**2
    turned = np.radians(azimuth)  # plane of incidence on the mirror against the laser's plane of polarisation
    s, p = 0.94, 0.94 * (1.0 - polarised)
    passed = s * np.sin(turned) ** 2 + p * np.cos(turned) ** 2
    error = np.sqrt(9.0 + 1.2 * sim + (4e-3 * sim) ** 2)
    return columns_of(pa.table({
        "step": step.astype(float), "azimuth_deg": azimuth, "elevation_deg": elevation, "pixel_v": beam.astype(float),
        "surface": np.array([f"panel {k}" for k in range(8)])[walls], "n_frames": np.full(step.size, 8.0),
        "tof_temperature_c": 9.0 * step - 20.0, "true_range_m": far,
        "sim_intensity_counts": sim, "sim_intensity_counts_std": error,
        "intensity_counts": sim * passed / 0.92 + error / np.sqrt(8.0) * rng.normal(size=step.size),
    }))  # fmt: skip


def test_what_goes_round_twice_is_no_passband():
    (found,) = diagnose(scanner(5, 0.05))[0].findings
    assert (found.effect, found.drivers[0]) == ("unknown", "azimuth_deg")


def tilted_hall(seed, pitch_deg, west_m):
    """Sixteen beams in a hall whose floor the lowest sees, in two corners only; the head nods by `pitch_deg`."""
    rng = np.random.default_rng(seed)
    step, around, beam = (x.ravel() for x in np.meshgrid(np.arange(2), np.arange(110), np.arange(16), indexing="ij"))
    az, el = np.radians(around * 360.0 / 110.0 - 180.0), np.radians(1.6 * beam - 12.0)
    ray = np.stack([np.cos(el) * np.cos(az), np.cos(el) * np.sin(az), np.sin(el)])
    nod = np.radians(pitch_deg)
    nodded = np.stack(
        [np.cos(nod) * ray[0] - np.sin(nod) * ray[2], ray[1], np.cos(nod) * ray[2] + np.sin(nod) * ray[0]]
    )
    far, wall, facing = hall(ray, west_m)
    far_seen, wall_seen, facing_seen = hall(nodded, west_m)
    paint = 2.6e4 * np.array([0.5, 0.3, 0.5, 0.3, 0.15])
    sim, light = paint[wall] * facing / far**2, paint[wall_seen] * facing_seen / far_seen**2
    error, blur = np.sqrt(25.0 + sim), np.full(far.size, 0.011)
    return columns_of(pa.table({
        "step": step.astype(float), "azimuth_deg": np.degrees(az), "elevation_deg": np.degrees(el),
        "pixel_v": beam.astype(float), "housing_temperature_c": 10.0 * step + 15.0, "true_range_m": far,
        "incidence_deg": np.degrees(np.arccos(facing)),
        "surface": np.array(["east", "north", "west", "south", "floor"])[wall], "n_frames": np.full(far.size, 20.0),
        "sim_intensity_counts": sim, "sim_intensity_counts_std": error,
        "sim_distance_m": far, "sim_distance_m_std": blur,
        "intensity_counts": light + error / np.sqrt(20.0) * rng.normal(size=far.size),
        "distance_m": far_seen + blur / np.sqrt(20.0) * rng.normal(size=far.size),
    }))  # fmt: skip


def hall(ray, west_m):
    """Range, number of the wall and cosine of the incidence of unit rays from a place 1.44 m above the floor."""
    ahead, left, up = ray
    away = np.array([4.5, 4.55, west_m, 4.55, 1.44])
    towards = np.stack([ahead, left, -ahead, -left, -up])
    with np.errstate(divide="ignore"):
        far = np.where(towards > 1e-9, away[:, None] / towards, np.inf)
    wall = np.argmin(far, axis=0)
    return far.min(axis=0), wall, np.take_along_axis(towards, wall[None], axis=0)[0]


@pytest.mark.parametrize(
    ("west_m", "told"),
    [pytest.param(5.4, True, id="one ray a corner"), pytest.param(5.8, False, id="few rays and no incidence")],
)
def test_a_floor_that_one_beam_sees_in_two_corners_is_a_plane_too(west_m, told):
    columns = tilted_hall(8, -0.034, west_m)
    if not told:
        del columns.numbers["incidence_deg"]
    (found,) = diagnose(columns, effects=[library()[n] for n in TURNS])[0].findings
    assert found.effect == "mount.tilt"
    pitch = next(p for p in found.parameters if p.name == "pitch")
    assert pitch.low < -0.034 < pitch.high


def moved_head(seed, wave_deg, zero_deg, right_m=0.0):
    """A head that stands at another place and heading in every step.

    Its encoder is off, with three waves a turn, or its optical centre lies beside its axis.
    """
    rng = np.random.default_rng(seed)
    step, around, beam = (x.ravel() for x in np.meshgrid(np.arange(4), np.arange(120), np.arange(8), indexing="ij"))
    azimuth, el = 3.0 * around, np.radians(4.0 * beam - 14.0)
    east, north = rng.uniform(3.0, 6.0, 4), rng.uniform(2.5, 4.0, 4)
    heading = rng.uniform(0.0, 90.0, 4)

    def look(turn_deg, right_m=0.0):
        az = np.radians(azimuth + heading[step] + turn_deg)
        ray = np.stack([np.cos(el) * np.cos(az), np.cos(el) * np.sin(az), np.sin(el)])
        x, y = east[step] - right_m * np.sin(az), north[step] + right_m * np.cos(az)
        away = np.stack([9.0 - x, 6.5 - y, x, y, np.full(step.size, 1.4)])
        towards = np.stack([ray[0], ray[1], -ray[0], -ray[1], -ray[2]])
        with np.errstate(divide="ignore"):
            far = np.where(towards > 1e-9, away / towards, np.inf)
        wall = np.argmin(far, axis=0)
        return far.min(axis=0), wall

    far, wall = look(0.0)
    seen = look(zero_deg + wave_deg * np.sin(np.radians(3.0 * azimuth)), right_m)[0]
    return columns_of(pa.table({
        "step": step.astype(float), "azimuth_deg": azimuth, "elevation_deg": np.degrees(el),
        "surface": np.array(["east", "north", "west", "south", "floor"])[wall], "n_frames": np.full(far.size, 5.0),
        "sim_range_m": far, "sim_range_m_std": np.full(far.size, 0.01), "rotor_temperature_c": 25.0 + 5.0 * step,
        "range_m": seen + 0.01 / np.sqrt(5.0) * rng.normal(size=far.size),
    }))  # fmt: skip


@pytest.mark.parametrize(
    ("wave_deg", "zero_deg", "name"), [(0.0, 0.03, "stage.zero_offset"), (0.05, 0.0, "stage.periodic_error")]
)
def test_a_head_sees_other_walls_where_it_was_moved_between_steps(wave_deg, zero_deg, name):
    (found,) = diagnose(moved_head(4, wave_deg, zero_deg), effects=[library()[n] for n in TURNS])[0].findings
    assert (found.effect, found.drivers) == (name, ["azimuth_deg"])
    alike = {"mount.tilt", "stage.eccentricity"}  # far walls turn alike, whatever turns
    assert {"mount.tilt"} <= set(found.equivalent_to) <= alike if zero_deg else found.equivalent_to == []
    by_name = {p.name: p for p in found.parameters}
    if zero_deg:
        assert by_name["zero"].low < zero_deg < by_name["zero"].high
    else:
        assert by_name["period"].value == pytest.approx(120.0, rel=0.02)


def test_an_optical_centre_beside_the_axis_of_a_head_sees_near_walls_turned_by_more():
    (found,) = diagnose(moved_head(6, 0.0, 0.0, 0.01), effects=[library()[n] for n in TURNS])[0].findings
    assert found.effect == "stage.eccentricity"
    by_name = {p.name: p for p in found.parameters}
    assert by_name["right"].low < 0.01 < by_name["right"].high


def test_a_head_that_was_moved_and_reads_right_is_silent():
    diagnosis = diagnose(moved_head(5, 0.0, 0.0), effects=[library()[n] for n in TURNS])[0]
    assert diagnosis.findings == []
    assert not [why for why in diagnosis.notes.values() if "was not tried" in why]


def standing_head(seed, zero_deg_of_days):
    """A head that stands in the middle of the hall, its encoder's zero off by another angle every day."""
    rng = np.random.default_rng(seed)
    zero = np.array(zero_deg_of_days)
    day, around, beam = (x.ravel() for x in np.meshgrid(np.arange(zero.size), np.arange(90), np.arange(6),
                                                         indexing="ij"))  # fmt: skip
    azimuth, el = 4.0 * around - 180.0, np.radians(3.0 * beam - 10.0)

    def look(turn_deg):
        az = np.radians(azimuth + turn_deg)
        return hall(np.stack([np.cos(el) * np.cos(az), np.cos(el) * np.sin(az), np.sin(el)]), 5.4)

    (far, wall, facing), (seen, _, _) = look(0.0), look(zero[day])
    return columns_of(pa.table({
        "step": day.astype(float), "azimuth_deg": azimuth, "elevation_deg": np.degrees(el),
        "tof_temperature_c": 9.0 * day - 20.0, "incidence_deg": np.degrees(np.arccos(facing)),
        "surface": np.array(["east", "north", "west", "south", "floor"])[wall], "n_frames": np.full(far.size, 10.0),
        "sim_distance_m": far, "sim_distance_m_std": np.full(far.size, 0.01),
        "distance_m": seen + 0.01 / np.sqrt(10.0) * rng.normal(size=far.size),
    }))  # fmt: skip


@pytest.mark.parametrize(("zero_deg_of_days", "holds"), [([0.05] * 6, True), ([0.0] * 5 + [0.3], False)])
def test_a_zero_of_one_day_is_no_zero_of_the_stage(zero_deg_of_days, holds):
    problem, effect = Problem(standing_head(7, zero_deg_of_days)), library()["stage.zero_offset"]
    variant = next(v for v in effect.variants(problem.view) if "channel" not in v.options)
    term = fit(problem, [Term(effect=effect, variant=variant, values={"zero": 0.01})]).terms[0]
    assert term.values["zero"] == pytest.approx(0.05, abs=0.01)  # on their average both are off by as much
    assert is_unsteady(Looker(problem), [term], term) is not holds
