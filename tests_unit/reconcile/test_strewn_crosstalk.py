"""Pixels that leak into each other where the table holds none of their neighbours, against a bench traced here."""

import numpy as np
import pyarrow as pa
import pytest
from traced_bench import LIGHT, table, trace
from upright_boards import COLUMNS, F_PX, ROWS, seen

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.effects_bench import bench_of
from arl_fixtures.reconcile.table import columns_of
from arl_fixtures.reconcile.view import View


def beam(u, v):
    x, y = (u - 63.5) / 58.1, (v - 15.5) / 66.0
    grow = 2.0 / (1.0 + np.sqrt(1.0 - 4.0 * 0.198 * (x * x + y * y)))
    azimuth = np.degrees(np.arctan(x * grow))
    elevation = np.degrees(np.arcsin(-y * grow / np.sqrt(1.0 + (x * grow) ** 2 + (y * grow) ** 2)))
    return 4000.0 * 1.1**2 * np.exp(-((azimuth / 75.0) ** 4) - (elevation / 18.0) ** 4)


@pytest.mark.parametrize(("direction", "across"), [("both", 1.0), ("uneven", 0.3), ("rows", 0.0)])
def test_what_a_pixel_gets_from_neighbours_outside_the_table(direction, across):
    columns = table(noise=False)
    u, v, stage = (columns.numbers[n] for n in ("pixel_u", "pixel_v", "stage_angle_deg"))
    own = columns.numbers[f"sim_{LIGHT}"]
    leaked = np.zeros(u.size)
    for du, dv, part in ((1, 0, 1.0), (-1, 0, 1.0), (0, 1, across), (0, -1, across)):
        other = beam(u + du, v + dv) * trace(u + du, v + dv, stage, 0.10)[0]
        leaked += 0.02 * part * (other - own)
    view = View(columns)
    assert bench_of(view) is not None
    effect = library()["detector.crosstalk"]
    variant = next(
        v for v in effect.variants(view) if v.options["direction"] == direction and v.options["leaks"] == "charge"
    )
    state = view.fresh_state()
    before = state[LIGHT].copy()
    effect.apply(
        variant, {"share": 0.02, "across": across} if direction == "uneven" else {"share": 0.02}, state, view
    )
    said = state[LIGHT] - before
    assert np.sqrt(np.mean((said - leaked) ** 2)) < 0.05 * np.sqrt(np.mean(leaked**2))


def test_a_swept_scene_tells_what_neighbours_outside_the_table_see():
    """A camera that is no bench of ours, every fourth column of it; a neighbour's whole pulse leaks."""
    u, v, stage = (
        x.ravel()
        for x in np.meshgrid(
            np.arange(1.0, COLUMNS - 1, 4.0), np.arange(ROWS), np.arange(-28.0, 28.5, 0.9), indexing="ij"
        )
    )
    light, far = seen(u, v, stage)
    share, moment, total = 0.02, far * light * (1.0 - 2 * 0.02), light * (1.0 - 2 * 0.02)
    for du in (-1.0, 1.0):
        other, there = seen(u + du, v, stage)
        total, moment = total + share * other, moment + share * other * there
    columns = columns_of(pa.table({
        "pixel_u": u, "pixel_v": v, "stage_angle_deg": stage, "step": np.zeros(u.size),
        "azimuth_deg": np.degrees(np.arctan((u - (COLUMNS - 1) / 2) / F_PX)),
        "elevation_deg": np.degrees(np.arctan(((ROWS - 1) / 2 - v) / np.hypot(F_PX, u - (COLUMNS - 1) / 2))),
        "sim_intensity_counts": 1000.0 * light, "sim_intensity_counts_std": np.full(u.size, 5.0),
        "intensity_counts": 1000.0 * total, "sim_distance_m": far, "sim_distance_m_std": np.full(u.size, 0.01),
        "distance_m": moment / total,
    }))  # fmt: skip
    view = View(columns)
    assert bench_of(view) is None
    effect = library()["detector.crosstalk"]
    options = {"direction": "rows", "leaks": "pulse"}
    variant = next(v for v in effect.variants(view) if options.items() <= v.options.items())
    state = view.fresh_state()
    effect.apply(variant, {"share": share}, state, view)
    for name, truth in ((LIGHT, 1000.0 * total), ("distance_m", moment / total)):
        wanted = truth - view.sim[name]
        assert np.sqrt(np.mean((state[name] - truth) ** 2)) < 0.2 * np.sqrt(np.mean(wanted**2))
