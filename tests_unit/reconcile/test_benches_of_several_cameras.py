"""Devices of one table that look through cameras of their own, tenths of a pixel apart: each is rendered as it is."""

import numpy as np
import pyarrow as pa
from scipy.ndimage import convolve

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.effects_bench import bench_of
from arl_fixtures.reconcile.table import columns_of
from arl_fixtures.reconcile.view import View
from arl_fixtures.twin.frame import Renderer
from arl_fixtures.twin.projection import Intrinsics
from arl_fixtures.twin.settings import DutSettings

SHARE = 0.01
FOUR = np.array([[0.0, 1.0, 0.0], [1.0, -4.0, 1.0], [0.0, 1.0, 0.0]])
DUTS = [
    DutSettings(serial="upper", height_m=0.1, intrinsics=Intrinsics(fx=58.3, cx=63.38, cy=15.6)),
    DutSettings(serial="lower", height_m=-0.1, intrinsics=Intrinsics(fx=57.95, fy=66.1, cx=63.61, k4=0.1985)),
]


def test_neighbours_that_a_table_lacks_are_those_of_the_devices_own_camera():
    u, v = (a.ravel() for a in np.meshgrid(np.arange(5, 124, 17), np.arange(3, 30, 5)))
    parts, leaks = [], []
    for dut in DUTS:
        for angle_deg in np.arange(-40.0, 41.0, 2.3):
            frame = Renderer(dut).expected(float(angle_deg))
            light = frame.intensity_counts.astype(float)
            leaks.append(SHARE * convolve(light, FOUR, mode="nearest")[v, u])
            parts.append(
                {
                    "dut": np.full(u.size, dut.serial), "pixel_u": u, "pixel_v": v,
                    "stage_angle_deg": np.full(u.size, angle_deg), "sim_intensity_counts": light[v, u],
                    "intensity_counts": light[v, u], "sim_distance_m": frame.distance_m[v, u],
                    "distance_m": frame.distance_m[v, u], "azimuth_deg": frame.azimuth_deg[v, u],
                    "elevation_deg": frame.elevation_deg[v, u],
                }
            )  # fmt: skip
    view = View(columns_of(pa.table({name: np.concatenate([p[name] for p in parts]) for name in parts[0]})))
    bench, leak = bench_of(view), np.concatenate(leaks)
    assert bench is not None
    assert bench.sharp
    effect, state = library()["detector.crosstalk"], view.fresh_state()
    variant = next(
        v for v in effect.variants(view) if v.options["direction"] == "both" and v.options["leaks"] == "charge"
    )
    effect.apply(variant, {"share": SHARE}, state, view)
    told = state["intensity_counts"] - view.sim["intensity_counts"]
    assert np.abs(leak).max() > 5.0
    # a ray in hundreds grazes an edge, which it misses by a thousandth of a pixel in the image of another camera
    assert np.quantile(np.abs(told - leak), 0.98) < 0.02
