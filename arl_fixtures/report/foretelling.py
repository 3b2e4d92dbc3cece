"""Do cheap operating signals foretell the performance? Rank correlations of all with all, as matrices and a table."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

import numpy as np

from arl_fixtures.journal.record import AttemptRecord
from arl_fixtures.metrics.correlation import Correlation
from arl_fixtures.report.blocks import Block, Cell, Picture, Section, Table, Text
from arl_fixtures.report.cycles import Cycle
from arl_fixtures.report.drawing import drawn, label
from arl_fixtures.report.series import FALSE_DISCOVERIES, correlations
from arl_fixtures.report.text import shown

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TITLE: Final = "Operating signals and performance"
MOST_PAIRS: Final = 15
NO_VALUE: Final = "#ececec"


def foretelling(cycles: Sequence[Cycle], pictures: dict[str, bytes]) -> Section:
    """Every operating signal with every performance metric: over the newest cycle's steps, and over all cycles'."""
    newest = cycles[-1]
    series = {f"over the steps of cycle {newest.number}": list(newest.finished)}
    if len(cycles) > 1:
        all_steps = [attempt for cycle in cycles for attempt in cycle.finished]
        series[f"over the steps of all {len(cycles)} cycles"] = all_steps
    serials = [dut.serial for dut in newest.record.identity.duts]
    blocks: list[Block] = []
    for number, (over, attempts) in enumerate(series.items(), start=1):
        blocks += _over(over, attempts, serials, number, pictures)
    return Section(title=TITLE, blocks=tuple(blocks))


def _over(
    over: str, attempts: Sequence[AttemptRecord], serials: Sequence[str], number: int, pictures: dict[str, bytes]
) -> list[Block]:
    found = {serial: correlations(attempts, serial) for serial in serials}
    known = {serial: [pair for pair in pairs if not math.isnan(pair.p)] for serial, pairs in found.items()}
    tried = sum(len(pairs) for pairs in known.values())
    if not tried:
        reasons = dict.fromkeys(pair.reason for pairs in found.values() for pair in pairs if pair.reason)
        why = f": {shown(next(iter(reasons)))}" if reasons else ""
        return [Text(text=f"Nothing to correlate {over}{why}.")]
    count = sum(pair.q <= FALSE_DISCOVERIES for pairs in known.values() for pair in pairs)
    blocks: list[Block] = [Text(text=_method(over, len(attempts), tried))]
    blocks.append(_table(over, known, count) if count else Text(text=f"No pair was found {over}."))
    still = _without_variation(found)
    if still:
        blocks.append(Text(text=f"Did not vary, or too few independent steps: {', '.join(still)}."))
    for place, serial in enumerate(serials, start=1):
        if not known[serial]:
            continue
        name = f"foretelling-{number}-{place}.svg"
        pictures[name] = _matrix(found[serial])
        blocks.append(
            Picture(
                name=name,
                caption=f"DUT {shown(serial)}, {over}: rank correlation given set temperature and ramp. "
                f"Dots: reported at a false discovery rate of {100 * FALSE_DISCOVERIES:g}\u00a0%; grey: too few "
                "independent steps.",
                alt=f"Matrix of the correlations of operating signals with metrics of {shown(serial)}, {over}",
                share=0.49,
            )
        )
    return blocks


def _method(over: str, steps: int, tried: int) -> str:
    return (
        f"Spearman's rank correlation of every operating signal with every performance metric {over} ({steps} steps, "
        f"{tried} pairs). Signals and metrics all follow the temperature, which would let everything foretell "
        "everything: what the ranks of set temperature and ramp explain is taken out of both first (partial rank "
        "correlation). Intervals are for 95 % (Bonett and Wright), with steps that resemble their neighbours counted "
        f"by what they are worth; pairs are reported at a false discovery rate of {100 * FALSE_DISCOVERIES:g} % for "
        "each DUT (Benjamini-Yekutieli)."
    )


def _without_variation(found: dict[str, list[Correlation]]) -> list[str]:
    """Signals and metrics that are in no pair of any DUT."""
    names = [{getattr(pair, of): None for pairs in found.values() for pair in pairs} for of in ("signal", "metric")]
    told = [pair for pairs in found.values() for pair in pairs if not math.isnan(pair.p)]
    known = {pair.signal for pair in told} | {pair.metric for pair in told}
    return sorted(shown(name) for each in names for name in each if name not in known)


def _table(over: str, known: dict[str, list[Correlation]], count: int) -> Table:
    rows = tuple(
        (
            Cell(shown(serial)),
            Cell(shown(pair.signal)),
            Cell(shown(pair.metric)),
            Cell(f"{pair.rho:+.2f} ({pair.low:+.2f} … {pair.high:+.2f})"),
            Cell(f"{pair.effective_steps:.0f} of {pair.steps}"),
            Cell(f"{pair.q:.1g}"),
        )
        for serial, pairs in known.items()
        for pair in [each for each in pairs if each.q <= FALSE_DISCOVERIES][:MOST_PAIRS]
    )
    return Table(
        title=f"Strongest evidence {over}",
        header=("DUT", "Operating signal", "Metric", "ρ (95 %)", "Independent steps", "q"),
        rows=rows,
        weights=(1.6, 2.0, 2.6, 2.2, 1.5, 0.8),
        note=f"{count} pairs found; at most {MOST_PAIRS} for each DUT are listed.",
    )


def _matrix(pairs: Sequence[Correlation]) -> bytes:
    """Metrics by signals, coloured by ρ."""
    pairs = [pair for pair in pairs if not math.isnan(pair.p)]
    signals, metrics = (sorted({getattr(pair, of) for pair in pairs}) for of in ("signal", "metric"))
    rho = np.full((len(metrics), len(signals)), np.nan)
    told = []
    for pair in pairs:
        row, column = metrics.index(pair.metric), signals.index(pair.signal)
        rho[row, column] = pair.rho
        if pair.q <= FALSE_DISCOVERIES:
            told.append((column, row))

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        axes.grid(visible=False)
        axes.set_facecolor(NO_VALUE)
        image = axes.imshow(rho, aspect="auto", interpolation="nearest", cmap="RdBu_r", vmin=-1.0, vmax=1.0)
        axes.set_xticks(range(len(signals)), [label(each) for each in signals], rotation=90)
        axes.set_yticks(range(len(metrics)), [label(each) for each in metrics])
        axes.tick_params(labelsize=7.5, length=0)
        if told:
            axes.plot(*zip(*told, strict=True), "o", color="black", markersize=3, linestyle="none")
        figure.colorbar(image, ax=axes, location="top", shrink=0.6, aspect=30, pad=0.01, label="ρ")

    return drawn(draw, 0.17 * len(metrics) + 2.4)
