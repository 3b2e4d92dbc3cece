"""Which rows share errors: groups told from the columns that a table has.

Rows of one step share what the bench did in that step, rows of one image what it did in that image, all rows of a
pixel its fixed pattern, all rows of a stage angle the stage's own error. A table without steps is cut into blocks
of neighbouring conditions instead: rows next to each other in time or in a swept quantity are never independent
witnesses.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from arl_fixtures.reconcile.columns import IMAGE_COLUMNS, Columns, FloatArray, IntArray
from arl_fixtures.reconcile.roles import PIXEL_COLUMNS, counts_repeats, counts_visits, unit_of

UNIT_WORDS = ("zone", "pixel", "channel", "sensor", "device", "unit", "module", "serial", "run", "tap")
PART_WORDS = ("readout", "head", "amplifier", "receiver", "probe", "adc", "camera")
"""Parts that a table names; where it has numbers of them these are as well settings or readings."""
DEVICE_WORDS = ("dut", "sensor", "device", "module", "serial", "run")
"""Columns that tell instruments or recordings apart; zones or taps of one device share the errors of its steps."""
PATCHES, RUNS, STAGE_ANGLES = "patches of pixels", "runs of neighbouring rows", "stage angles"
WITHIN_IMAGES = (PATCHES, RUNS)
"""Blocks that take a part of each image."""
BLOCKS_WITHOUT_STEPS = 16
FEWEST_BLOCKS = 5
ROWS_OF_A_CURVE, FEWEST_CURVES = 8.0, 2
SHORTEST_RUN = 3
"""Rows that follow one another from which they may share an error of their own."""
DRIVES = {"A", "mA", "uA", "V", "mV", "W", "mW", "uW"}
"""Units of what a device is driven by, set anew for every curve."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Groups:
    """Codes on all rows of a table, 0…k−1 each; None where the table has no such level.

    Attributes:
        unit: what is calibrated as one (a DUT, a zone, a run).
        step: rows that share the bench's state.
        frame: rows of one image, nested in `step`.
        pixel: rows of one pixel of one unit.
        angle: rows of one stage angle of one unit.
        stretch, spell: rows of a step that follow one another in time where no images are told apart: a few, nested
            in many. Where blocks of time stand for steps what wanders over them is what is asked for.
        block: unit of holding out: steps, or blocks of neighbouring conditions.
        block_name: what a block is, for the report.
        unit_columns: columns that make the unit.
        of_curves: a step is a part of a swept quantity in several curves over it: no state of the bench to share.
    """

    unit: IntArray
    step: IntArray
    frame: IntArray | None
    pixel: IntArray | None
    angle: IntArray | None
    block: IntArray
    block_name: str
    unit_columns: tuple[str, ...]
    of_curves: bool = False
    stretch: IntArray | None = None
    spell: IntArray | None = None

    @property
    def unseen_alike(self) -> IntArray | None:
        """Rows whose common error holding blocks out does not test, as blocks take some of each; None for none."""
        if self.block is self.step:
            return None
        return self.frame if self.frame is not None and self.block_name in WITHIN_IMAGES else self.step


GAP_SHARE = 1.7
"""Of the usual distance of neighbours, beyond which one between them is missing."""


def find_groups(table: Columns) -> Groups:
    """Groups of a table, see `Groups`."""
    unit_columns = unit_columns_of(table)
    unit = table.group(*unit_columns)
    step_columns: tuple[str, ...] = tuple(n for n in ("cycle", "step") if n in table.numbers)
    visits: tuple[str, ...] = ()
    if "step" not in table.numbers:
        visits = _visit_columns(table, unit_columns)
        step_columns += tuple(n for n in ("set_temperature_c", "ramp") if n in table.numbers) + visits
    device = table.group(*(n for n in unit_columns if n.startswith(DEVICE_WORDS)))
    step = _dense(device, table.group(*step_columns)) if step_columns else unit
    name = f"levels of {visits[0]}" if visits else "temperature steps"
    repeated, of_curves = None, False
    # a stage turns all zones or channels of a device at once
    angle = _dense(device, table.codes_of("stage_angle_deg")) if _few(table, "stage_angle_deg") else None
    if not step_columns:
        swept = swept_column(table)
        if angle is not None and swept != "time_s":  # every pose once: what a pose shares is what a step shares
            step, angle, name = _dense(device, table.codes_of("stage_angle_deg")), None, STAGE_ANGLES
        elif swept:
            step = _dense(device, _blocks_along(table.numbers[swept]))
            name = f"blocks of neighbouring {swept}"
            of_curves = unit_of(swept) in DRIVES and _curves_over(table, swept)
            repeated = None if of_curves else _dense(step, table.codes_of(swept))  # equal to the last digit
    frame = _dense(step, angle) if angle is not None else repeated
    if len(table.image_columns) > len(IMAGE_COLUMNS):
        frame = _dense(step, table.group(*table.image_columns))
    pixel = None
    if "pixel_u" in table.numbers or "pixel_v" in table.numbers:
        pixel = _dense(unit, table.group("pixel_u", "pixel_v"))
    pixel = _if_repeated(pixel, table.n)
    angle = _if_repeated(angle, table.n)
    frame = _if_repeated(frame, table.n)
    if frame is not None and frame.max() == step.max():
        frame = None
    told = not step_columns or any(code is not None for code in (frame, angle, pixel))
    stretch, spell = (None, None) if told else _following(table, _dense(unit, step))
    block = step
    if step.max() < FEWEST_BLOCKS - 1:
        block, name = _last_resort(table, unit)
    return Groups(
        unit=unit, step=step, frame=frame, pixel=pixel, angle=angle, block=block, block_name=name,
        unit_columns=unit_columns, of_curves=of_curves, stretch=stretch, spell=spell,
    )  # fmt: skip


def _following(table: Columns, cell: IntArray) -> tuple[IntArray | None, IntArray | None]:
    """Few and many rows that follow one another in time within a cell (what one unit measured in one step).

    Slow noise has no length of its own: runs of two lengths part the octaves between a row and a cell evenly.
    """
    if "time_s" not in table.numbers:
        return None, None
    size = np.bincount(cell)
    order = np.lexsort((table.numbers["time_s"], cell))
    place = np.empty(table.n, dtype=np.int64)
    place[order] = np.arange(table.n) - (np.cumsum(size) - size)[cell[order]]
    few, many = (round(float(np.median(size[cell])) ** power) for power in (1.0 / 3.0, 2.0 / 3.0))
    spell = _dense(cell, place // max(many, 1))
    return _dense(spell, place // few) if few >= SHORTEST_RUN else None, spell if many >= SHORTEST_RUN else None


def swept_column(table: Columns) -> str:
    """The numeric covariate along which the rows were taken: time, else the one with most distinct values."""
    taken = {c.name for c in table.channels}
    best, most = "", 7
    for name, values in sorted(table.numbers.items()):
        bare = name.removesuffix("_std")
        if name.startswith("sim_") or name in taken or bare in taken or name in PIXEL_COLUMNS | {"n_frames"}:
            continue
        finite = values[np.isfinite(values)]
        distinct = len(np.unique(finite)) if len(finite) > 0.9 * table.n else 0
        if name == "time_s" and distinct > 7:
            return name
        smooth = name in {"true_range_m", "stage_angle_deg"} or "drive" in name
        if distinct * (100 if smooth and distinct > 7 else 1) > most:
            best, most = name, distinct * (100 if smooth else 1)
    return best


def _curves_over(table: Columns, swept: str) -> bool:
    """Whether other quantities, of few values each, tell curves over a swept one apart.

    What rows at a current have in common at every temperature is what the current does, not an error of that moment.
    Not so of places: a stop of a rail is off by the same before every target.
    """
    taken = {c.name for c in table.channels}
    others = [
        name for name, x in sorted(table.numbers.items())
        if name not in (swept, "n_frames", *unit_columns_of(table)) and not name.startswith(("sim_", "pixel_"))
        and name not in taken and name.removesuffix("_std") not in taken
        and not name.endswith("_counts") and 1 < len(np.unique(x)) <= table.n / ROWS_OF_A_CURVE
    ]  # fmt: skip
    count = np.bincount(table.group(*others))
    return len(count) >= FEWEST_CURVES and float(np.median(count)) >= ROWS_OF_A_CURVE


def unit_columns_of(table: Columns) -> tuple[str, ...]:
    """Columns that tell apart what is calibrated as one."""
    if "dut" in table.categories:
        return ("dut",)
    found = [
        n for n in sorted(table.categories)
        if n not in {"surface", "mixed"} and any(w in n for w in (*UNIT_WORDS, *PART_WORDS))
    ]  # fmt: skip
    for name in sorted(table.numbers):
        if name.startswith(("sim_", "pixel_")) or not any(
            word == name or name.startswith(word) for word in UNIT_WORDS
        ):
            continue
        values = table.numbers[name]
        values = values[np.isfinite(values)]
        if len(values) and np.all(values == np.round(values)) and 1 < len(np.unique(values)) <= 64:
            found.append(name)
    return tuple(found)


def _visit_columns(table: Columns, unit_columns: tuple[str, ...]) -> tuple[str, ...]:
    """The column that numbers stops, read-outs or the like, the one with most levels; none where none does."""
    best: tuple[str, ...] = ()
    most = 2
    for name in sorted({*table.numbers, *table.categories} - set(unit_columns)):
        if not counts_visits(name) and not counts_repeats(name):
            continue
        if name in table.numbers and not np.array_equal(table.numbers[name], np.round(table.numbers[name])):
            continue  # a NaN is no number of a stop
        levels = int(table.group(name).max()) + 1
        if counts_repeats(name) and levels < FEWEST_BLOCKS:
            continue
        if most < levels <= table.n // 3:
            best, most = (name,), levels
    return best


def _few(table: Columns, name: str) -> bool:
    if name not in table.numbers:
        return False
    return 1 < len(np.unique(table.numbers[name])) < max(table.n // 3, 2)


def _dense(*codes: IntArray) -> IntArray:
    result = codes[0]
    for code in codes[1:]:
        joint = result * (int(code.max()) + 1) + code
        result = np.unique(joint, return_inverse=True)[1].astype(np.int64)
    return result


def _if_repeated(code: IntArray | None, n: int) -> IntArray | None:
    """A level is of use only with at least three groups and on average two rows in each."""
    if code is None or code.max() < 2 or (int(code.max()) + 1) * 2 > n:
        return None
    return code


def _blocks_along(values: FloatArray) -> IntArray:
    """Blocks of neighbouring values, equally filled."""
    ranked = np.nan_to_num(values, nan=float(np.nanmedian(values)))
    distinct = len(np.unique(ranked))
    pieces = int(min(BLOCKS_WITHOUT_STEPS, max(distinct // 2, 2)))
    edges = np.unique(np.quantile(ranked, np.linspace(0, 1, pieces + 1)[1:-1]))
    return np.searchsorted(edges, ranked, side="right").astype(np.int64)


def _last_resort(table: Columns, unit: IntArray) -> tuple[IntArray, str]:
    """Blocks for holding out where steps are too few: angles, patches of pixels, else runs of rows."""
    if _few(table, "stage_angle_deg"):
        return table.codes_of("stage_angle_deg"), STAGE_ANGLES
    if "pixel_u" in table.numbers:
        v = table.numbers.get("pixel_v", np.zeros(table.n))
        return table.group("pixel_u") // 4 * 1000 + np.nan_to_num(v).astype(np.int64) // 4, PATCHES
    pieces = max(min(BLOCKS_WITHOUT_STEPS, table.n // 2), 1)
    return np.arange(table.n) * pieces // table.n, RUNS


def typical_gaps(table: Columns) -> tuple[float, float]:
    """Largest distance of neighbours in the sweep (degrees) and in time (seconds): `GAP_SHARE` of the usual."""
    gaps = []
    for name in ("stage_angle_deg", "time_s"):
        gap = np.inf
        if name in table.numbers:
            cell = table.group(*table.sweep_columns)
            order = np.lexsort((table.numbers[name], cell))
            steps = np.diff(table.numbers[name][order])[np.diff(cell[order]) == 0]
            steps = steps[np.isfinite(steps) & (steps > 1e-9)]
            gap = GAP_SHARE * float(np.median(steps)) if len(steps) else np.inf
        gaps.append(gap)
    return gaps[0], gaps[1]


def folds_of(block: IntArray, folds: int) -> IntArray:
    """Fold of each row: whole blocks, spread evenly over their order by a fixed stride."""
    present, inverse = np.unique(block, return_inverse=True)
    order = (np.arange(len(present)) * 7 + np.arange(len(present)) // folds) % folds
    return order[inverse].astype(np.int64)
