"""Tables of a few columns or of one image, and the values of an operator that come nearest to what they measured."""

import numpy as np
from rendered_bench import corrected, make_columns
from scipy.optimize import least_squares

from arl_fixtures.reconcile.effect import Variant
from arl_fixtures.reconcile.view import View


def table(**columns):
    """Columns only; measured channels equal their simulation where not given."""
    n = max(np.size(values) for values in columns.values())
    numbers = {
        name: np.broadcast_to(np.asarray(values, dtype=float), (n,)).copy() for name, values in columns.items()
    }
    for name in [name for name in numbers if name.startswith("sim_")]:
        numbers.setdefault(name.removeprefix("sim_"), numbers[name].copy())
    return View(make_columns(numbers, {}, shuffle=None)[0])


def fit(view: View, variant: Variant, channel: str, start: dict[str, float], *, scale=None, offset=False):
    """Least-squares values from a start, on one channel; with `offset`, beside a free constant."""
    names = list(start)
    bounds = {p.name: (p.low, p.high) for p in variant.parameters}
    if scale is None:
        scale = np.std(view.number(channel) - view.sim[channel])

    def misfit(x):
        state = corrected(view, variant, **dict(zip(names, map(float, x), strict=True)))
        rest = (view.number(channel) - state[channel]) / scale
        return rest - rest.mean() if offset else rest

    low, high = np.transpose([bounds[name] for name in names])
    sizes = np.maximum(np.abs(list(start.values())), 1e-6)
    found = least_squares(misfit, list(start.values()), bounds=(low, high), x_scale=sizes)
    return dict(zip(names, map(float, found.x), strict=True))


def image_of(columns_u=range(40, 64), rows_v=range(8, 24)):
    """One image with a bright block: u, v, light, range as 2-D arrays."""
    v, u = np.meshgrid(np.array(list(rows_v), dtype=float), np.array(list(columns_u), dtype=float), indexing="ij")
    bright = ((u - 45.0) ** 2 + (v - 14.0) ** 2) < 16.0
    return u, v, np.where(bright, 3000.0, 200.0), np.where(bright, 1.1, 1.6)


def image_view(light, far, u, v):
    """The table of one image, its measured channels equal to their simulation."""
    return table(
        pixel_u=u.ravel(), pixel_v=v.ravel(), stage_angle_deg=np.zeros(u.size),
        sim_intensity_counts=light.ravel(), sim_distance_m=far.ravel(),
    )  # fmt: skip
