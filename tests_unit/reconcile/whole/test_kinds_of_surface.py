"""Walls of one paint among posts of another: the rise of their light at a slant is one finding, and says where."""

import numpy as np
import pyarrow as pa

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of

RIVALS = [
    library()[name] for name in
    ("target.non_lambertian", "target.reflectance_error", "detector.compression", "optics.vignetting")
]  # fmt: skip
SURFACES = np.array(["wall_e", "wall_n", "wall_s", "wall_w", "post_a", "post_b"])


def of_facets(incidence_deg, roughness_deg):
    """Light back from facets that are Lambertian each and tilted at random, over that of a flat wall."""
    rng = np.random.default_rng(0)
    tilt = np.abs(rng.normal(0.0, np.radians(roughness_deg), 4000))
    turn = rng.uniform(0.0, 2.0 * np.pi, tilt.size)
    angle = np.radians(np.arange(0.0, 66.0, 1.0))[:, None]
    cosine = np.cos(angle) * np.cos(tilt) + np.sin(angle) * np.sin(tilt) * np.cos(turn)
    # of a facet is seen what it turns to the sensor, and it is lit by as much
    light = np.mean(np.maximum(cosine, 0.0) ** 2 / np.cos(tilt), axis=1) / np.cos(angle[:, 0]) ** 2
    return np.interp(incidence_deg, np.arange(0.0, 66.0, 1.0), light / light[0])


def room(seed, roughness_deg):
    rng = np.random.default_rng(seed)
    n = 2400
    surface, step = rng.integers(0, 6, n), rng.integers(0, 8, n)
    incidence, away = rng.uniform(0.0, 58.0, n), rng.uniform(1.5, 6.0, n)
    light = 4000.0 * np.cos(np.radians(incidence)) / away**2
    real = light * np.where(surface < 4, of_facets(incidence, roughness_deg), 1.0)
    real *= 1.0 + 5e-4 * rng.normal(size=8)[step]
    sigma = np.sqrt(light + 25.0)
    return columns_of(pa.table({
        "step": step, "time_s": step * 600.0 + rng.uniform(0.0, 300.0, n), "surface": SURFACES[surface],
        "incidence_deg": incidence, "true_range_m": away, "azimuth_deg": rng.uniform(-180.0, 180.0, n),
        "n_frames": np.full(n, 50.0), "sim_intensity_counts": light, "sim_intensity_counts_std": sigma,
        "intensity_counts": real + sigma / np.sqrt(50.0) * rng.normal(size=n),
    }))  # fmt: skip


def test_rough_walls_are_one_finding_that_leaves_the_posts_out():
    (finding,) = diagnose(room(1, 11.0), effects=RIVALS)[0].findings
    assert finding.effect == "target.non_lambertian"
    assert sorted(finding.where["surface"]) == ["wall_e", "wall_n", "wall_s", "wall_w"]


def test_a_small_board_among_ten_is_off_as_well_as_a_large_one():
    rng = np.random.default_rng(5)
    n = 4000
    share = 0.75 ** np.arange(10)
    board, step = rng.choice(10, n, p=share / share.sum()), rng.integers(0, 8, n)
    away, paint = rng.uniform(1.5, 6.0, n), rng.uniform(0.1, 0.9, 10)
    light = 9000.0 * paint[board] / away**2
    paint[9] *= 1.03  # by a month of sun
    real = 9000.0 * paint[board] / away**2 * (1.0 + 5e-4 * rng.normal(size=8)[step])
    sigma = np.sqrt(light + 25.0)
    columns = columns_of(pa.table({
        "step": step, "time_s": step * 600.0 + rng.uniform(0.0, 300.0, n),
        "surface": np.array(list("abcdefghij"))[board],
        "true_range_m": away, "azimuth_deg": rng.uniform(-20.0, 20.0, n), "n_frames": np.full(n, 50.0),
        "sim_intensity_counts": light, "sim_intensity_counts_std": sigma,
        "intensity_counts": real + sigma / np.sqrt(50.0) * rng.normal(size=n),
    }))  # fmt: skip
    (finding,) = diagnose(columns, effects=RIVALS)[0].findings
    assert (finding.effect, finding.where) == ("target.reflectance_error", {"surface": ["j"]})
