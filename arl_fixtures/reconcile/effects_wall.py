"""A surface beside the target whose distance from it was logged: the light that comes by way of it.

A diffuse wall at the distance x from the lit spot, up to a size h, returns in proportion to 1 − x/√(x² + h²), the
integral of x·s / (x² + s² + y²)² over it; most of that light left the wall about as far from its foot as the spot is,
so that the way is longer in proportion to x.
"""

from __future__ import annotations

import numpy as np

from arl_fixtures.reconcile.effect import Option, State, Values, Variant
from arl_fixtures.reconcile.effects_common import FloatArray, distances, rounded
from arl_fixtures.reconcile.roles import unit_of
from arl_fixtures.reconcile.view import View

_WALLS = ("wall", "corner", "floor", "ceiling", "side")
_WHITE = ("reflectance", "albedo")
_LENGTHS = ("m", "mm")


def logged_walls(view: View, unit: str) -> list[dict[str, Option]]:
    """Options of the ways in which a surface beside the target may be seen; none where no column tells its distance.

    The column is that whose values a row's own distance does not give: nearest to the spot, a corner's before a
    wall's. `along`: the wall runs from the sensor to the target; it is as large as that way is long, and lit the more
    obliquely. `white`: the column that says how bright the wall is.
    """
    named = [name for name in sorted(view.columns.numbers) if _is_of_wall(name) and view.varies(name)]
    away = [n for n in named if unit_of(n) == unit and unit in _LENGTHS and view.span(n)[0] >= 0.0]
    if not away:
        return []
    found: dict[str, Option] = {"wall": min(away, key=lambda name: ("corner" not in name, name))}
    white = [name for name in named if name.endswith(_WHITE) and view.span(name)[0] >= 0.0]
    if white:
        found |= {"white": white[0], "whitest": rounded(view.span(white[0])[1])}
    low, high = view.span(f"sim_{distances(view)[0]}")
    typical = rounded(0.5 * (low + high))
    return [found, {**found, "along": typical}] if low > 0.0 else [found]


def _is_of_wall(name: str) -> bool:
    return not name.startswith("sim_") and any(part in _WALLS for part in name.split("_"))


def by_the_wall(variant: Variant, values: Values, state: State, view: View) -> tuple[FloatArray, FloatArray]:
    """Share of light by way of the wall, and its extra one-way path; rows without a logged distance have none."""
    away = view.number(str(variant.options["wall"]))
    along: FloatArray | float = 1.0
    if "along" in variant.options:
        along = np.maximum(state[distances(view)[0]] / float(variant.options["along"]), 1e-3)
    share = float(values["share"]) * (1.0 - away / np.hypot(away, float(values["reach"]) * along)) / along
    if "white" in variant.options:
        share = share * view.number(str(variant.options["white"])) / float(variant.options["whitest"])
    return np.nan_to_num(share), np.nan_to_num(float(values.get("stretch", 1.0)) * away)


def law_by_the_wall(variant: Variant) -> str:
    """Its expression."""
    wall = variant.options["wall"]
    far = f" * (distance / {variant.options['along']})" if "along" in variant.options else ""
    law = f"k = share * (1 - {wall} / sqrt({wall}^2 + (reach{far})^2)){far.replace('*', '/')}"
    if "white" in variant.options:
        law += f" * {variant.options['white']} / {variant.options['whitest']}"
    longer, grows = ("stretch * ", "; signal *= 1 + k") if variant.options.get("lit") else ("", "")
    return f"distance += k / (1 + k) * {longer}{wall}, {law}{grows}"
