"""A physics-free model of a mismatch: boosted symmetric trees on binned columns.

It is the ceiling: how much of the mismatch the table's columns can predict at all, whatever the physics. Named
effects have to come near it, and what they leave must hold nothing that it can still predict on unseen blocks. Each
tree splits all its nodes by the same column and threshold at each depth, which is fast with histograms and hard to
over-fit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array

from arl_fixtures.reconcile.columns import FloatArray, IntArray

BINS = 32
PATIENCE = 10
"""Trees without a gain on the watched rows after which fitting stops."""


@dataclass(frozen=True, slots=True)
class Tree:
    """One symmetric tree: the column and bin of each depth, the value of each leaf."""

    features: tuple[int, ...]
    thresholds: tuple[int, ...]
    values: FloatArray


@dataclass(slots=True)
class Binned:
    """Columns cut into at most `BINS` bins each: codes of shape (columns, rows)."""

    names: tuple[str, ...]
    codes: NDArray[np.uint8]
    edges: list[FloatArray]


def bin_columns(columns: dict[str, FloatArray]) -> Binned:
    """Quantile bins of every column; NaN falls into a bin of its own at the low end."""
    names, codes, edges = [], [], []
    for name, values in columns.items():
        finite = values[np.isfinite(values)]
        if finite.size == 0:
            continue
        levels = np.unique(finite)
        if len(levels) <= BINS - 2:
            cuts = (levels[1:] + levels[:-1]) / 2.0
        else:
            cuts = np.unique(np.quantile(finite, np.linspace(0, 1, BINS - 1)[1:-1]))
        if len(cuts) == 0:
            continue
        code = np.searchsorted(cuts, values, side="right") + 1
        code[~np.isfinite(values)] = 0
        names.append(name)
        codes.append(code.astype(np.uint8))
        edges.append(cuts)
    stacked = np.stack(codes) if codes else np.zeros((0, 0), dtype=np.uint8)
    return Binned(tuple(names), stacked, edges)


class Boosted:
    """Boosted trees for a weighted target.

    Args:
        depth: splits of a tree (2^depth leaves).
        rate: shrinkage of each tree.
        ridge: prior weight on each leaf, in units of the mean weight of a row.
    """

    def __init__(self, *, depth: int = 3, rate: float = 0.2, ridge: float = 20.0) -> None:
        self.depth, self.rate, self.ridge = depth, rate, ridge
        self.trees: list[Tree] = []
        self.importance: FloatArray = np.zeros(0)

    def fit(
        self, codes: NDArray[np.uint8], target: FloatArray, weight: FloatArray, *, trees: int,
        watch: tuple[NDArray[np.uint8], FloatArray, FloatArray] | None = None,
    ) -> list[float]:  # fmt: skip
        """Fit, and follow the weighted squared error on watched rows.

        Returns:
            the watched rows' error after 0, 1, 2 … trees (empty without `watch`).
        """
        residual = target.copy()
        first = {codes[k].tobytes(): k for k in reversed(range(len(codes)))}  # of columns that part rows alike
        kept = np.sort(np.fromiter(first.values(), dtype=np.int64))
        cells = _cells(codes[kept])
        whole = cells @ weight
        self.importance = np.zeros(len(codes))
        prior = self.ridge * float(weight.mean()) if len(weight) else 1.0
        errors: list[float] = []
        seen = np.zeros(0) if watch is None else watch[1].copy()
        if watch is not None:
            errors.append(float(np.sum(watch[2] * seen**2)))
        for _ in range(trees):
            tree, leaf, gain = self._grow(codes, kept, cells, residual, weight, whole, prior)
            if tree is None:
                break
            self.trees.append(tree)
            for feature in tree.features:
                self.importance[feature] += gain
            residual -= self.rate * tree.values[leaf]
            if watch is not None:
                seen -= self.rate * tree.values[_leaf(tree, watch[0])]
                errors.append(float(np.sum(watch[2] * seen**2)))
                if len(errors) > PATIENCE and min(errors[-PATIENCE:]) > min(errors[:-PATIENCE]):
                    break
        return errors

    def predict(self, codes: NDArray[np.uint8], trees: int | None = None) -> FloatArray:
        """Sum of the first `trees` trees on binned rows."""
        total = np.zeros(codes.shape[1])
        for tree in self.trees[:trees]:
            total += self.rate * tree.values[_leaf(tree, codes)]
        return total

    def _grow(
        self, codes: NDArray[np.uint8], kept: IntArray, cells: csc_array, residual: FloatArray, weight: FloatArray,
        whole: FloatArray, prior: float,
    ) -> tuple[Tree | None, IntArray, float]:  # fmt: skip
        """A tree, the leaf of each row, its gain.

        Args:
            codes: of the rows; kept: columns that no earlier one equals; cells: of these.
            residual, weight: of the rows; whole: sums of the weights in the cells.
            prior: weight on each leaf.
        """
        push = weight * residual
        node: IntArray = np.zeros(len(residual), dtype=np.int64)
        rows = np.arange(len(residual))
        features: list[int] = []
        thresholds: list[int] = []
        for level in range(self.depth if len(codes) else 0):
            nodes = 1 << level
            if level == 0:
                sums = np.stack([cells @ push, whole])
            else:
                split = np.zeros((len(residual), 2 * nodes))
                split[rows, node] = push
                split[rows, nodes + node] = weight
                sums = (cells @ split).T
            p, w = sums.reshape(2, nodes, len(kept), BINS).cumsum(axis=3)
            rest_p, rest_w = p[..., -1:] - p, w[..., -1:] - w
            gain = (p**2 / (w + prior) + rest_p**2 / (rest_w + prior)).sum(axis=0)[:, :-1]
            place, cut = divmod(int(np.argmax(gain)), BINS - 1)
            feature = int(kept[place])
            features.append(feature)
            thresholds.append(cut)
            node = node * 2 + (codes[feature] > cut)
        if not features:
            return None, node, 0.0
        leaves = 1 << self.depth
        p = np.bincount(node, push, minlength=leaves)
        w = np.bincount(node, weight, minlength=leaves)
        values = p / (w + prior)
        return Tree(tuple(features), tuple(thresholds), values), node, float(np.sum(p**2 / (w + prior)))


def _cells(codes: NDArray[np.uint8]) -> csc_array:
    """Which rows fall into each bin of each column, (columns · BINS, rows): one product sums them all."""
    columns, n = codes.shape
    place = codes.T.astype(np.int32) + BINS * np.arange(columns, dtype=np.int32)
    ends = columns * np.arange(n + 1, dtype=np.int32)
    return csc_array((np.ones(place.size), place.ravel(), ends), shape=(columns * BINS, n))


def _leaf(tree: Tree, codes: NDArray[np.uint8]) -> IntArray:
    node: IntArray = np.zeros(codes.shape[1], dtype=np.int64)
    for feature, threshold in zip(tree.features, tree.thresholds, strict=True):
        node = node * 2 + (codes[feature] > threshold)
    return node


@dataclass(frozen=True, slots=True, kw_only=True)
class Ceiling:
    """What a physics-free model predicts of a residual on unseen blocks.

    Attributes:
        before: weighted mean square of the residual (in squared standard errors of a row).
        after: the same after subtracting the prediction made from the other blocks.
        block_gain: half the reduction of the sum of squares per held-out fold (log-likelihood).
        importance: column to its share of the splits' gain.
        prediction: cross-fitted prediction, in the target's unit.
        models: one for each held-out fold; size: trees of each that are used.
    """

    before: float
    after: float
    block_gain: FloatArray
    importance: dict[str, float]
    prediction: FloatArray
    models: tuple[Boosted, ...] = ()
    size: int = 0

    def predict(self, codes: NDArray[np.uint8], fold: IntArray) -> FloatArray:
        """Prediction for further rows of the same folds."""
        return _crossed(self.models, codes, fold, self.size)

    @property
    def gain(self) -> float:
        """Log-likelihood gained on unseen blocks."""
        return float(self.block_gain.sum())


def ceiling(
    binned: Binned, target: FloatArray, weight: FloatArray, fold: IntArray, *, trees: int = 60, depth: int = 3
) -> Ceiling:
    """Cross-fit boosted trees over folds of whole blocks; the number of trees is the best on the whole."""
    folds = int(fold.max()) + 1 if len(fold) else 0
    models: list[Boosted] = []
    paths: list[list[float]] = []
    importance = np.zeros(len(binned.names))
    for k in range(folds):
        train, test = fold != k, fold == k
        model = Boosted(depth=depth)
        if train.any() and test.any() and len(binned.names):
            watch = (binned.codes[:, test], target[test], weight[test])
            path = model.fit(binned.codes[:, train], target[train], weight[train], trees=trees, watch=watch)
            importance += model.importance
        else:
            path = [float(np.sum(weight[test] * target[test] ** 2))]
        models.append(model)
        paths.append(path + [path[-1]] * (trees + 1 - len(path)))
    stacked = np.array(paths) if paths else np.zeros((1, 1))
    best = int(np.argmin(stacked.sum(axis=0)))
    total = max(float(np.sum(weight > 0)), 1.0)
    share = importance / importance.sum() if importance.sum() > 0 else importance
    return Ceiling(
        before=float(stacked[:, 0].sum()) / total,
        after=float(stacked[:, best].sum()) / total,
        block_gain=0.5 * (stacked[:, 0] - stacked[:, best]),
        importance=dict(zip(binned.names, share.tolist(), strict=True)),
        prediction=_crossed(models, binned.codes, fold, best), models=tuple(models), size=best,
    )  # fmt: skip


def _crossed(models: Sequence[Boosted], codes: NDArray[np.uint8], fold: IntArray, trees: int) -> FloatArray:
    prediction = np.zeros(codes.shape[1])
    for k, model in enumerate(models):
        test = fold == k
        prediction[test] = model.predict(codes[:, test], trees)
    return prediction
