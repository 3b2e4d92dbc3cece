"""Pixels of a camera on a border or beside one: what a small turn or lift changes where images tell it and no curve.

A pixel that sees two surfaces sees by shares what the nearest pixels show that see one each. Where one of these lies
on one side and the other on the other, a turn by a pixel takes it from one to the other; how fast by here, its share
tells: a border through its middle sweeps over all of it, one of which only the blurred image reaches it over little.
What sees one surface goes on seeing it: there only what lies on the same surface beside it tells how light and range
change, and no curve through the border's other side.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from arl_fixtures.reconcile.effects_beyond import grows
from arl_fixtures.reconcile.effects_common import FloatArray, distances, pure_rows, signals
from arl_fixtures.reconcile.effects_illumination import log_profile, ray_column
from arl_fixtures.reconcile.effects_pulled import pulled_channels
from arl_fixtures.reconcile.effects_room_borders import Borders
from arl_fixtures.reconcile.effects_sides import Sides, part_of, sides_of
from arl_fixtures.reconcile.roles import Role
from arl_fixtures.reconcile.view import View

IntArray = NDArray[np.int64]
_AXES = (("pixel_u", "azimuth_deg", (1, 0)), ("pixel_v", "elevation_deg", (0, 1)))
"""Pixels along an axis, the angle that grows with them, and the step to the next one."""
_CONTRAST = 0.05
"""Difference of both surfaces' light, in units of a row's own, from which light tells shares."""
_BLUR = 0.15
"""Standard deviation of a border's image, pixels: between that of sharp rays over a pixel's area and a lens's."""
_STEEP = 0.5
"""Change of a share over two pixels from which it tells which way a border runs."""


@dataclass(frozen=True, slots=True)
class ImageBorders:
    """What rays of images that point elsewhere see; arrays of all rows of a table.

    Attributes:
        borders: of the pixels that see two surfaces.
        alone: pixels that see one surface, and have neighbours.
        slopes: of ln light and of range along their surface for a degree of turn and of lift, (n, 2) each.
        wide: degrees from a pixel to the next along each axis, infinite where rays do not tell it.
    """

    borders: Borders
    alone: NDArray[np.bool_]
    slopes: dict[str, FloatArray]
    wide: FloatArray

    def changes(
        self, view: View, turn: FloatArray | float, lift: FloatArray | float, told: dict[str, FloatArray]
    ) -> dict[str, FloatArray]:
        """The changes that curves tell, but where these images tell more: a pixel beyond, that is what lies there."""
        rows, of_borders, changes = view.rows, self.borders.changes(view, turn, lift), {}
        known, alone = self.borders.known[rows], self.alone[rows]
        nearby = np.clip(2.0 - 2.0 * np.hypot(turn / self.wide[0], lift / self.wide[1]), 0.0, 1.0)
        for name, change in told.items():
            along = nearby * (self.slopes[name][rows, 0] * turn + self.slopes[name][rows, 1] * lift)
            on_surface = along if name in distances(view) else np.exp(along)
            mixed = of_borders.get(name, change)
            here = np.where(known & np.isfinite(mixed), mixed, np.where(alone, on_surface, change))
            changes[name] = np.where(np.isfinite(change), here + (1.0 - nearby) * (change - here), here)
        return changes


def borders_in_images(view: View) -> ImageBorders | None:
    """What images of a table tell of their borders; None where it is not said which pixels see two surfaces."""
    view, channel = View(view.columns), view.channel(Role.INTENSITY)
    sides = sides_of(view) if channel and view.varies("azimuth_deg") else None
    if sides is None:
        return None
    flat = {name: _flat(view, name) for name in (*signals(view), *distances(view))}
    alone = {n: _alone(view, flat, n, sides) for n in signals(view)}
    own, other = ({n: light[k] for n, light in alone.items()} for k in (0, 1))
    part = part_of(sides, view, channel, pulled_channels(view))
    part[(sides.own < 0) | (sides.other < 0) | (np.abs(own[channel] - other[channel]) < _CONTRAST)] = np.nan
    wide = np.array([_degrees_for(view, column, angle) for column, angle, _ in _AXES])
    across = _across(view, sides, part, wide)
    known = np.isfinite(part) & np.any(across != 0.0, axis=1)
    if not known.any():
        return None
    fars = [{n: sides.seen(view, f"sim_{n}")[k] / flat[n] for n in pulled_channels(view)} for k in (0, 1)]
    borders = Borders(known, across, 1.0 - np.nan_to_num(part), own, other, *fars)
    return ImageBorders(borders, *_along_surfaces(view, flat, wide), wide)


def _alone(view: View, flat: dict[str, FloatArray], name: str, sides: Sides) -> list[FloatArray]:
    """A signal of either side alone, in units of each row's own; the nearest where its surface tells no trend."""
    found, own = [], view.number(f"sim_{name}")
    for place, seen in zip((sides.own, sides.other), sides.seen(view, f"sim_{name}"), strict=True):
        bare = seen == view.take_number(f"sim_{name}", place)
        found.append(np.where(bare, np.exp(flat[name][place] - flat[name]), seen / own))
    return found


def _across(view: View, sides: Sides, part: FloatArray, wide: FloatArray) -> FloatArray:
    """By which share more its own surface fills a pixel for a degree of turn and of lift, (n, 2).

    Args:
        view: of a table; sides: of its rows; part: that the other surface fills, NaN where it is not told.
        wide: degrees from a pixel to the next, along each axis.
    """
    grown, share = np.zeros((view.n, 2)), 2.0 * (1.0 - part)
    for k, (*_, (du, dv)) in enumerate(_AXES):
        ahead, back = (_own_share(view, sides, part, view.neighbour_place(du=w * du, dv=w * dv)) for w in (1, -1))
        after = np.where(np.isnan(ahead), share - back, ahead)  # at an image's end as on the other side
        before = np.where(np.isnan(back), share - ahead, back)
        grown[:, k] = np.nan_to_num(np.clip(after - before, -1.0, 1.0))
    way = grown / np.maximum(np.max(np.abs(grown), axis=1, keepdims=True), _STEEP)
    return np.asarray(way * grows(np.nan_to_num(part), _BLUR)[:, None] / wide)


def _own_share(view: View, sides: Sides, part: FloatArray, place: IntArray) -> FloatArray:
    """How much of a neighbour a row's own surface fills, (n,); NaN where that is not told."""
    codes, pure = view.columns.categories["surface"][0], pure_rows(view)
    beyond, own = np.where(sides.other >= 0, codes[sides.other], -1)[place], codes[place] == codes
    mixed = np.where(own, 1.0 - part[place], np.where(beyond == codes, part[place], 0.0 * part[place]))
    return np.where(place < 0, np.nan, np.where(pure[place], own.astype(float), mixed))


def _along_surfaces(
    view: View, flat: dict[str, FloatArray], wide: FloatArray
) -> tuple[NDArray[np.bool_], dict[str, FloatArray]]:
    """Pixels that see one surface; and what grows along it beside each, (n, 2) per degree."""
    codes, pure = view.columns.categories["surface"][0], pure_rows(view)
    told, slopes = np.zeros(view.n, dtype=bool), {name: np.zeros((view.n, 2)) for name in flat}
    for k, (*_, (du, dv)) in enumerate(_AXES):
        places = [view.neighbour_place(du=way * du, dv=way * dv) for way in (1, -1)]
        alike = [(place >= 0) & pure[place] & (codes[place] == codes) for place in places]
        told |= (places[0] >= 0) | (places[1] >= 0)
        for name, values in flat.items():
            ahead, back = (
                way * np.where(like, values[place] - values, np.nan)
                for way, like, place in zip((1.0, -1.0), alike, places, strict=True)
            )
            one = np.where(np.isfinite(ahead), ahead, back)
            slopes[name][:, k] = np.nan_to_num(np.where(alike[0] & alike[1], 0.5 * (ahead + back), one)) / wide[k]
    return pure & told, slopes


def _degrees_for(view: View, column: str, angle: str) -> float:
    """Angle from one pixel to the next, degrees, signed; infinite where rays do not tell it."""
    if not (view.varies(column) and view.varies(angle)):
        return np.inf
    at, to = view.number(column), ray_column(view, angle)
    good = np.isfinite(at) & np.isfinite(to)
    return float(np.polyfit(at[good], to[good], 1)[0]) or np.inf


def _flat(view: View, name: str) -> FloatArray:
    """Logarithm of a simulated signal without the illumination's; a distance as it is."""
    values = view.number(f"sim_{name}")
    if name in distances(view):
        return values
    return np.asarray(np.log(np.maximum(values, 1e-300)) - log_profile(view, name))
