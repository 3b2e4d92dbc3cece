"""Where pixels look, in a table that does not say so but whose simulation or rays show it.

A table of pixels at stage angles need not carry their azimuth and elevation. Where light and range are those of the
nominal bench (see `effects_bench`), its camera's are known, and so they are where one of the two angles is given and
is the nominal camera's in every pixel, whatever the scene. Else the sweep tells (see `swept_rays`), or, beside
azimuths, the planes that pixels see (see `camera_of_planes`), or a line the floor below it (see `line_over_floor`).
Effects see them as columns; laws and reports do not, for the table has none: there a pixel's own column stands for
them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, replace

import numpy as np

from arl_fixtures.reconcile.camera_of_planes import bend_of, camera_of_planes
from arl_fixtures.reconcile.columns import Columns
from arl_fixtures.reconcile.effect import Variant
from arl_fixtures.reconcile.effects_bench import bench_of
from arl_fixtures.reconcile.effects_camera import Camera, cameras_of
from arl_fixtures.reconcile.line_over_floor import elevation_of_line
from arl_fixtures.reconcile.swept_rays import camera_of_sweep, rows_of_pixels
from arl_fixtures.reconcile.view import View

FLATTER = 0.5
"""Share of how far ranges are off planes with a sweep's camera, from which that of the planes is the better one."""
_STANDS_FOR = {"azimuth_deg": "pixel_u", "elevation_deg": "pixel_v"}


def derive_rays(columns: Columns, *, known: bool = False, lens: Mapping[str, float] | None = None) -> bool:
    """Give a table's rows the azimuth and elevation that it lacks; whether it lacked them and has them now.

    Args:
        columns: `derived` is filled, and `lens` where a sweep tells it.
        known: that the simulation is the nominal bench; else the table must show it.
        lens: of the camera, where another table's sweep has told it; of a line only its elevation.
    """
    lacking = [name for name in _STANDS_FOR if name not in columns.numbers]
    if not lacking or "pixel_u" not in columns.numbers:
        return False
    view = View(columns)
    if lacking == ["elevation_deg"] and "pixel_v" not in columns.numbers:
        return _of_line(columns, lens["elevation_deg"] if lens else elevation_of_line(view))
    camera = Camera(**lens) if lens else _nominal_of(view, len(lacking), known=known)
    if camera is None and not known:
        camera = _shown(view, len(lacking))
        lens = None if camera is None else asdict(camera)
    if camera is None:
        return False
    columns.lens = dict(lens or {})
    rows = rows_of_pixels(view)
    angles = camera.angles_deg(columns.numbers["pixel_u"], rows)
    columns.derived = {
        name: np.asarray(values)
        for name, values in zip(_STANDS_FOR, angles, strict=True)
        if name in lacking and _STANDS_FOR[name] in columns.numbers
    }
    return True


def _shown(view: View, lacking: int) -> Camera | None:
    """Camera that a sweep or planes show; where both do, that with which planes are clearly flatter."""
    planes = camera_of_planes(view)
    swept = camera_of_sweep(view) if lacking == len(_STANDS_FOR) else None
    if planes is None or swept is None:
        return planes or swept
    return planes if bend_of(view, planes) < FLATTER * bend_of(view, swept) else swept


def _of_line(columns: Columns, level_deg: float | None) -> bool:
    """Give all rays of a line one elevation, where it is known; whether it is."""
    if level_deg is not None:
        columns.lens = {"elevation_deg": level_deg}
        columns.derived = {"elevation_deg": np.full(columns.n, level_deg)}
    return level_deg is not None


def _nominal_of(view: View, lacking: int, *, known: bool) -> Camera | None:
    """Camera of the nominal bench, where a table of both pixel columns shows it or is known to be that."""
    if any(pixel not in view.columns.numbers for pixel in _STANDS_FOR.values()):
        return None
    bench = bench_of(view)
    if bench is not None:
        return bench.optics.camera
    # one angle of each pixel tells the nominal camera, whatever it sees
    return next(iter(cameras_of(view)), None) if known or lacking < len(_STANDS_FOR) else None


def as_the_table_says(variant: Variant, view: View) -> Variant:
    """A variant whose drivers are columns that the table has: a line of pixels has no rows of them."""
    known = view.columns.derived
    drivers = dict.fromkeys(_STANDS_FOR[name] if name in known else name for name in variant.drivers)
    present = tuple(name for name in drivers if view.has(name) or view.has(f"sim_{name}"))
    return variant if present == variant.drivers else replace(variant, drivers=present)
