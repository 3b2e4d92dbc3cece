"""Surfaces of the scene: which there are, how much of a pixel's light comes from one, and where they meet."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from arl_fixtures.reconcile.effects_common import FloatArray, per_table, per_view
from arl_fixtures.reconcile.effects_pointing import footprint_share
from arl_fixtures.reconcile.view import View

IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

_LEAST_SHARE = 0.005
_MOST_SURFACES = 6


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


def mixed_rows(view: View) -> BoolArray:
    """Rows that the simulation says see more than one surface; none where it does not say."""
    if not view.is_category("mixed"):
        return np.zeros(view.n, dtype=bool)
    return view.selects("mixed", "true")


def neighbours(view: View, name: str) -> list[tuple[IntArray, FloatArray]]:
    """Surface codes and values of a numeric column at the neighbouring pixels and stage angles (−1 and NaN: none)."""
    found: list[tuple[IntArray, FloatArray]] = []
    if view.varies("pixel_u") or view.varies("pixel_v"):
        for du, dv in ((-1, 0), (1, 0), (0, -1), (0, 1)):
            found.append((view.neighbour_codes("surface", du=du, dv=dv), view.neighbour_number(name, du=du, dv=dv)))
    if view.varies("stage_angle_deg"):
        codes = view.columns.categories["surface"][0]
        for steps in (-1, 1):
            place = view.sweep_place(steps)
            found.append((np.where(place >= 0, codes[place], -1), view.take_number(name, place)))
    return found


def light_share(view: View, channel: str, surface: str) -> FloatArray:
    """Share of a pixel's simulated light that comes from a surface.

    1 or 0 away from borders. At a mixed pixel the surfaces' borders (where the centre's label changes along the
    bearing) tell how much of it each fills, and the surfaces' mean signals how much light that is; without bearings,
    the simulated signal between those of its neighbours tells it.
    """

    def make() -> FloatArray:
        share = view.selects("surface", surface).astype(float)
        mixed = np.flatnonzero(mixed_rows(view))
        if mixed.size == 0:
            return share
        share[mixed] = _share_by_bearing(view, channel, surface, mixed)
        return share

    return per_view(view, ("light share", channel, surface), make)


def _share_by_bearing(view: View, channel: str, surface: str, mixed: IntArray) -> FloatArray:
    codes, labels = view.columns.categories["surface"]
    signal = view.columns.numbers[f"sim_{channel}"]
    pure = np.isfinite(signal)
    if view.is_category("mixed"):
        marks, names = view.columns.categories["mixed"]
        pure &= marks != (names.index("true") if "true" in names else -2)
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
        if not at.any() and view.labels("surface"):
            own = view.codes("surface")[0]
            name = next(iter(view.columns.numbers))
            for codes, _ in neighbours(view, name):
                at |= (codes >= 0) & (codes != own)
        return at

    return per_view(view, "borders", make)
