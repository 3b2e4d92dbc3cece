"""What the pictures show: mean mismatch over bins of the rows that were searched, and how far chance alone takes it.

A bin's mean weighs rows by their information. Its standard error honours what rows of a step, an image, a pixel or a
stage angle share, and that a constant per unit (DUT) was taken out as calibration. With weights W and v the row
vector of the bin's mean less the units' constants, the variance is Σ v²/W + Σ_levels τ² Σ_groups (Σ_rows v·λ)².
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from arl_fixtures.reconcile.channel_data import ChannelData
from arl_fixtures.reconcile.columns import FloatArray, IntArray
from arl_fixtures.reconcile.effect import State
from arl_fixtures.reconcile.noise import Level
from arl_fixtures.reconcile.view import BoolArray, View

NULL_Z = 1.96
"""Half width of the null band in standard errors: 95 of 100 bins of a table without mismatch lie within."""
OWN_BIN, MOST_BINS = 64, 32
MOST_INDICES = 160
"""A column with at most `OWN_BIN` values is not binned; others get `MOST_BINS` equally full bins."""
LARGEST_IMAGE = 1e5
"""Pixels along an image's side beyond which a column is no pixel index."""
CLOSEST = 1.0 / 170.0
"""Share of an axis that two bins are at least apart."""
FEWEST_ROWS = 12
MOST_TILES, FILLED, MOST_POINTS = 20_000, 0.6, 1500
"""A map has at most so many tiles, and rows in this share of them; else it shows single pixels, or larger tiles."""

Where = Mapping[str, Sequence[str] | Sequence[float]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Axis:
    """A column cut into bins.

    Attributes:
        column: name in the table.
        code: bin of each row of the view, −1 outside.
        at: middle of each numeric bin; empty for categories.
        names: label of each category; empty for numbers.
        log: whether the values are shown on a logarithmic axis.
    """

    column: str
    code: IntArray
    at: FloatArray = field(default_factory=lambda: np.zeros(0))
    names: tuple[str, ...] = ()
    log: bool = False

    @property
    def count(self) -> int:
        """Number of bins."""
        return len(self.names) or len(self.at)


@dataclass(frozen=True, slots=True, kw_only=True)
class Profile:
    """Mean mismatch per bin (NaN where no row lies), in shares of the simulated value or in the channel's unit.

    Attributes:
        before, after: without and with the findings.
        error: standard error of the mean of a table without mismatch.
        rows: rows in each bin.
    """

    before: FloatArray
    after: FloatArray
    error: FloatArray
    rows: IntArray


class Mismatch:
    """One channel's mismatch on the rows that were searched.

    Args:
        data: the channel.
        before, after: simulated values without and with the findings.
        keep_constant: whether a constant gain or offset is itself the finding, so that it must be seen before.
    """

    def __init__(self, data: ChannelData, before: State, after: State, *, keep_constant: bool = False) -> None:
        self.data = data
        self.weight = (data.root_weight * data.scale) ** 2
        self.tau = data.fit_scatter(data.residual(after))[1]
        self.centred = data.calibrated and not keep_constant
        unit_weight = np.bincount(data.unit, self.weight, minlength=data.units)
        self._unit_weight = np.where(unit_weight > 0, unit_weight, np.inf)
        self.before = data.residual(before) / (data.expect * data.scale)
        self.after = data.residual(after) / (data.expect * data.scale)
        if self.centred:
            self.before = self.before - self._constants(self.before)
        if data.calibrated:
            self.after = self.after - self._constants(self.after)

    def _constants(self, mismatch: FloatArray) -> FloatArray:
        total = np.bincount(self.data.unit, self.weight * mismatch, minlength=self.data.units)
        return np.asarray((total / self._unit_weight)[self.data.unit])

    def change(self, before: State, after: State) -> FloatArray:
        """What moves between two simulations in the channel's unit, less units' constants if it is more."""
        name, use = self.data.channel.name, self.data.use
        moved = (after[name] - before[name])[use] / self.data.scale
        return (moved if self.moves_units_only(moved) else moved - self._constants(moved)) * self.data.scale

    def moves_units_only(self, moved: FloatArray) -> bool:
        """Whether a change (over the channel's scale) is but a constant in each unit; or none of these are free."""
        if not self.data.calibrated:
            return True
        beyond = moved - self._constants(moved)
        return float(np.nanmax(np.abs(beyond), initial=0.0)) < 1e-6 * float(np.nanmax(np.abs(moved), initial=0.0))

    def profile(self, code: IntArray, count: int) -> Profile:
        """Mean mismatch of each bin.

        Args:
            code: bin of each of the view's rows, −1 for rows to leave out.
            count: number of bins.
        """
        place = np.flatnonzero(code[self.data.use] >= 0)
        bins = code[self.data.use][place]
        total = np.bincount(bins, self.weight[place], minlength=count)
        with np.errstate(invalid="ignore", divide="ignore"):
            share = 1.0 / np.where(total > 0, total, np.nan)
        means = [
            np.bincount(bins, self.weight[place] * values[place], minlength=count) * share
            for values in (self.before, self.after)
        ]
        variance = share.copy()
        units = self.data.units
        part: FloatArray = np.zeros((count, units))
        if self.centred:
            joint = bins * units + self.data.unit[place]
            inside_unit = np.bincount(joint, self.weight[place], minlength=count * units).reshape(count, units)
            part = inside_unit * np.nan_to_num(share)[:, None] / self._unit_weight
            variance = variance - np.sum(part**2 * np.where(np.isfinite(self._unit_weight), self._unit_weight, 0), 1)
        for level in self.data.levels:
            tau = max(self.tau.get(level.name, 0.0), level.floor)
            if tau > 0:
                variance = variance + tau**2 * self._shared(level, place, bins, share, part)
        return Profile(
            before=means[0], after=means[1], error=np.sqrt(np.maximum(variance, 0.0)),
            rows=np.bincount(bins, minlength=count).astype(np.int64),
        )  # fmt: skip

    def _shared(
        self, level: Level, place: IntArray, bins: IntArray, share: FloatArray, part: FloatArray
    ) -> FloatArray:
        """Σ over groups of the squared sum of the bin's row vector, times the level's scale."""
        load = self.weight * level.scale / self.data.scale
        joint, inverse = np.unique(bins * level.count + level.code[place], return_inverse=True)
        own = np.bincount(inverse, load[place])
        in_bin, group = joint // level.count, joint % level.count
        own = np.asarray(own * np.nan_to_num(share)[in_bin])
        sums: FloatArray = np.bincount(in_bin, own**2, minlength=len(share)).astype(np.float64)
        if self.centred:
            whole = np.bincount(level.code, load, minlength=level.count)
            unit = np.zeros(level.count, dtype=np.int64)
            unit[level.code] = self.data.unit  # every group lies within one unit
            sums = sums - 2.0 * np.bincount(
                in_bin, own * part[in_bin, unit[group]] * whole[group], minlength=len(share)
            )
            sums = sums + part**2 @ np.bincount(unit, whole**2, minlength=self.data.units)
        return np.asarray(sums)


def shown_column(view: View, name: str) -> str:
    """Column to bin for a driver: the simulated value where the driver is a channel; empty where it is no column."""
    if f"sim_{name}" in view.columns.numbers:
        return f"sim_{name}"
    return name if view.has(name) else ""


def axis_of(view: View, column: str, *, most: int = MOST_BINS, own: int = OWN_BIN) -> Axis | None:
    """Bins of a column on the view's rows; None where it does not vary there.

    Args:
        view: rows.
        column: numeric or category.
        most: bins of a column with many values.
        own: number of values up to which each has a bin of its own (indices of pixels and steps: `MOST_INDICES`).
    """
    if view.is_category(column):
        code, labels = view.codes(column)
        count = np.bincount(code[code >= 0], minlength=len(labels))
        kept = np.sort(np.argsort(-count, kind="stable")[:MOST_BINS])
        kept = kept[count[kept] > 0]
        if len(kept) < 2:
            return None
        lookup = np.full(len(labels) + 1, -1, dtype=np.int64)
        lookup[kept] = np.arange(len(kept))
        return Axis(column=column, code=lookup[code], names=tuple(labels[k] for k in kept))
    if column not in view.columns.numbers:
        return None
    values = view.number(column)
    finite = values[np.isfinite(values)]
    levels = np.unique(finite)
    if len(levels) < 2:
        return None
    index = levels[-1] - levels[0] < MOST_INDICES and bool(np.all(levels == np.round(levels)))
    whole = own == OWN_BIN and index
    if len(levels) <= own or whole:
        cuts = (levels[1:] + levels[:-1]) / 2.0
    else:
        bins = int(np.clip(len(finite) // FEWEST_ROWS, 2, most))
        cuts = np.unique(np.quantile(finite, np.linspace(0, 1, bins + 1)[1:-1]))
    code = np.where(np.isfinite(values), np.searchsorted(cuts, values, side="right"), -1).astype(np.int64)
    count = np.bincount(code[code >= 0], minlength=len(cuts) + 1)
    sums = np.bincount(code[code >= 0], values[code >= 0], minlength=len(cuts) + 1)
    kept = np.flatnonzero(count > 0)
    log = _is_skewed(finite)
    group = _near(sums[kept] / count[kept], log=log)
    lookup = np.full(len(count) + 1, -1, dtype=np.int64)
    lookup[kept] = group
    at = np.bincount(group, sums[kept]) / np.bincount(group, count[kept])
    return Axis(column=column, code=lookup[code], at=at, log=log) if len(at) > 1 else None


def _is_skewed(values: FloatArray) -> bool:
    """Whether values span decades and crowd at the low end, so that a linear axis would hide most of them."""
    high = float(values.max())
    return bool(values.min() > 0 and high > 30.0 * values.min() and np.median(values) < 0.25 * high)


def _near(at: FloatArray, *, log: bool) -> IntArray:
    """Number of the bin that each of ascending bins joins, so that no two lie closer than can be drawn apart."""
    place = np.log(at) if log else at
    gap = CLOSEST * float(place[-1] - place[0])
    group = np.zeros(len(at), dtype=np.int64)
    start = place[0]
    for k in range(1, len(at)):
        apart = place[k] - start > gap
        group[k] = group[k - 1] + apart
        start = place[k] if apart else start
    return group


def inside(view: View, where: Where, *, but: Sequence[str] = ()) -> BoolArray:
    """Rows of a region, without the bounds on the columns `but`; all rows where hardly any is left."""
    mask = np.ones(view.n, dtype=bool)
    for column, bounds in where.items():
        name = column if column not in view.sim else f"sim_{column}"
        if name in but or column in but or not view.has(name) or not len(bounds):
            continue
        if view.is_category(name):
            code, labels = view.codes(name)
            mask &= np.isin(code, [k for k, label in enumerate(labels) if label in bounds])
        elif len(bounds) == 2:
            values, (low, high) = view.number(name), (float(bounds[0]), float(bounds[1]))
            slack = 1e-9 * max(abs(low), abs(high))
            mask &= (values >= low - slack) & (values <= high + slack)
        else:
            mask &= np.isin(view.number(name), np.array(bounds, dtype=np.float64))
    return mask if mask.sum() >= 3 * FEWEST_ROWS else np.ones(view.n, dtype=bool)


@dataclass(frozen=True, slots=True, kw_only=True)
class Tiles:
    """The image cut into tiles, or single pixels where only some were recorded.

    Attributes:
        code: tile of each row of the view, −1 where the pixel is not known.
        rows, columns: of tiles; `rows` is 1 where `u` and `v` hold the tiles' places.
        size: pixels along a tile.
        left, right, top, bottom: bounds in pixels.
        u, v: pixel of each tile where they do not fill the image, else empty.
    """

    code: IntArray
    rows: int
    columns: int
    size: int
    left: float
    right: float
    top: float
    bottom: float
    u: FloatArray = field(default_factory=lambda: np.zeros(0))
    v: FloatArray = field(default_factory=lambda: np.zeros(0))


def pixel_tiles(view: View) -> Tiles | None:
    """Tiles as small as the rows fill them; None where the table has no image."""
    if not (view.varies("pixel_u") and view.varies("pixel_v")):
        return None
    u, v = view.number("pixel_u"), view.number("pixel_v")
    good = np.isfinite(u) & np.isfinite(v)
    if good.sum() < FEWEST_ROWS or np.ptp(u[good]) == 0 or np.ptp(v[good]) == 0:
        return None
    left, right, top, bottom = (
        float(np.floor(f)) for f in (u[good].min(), u[good].max(), v[good].min(), v[good].max())
    )
    size = 1
    while size <= 64 and max(right - left, bottom - top) < LARGEST_IMAGE:
        wide, high = int((right - left) // size) + 1, int((bottom - top) // size) + 1
        code = np.full(view.n, -1, dtype=np.int64)
        code[good] = ((v[good] - top) // size).astype(np.int64) * wide + ((u[good] - left) // size).astype(np.int64)
        present = np.unique(code[good])
        filled = wide * high <= MOST_TILES and len(present) >= FILLED * wide * high
        if size == 1 and not filled and len(present) <= MOST_POINTS:
            code[good] = np.searchsorted(present, code[good])
            places: FloatArray = present.astype(np.float64)
            pad_u, pad_v = 0.5 + 0.02 * (right - left), 0.5 + 0.04 * (bottom - top)
            return Tiles(
                code=code, rows=1, columns=len(present), size=1, left=left - pad_u, right=right + pad_u,
                top=top - pad_v, bottom=bottom + pad_v, u=left + places % wide, v=top + places // wide,
            )  # fmt: skip
        if filled or (size >= 64 and wide * high <= MOST_TILES):
            return Tiles(
                code=code, rows=high, columns=wide, size=size, left=left - 0.5, right=left + wide * size - 0.5,
                top=top - 0.5, bottom=top + high * size - 0.5,
            )  # fmt: skip
        size *= 2
    return None
