"""Pixels that leak into each other where the table holds none of their neighbours, against a bench traced here."""

import numpy as np
import pytest
from traced_bench import LIGHT, table, trace

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.effects_bench import bench_of
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
