"""A line of pixels on a post that looks down a road with boards on it: rays are traced here."""

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from operator_tables import fit
from rendered_bench import variant_of

from arl_fixtures.reconcile.command import reconcile
from arl_fixtures.reconcile.derived_rays import derive_rays
from arl_fixtures.reconcile.table import columns_of
from arl_fixtures.reconcile.view import View

HEIGHT_M, DOWN_DEG = 4.0, -6.0
BOARDS = ((22.0, -8.0, -3.0), (30.0, 4.0, 9.0))
"""Range ahead, from and to across, metres; they stand upright and face the sensor."""
AZIMUTH_DEG = np.linspace(-30.0, 30.0, 121)


def seen(azimuth_deg, **tilt):
    """Light and range by light of pixels that see side by side, and the incidence in their middles."""
    across = np.diff(AZIMUTH_DEG)[0] * (np.arange(25) - 12) / 25.0
    light, far, _ = np.moveaxis([rays(azimuth_deg + off, **tilt) for off in across], 1, 0)
    return light.mean(axis=0), np.average(far, axis=0, weights=light), rays(azimuth_deg, **tilt)[2]


def rays(azimuth_deg, pitch_deg=0.0, roll_deg=0.0):
    """Light, range and incidence of rays of a cone about the vertical, turned as a whole about level axes."""
    az, el = np.radians(azimuth_deg), np.radians(DOWN_DEG)
    x, y, z = np.cos(el) * np.cos(az), np.cos(el) * np.sin(az), np.sin(el) * np.ones_like(az)
    p, r = np.radians([pitch_deg, roll_deg])
    x, z = x * np.cos(p) - z * np.sin(p), x * np.sin(p) + z * np.cos(p)
    y, z = y * np.cos(r) + z * np.sin(r), -y * np.sin(r) + z * np.cos(r)
    far, facing = np.where(z < 0.0, -HEIGHT_M / np.minimum(z, -1e-9), np.inf), -z
    paint = np.full(az.size, 0.2)
    for ahead, left, right in BOARDS:
        there = ahead / x
        on = (there < far) & (there * y > left) & (there * y < right)
        far, facing, paint = np.where(on, there, far), np.where(on, x, facing), np.where(on, 0.6, paint)
    return 3e6 * paint * facing / far**2, far, np.degrees(np.arccos(facing))


def table(seed, **tilt):
    """Twelve looks of a line that is tilted, and the simulation of one that is not."""
    rng = np.random.default_rng(seed)
    steps = 12
    azimuth = np.tile(AZIMUTH_DEG, steps)
    (light, far, met), (real, real_far, _) = seen(azimuth), seen(azimuth, **tilt)
    return pa.table({
        "step": np.repeat(np.arange(steps), AZIMUTH_DEG.size), "pixel_u": np.tile(np.arange(121), steps),
        "azimuth_deg": azimuth, "incidence_deg": met, "true_range_m": far, "n_frames": np.full(azimuth.size, 4),
        "sim_intensity_counts": light, "sim_intensity_counts_std": 0.05 * light,
        "intensity_counts": real * (1.0 + 0.025 * rng.normal(size=azimuth.size)),
        "sim_distance_m": far, "sim_distance_m_std": np.full(azimuth.size, 0.2),
        "distance_m": real_far + 0.1 * rng.normal(size=azimuth.size),
    })  # fmt: skip


def test_the_floor_tells_how_steeply_a_line_looks_down():
    columns = columns_of(table(1))
    assert derive_rays(columns)
    assert columns.derived["elevation_deg"] == pytest.approx(DOWN_DEG, abs=0.02)


def test_what_stands_upright_tells_nothing():
    """There the incidence follows the azimuth."""
    columns = columns_of(table(1))
    columns.numbers["incidence_deg"] = 40.0 + np.abs(columns.numbers["azimuth_deg"])
    assert not derive_rays(columns)


def test_a_line_that_is_pitched_sees_the_road_farther_away():
    columns = columns_of(table(2, pitch_deg=0.05, roll_deg=-0.04))
    assert derive_rays(columns)
    view = View(columns)
    values = fit(view, variant_of(view, "mount.tilt"), "distance_m", {"yaw": 0.0, "pitch": 0.02, "roll": 0.02})
    assert values["pitch"] == pytest.approx(0.05, abs=0.006)
    assert values["roll"] == pytest.approx(-0.04, abs=0.012)


def test_a_page_and_a_model_say_how_steeply_it_looks(tmp_path):
    path = tmp_path / "table.parquet"
    pq.write_table(table(3), path)
    reconcile(path, tmp_path / "out")
    assert "shows -6°" in (tmp_path / "out" / "diagnosis.html").read_text()
    unseen = columns_of(table(4).slice(0, 40))
    assert not derive_rays(columns_of(table(4).slice(0, 10)))
    assert derive_rays(unseen, known=True, lens={"elevation_deg": DOWN_DEG})
    assert np.all(unseen.derived["elevation_deg"] == DOWN_DEG)
