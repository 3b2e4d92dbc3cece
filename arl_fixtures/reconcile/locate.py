"""Where a residual carries structure: every column, and every column that changes the slope on another one.

For each pair of a grouping (a column's levels or bins, `pixel_u` modulo a period, patches of pixels …) and a slope
(1, a temperature, time, cycle, ramp, angle) the residual is asked for one coefficient per bin, all drawn from one
normal law: a test with a single degree of freedom, the law's width. What the bins' coefficients say in one half of
the blocks must also predict the other half. Both together keep the whole family of some hundred looks below one
false alarm in a hundred tables, with rows of a step, of an image or of a pixel sharing what they like.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from arl_fixtures.reconcile.channel_data import ChannelData
from arl_fixtures.reconcile.columns import BoolArray, FloatArray, IntArray
from arl_fixtures.reconcile.effect import State
from arl_fixtures.reconcile.features import category_id
from arl_fixtures.reconcile.law import Axis, Law, LawTerm
from arl_fixtures.reconcile.law_fit import scatter_where
from arl_fixtures.reconcile.noise import fit_tau
from arl_fixtures.reconcile.patterns import half_z, shared_part
from arl_fixtures.reconcile.pilot import Looker
from arl_fixtures.reconcile.roles import FIELD_COLUMNS, PER_TURN, PIXEL, Role

LOCATED_GAIN, LOCATED_Z = 11.0, 3.5
MOST_BINS = 24
MOST_PLACES = 3
PERIODS = (2, 3, 4, 6, 8, 16)
WITHIN_STEPS = ("pixel_v", "pixel_u", "zone", "elevation_deg", "azimuth_deg", *FIELD_COLUMNS)
STEP_BINS, STEP_GAIN = 12, 20.0
STEP_SLOPE = Axis(column="step", kind="one")
"""Marks a pattern that each step has anew."""
SLOPES = ("cycle", "time_s", "ramp", "stage_angle_deg")


@dataclass(frozen=True, slots=True, kw_only=True)
class Place:
    """Structure over the bins of a column, perhaps as a slope on another.

    Attributes:
        table: the coefficients as an axis function; slope: what they multiply.
        gain: log-likelihood of the coefficients' width.
        z: how well one half of the blocks predicts the other.
    """

    table: Axis
    slope: Axis
    gain: float
    z: float

    @property
    def columns(self) -> list[str]:
        """The columns concerned, the binned one first."""
        return [self.table.column] + ([self.slope.column] if self.slope.column else [])


def locate(looker: Looker, data: ChannelData, state: State) -> Place | None:
    """The strongest structure of a channel's residual, None where nothing stands out."""
    residual = data.residual(state)
    residual = residual - shared_part(data, residual)
    weight = data.root_weight**2
    half = np.unique(data.block, return_inverse=True)[1] % 2
    parts = half == 0, half == 1
    features = {name: values[data.use] for name, values in looker.features.items()}
    step = looker.problem.groups.step[looker.problem.view.rows[data.use]]
    best = _own_in_steps(data, residual, features, step)
    images = data.level("frame")
    frame = None if images is None else images.code
    slopes: list[tuple[Axis, bool, _Sums]] = []
    for slope in _slopes(features, looker):
        if slope.column:
            slope = replace(slope, middle=_mean(np.nan_to_num(features[slope.column]), weight * data.scale**2))
        sums = _Sums(data.expect * data.scale * slope(features), residual, weight, parts)
        slopes.append((slope, not slope.column or _constant_in(features[slope.column], step), sums))
    for binning, code in _binnings(features, looker):
        # bins and slope both constant within steps: what steps share by chance would pass for structure
        shared, codes = _constant_in(code.astype(np.float64), step), tuple(code[part] for part in parts)
        for slope, alike, sums in slopes:
            if slope.column == binning.column or (shared and alike):
                continue
            found = _test(binning, slope, codes, sums)
            if found is None or (best is not None and found.gain <= best.gain):
                continue
            change = (
                np.asarray(found.table.values)[code] * data.expect * data.scale * slope(features) * data.root_weight
            )
            scatter = scatter_where(change, residual * data.root_weight - change, frame)
            found = replace(found, gain=found.gain / scatter, z=found.z / np.sqrt(scatter))
            if found.gain > (best.gain if best else LOCATED_GAIN) and found.z > LOCATED_Z:
                best = found
    return best


def where_it_acts(looker: Looker, data: ChannelData, state: State, table: Axis) -> Place | None:
    """In which bins of another column what a table says acts, and how much; None where that differs in no column.

    Args:
        looker: of the problem; data: the channel, or a part of it; state: simulation, not corrected by the table.
        table: coefficients over the bins of one column, which are the slope.
    """
    residual, half = data.residual(state), np.unique(data.block, return_inverse=True)[1] % 2
    parts = half == 0, half == 1
    features = {name: values[data.use] for name, values in looker.features.items()}
    direction = data.expect * data.scale * table(features)
    weight = data.root_weight**2
    mean = float(weight @ (direction * residual)) / max(float(weight @ direction**2), 1e-300)
    sums, best = _Sums(direction, residual - mean * direction, weight, parts), None
    for binning, code in _binnings(features, looker):
        if binning.column == table.column:
            continue
        found = _test(binning, table, tuple(code[part] for part in parts), sums)
        if found is not None and (best is None or found.gain > best.gain):
            values = tuple(mean + value for value in found.table.values)
            best = replace(found, table=replace(found.table, values=values))
    return best


def _own_in_steps(
    data: ChannelData, residual: FloatArray, features: dict[str, FloatArray], step: IntArray
) -> Place | None:
    """A pattern over the image or over zones that every step has anew; it locates, and predicts no unseen step.

    What half of the rows of a bin and step say must predict the other half.
    """
    steps = int(step.max()) + 1
    weight = data.root_weight**2
    # within a cell by chance, not in turn: rows stand in the order of pixels or of the sweep
    half = np.random.default_rng(len(residual)).permutation(len(residual)) % 2
    parts = half == 0, half == 1
    best: Place | None = None
    for name in WITHIN_STEPS:
        if name not in features or not np.isfinite(features[name]).all():
            continue
        values = features[name]
        levels = np.unique(values)
        if len(levels) < 4:
            continue
        cuts = (levels[1:] + levels[:-1]) / 2.0
        if len(levels) > STEP_BINS:
            cuts = np.unique(np.quantile(values, np.linspace(0, 1, STEP_BINS + 1)[1:-1]))
        axis = Axis(column=name, kind="table", edges=tuple(float(x) for x in cuts))
        code = axis.bin_of(values)
        cell = np.unique(step * (len(cuts) + 1) + code, return_inverse=True)[1].astype(np.int64)
        if 4 * (int(cell.max()) + 1) > len(residual) or steps < 3:
            continue
        direction = data.expect * data.scale
        # what all steps have in common is a pattern of its own, and found as such
        top = np.bincount(code, weight * direction * residual, minlength=axis.count)
        mean = top / np.maximum(np.bincount(code, weight * direction**2, minlength=axis.count), 1e-300)
        sums = _Sums(direction, residual - direction * mean[code], weight, parts)
        found = _test(axis, STEP_SLOPE, tuple(cell[part] for part in parts), sums)
        if found is not None and found.gain > STEP_GAIN and (best is None or found.gain > best.gain):
            best = replace(found, table=replace(axis, values=(0.0,) * axis.count))
    return best


class _Sums:
    """What is summed over bins to test a slope: on both halves of the rows its square, and its product with the rest.

    Args:
        direction: of the slope on each row; residual, weight: of each row; parts: which rows make each half.
    """

    def __init__(
        self, direction: FloatArray, residual: FloatArray, weight: FloatArray, parts: Sequence[BoolArray]
    ) -> None:
        square, product = weight * direction**2, weight * direction * residual
        self._halves = [(square[part], product[part]) for part in parts]

    def over(self, codes: Sequence[IntArray]) -> tuple[FloatArray, FloatArray]:
        """Both sums over the bins of each half's rows, (2, bins) each."""
        count = max(int(code.max(initial=0)) for code in codes) + 1
        gram, score = np.zeros((2, count)), np.zeros((2, count))
        for k, (code, (square, product)) in enumerate(zip(codes, self._halves, strict=True)):
            gram[k], score[k] = (np.bincount(code, x, minlength=count) for x in (square, product))
        return gram, score


def _test(binning: Axis, slope: Axis, codes: Sequence[IntArray], sums: _Sums) -> Place | None:
    gram, score = sums.over(codes)
    count = gram.shape[1]
    total, pull = gram.sum(axis=0), score.sum(axis=0)
    if not slope.column and total.sum() > 0:  # a common constant is calibration
        level = pull.sum() / total.sum()
        pull, score = pull - level * total, score - level * gram
    if 0.5 * float(np.sum(pull**2 / np.maximum(total, 1e-300))) < LOCATED_GAIN:
        return None
    tau, gain = fit_tau(pull, total) if count >= 3 else _two(pull, total)
    z = half_z(gram, score, tau)
    if gain < LOCATED_GAIN or z < LOCATED_Z:
        return None
    values = pull / (total + 1.0 / max(tau, 1e-12) ** 2)
    table = Axis(
        column=binning.column,
        kind="table",
        at=binning.at,
        edges=binning.edges,
        values=tuple(float(v) for v in values),
    )
    return Place(table=table, slope=slope, gain=gain, z=z)


def _two(pull: FloatArray, total: FloatArray) -> tuple[float, float]:
    """Width and gain for two bins, where a width cannot be estimated: their difference."""
    values = pull / np.maximum(total, 1e-300)
    gain = 0.5 * float(np.sum(pull**2 / np.maximum(total, 1e-300)))
    return float(np.sqrt(np.mean(values**2))), gain


def _mean(x: FloatArray, weight: FloatArray) -> float:
    return float(np.sum(weight * x) / np.sum(weight))


def _constant_in(x: FloatArray, step: IntArray) -> bool:
    count = np.maximum(np.bincount(step), 1)
    filled = np.nan_to_num(x)
    mean = np.bincount(step, filled) / count
    inside = float(np.mean((filled - mean[step]) ** 2))
    return inside < 1e-3 * float(np.var(filled)) + 1e-300


def _binnings(features: dict[str, FloatArray], looker: Looker) -> Iterator[tuple[Axis, IntArray]]:
    """Columns cut into bins, image columns and rows also modulo a period."""
    view = looker.problem.view
    for name, values in features.items():
        if name.startswith(("~parity", PER_TURN)) or name == PIXEL:
            continue
        if view.is_category(name) if not name.startswith(("~", "sim_")) else False:
            labels = view.labels(name)
            ids = np.sort([category_id(label) for label in labels])
            edges = tuple(float(x) for x in (ids[1:] + ids[:-1]) / 2.0)
        else:
            finite = values[np.isfinite(values)]
            levels = np.unique(finite)
            most = 128 if name in {"pixel_u", "pixel_v"} else MOST_BINS
            if len(levels) < 2:
                continue
            cuts = (levels[1:] + levels[:-1]) / 2.0
            if len(levels) > most:
                cuts = np.unique(np.quantile(finite, np.linspace(0, 1, MOST_BINS + 1)[1:-1]))
            edges = tuple(float(x) for x in cuts)
        axis = Axis(column=name, kind="table", edges=edges)
        yield axis, axis.bin_of(values)
        if name in {"pixel_u", "pixel_v"}:
            for period in PERIODS:
                if len(np.unique(values)) > period:
                    axis = Axis(
                        column=name, kind="table", at=float(period), edges=tuple(k + 0.5 for k in range(period - 1))
                    )
                    yield axis, axis.bin_of(values)


def _slopes(features: dict[str, FloatArray], looker: Looker) -> Iterator[Axis]:
    yield Axis(column="", kind="one")
    names = [*looker.problem.view.temperatures("tof_temperature_c", "housing_temperature_c")[:2], *SLOPES]
    for name in names:
        if name in features:
            values = features[name][np.isfinite(features[name])]  # rows of a log among images have no place
            low, high = (float(values.min()), float(values.max())) if values.size else (0.0, 0.0)
            if high > low:
                yield Axis(column=name, kind="linear", middle=0.5 * (low + high), width=high - low)


def located_law(looker: Looker, data: ChannelData, state: State) -> Law:
    """Law of tables over the places where a channel's residual carries structure, strongest first; empty for none."""
    name = data.channel.name
    law = Law(channel=name, relative=data.channel.role in {Role.INTENSITY, Role.SCATTER}, terms=[], drivers=[])
    corrected = dict(state)
    for _ in range(MOST_PLACES):
        place = locate(looker, data, corrected)
        if place is None or place.slope is STEP_SLOPE:
            break
        axes = (place.table,) if not place.slope.column else (place.table, place.slope)
        law.terms.append(LawTerm(axes=axes, value=1.0, error=1.0 / max(place.z, 1.0)))
        law.drivers += [c for c in place.columns if c not in law.drivers]
        law.gain += place.gain
        corrected[name] = state[name] + law.correction(looker.features, state[name])
    law.law_gain = law.gain
    return law
