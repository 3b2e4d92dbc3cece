"""Surfaces of the scene: which there are, how much of a pixel's light comes from one, and where they meet."""

from __future__ import annotations

import re

import numpy as np
from numpy.typing import NDArray

from arl_fixtures.reconcile.effects_bench import bench_of
from arl_fixtures.reconcile.effects_common import FloatArray, distances, per_table, per_view, pure_rows
from arl_fixtures.reconcile.effects_filled import footprint_share
from arl_fixtures.reconcile.effects_illumination import turns_round
from arl_fixtures.reconcile.effects_rings import beside_in_rings
from arl_fixtures.reconcile.effects_scene import pixel_width
from arl_fixtures.reconcile.roles import per_metre, unit_of
from arl_fixtures.reconcile.view import View

IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

_LEAST_SHARE = 0.005
_JUMP, _JUMP_GAPS = 0.05, 8.0
"""Share of the range, and usual differences of neighbours, by which ranges jump from one surface to another."""
_MOST_SURFACES, _MOST_KINDRED = 6, 24
_BESIDE = 1.5
"""Pixels' widths within which two rays look beside each other."""
_MOST = 0.5
"""Share of rows that have a neighbour in their image, from which no other image is asked."""
TOGETHER = " + "
"""Joins the names of surfaces that a variant changes together."""


def surface_names(view: View, most: int = _MOST_SURFACES) -> tuple[str, ...]:
    """Surfaces that hold at least half a percent of the rows, the largest first; empty where there is only one."""

    def make() -> tuple[str, ...]:
        labels = view.labels("surface")
        if not labels:
            return ()
        codes = view.columns.categories["surface"][0]
        count = np.bincount(codes[codes >= 0], minlength=len(labels))
        order = np.argsort(-count, kind="stable")
        return tuple(labels[i] for i in order if count[i] > _LEAST_SHARE * max(view.columns.n, 1))

    return per_table(view, "surface names", make)[:most]


def surfaces_of_a_kind(view: View) -> tuple[str, ...]:
    """Surfaces that may share a paint, joined by `TOGETHER`: those with a word in common, and all but the largest.

    "wall_n" and "wall_s" are walls, "stripe_18" and "stripe_50" stripes of a panel; what stands before the largest
    surface is what was put there. Kinds that hold one surface or all of them are none.
    """
    names = surface_names(view, _MOST_KINDRED)
    kinds: dict[str, list[str]] = {}
    for name in names:
        kinds.setdefault(re.split(r"[_\W\d]", name, maxsplit=1)[0], []).append(name)
    groups = [sorted(kind) for kind in kinds.values()] + [sorted(names[1:])]
    joined = dict.fromkeys(TOGETHER.join(group) for group in groups if 1 < len(group) < len(names))
    return tuple(joined)


def mixed_rows(view: View) -> BoolArray:
    """Rows that the simulation says see more than one surface; none where it does not say."""
    if not view.is_category("mixed"):
        return np.zeros(view.n, dtype=bool)
    return view.selects("mixed", "true")


def neighbours(view: View, name: str) -> list[tuple[IntArray, FloatArray]]:
    """Surface codes and values of a numeric column next to each row, −1 and NaN where there is none.

    At the neighbouring pixels and stage angles; of a scanner that has neither, at the rays next along its ring and
    across.
    """
    codes = view.columns.categories["surface"][0]
    return [
        (np.where(place >= 0, codes[place], -1), view.take_number(name, place))
        for place in _beside(view)
    ]


def _beside(view: View) -> list[IntArray]:
    """Whole-table rows next to each row, −1 where there is none."""

    def find() -> list[IntArray]:
        found: list[IntArray] = []
        if turns_round(view) and not view.varies("stage_angle_deg"):
            return beside_in_rings(view)
        if view.varies("pixel_u") or view.varies("pixel_v"):
            found += [view.neighbour_place(du=du, dv=dv) for du, dv in ((-1, 0), (1, 0), (0, -1), (0, 1))]
        close = [place >= 0 for place in found]
        if view.varies("stage_angle_deg") and not (_most_have(close) and stops_far_apart(view)):
            found += [view.sweep_place(steps) for steps in (-1, 1)]
        return beside_in_rings(view) if not found and view.varies("azimuth_deg") else found

    return per_view(view, "beside", find)


def _most_have(close: list[BoolArray]) -> bool:
    """Whether most rows have another one on some side."""
    return bool(close) and float(np.mean(np.any(close, axis=0))) > _MOST


def stops_far_apart(view: View) -> bool:
    """Whether a stage takes a pixel past its neighbours from one stop to the next: what it sees lies elsewhere."""
    if not (view.varies("azimuth_deg") and view.varies("pixel_u")):
        return False
    wide = per_table(view, "pixel's width", lambda: float(np.median(pixel_width(view))))
    return bool(view.columns.sweep_gap_deg > _BESIDE * wide)


def light_share(view: View, channel: str, surface: str) -> FloatArray:
    """Share of a pixel's simulated light that comes from a surface.

    1 or 0 away from borders. At a mixed pixel the surfaces' borders (where the centre's label changes along the
    bearing) tell how much of it each fills, and the surfaces' mean signals how much light that is; without bearings,
    the simulated signal between those of its neighbours tells it.
    """

    def make() -> FloatArray:
        share = view.selects("surface", surface).astype(float)
        mixed = np.flatnonzero(mixed_rows(view))
        if mixed.size == 0 or not is_seen(view, surface):
            return share
        share[mixed] = _share_by_bearing(view, channel, surface, mixed)
        return share

    return per_view(view, ("light share", channel, surface), make)


def is_seen(view: View, surface: str) -> bool:
    """Whether the table has the surface at all: rows to predict may lie on others only."""
    return surface in view.columns.categories["surface"][1]


def _share_by_bearing(view: View, channel: str, surface: str, mixed: IntArray) -> FloatArray:
    codes, labels = view.columns.categories["surface"]
    signal = view.columns.numbers[f"sim_{channel}"]
    pure = np.isfinite(signal) & pure_rows(view)
    part, total = np.zeros(mixed.size), np.zeros(mixed.size)
    for index, label in enumerate(labels):
        here = codes == index
        filled = _filled(view, label, here)
        if filled is None:
            return _share_by_neighbours(view, channel, surface)[mixed]
        known = signal[here & pure]
        light = filled[mixed] * (float(known.mean()) if known.size else float(np.nanmean(signal)))
        total += light
        if label == surface:
            part = light
    fallback = view.selects("surface", surface)[mixed].astype(float)
    return np.where(total > 0.0, part / np.maximum(total, 1e-300), fallback)


def _filled(view: View, label: str, here: BoolArray) -> FloatArray | None:
    return per_view(view, ("filled", label), lambda: footprint_share(view, here.astype(float)))


def _share_by_neighbours(view: View, channel: str, surface: str) -> FloatArray:
    own = view.selects("surface", surface)
    index = view.columns.categories["surface"][1].index(surface)
    light = view.number(f"sim_{channel}")
    inside, outside = np.full(view.n, np.nan), np.full(view.n, np.nan)
    for codes, values in neighbours(view, f"sim_{channel}"):
        here = codes == index
        inside = np.fmax(inside, np.where(here, values, np.nan))
        other = np.where(~here & (codes >= 0), values, np.nan)
        further = np.abs(other - light) > np.abs(np.nan_to_num(outside - light, nan=-1.0))
        outside = np.where(np.isnan(outside) | (further & np.isfinite(other)), other, outside)
    with np.errstate(invalid="ignore", divide="ignore"):
        area = np.clip((light - outside) / (inside - outside), 0.0, 1.0)
        part = np.clip(area * inside / light, 0.0, 1.0)
    part = np.where(np.isfinite(part), part, 0.5)
    return np.where(np.isfinite(inside) | own, part, 0.0)


def borders(view: View) -> BoolArray:
    """Rows at a border between surfaces: marked mixed, or with another surface next to them."""

    def make() -> BoolArray:
        at = mixed_rows(view).copy()
        if not at.any():
            for kin in _kin_beside(view):
                at |= kin == OTHER
        return at

    return per_view(view, "borders", make)


OWN, OTHER, UNKNOWN = 0, 1, -1


def _kin_beside(view: View) -> list[IntArray]:
    """Whose surface lies at each of the places beside a row: by its name, else it is another where the range jumps.

    A bench that is known is rendered instead: its pixels' areas and rays say where surfaces meet.
    """

    def make() -> list[IntArray]:
        if view.labels("surface"):
            codes = view.columns.categories["surface"][0]
            near = [np.where(place >= 0, codes[place], -1) for place in _beside(view)]
            return [np.where(code < 0, UNKNOWN, np.where(code == codes[view.rows], OWN, OTHER)) for code in near]
        name = next((f"sim_{n}" for n in distances(view)), "")
        if not name or bench_of(view) is not None:
            return []
        least = _JUMP * view.number(name)
        usual = per_table(view, "usual gaps", lambda: _usual_gaps(View(view.columns), name))
        return [
            np.where(np.isnan(gap), UNKNOWN, np.where(gap > np.maximum(least, _JUMP_GAPS * few), OTHER, OWN))
            for gap, few in zip(_gaps(view, name), usual, strict=True)
        ]

    return per_view(view, "kin beside", make)


def _gaps(view: View, name: str) -> list[FloatArray]:
    """Absolute differences of a column to the places beside each row."""
    return [np.abs(view.take_number(name, place) - view.number(name)) for place in _beside(view)]


def _usual_gaps(view: View, name: str) -> list[float]:
    """Median difference to each of the places beside, of those that are no jump; of all of a table's rows."""
    small = [gap[gap < _JUMP * view.number(name)] for gap in _gaps(view, name)]
    return [float(np.median(gap)) if gap.size else 0.0 for gap in small]


def beyond_border(view: View, name: str) -> FloatArray:
    """Simulated value beyond a border: of the neighbour with another surface that differs most from the row."""

    return per_view(view, ("across", name), lambda: _furthest(view, name, view.number(f"sim_{name}"), OTHER))


def beyond_surface(view: View, name: str) -> IntArray:
    """Code of the surface beyond a border, of the neighbour that `beyond_border` takes; −1 where there is none."""
    own, best = view.number(f"sim_{name}"), beyond_border(view, name)
    code = np.full(view.n, -1, dtype=np.int64)
    for surfaces, values in neighbours(view, f"sim_{name}"):
        code = np.where((values == best) & (best != own), surfaces, code)
    return code


def _furthest(view: View, name: str, start: FloatArray, kin: int) -> FloatArray:
    """Simulated value beside a row, of its own surface or of another, that differs most from a start."""
    best = np.full(view.n, np.nan)
    for found, place in zip(_kin_beside(view), _beside(view), strict=False):
        candidate = np.where(found == kin, view.take_number(f"sim_{name}", place), np.nan)
        further = np.abs(candidate - start) > np.abs(best - start)
        best = np.where(np.isnan(best) | further, candidate, best)
    return best


def at_centre(view: View, name: str) -> FloatArray:
    """Range of the surface at a pixel's centre: as the simulation says, else of the neighbour that shows it alone."""
    if "true_range_m" in view.columns.numbers:
        return view.number("true_range_m") * per_metre(unit_of(name))
    best = _furthest(view, name, beyond_border(view, name), OWN)
    return np.where(np.isfinite(best), best, view.number(f"sim_{name}"))
