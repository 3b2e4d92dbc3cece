"""Light from beyond a border in pixels that see two surfaces: a share of it, or what a wider point spread lets in.

Of such a pixel's light I = f·B + (1 − f)·A the rows beside it tell A, of its own surface, and B, of the other one; so
the simulation's own light tells f. A pixel of width 1 whose image of a sharp edge at x is blurred by a Gaussian of s
sees f = F(x; s) = g(x + 1/2) − g(x − 1/2), g(a) = a·Φ(a / s) + s·φ(a / s). A blur of width w more makes it
F(x; √(s² + w²)): what is nearly all of one surface gets most, what is half and half gets nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.special import ndtr

from arl_fixtures.reconcile.effect import State
from arl_fixtures.reconcile.effects_common import FloatArray, distances, per_view, pure_rows, set_light
from arl_fixtures.reconcile.effects_scene import pixel_width
from arl_fixtures.reconcile.effects_surface import beyond_border, beyond_surface, borders, mixed_rows, pulled_channels
from arl_fixtures.reconcile.roles import Role
from arl_fixtures.reconcile.view import View

IntArray = NDArray[np.int64]
USUAL_BLUR = 0.3
"""Standard deviation of the blur that a simulation has anyway, pixels: that of a camera whose image is sharp."""
_CONTRAST = 0.05
"""Share of the light by which two surfaces must differ to tell how much a pixel sees of either."""
OFF = 0.1
"""Part by which the light may lie outside that of both surfaces: nowhere is it quite that of the nearest pure row."""
_FARTHEST = 24.0
"""Pixels within which a row must show a surface alone."""
_ELSEWHERE, _ANOTHER_STEP = 3.0, 1e-3
"""How many pixels' turn another pixel counts, and another step."""
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


@dataclass(frozen=True, slots=True)
class Sides:
    """Rows of the whole table that show alone what a row at a border sees of either surface; −1 where none, (n,)."""

    own: IntArray
    other: IntArray

    def seen(self, view: View, name: str) -> tuple[FloatArray, FloatArray]:
        """A column as either side shows it alone, (n,) each; NaN where none does."""
        return per_view(
            view, ("sides", name), lambda: (view.take_number(name, self.own), view.take_number(name, self.other))
        )

    def part(self, view: View, channel: str) -> FloatArray:
        """Part of a pixel that the other surface fills, as the simulated light says, and ranges that follow it.

        NaN where neither tells the surfaces apart. Both are linear in it: I, and I·D.
        """
        names = [f"sim_{name}" for name in (channel, *pulled_channels(view))]
        light, *far = (view.number(name) for name in names)

        def moments(lit: FloatArray, *ranges: FloatArray) -> FloatArray:
            return np.stack([lit, *(lit * at / ours for at, ours in zip(ranges, far, strict=True))])

        here = moments(light, *far)
        own, other = (moments(*side) for side in zip(*(self.seen(view, name) for name in names), strict=True))
        with np.errstate(invalid="ignore", divide="ignore"):
            apart = (other - own) / here[0]
            size = np.sqrt(np.sum(apart**2, axis=0))
            part = np.sum((here - own) / here[0] * apart, axis=0) / size**2
        told = (size > _CONTRAST) & (np.abs(part - 0.5) < 0.5 + OFF)
        return np.where(told, np.clip(part, 0.0, 1.0), np.nan)


def sides_of(view: View) -> Sides | None:
    """Both sides of the rows under work that are said to see two surfaces; None where no column says which."""
    if not (view.labels("surface") and mixed_rows(view).any() and pure_rows(view).any()):
        return None
    return per_view(view, "sides", lambda: _find_sides(view))


def _find_sides(view: View) -> Sides:
    """The nearest pure rows: of the row's own surface, and of that beside it which looks most unlike."""
    codes = view.columns.categories["surface"][0]
    channel = view.channel(Role.INTENSITY) or distances(view)[0]
    place, pure = _places(view), pure_rows(view)
    mixed = np.flatnonzero(mixed_rows(view))
    found = Sides(np.full(view.n, -1), np.full(view.n, -1))
    beyond = beyond_surface(view, channel)
    for code in np.unique(codes[pure & (codes >= 0)]).tolist():
        members = np.flatnonzero(pure & (codes == code))
        far, nearest = cKDTree(place[members]).query(place[view.rows[mixed]])
        rows = np.where(np.asarray(far) < _FARTHEST, members[nearest], -1)
        for side, is_it in ((found.own, codes[view.rows[mixed]] == code), (found.other, beyond[mixed] == code)):
            side[mixed[is_it]] = rows[is_it]
    return found


def _places(view: View) -> FloatArray:
    """Where every row of a table looks, in pixels: another stage angle is nearer than another pixel, (n, k)."""
    table = view.columns
    along: list[NDArray[Any]] = [_ELSEWHERE * table.numbers[n] for n in ("pixel_u", "pixel_v") if view.varies(n)]
    if view.varies("stage_angle_deg"):
        along.append(table.numbers["stage_angle_deg"] / max(float(np.median(pixel_width(view))), 1e-6))
    along += [1e6 * table.group("dut"), _ANOTHER_STEP * table.group("cycle", "step")]
    return np.asarray(np.nan_to_num(np.column_stack(along)))


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
    part = per_view(view, ("part beyond", channel), lambda: sides.part(view, channel))
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
