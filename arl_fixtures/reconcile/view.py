"""What an effect sees of a table: columns, groups and neighbours of the rows under work.

The engine works on whole blocks of rows (a subset of a large table). Neighbours are looked up in the *whole* table:
where a neighbour is not among the rows under work, its simulated value is taken and scaled by what earlier stages did
to the row itself. So an effect is written once and never learns which rows are worked on. What an image lacks of a
scene that stands still is taken from other steps in the same way (see `still_scene`).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from arl_fixtures.reconcile.columns import Channel, Columns
from arl_fixtures.reconcile.effect import State
from arl_fixtures.reconcile.image_grid import ImageGrid
from arl_fixtures.reconcile.roles import Role, unit_of
from arl_fixtures.reconcile.still_scene import at_angle, is_still, next_angle, still_grid

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]
Of = TypeVar("Of")

_STEP = ("dut", "cycle", "step")
_PIXEL = ("pixel_u", "pixel_v")


class View:
    """Rows of a table, as effects see them.

    Args:
        columns: the whole table.
        rows: indices of the rows under work; all where None.
        scatters: whether the simulation's scatters are carried along that the table has not measured: needed to
            predict them, wasted on a fit.

    `memo` is room for what effects compute once per view, `columns.memo` for once per table.
    """

    def __init__(self, columns: Columns, rows: IntArray | None = None, *, scatters: bool = True) -> None:
        self.columns = columns
        self._all = rows is None
        self.rows: IntArray = np.arange(columns.n) if rows is None else np.asarray(rows, dtype=np.int64)
        self.n = len(self.rows)
        self._local: IntArray | None = None
        self._cache: dict[object, FloatArray] = {}
        self._places: dict[object, IntArray] = {}
        self.memo: dict[object, Any] = {}
        self.sim: State = {}
        for channel in columns.channels:
            self.sim[channel.name] = self.number(f"sim_{channel.name}")
            if scatters and f"sim_{channel.name}_std" in columns.numbers:
                self.sim[f"{channel.name}_std"] = self.number(f"sim_{channel.name}_std")

    # ---- columns ---------------------------------------------------------------------------------------------

    def has(self, *names: str) -> bool:
        """Whether the table has all these columns (covariates, `sim_` columns or channels)."""
        table = self.columns
        return all(name in table.numbers or name in table.categories or name in table.derived for name in names)

    def number(self, name: str) -> FloatArray:
        """A numeric column on the rows under work (NaN where not observed). Never a measured column in an effect."""
        if name not in self._cache:
            values = self._whole(name)
            self._cache[name] = values if self._all else values[self.rows]
        return self._cache[name]

    def _whole(self, name: str) -> FloatArray:
        """A numeric column of the whole table, without its logger's noise, or one that its simulation shows."""
        table = self.columns
        return next(kind[name] for kind in (table.smoothed, table.derived, table.numbers) if name in kind)

    def codes(self, name: str) -> tuple[IntArray, tuple[str, ...]]:
        """Codes (−1 = null) and labels of a category column (`surface`, `dut`, `mixed` as 'false'/'true', …)."""
        codes, labels = self.columns.categories[name]
        return codes[self.rows], labels

    def is_category(self, name: str) -> bool:
        """Whether the column is text, boolean or an identifier such as `dut`."""
        return name in self.columns.categories

    def labels(self, name: str) -> tuple[str, ...]:
        """Labels of a category column that has more than one; else empty."""
        if name not in self.columns.categories:
            return ()
        labels = self.columns.categories[name][1]
        return labels if len(labels) > 1 else ()

    def selects(self, name: str, label: str) -> BoolArray:
        """Rows whose category column has this label; none where the table does not know it."""
        codes, labels = self.codes(name)
        return np.equal(codes, labels.index(label) if label in labels else -2)

    def varies(self, name: str) -> bool:
        """Whether a numeric column of the whole table takes at least two finite values."""
        if name not in self.columns.numbers and name not in self.columns.derived:
            return False
        return self._of_column("varies", name, _varies)

    def span(self, name: str) -> tuple[float, float]:
        """Smallest and largest finite value of a numeric column of the whole table."""
        return self._of_column("span", name, lambda values: (float(np.nanmin(values)), float(np.nanmax(values))))

    def middle(self, name: str) -> float:
        """Median of a numeric column of the whole table: a reference that does not depend on the rows under work."""
        return self._of_column("middle", name, lambda values: float(np.nanmedian(values)))

    def _of_column(self, what: str, name: str, make: Callable[[FloatArray], Of]) -> Of:
        """What `make` finds of a numeric column of the whole table, once per table."""
        memo, key = self.columns.memo, ("of column", what, name)
        if key not in memo:
            memo[key] = make(self._whole(name))
        found: Of = memo[key]
        return found

    def covariates(self, suffix: str = "") -> tuple[str, ...]:
        """Varying numeric covariates whose name ends with `suffix`, by name; channels are none."""
        taken = {c.name for c in self.columns.channels}
        return tuple(
            name for name in sorted(self.columns.numbers)
            if name.endswith(suffix) and not name.startswith("sim_") and name not in taken
            and not (name.endswith("_std") and name.removesuffix("_std") in taken) and self.varies(name)
        )  # fmt: skip

    def currents(self) -> tuple[str, ...]:
        """Varying currents that may drive a laser; a cooler's is none."""
        return tuple(n for n in self.covariates() if unit_of(n) in {"A", "mA", "uA"} and "tec" not in n)

    def voltages(self) -> tuple[str, ...]:
        """Varying voltages."""
        return tuple(n for n in self.covariates() if unit_of(n) in {"V", "mV"})

    def temperatures(self, *first: str) -> tuple[str, ...]:
        """Varying temperature covariates (`…_c`), those named in `first` before the others."""
        names = self.covariates("_c")
        return tuple(n for n in first if n in names) + tuple(n for n in names if n not in first)

    # ---- channels --------------------------------------------------------------------------------------------

    def channels(self, role: Role) -> tuple[Channel, ...]:
        """Channels of a role, e.g. every intensity."""
        return tuple(c for c in self.columns.channels if c.role is role)

    def channel(self, role: Role) -> str:
        """Name of the first channel of a role, empty where the table has none."""
        found = self.channels(role)
        return found[0].name if found else ""

    def frames(self) -> FloatArray:
        """Frames averaged in each row."""
        return self.number("n_frames") if "n_frames" in self.columns.numbers else np.ones(self.n)

    def fresh_state(self) -> State:
        """The untouched simulation: what `apply` starts from."""
        return dict(self.sim)

    # ---- groups ----------------------------------------------------------------------------------------------

    def group(self, *names: str) -> IntArray:
        """Code of the combination of those of `names` that the table has (the same on any subset)."""
        return self.columns.group(*names)[self.rows]

    def frame(self) -> IntArray:
        """Code of the image a row belongs to: one stage angle of one step of one DUT, or one lamp's level there."""
        return self.group(*self.columns.image_columns)

    def step(self) -> IntArray:
        """Code of (`dut`, `cycle`, `step`)."""
        return self.group(*_STEP)

    # ---- neighbours ------------------------------------------------------------------------------------------

    def neighbour(self, state: State, channel: str, *, du: int, dv: int) -> FloatArray:
        """Value of the pixel `du` columns and `dv` rows further in the same image; NaN where there is none."""
        place = self.neighbour_place(du=du, dv=dv)
        return self.take(state, channel, place, own=self.columns.image_columns)

    def neighbour_number(self, name: str, *, du: int, dv: int) -> FloatArray:
        """A numeric column at the neighbouring pixel of the same image."""
        return self.take_number(name, self.neighbour_place(du=du, dv=dv))

    def neighbour_place(self, *, du: int, dv: int) -> IntArray:
        """Whole-table row of the neighbouring pixel of the same image, −1 where there is none."""
        if (du, dv) not in self._places:
            raster = self.raster()
            u, v = raster.u[self.rows] + du, raster.v[self.rows] + dv
            place = raster.rows_at(self.frame(), u, v)
            if np.any(place < 0) and is_still(self.columns):
                grid, picture = still_grid(self.columns)
                place = np.where(place >= 0, place, grid.rows_at(picture[self.rows], u, v))
            self._places[du, dv] = place
        return self._places[du, dv]

    def in_sweep(self, state: State, channel: str, *, steps: int) -> FloatArray:
        """Value of the same pixel `steps` stage angles further (by angle, not by time); NaN beyond the sweep."""
        return self.take(state, channel, self.sweep_place(steps), own=self._sweep())

    def _sweep(self) -> tuple[str, ...]:
        """Columns that tell apart what the stage swept under one condition."""
        own = self.columns.sweep_columns
        return (*own, "set_temperature_c", "ramp") if "step" in own else own

    def sweep_place(self, steps: int) -> IntArray:
        """Whole-table row of the same ray `steps` stage angles further, −1 where there is none."""
        cell = self.columns.group(*self._sweep(), *self.columns.ray_columns)
        order = self.columns.numbers["stage_angle_deg"]
        place = self.columns.following(("sweep", steps), cell, order, steps)[self.rows]
        gap = self.columns.sweep_gap_deg
        place = self._near(place, order, gap * abs(steps))
        if abs(steps) == 1 and np.isfinite(gap) and np.any(place < 0) and is_still(self.columns):
            place = np.where(place >= 0, place, next_angle(self.columns, self.rows, steps, gap))
        return place

    def acquired_before(self, state: State, channel: str, *, frames: int = 1) -> FloatArray:
        """Value of the same ray `frames` stage positions *earlier in time* (see `Columns.sweep_order`)."""
        return self.take(state, channel, self.acquired_place(frames))

    def acquired_place(self, frames: int = 1) -> IntArray:
        """Whole-table row of the same ray `frames` stage positions earlier in time, −1 where there is none."""
        cell = self.columns.group(*self.columns.sweep_columns, *self.columns.ray_columns)
        order = self.columns.sweep_order
        place = self.columns.following(("acquired", frames), cell, order, -frames)[self.rows]
        gap = self.columns.frame_gap_s if self.varies("time_s") else self.columns.sweep_gap_deg
        return self._near(place, order, gap * frames)

    def _near(self, place: IntArray, order: FloatArray, gap: float) -> IntArray:
        """Places without those that lie farther away than neighbours do: a hole in the sweep is no neighbour."""
        if not np.isfinite(gap):
            return place
        return np.where(np.abs(order[place] - order[self.rows]) <= gap, place, -1)

    def step_before(self, state: State, channel: str) -> FloatArray:
        """Value of the same pixel and angle in the step before; NaN in the first step."""
        cell = self.columns.group("dut", "cycle", "stage_angle_deg", *_PIXEL)
        order = self.columns.numbers["step" if "step" in self.columns.numbers else "time_s"]
        return self.take(state, channel, self.columns.following(("step", -1), cell, order, -1)[self.rows])

    def elsewhere_place(self, angle: FloatArray) -> IntArray:
        """Whole-table row of the same ray at another stage angle, in whichever step; −1 where no step holds it."""
        return at_angle(self.columns, self.rows, angle)

    def seen_elsewhere(self, state: State, channel: str, place: IntArray) -> FloatArray:
        """Value of a scene that stands still at such rows, under the row's own conditions; NaN where −1."""
        return self.take(state, channel, place, own=self.columns.sweep_columns)

    def take(self, state: State, channel: str, place: IntArray, *, own: tuple[str, ...] = ()) -> FloatArray:
        """Value of `channel` at whole-table rows `place` (−1: NaN); see the module's text for rows outside.

        `own`: columns that tell what a row's neighbours are in; those in another one count as outside.
        """
        now = state[channel]
        reference = self.columns.numbers.get(f"sim_{channel}")
        if reference is None:
            reference = np.full(self.columns.n, np.nan)
        local = self._local_index()[place]
        with np.errstate(invalid="ignore", divide="ignore"):
            ratio = np.where(self.sim[channel] != 0.0, now / self.sim[channel], 1.0)
            outside = reference[place] * np.where(np.isfinite(ratio), ratio, 1.0)
        if own and is_still(self.columns):
            group = self.columns.group(*own)
            local = np.where(group[place] == group[self.rows], local, -1)
        value = np.where(local >= 0, now[local], outside)
        return np.where(place >= 0, value, np.nan)

    def take_number(self, name: str, place: IntArray) -> FloatArray:
        """A numeric column at whole-table rows `place`; NaN where −1."""
        return np.where(place >= 0, self.columns.numbers[name][place], np.nan)

    def frame_mean(self, state: State, channel: str) -> FloatArray:
        """Mean of a channel over the row's image (the whole table's, scaled by what earlier stages did here)."""
        whole = self.mean_of_group(f"sim_{channel}", *self.columns.image_columns)
        if state[channel] is self.sim[channel]:
            return whole
        code = np.unique(self.frame(), return_inverse=True)[1]
        good = np.isfinite(state[channel]) & np.isfinite(self.sim[channel])
        now = np.bincount(code, np.where(good, state[channel], 0.0))
        before = np.bincount(code, np.where(good, self.sim[channel], 0.0))
        with np.errstate(invalid="ignore", divide="ignore"):
            ratio = np.where(before != 0.0, now / before, 1.0)
        return whole * ratio[code]

    def mean_of_group(self, name: str, *groups: str) -> FloatArray:
        """Mean of a numeric column over the groups of the *whole* table, on the rows under work."""
        key = ("mean", name, groups)
        if key not in self._cache:
            code = self.columns.group(*groups)
            values = self.columns.numbers[name]
            good = np.isfinite(values)
            total = np.bincount(code, np.where(good, values, 0.0))
            count = np.bincount(code, good.astype(float))
            with np.errstate(invalid="ignore", divide="ignore"):
                self._cache[key] = (total / count)[code][self.rows]
        return self._cache[key]

    def raster(self) -> ImageGrid:
        """The raster of the whole table's images."""
        memo = self.columns.memo
        if "image grid" not in memo:
            memo["image grid"] = ImageGrid(self.columns)
        found: ImageGrid = memo["image grid"]
        return found

    def _local_index(self) -> IntArray:
        if self._local is None:
            local = np.full(self.columns.n + 1, -1, dtype=np.int64)  # last entry answers place −1
            local[self.rows] = np.arange(self.n)
            self._local = local
        return self._local


def _varies(values: FloatArray) -> bool:
    finite = values[np.isfinite(values)]
    return finite.size > 1 and bool(finite.max() > finite.min())
