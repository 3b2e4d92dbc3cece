"""A channel's rows as the search for a law sees them: a part of them, whitened, without what calibration explains."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from arl_fixtures.reconcile.channel_data import ChannelData
from arl_fixtures.reconcile.columns import FloatArray, IntArray
from arl_fixtures.reconcile.effect import State
from arl_fixtures.reconcile.law import Features
from arl_fixtures.reconcile.law_basis import Basis, Known
from arl_fixtures.reconcile.roles import PIXEL, Role
from arl_fixtures.reconcile.whitener import Shared, Whitener

MOST_ROWS, ALL_ROWS = 6_000, 20_000
"""Rows on which candidates are ranked, and on which the best of them are judged and fitted."""
LEAST_LEVELS, MOST_LEVELS, LEVEL_FOLDS = 5, 48, 4
"""Levels of a column from which, and into at most how many, it is parted; folds of them."""
CROSSED = 2.0
"""Blocks that an image must have rows in for blocks to be parts of images."""
AT_ONCE = 64_000
"""Numbers that are whitened at once: few enough for the processor's cache."""
LEAST_SEEN = 1e-3
"""Share of a function's power that must be left beside the units' constants."""


@dataclass(slots=True, kw_only=True)
class Candidate:
    """A basis on the rows at work: whitened vectors, their sums per fold, and what it would gain."""

    basis: Basis
    vectors: FloatArray
    gram: FloatArray
    gain: float = 0.0
    width: float = 1.0


class Work:
    """A part of a channel's rows, whitened by the channel's noise.

    Args:
        data: the channel; state: corrected simulation that its residual is taken from.
        features: columns on the view's rows.
        tau: scatters that groups share.
        most: rows at work, drawn where there are more.
    """

    def __init__(
        self, data: ChannelData, state: State, features: Features, tau: dict[str, float], most: int = MOST_ROWS
    ) -> None:
        n = len(data.use)
        pick = np.arange(n)
        if n > most:  # not every k-th: a stride would alias with the image's rows
            pick = np.sort(np.random.default_rng(n).choice(n, size=most, replace=False))
        self.data, self.pick = data, pick
        here = {name: values[data.use[pick]] for name, values in features.items()}
        self.features: Features = {name: values for name, values in here.items() if np.isfinite(values).any()}
        levels = tuple(level.part(pick) for level in data.levels)
        self._root_weight = data.root_weight[pick]
        self._whitener = Whitener(self._root_weight, levels, tau)
        self._known = Known()
        self.unit = np.unique(data.unit[pick], return_inverse=True)[1]
        relative = data.channel.role in {Role.INTENSITY, Role.SCATTER}
        sim = state[data.channel.name][data.use[pick]]
        self.scale = data.expect[pick] * (sim if relative else np.ones(len(pick)))
        self.direction = self.scale * self._root_weight
        self._constant = self._whitener(data.scale[pick]) if data.calibrated else np.zeros(0)
        self._power = np.zeros(0)
        self._units: Shared | None = None
        if data.calibrated:
            self._power = np.maximum(np.bincount(self.unit, self._constant**2), 1e-300)
            self._units = Shared(self.unit, self._constant, len(self._power))
        self.bare = self._root_weight * data.residual(state)[pick]
        self.residual = self.whiten(data.residual(state)[pick])
        self.step = next(
            (level.code for level in levels if level.name == "step"), np.zeros(len(pick), dtype=np.int64)
        )
        self.fold, self.block = data.fold[pick], np.unique(data.block[pick], return_inverse=True)[1]
        self.image = next((level.code for level in levels if level.name == "frame"), None)
        self.image_fold = _image_folds(self.image, self.block)

    def whiten(self, x: FloatArray) -> FloatArray:
        """Whitened vector without what a constant per unit explains."""
        z = self._whitener(x)
        if self._units is not None:
            share = np.bincount(self.unit, self._constant * z) / self._power
            z = z - self._constant * share[self.unit]
        return np.asarray(z)

    def is_shared(self, columns: Sequence[str]) -> bool:
        """Whether all columns are constant within steps: steps then are the only witnesses, and they share errors."""
        for name in columns:
            x = np.nan_to_num(self.features[name])
            if name == PIXEL:  # a name and no size: devices lie further apart than their pixels
                if len(np.unique(np.stack([self.step, x]), axis=1).T) > len(np.unique(self.step)):
                    return False
                continue
            if not _is_steady(x, self.step):
                return False
        return True

    def shares(self, basis: Basis) -> bool:
        """Whether all that a basis is made of is constant within steps; of a wave that is its phase, not its time."""
        axes = [axis for product in (basis.axes, *basis.waves) for axis in product if axis.column]
        turning = {
            axis for axis in axes if axis.kind in {"sin", "cos", "saw"} or (axis.kind == "table" and axis.at > 0.0)
        }
        for axis in turning:
            phase = np.nan_to_num(2.0 * np.pi * self.features[axis.column] / axis.at)
            if not all(_is_steady(wave(phase), self.step) for wave in (np.sin, np.cos)):
                return False
        return self.is_shared([name for axis in axes if axis not in turning for name in axis.columns])

    def levels_of(self, column: str) -> IntArray | None:
        """Folds that keep equal (or, of very many, neighbouring) values of a column together; None for few values."""
        x = np.nan_to_num(self.features[column])
        levels, code = np.unique(x, return_inverse=True)
        if len(levels) < LEAST_LEVELS:
            return None
        if len(levels) > MOST_LEVELS:
            code = np.searchsorted(np.quantile(x, np.linspace(0.0, 1.0, MOST_LEVELS + 1)[1:-1]), x, side="right")
        fold = np.random.default_rng(len(levels)).permutation(int(code.max()) + 1) % LEVEL_FOLDS
        return np.asarray(fold[code], dtype=np.int64)

    def candidate(self, basis: Basis) -> Candidate:
        """A basis on these rows."""
        vectors, gram = self.together([basis])
        return Candidate(basis=basis, vectors=vectors[0], gram=gram[0])

    def raw(self, basis: Basis) -> FloatArray:
        """A basis on these rows in standard errors of each row alone, shape (k, n)."""
        return np.asarray(basis.vectors(self.features, self._known) * self.scale * self._root_weight)

    def together(self, bases: Sequence[Basis]) -> tuple[FloatArray, FloatArray]:
        """Whitened vectors of m bases of k functions each, shape (m, k, n), and their products, (m, k, k)."""
        count = bases[0].count
        vectors = np.empty((len(bases), count, len(self.pick)))
        power = np.empty(vectors.shape[:2])
        for here, sums, basis in zip(vectors, power, bases, strict=True):
            np.multiply(basis.vectors(self.features, self._known), self.scale, out=here)
            here *= self._root_weight
            np.einsum("kn,kn->k", here, here, out=sums)
        self._known.open.clear()
        self._whiten_rows(vectors.reshape(-1, len(self.pick)))
        gram = vectors @ vectors.swapaxes(1, 2)
        # what calibration explains must not come back as a difference of large numbers
        lost = np.diagonal(gram, axis1=1, axis2=2) < LEAST_SEEN * power
        vectors[lost] = 0.0
        gram[lost[:, :, None] | lost[:, None, :]] = 0.0
        return vectors, gram

    def _whiten_rows(self, vectors: FloatArray) -> None:
        """Whiten rows in standard errors in place, a few at a time."""
        most = max(AT_ONCE // len(self.pick), 4)
        for start in range(0, len(vectors), most):
            part = vectors[start : start + most]
            z = part.T.copy()
            self._whitener.columns(z)
            if self._units is not None:
                z -= self._units.rows(self._units.sums(z) / self._power[:, None])
            part[:] = z.T


def _is_steady(x: FloatArray, step: IntArray) -> bool:
    mean = np.bincount(step, x) / np.maximum(np.bincount(step), 1)
    return float(np.mean((x - mean[step]) ** 2)) <= 0.02 * float(np.var(x))


def _image_folds(image: IntArray | None, block: IntArray) -> IntArray | None:
    """Folds of images that follow one another, where blocks hold parts of every image out but no whole one."""
    if image is None:
        return None
    images = np.unique(image, return_inverse=True)[1]
    count = int(images.max()) + 1
    pairs = len(np.unique(images * (int(block.max()) + 1) + block))
    if count < LEAST_LEVELS or pairs < CROSSED * count:
        return None
    return np.asarray(images * LEVEL_FOLDS // count, dtype=np.int64)
