"""A few pixels at five angles, those at edges left out: no curve over the bearing joins them, but planes do."""

import numpy as np
import pyarrow as pa
import pytest
from traced_bench import FIFTEENTHS, STRIPES, angles_of, trace

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of
from arl_fixtures.reconcile.view import View

KNOWN = [
    library()[name] for name in (
        "stage.eccentricity", "stage.zero_offset", "mount.tilt", "timing.row_skew", "readout.column_pattern",
        "beam.profile_change", "optics.vignetting", "target.reflectance_error", "timing.clock_scale",
    )
]  # fmt: skip
BENCH = {"arc_m": 1.2, "wall_m": 2.1, "paint": 0.1, "tall": 5.0}


def sweep(seed, *, turn_deg=0.0, forward_m=0.0, noise=1.0, edges=False):
    """Stripes before a round wall at five stage angles, twelve times; rows at edges are left out unless wanted."""
    rng = np.random.default_rng(seed)
    columns = np.array([4, 28, 44, 48, 51, 55, 61, 65, 72, 75, 84, 98, 122])
    axes = np.meshgrid(np.arange(12), np.arange(-30.0, 31.0, 15.0) + 0.4, columns, (2, 16, 29), indexing="ij")
    step, angle, u, v = (a.ravel() + 0.0 for a in axes)
    first = step == 0.0

    def seen(turn=0.0, **other):
        one = trace(u[first], v[first], angle[first] + turn, 0.0, places=FIFTEENTHS, **BENCH, **other)
        return [np.tile(x, 12) for x in one]

    light, far = seen()
    real_light, real_far = seen(turn_deg, forward_m=forward_m)
    ends = [np.tile(trace(u[first] + part, v[first], angle[first], 0.0, places=(0.0,), **BENCH)[1], 12)
            for part in (-0.9, 0.0, 0.9)]  # fmt: skip
    mixed = np.ptp(ends, axis=0) > 0.2
    azimuth, elevation = angles_of(u, v)
    gain = 4840.0 * np.exp(-((azimuth / 75.0) ** 4) - (elevation / 18.0) ** 4)
    sigma_i, sigma_d = np.sqrt(36.0 + 0.25 * gain * light), np.full(u.size, 0.004)
    level = np.cos(np.radians(elevation))
    off = np.abs([azimuth + angle + own for own, _ in STRIPES])
    facing = level * np.where(far < 1.8, np.cos(np.radians(off.min(axis=0))), 1.0)  # the wall is round
    surface = np.where(far < 1.8, np.array(["right", "middle", "left"])[off.argmin(axis=0)], "wall")
    shared = noise * rng.normal(size=(2, 12))[:, step.astype(int)] * np.array([[4e-3], [1e-3]])
    scatter = noise * rng.normal(size=(2, u.size)) / np.sqrt(30.0)
    made = {
        "step": step, "set_temperature_c": 9.0 * step - 30.0, "stage_angle_deg": angle, "pixel_u": u, "pixel_v": v,
        "azimuth_deg": azimuth, "elevation_deg": elevation, "mixed": mixed, "surface": surface,
        "n_frames": np.full(u.size, 30.0), "incidence_deg": np.degrees(np.arccos(facing)),
        "time_s": 900.0 * step + 10.0 * angle,
        "sim_intensity_counts": gain * light, "sim_intensity_counts_std": sigma_i,
        "sim_intensity_counts_repeat_std": 4e-3 * gain * light, "sim_distance_m": far, "sim_distance_m_std": sigma_d,
        "sim_distance_m_repeat_std": np.full(u.size, 1e-3),
        "intensity_counts": gain * real_light * (1.0 + shared[0]) + sigma_i * scatter[0],
        "distance_m": real_far + shared[1] + sigma_d * scatter[1],
    }  # fmt: skip
    dotted = (np.abs(np.abs(azimuth + angle) - 45.0) < 18.0) & (far < 1.8)  # boards that pixels do not resolve
    kept = ~dotted & (edges | ~mixed)
    return columns_of(pa.table({name: values[kept] for name, values in made.items()}))


@pytest.mark.parametrize("seed", [1, 2])
def test_an_axis_beside_the_sensor_is_told_on_surfaces_whose_edges_were_left_out(seed):
    (found,) = diagnose(sweep(seed, forward_m=0.0015), effects=KNOWN)[0].findings
    assert found.effect == "stage.eccentricity"
    assert "distance_m" in found.channels


def turned(columns):
    """Ranges through a stage 0.35 degrees off as the tool makes them, as they are, and as simulated."""
    view = View(columns)
    effect, state = library()["stage.zero_offset"], view.fresh_state()
    variant = next(v for v in effect.variants(view) if v.options["kind"] == "constant")
    effect.apply(variant, {"zero": 0.35}, state, view)
    return view, state["distance_m"], view.number("distance_m"), view.sim["distance_m"]


def test_a_turned_stage_leaves_a_round_wall_where_it_was():
    _, said, real, simulated = turned(sweep(1, turn_deg=0.35, noise=0.0))
    on_stripe = simulated < 1.8
    assert on_stripe.sum() > 100
    left, before = (np.sqrt(np.mean((x - real)[on_stripe] ** 2)) for x in (said, simulated))
    assert left < 0.15 * before
    assert np.abs(said - real)[~on_stripe].max() < 0.3 * before


def test_rows_of_two_surfaces_lie_on_no_plane_and_trouble_none():
    view, said, real, simulated = turned(sweep(1, turn_deg=0.35, noise=0.0, edges=True))
    mixed = view.selects("mixed", "true")
    assert 0.05 < mixed.mean() < 0.5
    on_stripe = (simulated < 1.8) & ~mixed
    left, before = (np.sqrt(np.mean((x - real)[on_stripe] ** 2)) for x in (said, simulated))
    assert left < 0.15 * before
    assert np.any(said[mixed] != simulated[mixed])
