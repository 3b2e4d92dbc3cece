"""Pieces of the page: the rows of a channel, what was held back, and the sizes and blocks in words."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from arl_fixtures.reconcile import page_words as words
from arl_fixtures.reconcile.channel_data import ChannelData
from arl_fixtures.reconcile.columns import Columns, FloatArray, IntArray
from arl_fixtures.reconcile.effect import State
from arl_fixtures.reconcile.grouping import Groups
from arl_fixtures.reconcile.roles import Role

FAR_Z, FEW = 10.0, 0.01
"""So few rows so many standard errors off are outliers, not a mismatch."""
HELD_BACK = 0.25
"""Weight below which a row is held back (see `lonely`)."""


def misfit_of_fold(d: ChannelData, state: State, fold: int, *, centred: bool = False) -> float:
    """Mean square of what a state leaves in one fold, in stated errors; centred: beside a unit's constant."""
    residual = d.residual(state)
    if centred and d.calibrated:
        residual = residual - d.scale * d.constants(residual)[d.unit]
    here = d.fold == fold
    return float(np.sum((d.trust * (residual / d.stated) ** 2)[here]) / max(float(np.sum(d.trust[here])), 1e-12))


def rays_of(columns: Columns) -> list[tuple[str, str]]:
    """Where the directions of pixels come from that the table does not give."""
    if not columns.derived:
        return []
    if not columns.lens:
        return [("Rays", "not all in the table; those of the nominal camera")]
    if "fx" not in columns.lens:
        level = columns.lens["elevation_deg"]
        return [("Rays", f"elevation not in the table; the floor that the line sees shows {level:.3g}°")]
    pitch = float(np.degrees(1.0 / columns.lens["fx"]))
    if "azimuth_deg" not in columns.derived:
        pitch = float(np.degrees(1.0 / columns.lens["fy"]))
        return [("Rays", f"elevation not in the table; the planes that pixels see show {pitch:.3g}° from row to row")]
    return [
        ("Rays", f"not in the table; its sweep shows {pitch:.3g}° from pixel to pixel in the middle of the image")
    ]


def held_back(d: ChannelData) -> str:
    """How many rows are off by far alone and count for next to nothing, empty where none are."""
    count = int(np.sum(d.trust < HELD_BACK))
    if not count:
        return ""
    rows = "1 row lies" if count == 1 else f"{words.counted(count)} rows lie"
    return f"; {rows} far off alone and {'counts' if count == 1 else 'count'} for next to nothing"


def outliers(d: ChannelData, state: State) -> str:
    """A sentence about the few rows that make most of a mean square, empty where none do."""
    residual = d.residual(state)
    if d.calibrated:
        residual = residual - d.scale * d.constants(residual)[d.unit]
    power = (residual / (d.stated * d.spread)) ** 2
    far = power > FAR_Z**2
    if not 0 < far.sum() < FEW * len(far) or power[far].sum() < 0.5 * power.sum():
        return ""
    count = words.counted(int(far.sum()))
    rows = "1 row lies" if far.sum() == 1 else f"{count} rows lie"
    return f"{rows} more than {FAR_Z:g} standard errors off and make most of what is left: single outliers."


def size_text(d: ChannelData, moved: FloatArray) -> str:
    """How much a change usually is, and at most, in the channel's unit or percent."""
    size = np.abs(moved)
    good = np.isfinite(size) & (size > 0.02 * float(np.nanmax(size, initial=0.0)))
    if not good.any():
        return ""
    factor, unit = (1000.0, "mm") if d.channel.unit == "m" else (1.0, words.unit_text(d.channel.unit))
    relative = None
    if d.channel.role in {Role.INTENSITY, Role.SCATTER}:
        relative = float(np.median(size[good] / d.scale[good]))
    typical, most = (float(np.quantile(size[good], q)) * factor for q in (0.5, 0.95))
    return words.size_sentence(typical, most, float(np.median(d.stated * d.spread)) * factor, unit, relative)


def level_text(columns: Columns, label: str, names: Sequence[str]) -> str:
    """Which levels of a grouping there are, in words."""
    if label == "DUTs":
        labels = columns.categories["dut"][1] if "dut" in columns.categories else ()
        shown = ", ".join(labels[:8]) + (f" and {len(labels) - 8} more" if len(labels) > 8 else "")
        return f"{len(labels)}: {shown}"
    return str(int(columns.group(*names).max()) + 1)


def block_names(columns: Columns, groups: Groups, rows: IntArray) -> list[str]:
    """Names of the blocks that some rows belong to, from the columns that make a block."""
    code, first = np.unique(groups.block[rows], return_index=True)
    if groups.block_name == "temperature steps":
        return [step_name(columns, int(rows[k])) or f"block {c + 1}" for c, k in zip(code, first, strict=True)]
    column = "stage_angle_deg" if groups.block_name == "stage angles" else groups.block_name.rsplit(" ", 1)[-1]
    if column not in columns.numbers:
        return [f"block {c + 1}" for c in code]
    values = columns.numbers[column]
    unit = words.unit_text(words.column_unit(column))
    names = []
    for c in code:
        here = values[rows[groups.block[rows] == c]]
        low, high = float(np.nanmin(here)), float(np.nanmax(here))
        names.append(f"{words.plain(low)}{f' to {words.plain(high)}' if high > low else ''} {unit}".rstrip())
    return names


def step_name(columns: Columns, row: int) -> str:
    """DUT, cycle and step of a row in words."""
    text = []
    for name, word in (("dut", ""), ("cycle", "cycle "), ("step", "step ")):
        if name in columns.categories:
            code, labels = columns.categories[name]
            text.append(labels[code[row]] if len(labels) > 1 and code[row] >= 0 else "")
        elif name in columns.numbers and (name != "cycle" or columns.group("cycle").max() > 0):
            text.append(f"{word}{columns.numbers[name][row]:g}")
    if "step" not in columns.numbers and "set_temperature_c" in columns.numbers:
        text.append(f"{columns.numbers['set_temperature_c'][row]:g} °C")
    return " ".join(t for t in text if t)
