"""How far a pixel lies from the optical axis where a table does not say where its pixels look.

The tangent of the field angle grows with the distance from the image's middle, by an unknown `reach` in its corner.
"""

from __future__ import annotations

import numpy as np

from arl_fixtures.reconcile.columns import FloatArray
from arl_fixtures.reconcile.effect import Option, Variant
from arl_fixtures.reconcile.effects_common import per_view, rounded, span
from arl_fixtures.reconcile.view import View

PIXEL = ("pixel_u", "pixel_v")
_FEWEST_PX = 7.0


def has_field(view: View) -> bool:
    """Whether an image spans enough pixels for a field; a few rows of long lines do."""
    return view.has(*PIXEL) and any(view.varies(name) and span(view, name) >= _FEWEST_PX for name in PIXEL)


def middle_options(view: View) -> dict[str, Option]:
    """Middle and half width of the image, as rows to predict may be a part of it."""
    options: dict[str, Option] = {}
    for name in PIXEL:
        low, high = view.span(name)
        options |= {f"middle_{name[-1]}": rounded(0.5 * (low + high)), f"half_{name[-1]}": 0.5 * (high - low)}
    return options


def image_radius(variant: Variant, view: View) -> FloatArray:
    """Distance of each row's pixel from the middle of the image, the corner's distance being 1."""

    def made() -> FloatArray:
        of = variant.options
        u = view.number("pixel_u") - float(of["middle_u"])
        v = view.number("pixel_v") - float(of["middle_v"])
        return np.asarray(np.nan_to_num(np.hypot(u, v) / np.hypot(float(of["half_u"]), float(of["half_v"]))))

    return per_view(view, "image radius", made)
