"""A surface beside the target whose distance from it was logged: the light that comes by way of it.

Of the light that a diffuse spot gathers from the half of the room where a wall is, each direction shows it a facet of
that wall, in proportion to its cosine (Nusselt's projected solid angle); the facet is lit by the sensor.
"""

from __future__ import annotations

import numpy as np

from arl_fixtures.reconcile.effect import Option, Parameter, State, Values, Variant
from arl_fixtures.reconcile.effects_common import FloatArray, distances, rounded, shape
from arl_fixtures.reconcile.roles import per_metre, unit_of
from arl_fixtures.reconcile.view import View

_WALLS = ("corner", "floor", "ceiling", "side")
_WHITE = ("reflectance", "albedo")
_LENGTHS = ("m", "mm", "cm", "km")
_RINGS, _SPOKES = 6, 8
_SAME = 0.95
"""Correlation with the distance from which a wall is taken for the target."""


def logged_walls(view: View, unit: str) -> list[tuple[dict[str, Option], tuple[Parameter, ...]]]:
    """Ways in which a surface beside the target may be seen, with their shapes; none where no column is its distance.

    * corner: a small wall, 1 − x/√(x² + reach²) of it in sight, and a way longer by stretch·x (x times 1 without a
      signal: then that is of the share).
    * along: one that runs from the sensor, `aside` from it (or as far as another column says), to the target.

    A height is that of sensor and spot above the floor along which the light goes. `white` is a column that says how
    bright the wall is, `times` the distance's unit in the wall's.
    """
    named = [name for name in sorted(view.columns.numbers) if _is_of_wall(name) and view.varies(name)]
    away = [n for n in named if unit_of(n) in _LENGTHS and view.span(n)[0] >= 0.0]
    away = [n for n in away if not _is_target(view, n)]
    if not away:
        return _above_the_floor(view, unit)
    away.sort(key=lambda name: ("corner" not in name, name))
    wall: dict[str, Option] = {"wall": away[0]}
    if unit_of(away[0]) != unit:
        wall["times"] = per_metre(unit) / per_metre(unit_of(away[0]))
        away = [n for n in away if unit_of(n) == unit_of(away[0])]
    white = [name for name in named if name.endswith(_WHITE) and view.span(name)[0] >= 0.0]
    if white:
        wall |= {"white": white[0], "whitest": rounded(view.span(white[0])[1])}
    size = per_metre(unit)
    reach = shape("reach", unit, 0.02 * size, 5.0 * size, 0.3 * size, 1.0 * size)
    if len(away) > 1:
        return [({**wall, "way": "corner"}, (reach,)), ({**wall, "way": "along", "aside": away[1]}, ())]
    aside = shape("aside", unit, 0.05 * size, 10.0 * size, 0.5 * size, 1.5 * size)
    return [({**wall, "way": "corner"}, (reach,)), ({**wall, "way": "along"}, (aside,))]


def _above_the_floor(view: View, unit: str) -> list[tuple[dict[str, Option], tuple[Parameter, ...]]]:
    """The floor beside a beam whose height above it was logged, the same at sensor and spot."""
    high = [
        n for n in sorted(view.columns.numbers)
        if "height" in n.split("_") and not n.startswith("sim_") and unit_of(n) in _LENGTHS
        and view.varies(n) and view.span(n)[0] > 0.0
    ]  # fmt: skip
    if not high:
        return []
    floor: dict[str, Option] = {"wall": high[0], "aside": high[0], "way": "along"}
    if unit_of(high[0]) != unit:
        floor["times"] = per_metre(unit) / per_metre(unit_of(high[0]))
    lobe = shape("lobe", "1", 0.0, 100.0, 0.0, 4.0, 20.0)
    size = per_metre(unit)
    merges = shape("merges", unit, 0.05 * size, 30.0 * size, 0.3 * size, 30.0 * size)
    return [(floor, (lobe, merges))]


def _is_of_wall(name: str) -> bool:
    words = name.split("_")
    return words[0] != "sim" and any(word in _WALLS or word.endswith("wall") for word in words)


def _is_target(view: View, name: str) -> bool:
    """Whether a wall is what the rows look at: as far away as they see, but for their directions."""
    away, far = view.number(name), view.sim[distances(view)[0]]
    good = np.isfinite(away) & np.isfinite(far)
    if good.sum() < 3 or np.ptp(away[good]) == 0.0 or np.ptp(far[good]) == 0.0:
        return False
    return bool(np.corrcoef(away[good], far[good])[0, 1] > _SAME)


def by_the_wall(variant: Variant, values: Values, state: State, view: View) -> tuple[FloatArray, FloatArray]:
    """Share of light by way of the wall, and its extra one-way path; rows without a logged distance have none."""
    times = float(variant.options.get("times", 1.0))
    away = times * view.number(str(variant.options["wall"]))
    if variant.options["way"] == "along":
        aside: FloatArray | float = float(values["aside"]) if "aside" in values else 0.0
        if "aside" in variant.options:
            aside = times * view.number(str(variant.options["aside"]))
        form = (float(values[name]) for name in ("lobe", "merges")) if "lobe" in values else ()
        share, longer = along_a_wall(away, state[distances(view)[0]], aside, *form)
    else:
        share, longer = 1.0 - away / np.hypot(away, float(values["reach"])), float(values.get("stretch", 1.0)) * away
    if "white" in variant.options:
        share = share * view.number(str(variant.options["white"])) / float(variant.options["whitest"])
    return np.nan_to_num(float(values["share"]) * share), np.nan_to_num(longer)


def along_a_wall(
    away: FloatArray, far: FloatArray, aside: FloatArray | float, lobe: float = 0.0, merges: float = np.inf
) -> tuple[FloatArray, FloatArray]:
    """Light by way of a white wall over a spot's own, and its extra one-way path; all in one unit of length.

    Args:
        away: of the spot from the wall; far: of the spot from the sensor; aside: of the sensor from the wall. The
            board that the spot is on stands across the wall.
        lobe: exponent of the cosine to its axis with which the sensor lights or sees; 0 for all directions alike.
        merges: detour up to which a late return is part of the pulse and shifts it.
    """
    ahead = np.sqrt(np.maximum(far**2 - (away - aside) ** 2, (0.05 * far) ** 2))
    total, moment = np.zeros(far.shape), np.zeros(far.shape)
    for ring in np.sqrt((np.arange(_RINGS) + 0.5) / _RINGS):
        for turn in np.pi * ((np.arange(_SPOKES) + 0.5) / _SPOKES - 0.5):  # the half where the wall is
            across, up, back = ring * np.cos(turn), ring * np.sin(turn), np.sqrt(1.0 - ring**2)
            on = away / across
            place = ahead - on * back
            there = np.sqrt(aside**2 + (on * up) ** 2 + place**2)
            seen = np.maximum(place / there, 0.0) ** lobe if lobe else 1.0
            lit = np.where(place > 0.0, seen * aside / there**3, 0.0)
            total += lit
            detour = 0.5 * (there + on - far)
            moment += lit * detour * np.exp(-((detour / merges) ** 2))
    longer = moment / np.maximum(total, 1e-300)
    return 0.5 * total / (_RINGS * _SPOKES) * far**3 / ahead, longer


def law_by_the_wall(variant: Variant) -> str:
    """Its expression."""
    wall = variant.options["wall"]
    names = [parameter.name for parameter in variant.parameters]
    sight = f"(1 - {wall} / sqrt({wall}^2 + reach^2))"
    longer = ("stretch * " if "stretch" in names else "") + str(wall)
    if variant.options["way"] == "along":
        sight = f"light of a wall {variant.options.get('aside', 'aside')} beside the sensor at {wall} from the target"
        longer = "its detour"
    if "lobe" in names:
        sight = f"light of a floor {wall} below the beam, seen by cos(angle to the beam)^lobe"
        longer = "its detour where that is less than merges"
    white = f" * {variant.options['white']} / {variant.options['whitest']}" if "white" in variant.options else ""
    grows = "; signal *= 1 + k" if variant.options.get("lit") else ""
    return f"distance += k / (1 + k) * {longer}, k = share * {sight}{white}{grows}"
