"""What a pixel at a border would see of a surface alone, where the nearest pixel that does lies in another light."""

import numpy as np
import pyarrow as pa

from arl_fixtures.reconcile.effects_sides import part_of, sides_of
from arl_fixtures.reconcile.table import columns_of
from arl_fixtures.reconcile.view import View

COLUMNS, ROWS = 28, 20
BOARDS = {"left": (2.0, 6.4, 0.55), "middle": (9.7, 13.2, 0.8), "right": (17.0, 22.3, 0.3)}
"""From and to column, reflectance; in rows 3.5 to 16.5."""


def lit(u, v):
    """A beam that falls to a third at the corners of the image."""
    return 9e3 * np.exp(-0.5 * ((u - 13.5) / 12.0) ** 2 - 0.4 * ((v - 9.5) / 10.0) ** 2)


def picture(blur_px):
    """Three boards before a dark wall through a lens, 41 rays across each pixel: the view, and what boards fill."""
    u, v = (x.ravel().astype(float) for x in np.meshgrid(np.arange(COLUMNS), np.arange(ROWS)))
    across = np.linspace(-0.5, 0.5, 41)
    rays = np.concatenate([across + x for x in blur_px * np.array([-1.5, -1.0, -0.5, 0.0, 0.5, 1.0, 1.5])])
    weight = np.repeat(np.exp(-0.5 * np.array([1.5, 1.0, 0.5, 0.0, 0.5, 1.0, 1.5]) ** 2), across.size)
    weight /= weight.sum()
    inside = (v > 3.5) & (v < 16.5)
    fills = {
        name: np.where(inside, ((u[:, None] + rays > low) & (u[:, None] + rays < high)) @ weight, 0.0)
        for name, (low, high, _) in BOARDS.items()
    }
    boards = sum(fills.values())
    light = lit(u, v) * (sum(f * BOARDS[name][2] for name, f in fills.items()) + 0.06 * (1.0 - boards) / 1.7**2)
    most = np.array(list(fills))[np.argmax(np.stack(list(fills.values())), axis=0)]
    beside = np.any([np.abs(u - edge) < 1.7 for low, high, _ in BOARDS.values() for edge in (low, high)], axis=0)
    far = np.where(boards > 0.5, 1.0, 1.7)
    view = View(columns_of(pa.table({
        "pixel_u": u, "pixel_v": v, "surface": np.where(boards > 0.5, most, "wall"), "mixed": beside & inside,
        "sim_intensity_counts": light, "sim_distance_m": far, "intensity_counts": light, "distance_m": far,
    })))  # fmt: skip
    return view, boards


def test_light_that_falls_off_along_a_wall_is_no_part_of_a_board():
    view, boards = picture(0.0)
    part = part_of(sides_of(view), view, "intensity_counts")
    own = view.columns.categories["surface"][0][view.rows]
    wall = np.array([label == "wall" for label in view.columns.categories["surface"][1]])[own]
    alone = wall & (boards < 1e-3) & np.isfinite(part)
    assert alone.sum() > 20
    assert np.max(part[alone]) < 2e-3  # a border that is not there would be swept as fast as any


def test_no_board_goes_on_beyond_its_few_columns_as_its_rows_do():
    """Rows of the one column that shows a board alone tell its light up and down, and nothing of it beside."""
    view, _ = picture(0.3)
    sides, light = sides_of(view), view.number("sim_intensity_counts")
    own, _ = sides.seen(view, "sim_intensity_counts")
    shown = np.isfinite(own)
    assert shown.sum() > 100
    np.testing.assert_allclose(own[shown], light[sides.own[shown]], rtol=0.8)
    code = list(view.columns.categories["surface"][1]).index("left")
    left = shown & (view.columns.categories["surface"][0][view.rows] == code)
    np.testing.assert_allclose(own[left], light[sides.own[left]], rtol=0.05)
