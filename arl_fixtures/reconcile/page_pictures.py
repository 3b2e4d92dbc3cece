"""Pictures of one channel: maps of the image and of pairs of drivers, and curves over single columns."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from arl_fixtures.reconcile import page_words as words
from arl_fixtures.reconcile.columns import FloatArray, IntArray
from arl_fixtures.reconcile.diagnosis import Finding
from arl_fixtures.reconcile.page_data import Axis, Mismatch, axis_of, inside, pixel_tiles, shown_column
from arl_fixtures.reconcile.page_figures import Field, categories, colour_bar, curve, heat_map, number
from arl_fixtures.reconcile.region import columns_as_drivers
from arl_fixtures.reconcile.roles import Role
from arl_fixtures.reconcile.search import Found
from arl_fixtures.reconcile.view import View

MOST_CURVES, FEWER_CURVES, MOST_CELLS = 6, 3, 14
SHARE_OF_DRIVER = 0.05
USUAL = (
    "tof_temperature_c", "housing_temperature_c", "set_temperature_c", "stage_angle_deg", "true_range_m", "step",
    "surface", "dut",
)  # fmt: skip
"""Columns that are looked at where no finding asks for others."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Picture:
    """A figure with what is to be known about it."""

    title: str
    note: str
    figures: tuple[Markup, ...]


class Gallery:
    """Pictures of a diagnosis.

    Args:
        findings: of all channels.
        found: the search, for the columns that its first look used.
        view: rows to show.
    """

    def __init__(self, findings: Sequence[Finding], found: Found, view: View) -> None:
        self.findings, self.found, self.view = findings, found, view

    def place(self, m: Mismatch) -> dict[str, object]:
        """Maps and curves of one channel."""
        channel = m.data.channel
        concerned = [f for f in self.findings if channel.name in f.channels]
        factor, unit = words.display_of(channel)
        maps = list(self._maps(m, concerned))
        limit = 0.0
        drawn: list[Picture] = []
        if maps:
            tallest = np.concatenate([np.abs(before.z[np.isfinite(before.z)]) for _, _, before, _ in maps])
            limit = float(np.clip(np.quantile(tallest, 0.99) if len(tallest) else 6.0, 6.0, 1e6))
            limit = float(f"{limit:.2g}")
            drawn = [
                Picture(
                    title=title, note=note,
                    figures=(heat_map(before, limit), *([heat_map(after, limit)] if _differ(before, after) else [])),
                )
                for title, note, before, after in maps
            ]  # fmt: skip
        return {
            "name": channel.name, "unit": unit, "concerned": [words.title_of(f.effect) for f in concerned],
            "maps": drawn, "limit": words.plain(limit, 2), "bar": colour_bar(limit) if maps else "",
            "curves": list(self._curves(m, concerned, factor)), "centred": m.centred,
            "gain": channel.role is Role.INTENSITY,
        }  # fmt: skip

    def _maps(self, m: Mismatch, concerned: Sequence[Finding]) -> Iterator[tuple[str, str, Field, Field]]:
        tiles = pixel_tiles(self.view)
        if tiles is not None:
            first = concerned[0] if concerned else None
            region, note = self._region(first, but=("pixel_u", "pixel_v"), only_text=True)
            if tiles.size > 1:
                note = f"{note}{' ' if note else ''}Tiles of {tiles.size} × {tiles.size} pixels."
            before, after = self._fields(m, np.where(region, tiles.code, -1), tiles.rows, tiles.columns)
            field = Field(
                z=before, across="pixel_u", down="pixel_v", left=tiles.left, right=tiles.right, top=tiles.top,
                bottom=tiles.bottom, u=tiles.u, v=tiles.v,
            )  # fmt: skip
            yield "Where in the image", note, field, replace(field, z=after)
        seen: set[tuple[str, ...]] = set()
        for f in concerned:
            pair = [c for c in dict.fromkeys(shown_column(self.view, d) for d in f.drivers) if c][:2]
            if len(pair) < 2 or set(pair) == {"pixel_u", "pixel_v"} or tuple(pair) in seen:
                continue
            seen.add(tuple(pair))
            across, down = (axis_of(self.view, c, most=MOST_CELLS, own=MOST_CELLS + 4) for c in pair)
            if across is None or down is None:
                continue
            region, note = self._region(f, but=pair)
            joint = np.where(
                region & (across.code >= 0) & (down.code >= 0), down.code * across.count + across.code, -1
            )
            before, after = self._fields(m, joint, down.count, across.count)
            field = Field(
                z=before, across=words.column_label(pair[0]), down=words.column_label(pair[1]),
                at_across=_cell_names(across), at_down=_cell_names(down),
            )  # fmt: skip
            yield f"{words.title_of(f.effect)}: {pair[0]} with {pair[1]}", note, field, replace(field, z=after)

    def _fields(self, m: Mismatch, code: IntArray, high: int, wide: int) -> tuple[FloatArray, FloatArray]:
        profile = m.profile(code, high * wide)
        with np.errstate(invalid="ignore", divide="ignore"):
            error = np.where(profile.error > 0, profile.error, np.nan)
            return (profile.before / error).reshape(high, wide), (profile.after / error).reshape(high, wide)

    def _region(
        self, f: Finding | None, *, but: Sequence[str], only_text: bool = False
    ) -> tuple[NDArray[np.bool_], str]:
        """Rows of a finding's region on other columns, and the sentence that says so."""
        where = {
            k: v for k, v in (f.where if f is not None else {}).items()
            if k not in but and f"sim_{k}" not in but and (not only_text or self.view.is_category(k))
        }  # fmt: skip
        mask = inside(self.view, where)
        if mask.all():
            return mask, ""
        texts = [f"{k} is {words.bounds_text(v, words.column_unit(k))}" for k, v in where.items()]
        return mask, f"Only rows where {words.joined(texts)}."

    def _curves(self, m: Mismatch, concerned: Sequence[Finding], factor: float) -> Iterator[Picture]:
        count = 0
        most = MOST_CURVES if concerned or not self.findings else FEWER_CURVES
        for column, finding in self._columns(m, concerned):
            axis = axis_of(self.view, column)
            if axis is None or count >= most:
                continue
            region, note = self._region(finding, but=(column,))
            profile = m.profile(np.where(region, axis.code, -1), axis.count)
            label = words.column_label(column)
            draw = categories if axis.names else curve
            figure = draw(axis, profile, factor=factor, label=label)
            title = f"Over {column}" + (f" ({words.title_of(finding.effect).lower()})" if finding is not None else "")
            count += 1
            yield Picture(title=title, note=note, figures=(figure,))

    def _columns(self, m: Mismatch, concerned: Sequence[Finding]) -> list[tuple[str, Finding | None]]:
        """Columns to show a channel over: drivers of its findings, leading columns of the first look, usual ones."""
        found: dict[str, Finding | None] = {}
        for f in concerned:
            for driver in f.drivers[:3]:
                column = shown_column(self.view, driver)
                if column:
                    found.setdefault(column, f)
        seen = self.found.before[m.data.channel.name].ceiling.importance if concerned else {}
        leading = [n for n, s in sorted(seen.items(), key=lambda kv: (-kv[1], kv[0])) if s > SHARE_OF_DRIVER]
        usual = [*USUAL, *(f"sim_{c}" for c in (self.view.channel(Role.INTENSITY),) if c)]
        others = [*self.view.covariates(), *sorted(self.view.columns.categories)]
        rest = [*columns_as_drivers(leading, self.view), *usual, *others]
        for name in rest:
            column = shown_column(self.view, name)
            if column and column != "n_frames":
                found.setdefault(column, None)
        if m.centred:  # the units' constants are taken out: over the units nothing is left to see
            for name in self.found.problem.groups.unit_columns:
                found.pop(name, None)
        return list(found.items())


def _differ(before: Field, after: Field) -> bool:
    return not np.array_equal(before.z, after.z, equal_nan=True)


def _cell_names(axis: Axis) -> tuple[str, ...]:
    return axis.names or tuple(number(float(x)) for x in axis.at)
