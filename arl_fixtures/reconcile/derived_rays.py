"""Where pixels look, in a table that does not say so but whose simulation or rays are seen to be the nominal bench's.

A table of pixels at stage angles need not carry their azimuth and elevation. Where light and range are those of the
nominal bench (see `effects_bench`), its camera's are known, and so they are where one of the two angles is given and
is the nominal camera's in every pixel, whatever the scene. Effects see them as columns; laws and reports do not,
for the table has none: there a pixel's own column stands for them.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from arl_fixtures.reconcile.columns import Columns
from arl_fixtures.reconcile.effect import Variant
from arl_fixtures.reconcile.effects_bench import bench_of
from arl_fixtures.reconcile.effects_camera import cameras_of
from arl_fixtures.reconcile.view import View

_STANDS_FOR = {"azimuth_deg": "pixel_u", "elevation_deg": "pixel_v"}


def derive_rays(columns: Columns, *, known: bool = False) -> bool:
    """Give a table's rows the azimuth and elevation that it lacks; whether it lacked them and has them now.

    Args:
        columns: `derived` is filled.
        known: that the simulation is the nominal bench; else the table must show it.
    """
    lacking = [name for name in _STANDS_FOR if name not in columns.numbers]
    if not lacking or any(pixel not in columns.numbers for pixel in _STANDS_FOR.values()):
        return False
    view = View(columns)
    bench = bench_of(view)
    known |= len(lacking) < len(_STANDS_FOR)  # one angle of each pixel tells the nominal camera, whatever it sees
    cameras = [bench.optics.camera] if bench is not None else [*cameras_of(view)] if known else []
    if not cameras:
        return False
    angles = cameras[0].angles_deg(columns.numbers["pixel_u"], columns.numbers["pixel_v"])
    columns.derived = {
        name: np.asarray(values) for name, values in zip(_STANDS_FOR, angles, strict=True) if name in lacking
    }
    return True


def as_the_table_says(variant: Variant, view: View) -> Variant:
    """A variant whose drivers are columns that the table has: a line of pixels has no rows of them."""
    known = view.columns.derived
    drivers = dict.fromkeys(_STANDS_FOR[name] if name in known else name for name in variant.drivers)
    present = tuple(name for name in drivers if view.has(name) or view.has(f"sim_{name}"))
    return variant if present == variant.drivers else replace(variant, drivers=present)
