"""How much noise of its own a simulation of images has: one that counts photons averages some number of frames.

The second difference of neighbouring pixels takes what is smooth out of an image. Of white noise it is normal, and
two of them that overlap in two pixels have a correlation of −2/3 (their weights: 1, −2, 1): of a scene
it is neither. Noise is not the same again where the same pixel is seen in another image; a pattern of pixels is.
"""

from __future__ import annotations

import numpy as np

from arl_fixtures.reconcile.columns import BoolArray, FloatArray
from arl_fixtures.reconcile.effect import State
from arl_fixtures.reconcile.effects_common import per_view
from arl_fixtures.reconcile.roles import Role
from arl_fixtures.reconcile.view import View

QUARTILES = (0.3186, 0.6745, 1.1503)
"""Quantiles 1/4, 1/2 and 3/4 of the absolute value of a standard normal number."""
ALIKE = 0.12
"""Relative deviation from a normal law's that the ratios of these quantiles may have."""
OVERLAP, LEAST_OVERLAP = 2.0 / 3.0, 0.55
"""What two differences of white noise have in common, with the sign turned, and what they must have at least."""
MOST_STEADY = 0.3
"""Share of a difference's variance that may be the same whenever the pixel is seen."""
FEWEST = 300
"""Differences from which noise is told."""
WILD = 3.0
_SMALLEST = 1e-300


def own_noise(view: View) -> float:
    """Noise of the simulated means, in units of the stated scatter of one frame; 0 where they show none."""
    return per_view(view, "own noise", lambda: _own_noise(view))


def perturbed(view: View, seed: int = 1) -> State:
    """The simulation with as much noise of its own again."""
    return dict(per_view(view, ("perturbed", seed), lambda: _perturbed(view, seed)))


def _perturbed(view: View, seed: int) -> State:
    state, size, rng = view.fresh_state(), own_noise(view), np.random.default_rng(seed)
    for channel in view.columns.channels:
        name = f"sim_{channel.name}_std"
        if channel.role is not Role.SCATTER and view.has(name):
            noise = size * view.number(name) * rng.standard_normal(view.n)
            state[channel.name] = state[channel.name] + np.where(np.isfinite(noise), noise, 0.0)
    return state


def _own_noise(view: View) -> float:
    if not (view.varies("pixel_u") or view.varies("pixel_v")):
        return 0.0
    found = []
    for channel in view.columns.channels:
        if channel.role in {Role.INTENSITY, Role.DISTANCE} and view.has(f"sim_{channel.name}_std"):
            found += [_along(view, channel.name, *axis) for axis in ((1, 0), (0, 1))]
    return min((size for size in found if size > 0.0), default=0.0)


def _along(view: View, channel: str, du: int, dv: int) -> float:
    """Noise along the rows or columns of images; 0 where what is there is none."""
    before, after, beyond = (
        view.neighbour_number(f"sim_{channel}", du=k * du, dv=k * dv) for k in (-1, 1, 2)
    )  # fmt: skip
    own, unit = view.sim[channel], np.sqrt(6.0) * view.number(f"sim_{channel}_std")
    with np.errstate(divide="ignore", invalid="ignore"):
        here, there = (before - 2.0 * own + after) / unit, (own - 2.0 * after + beyond) / unit
    good = np.isfinite(here) & np.isfinite(there)
    if good.sum() < FEWEST:
        return 0.0
    quarters = np.quantile(np.abs(here[good]), (0.25, 0.5, 0.75)) / QUARTILES
    size = float(quarters[1])
    if size <= 0.0 or np.any(np.abs(quarters / size - 1.0) > ALIKE):
        return 0.0
    tame = good & (np.maximum(np.abs(here), np.abs(there)) < WILD * size)
    overlap = -float(np.corrcoef(here[tame], there[tame])[0, 1])
    return size if overlap > LEAST_OVERLAP and _steady(view, here, tame) < MOST_STEADY else 0.0


def _steady(view: View, values: FloatArray, tame: BoolArray) -> float:
    """Share of the variance of values that is the same in all images of a pixel; 0 where each is seen once."""
    place = np.unique(view.group("dut", "pixel_u", "pixel_v")[tame], return_inverse=True)[1]
    count = np.bincount(place)
    mean = (np.bincount(place, values[tame]) / count)[place]
    many = count[place] > 1
    if not many.any():
        return 0.0
    whole, within = float(np.mean(values[tame][many] ** 2)), float(np.mean((values[tame] - mean)[many] ** 2))
    times = float(np.mean(count[place][many]))
    return 1.0 - within / max(whole, _SMALLEST) * times / (times - 1.0)
