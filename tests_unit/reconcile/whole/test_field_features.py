"""What depends on the place in the field as a whole: rings about the axis, and parts that twist."""

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from arl_fixtures.reconcile.command import predict, reconcile
from arl_fixtures.reconcile.features import features_of
from arl_fixtures.reconcile.locate import locate
from arl_fixtures.reconcile.pilot import Looker
from arl_fixtures.reconcile.problem import Problem
from arl_fixtures.reconcile.region import columns_as_drivers
from arl_fixtures.reconcile.table import columns_of
from arl_fixtures.reconcile.view import View

PIXELS_U, PIXELS_V, PITCH_DEG = 26, 18, 2.2
RAYS = {"azimuth_deg", "elevation_deg"}


def camera(seed: int, *, steps: int, change) -> dict[str, np.ndarray]:
    """A camera before a wall of tiles, one image a step; `change` returns factor of the light and metres to add."""
    rng = np.random.default_rng(seed)
    step, v, u = (
        a.ravel().astype(float)
        for a in np.meshgrid(np.arange(steps), np.arange(PIXELS_V), np.arange(PIXELS_U), indexing="ij")
    )
    azimuth, elevation = (u - (PIXELS_U - 1) / 2) * PITCH_DEG, (v - (PIXELS_V - 1) / 2) * PITCH_DEG
    light = 2000.0 + 300.0 * ((u + 2.0 * v) % 7.0)
    sigma_i, sigma_d = np.sqrt(20.0 + 0.3 * light), np.full(u.size, 0.004)
    made = {
        "step": step, "pixel_u": u, "pixel_v": v, "azimuth_deg": azimuth, "elevation_deg": elevation,
        "time_s": 900.0 * step, "tof_temperature_c": -10.0 + 95.0 * step / (steps - 1),
        "n_frames": np.full(u.size, 16.0),
        "sim_intensity_counts": light, "sim_intensity_counts_std": sigma_i,
        "sim_distance_m": np.full(u.size, 2.0), "sim_distance_m_std": sigma_d,
    }  # fmt: skip
    factor, farther = change(made, rng)
    made["intensity_counts"] = light * factor + sigma_i / 4.0 * rng.normal(size=u.size)
    made["distance_m"] = 2.0 + farther + sigma_d / 4.0 * rng.normal(size=u.size)
    return made


def bubble(made, _rng):
    """A ball of 14° about the axis in the lens' cement that swells as it warms: the way through it, ray by ray."""
    u, v = (np.radians(made[name]) for name in ("azimuth_deg", "elevation_deg"))
    ray = np.stack([np.cos(v) * np.cos(u), np.cos(v) * np.sin(u), np.sin(v)])
    along = ray[0]  # from the pupil to the ball's middle, one unit ahead, projected on the ray
    inside = np.maximum(along**2 - 1.0 + np.sin(np.radians(14.0)) ** 2, 0.0)
    warm = 1.0 - np.exp(-(made["tof_temperature_c"] + 10.0) / 40.0)
    return 1.0, 0.012 * warm * 2.0 * np.sqrt(inside)


def lifted_corner(made, rng):
    """A board held at its corners, which each step settle anew: in between it lies as straight lines join them."""
    place_u, place_v = (made[name] / made[name].max() for name in ("pixel_u", "pixel_v"))
    height = rng.normal(0.0, 2.5e-3, 200)[made["step"].astype(int)]
    left, right = height * (1.0 - place_v) - height * place_v, height * place_v - height * (1.0 - place_v)
    return 1.0, left * (1.0 - place_u) + right * place_u


@pytest.mark.parametrize("rays", [True, False])
def test_a_twist_that_every_step_has_anew_is_one_place(rays):
    table = camera(5, steps=12, change=lifted_corner)
    made = columns_of(pa.table({n: v for n, v in table.items() if rays or n not in RAYS}))
    looker = Looker(Problem(made))
    data = next(d for d in looker.problem.data if d.channel.name == "distance_m")
    state = looker.problem.view.fresh_state()
    looker.calibrate(data, state)
    place = locate(looker, data, state)
    assert place is not None
    assert place.columns == ["~twist(field)", "step"]
    assert set(columns_as_drivers(place.columns, looker.problem.view)) == {"step"} | (
        RAYS if rays else {"pixel_u", "pixel_v"}
    )


def test_what_is_round_about_the_axis_is_predicted_on_pixels_never_seen(tmp_path):
    table = {name: x for name, x in camera(6, steps=5, change=bubble).items() if "intensity_counts" not in name}
    truth = bubble(table, None)[1]
    pixel = (table["pixel_v"] * PIXELS_U + table["pixel_u"]).astype(int)
    held = (np.random.default_rng(1).uniform(size=PIXELS_U * PIXELS_V) < 0.3)[pixel]
    pq.write_table(pa.table({n: v[~held] for n, v in table.items()}), tmp_path / "seen.parquet")
    unseen = {n: v[held] for n, v in table.items() if n != "distance_m"}
    pq.write_table(pa.table(unseen), tmp_path / "unseen.parquet")
    diagnosis = reconcile(tmp_path / "seen.parquet", tmp_path / "out")
    predict(tmp_path / "out", tmp_path / "unseen.parquet", tmp_path / "p.parquet")
    left = pq.read_table(tmp_path / "p.parquet")["corrected_distance_m"].to_numpy() - 2.0 - truth[held]
    assert {f.effect for f in diagnosis.findings} == {"unknown"}
    assert np.var(left) < 0.05 * np.var(truth[held])


def test_a_scanner_that_looks_all_around_has_no_field():
    around = {"azimuth_deg": np.arange(360.0), "elevation_deg": np.tile([-5.0, 5.0], 180)}
    table = {"sim_distance_m": np.ones(360), "distance_m": np.ones(360), **around}
    assert not [n for n in features_of(View(columns_of(pa.table(table)))) if "field" in n]
