"""Light from beyond a border in pixels that see two surfaces: a share of it, or what a wider point spread lets in.

Of such a pixel's light I = f·B + (1 − f)·A the rows beside it tell A, of its own surface, and B, of the other one; so
the simulation's own light tells f. A pixel of width 1 whose image of a sharp edge at x is blurred by a Gaussian of s
sees f = F(x; s) = g(x + 1/2) − g(x − 1/2), g(a) = a·Φ(a / s) + s·φ(a / s). A blur of width w more makes it
F(x; √(s² + w²)): what is nearly all of one surface gets most, what is half and half gets nothing.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.special import ndtr

from arl_fixtures.reconcile.effect import State
from arl_fixtures.reconcile.effects_common import FloatArray, distances, per_view, set_light
from arl_fixtures.reconcile.effects_pulled import pulled_channels
from arl_fixtures.reconcile.effects_sides import part_of, sides_of
from arl_fixtures.reconcile.effects_surface import beyond_border, borders
from arl_fixtures.reconcile.view import View

USUAL_BLUR = 0.3
"""Standard deviation of the blur that a simulation has anyway, pixels: that of a camera whose image is sharp."""
_PLACES = np.linspace(-2.0, 2.0, 401)


def take_beyond(view: View, state: State, channel: str, share: float, *, lights: bool) -> None:
    """Give rows at borders a share of what lies beyond: distances by light, and signals where `lights`.

    Args:
        view: rows under work; state: its arrays are replaced.
        channel: signal that says how much light comes from where; empty where there is none.
        share: of the other side, negative to take some back.
    """
    far = {name: beyond_border(view, name) for name in distances(view)}
    bright = beyond_border(view, channel) if channel else np.ones(view.n)
    own = state[channel] if channel else np.ones(view.n)
    at = borders(view) & np.isfinite(bright)
    with np.errstate(invalid="ignore", divide="ignore"):
        weight = share * bright / ((1.0 - abs(share)) * own + abs(share) * bright)
    for name, other in far.items():
        moved = np.clip(weight, -1.0, 1.0) * (other - state[name])
        state[name] = state[name] + np.where(at & np.isfinite(moved), moved, 0.0)
    if lights and channel:
        light = own + np.where(at, share * (bright - own), 0.0)
        set_light(view, state, channel, np.where(light > 0.0, light, own))


def widened(part: FloatArray, width: FloatArray) -> FloatArray:
    """What a pixel sees of a surface that filled `part` of it, through a blur of `width` pixels more; (n,) each."""
    place = np.interp(part, _filled(_PLACES, np.full(_PLACES.size, USUAL_BLUR)), _PLACES)
    return np.asarray(_filled(place, np.hypot(USUAL_BLUR, width)))


def grows(part: FloatArray, blur: float) -> FloatArray:
    """By how much more of a pixel a surface fills that fills `part` of it, for a pixel that its border moves; (n,).

    Args:
        part: shares, 0 to 1; blur: standard deviation of the border's image, pixels.
    """
    blurred = np.full(_PLACES.size, blur)
    return np.interp(part, _filled(_PLACES, blurred), ndtr((_PLACES + 0.5) / blur) - ndtr((_PLACES - 0.5) / blur))


def _filled(place: FloatArray, blur: FloatArray) -> FloatArray:
    """F of the module's text: how much of a pixel lies beyond an edge, `place` pixels from the edge to its middle."""
    from_edge, to_edge = place + 0.5, place - 0.5
    return np.asarray(_ramp(from_edge, blur) - _ramp(to_edge, blur))


def _ramp(above: FloatArray, blur: FloatArray) -> FloatArray:
    return np.asarray(
        above * ndtr(above / blur) + blur * np.exp(-0.5 * (above / blur) ** 2) / np.sqrt(2.0 * np.pi)
    )


def blur_borders(view: View, state: State, channel: str, width: FloatArray, far: Sequence[str]) -> None:
    """Blur what pixels see at borders by `width` pixels more, (n,); the distances `far` follow the light."""
    sides = sides_of(view)
    if sides is None:
        return
    part = per_view(view, ("part beyond", channel), lambda: part_of(sides, view, channel, pulled_channels(view)))
    gained = widened(part, width) - part
    own, other = sides.seen(view, f"sim_{channel}")
    simulated, at = view.number(f"sim_{channel}"), np.isfinite(gained)
    with np.errstate(invalid="ignore", divide="ignore"):
        light = simulated + gained * (other - own)
        pull = gained * other * own / (simulated * light)
    for name in far:
        near, beyond = sides.seen(view, f"sim_{name}")
        moved = pull * (beyond - near)  # of the mean by light
        state[name] = state[name] + np.where(at & np.isfinite(moved), moved, 0.0)
    set_light(view, state, channel, state[channel] * np.where(at & (light > 0.0), light / simulated, 1.0))
