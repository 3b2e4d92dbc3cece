"""How old a device is in each row: the columns that count it, and from where to where an effect of age grows."""

from __future__ import annotations

import numpy as np

from arl_fixtures.reconcile.columns import FloatArray
from arl_fixtures.reconcile.effect import Variant
from arl_fixtures.reconcile.effects_common import above, counts_age, rounded
from arl_fixtures.reconcile.pixel_calibration import is_calibrated_by_pixel
from arl_fixtures.reconcile.view import View


def age_drivers(view: View) -> tuple[str, ...]:
    """Columns that count a device's age: cycles, operating hours, shots, else the time in the record."""
    found = [n for n in view.covariates() if counts_age(n)]
    if view.varies("time_s"):
        found.append("time_s")
    return tuple(found[:3])


def aged(view: View, variant: Variant, column: str) -> FloatArray:
    """Age: 0 at the options' `first`, 1 at their `last`, not negative; less that at `calibrated`, where given."""
    first, last = float(variant.options["first"]), float(variant.options["last"])
    age = np.maximum(above(view, column, first) / (last - first), 0.0)
    if "calibrated" in variant.options:
        age = age - (float(variant.options["calibrated"]) - first) / (last - first)
    return age


def age_options(view: View, column: str, *, by_pixel: bool = False) -> dict[str, float]:
    """Options that `aged` needs; with `by_pixel` counted from where a calibration of pixels made it nil."""
    low, high = view.span(column)
    options = {"first": float(low), "last": float(high)}
    if by_pixel and is_calibrated_by_pixel(view.columns):
        options["calibrated"] = rounded(float(np.nanmean(view.columns.numbers[column])))
    return options


def age_scales(view: View, column: str, *, by_pixel: bool = False) -> list[dict[str, float]]:
    """What an age may be counted from, as `age_options`: its first value, and nil where a record begins later.

    The user's constants stand for what was lost before the first recorded cycle; without any the simulation is of a
    new sensor.
    """
    own = age_options(view, column, by_pixel=by_pixel)
    begun = column != "time_s" and own["first"] > 0.0 and "calibrated" not in own
    return [own, {**own, "first": 0.0}] if begun else [own]
