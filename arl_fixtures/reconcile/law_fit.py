"""Terms of a law fitted together, and what they tell of rows and levels that took no part."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from arl_fixtures.reconcile.columns import BoolArray, FloatArray, IntArray
from arl_fixtures.reconcile.law_basis import Basis
from arl_fixtures.reconcile.law_evidence import evidence
from arl_fixtures.reconcile.law_work import Candidate, Work

BETWEEN_SHARE = 0.25
"""Share of what a wave gains on unseen blocks that it must gain on levels of its columns that it has not seen."""

LEAST_LEANING, LEANING_ROWS = 4.0, 20.0
"""Images or blocks, each counting by its part, that must tell of a term that leans (true ones had 4.6 to 15, a false
one 2.9), or where there are no images rows."""
GROUPS_AT_REST = 20.0
"""Images on which the noise model counts as resting."""


@dataclass(slots=True, kw_only=True)
class Chosen:
    """Terms in the law, with their joint fit.

    Attributes:
        held: log-likelihood gained on unseen blocks; each: on each row of them.
        z: its significance over blocks.
        rows: from how many rows it comes, each counting by its part.
        inside: the same on the rows of the fit itself.
        left: whitened residual.
        plain: gain of the channel's likelihood, less `cost`: what laws and names are compared by.
        likelier: the same with the gain in units of `scatter`: what tells of a mismatch.
        shared: whether all terms vary only from step to step.
        scatter: variance of what is left on the rows that the terms change, 1 where it is the noise's; never less.
        image: group of each row at work that took its image, None where the table has none.
    """

    terms: list[Candidate] = field(default_factory=list)
    values: list[FloatArray] = field(default_factory=list)
    errors: list[FloatArray] = field(default_factory=list)
    held: float = 0.0
    each: FloatArray = field(default_factory=lambda: np.zeros(1))
    z: float = 0.0
    rows: float = 0.0
    left: FloatArray = field(default_factory=lambda: np.zeros(0))
    inside: float = 0.0
    plain: float = 0.0
    likelier: float = 0.0
    shared: bool = False
    scatter: float = 1.0
    image: IntArray | None = None

    def beyond(self, other: Chosen) -> float:
        """Log-likelihood on unseen blocks beyond another law's, in the scatter of the rows that tell them apart."""
        return (self.held - other.held) / scatter_where(other.left - self.left, self.left, self.image)

    def witnesses(self, other: Chosen, group: IntArray | None = None) -> float:
        """From how many rows, or groups of rows, what is held beyond another law comes, each counting by its part."""
        more = self.each - other.each
        more = more if group is None else np.asarray(np.bincount(group, more), dtype=np.float64)
        return max(float(more.sum()), 0.0) ** 2 / max(float(more @ more), 1e-300)

    def cost(self) -> float:
        """Log-likelihood that the terms must bring: what their coefficients pay, and what choosing them is worth."""
        return sum(paid(t, v) + t.basis.price for t, v in zip(self.terms, self.values, strict=True))


def joint(work: Work, terms: list[Candidate]) -> Chosen:
    """Fit terms together with their widths, and let every fold be predicted by the others."""
    if not terms:
        return Chosen(left=work.residual)
    vectors, precision = _stacked(terms)
    gram, score = vectors @ vectors.T, vectors @ work.residual
    inverse = np.linalg.inv(gram + precision + _ridge(gram))
    values = inverse @ score
    predicted = _cross_predicted(work, vectors, precision, work.fold)
    each = 0.5 * (work.residual**2 - (work.residual - predicted) ** 2)
    gains = np.bincount(work.block, each)
    spread = float(np.sqrt(np.sum((gains - gains.mean()) ** 2)))
    split = np.cumsum([len(t.vectors) for t in terms])[:-1]
    errors = np.sqrt(np.maximum(np.diag(inverse), 0.0))
    left = work.residual - values @ vectors
    return Chosen(
        terms=terms, values=np.split(values, split), errors=np.split(errors, split), held=float(gains.sum()),
        each=each,
        z=float(gains.sum()) / spread if spread > 0 else 0.0, left=left,
        rows=float(each.sum()) ** 2 / max(float(each @ each), 1e-300),
        inside=0.5 * float(work.residual @ work.residual - left @ left),
        scatter=scatter_where(work.residual - left, left, work.image), image=work.image,
    )  # fmt: skip


def scatter_where(change: FloatArray, left: FloatArray, image: IntArray | None = None) -> float:
    """Mean square of what is left where a law changes something, at least 1; or of what images have left in common.

    The estimate of a coefficient's variance that needs no equal noise (White, Econometrica 48 (1980) 817; Liang &
    Zeger, Biometrika 73 (1986) 13 for groups), over the usual one: a few rows whose noise is larger than stated,
    those at edges say, are no better witnesses for it, nor are the rows of an image whose pose was off.
    """
    power = float(change @ change)
    if power <= 0.0:
        return 1.0
    score = change * left
    alone = float(score @ score) / power
    if image is None:
        return max(alone, 1.0)
    sums = np.bincount(image, score)
    together = (GROUPS_AT_REST + float(sums @ sums) / power * len(sums)) / (GROUPS_AT_REST + len(sums))
    return max(alone, together, 1.0)


def paid(term: Candidate, values: FloatArray) -> float:
    """What fitted coefficients take from the likelihood at their best: one each, or as much as their prior asks.

    With the prior N(0, S) the marginal likelihood is the one at the fit less ½·log|1 + S·G| and ½·v'S⁻¹v, G the sums
    of products of the functions (MacKay, Neural Computation 4 (1992) 415: the Occam factor).
    """
    if term.basis.prior is None or not term.width > 0:
        return float(len(values))
    covariance = term.width**2 * (term.basis.prior + 1e-9 * np.eye(len(values)))
    spread = np.linalg.slogdet(np.eye(len(values)) + covariance @ term.gram)[1]
    return 0.5 * float(spread + values @ np.linalg.solve(covariance, values))


def _stacked(terms: list[Candidate]) -> tuple[FloatArray, FloatArray]:
    """Vectors of all terms, and the precision that the widths of their priors give them."""
    vectors = np.concatenate([t.vectors for t in terms])
    precision = np.zeros((len(vectors), len(vectors)))
    start = 0
    for t in terms:
        k = len(t.vectors)
        if t.basis.prior is not None and t.width > 0:
            precision[start : start + k, start : start + k] = np.linalg.inv(t.basis.prior + 1e-9 * np.eye(k)) / (
                t.width**2
            )
        start += k
    return vectors, precision


def _ridge(gram: FloatArray) -> FloatArray:
    return np.asarray(1e-9 * max(float(np.trace(gram)) / len(gram), 1e-6) * np.eye(len(gram)))


def _cross_predicted(work: Work, vectors: FloatArray, precision: FloatArray, fold: IntArray) -> FloatArray:
    """What the other folds say of each fold's rows, whitened."""
    predicted = np.zeros(len(work.residual))
    for test, values in _left_out(work, vectors, precision, fold):
        predicted[test] = values @ vectors[:, test]
    return predicted


def _left_out(
    work: Work, vectors: FloatArray, precision: FloatArray, fold: IntArray
) -> Iterator[tuple[BoolArray, FloatArray]]:
    """Rows of each fold, and the coefficients that the other folds give."""
    gram, score = vectors @ vectors.T, vectors @ work.residual
    ridge = _ridge(gram)
    for k in np.unique(fold):
        test = fold == k
        inside = vectors[:, test]
        part = gram - inside @ inside.T
        rest = score - inside @ work.residual[test]
        yield test, np.linalg.solve(part + precision + ridge, rest)


def each_fold(work: Work, terms: list[Candidate]) -> Iterator[tuple[BoolArray, FloatArray]]:
    """Rows of each fold of the work's blocks, and the coefficients of all terms that the other folds give."""
    return _left_out(work, *_stacked(terms), work.fold)


def holds_between(work: Work, chosen: Chosen, trial: Chosen) -> bool:
    """Whether a wave also tells levels of its columns that took no part in the fit: between levels it may be any.

    And whether what leans on a second column has several images or blocks for it: two that are off lie on a line. And
    whether any term does no harm on images that follow one another and took no part, where blocks are parts of
    images: terms that cancel one another in every image seen need not do so in the next.
    """
    images = work.image_fold
    if images is not None:
        before = _told(work, chosen.terms, images) if chosen.terms else 0.0
        if _told(work, trial.terms, images) < before:
            return False
    newest = trial.terms[-1].basis
    if any(axis.beside for axis in newest.axes) and not _has_witnesses(work, chosen, trial):
        return False
    for column in newest.columns if newest.waves else ():
        fold = work.levels_of(column)
        if fold is None:
            continue
        before = _told(work, chosen.terms, fold) if chosen.terms else 0.0
        if _told(work, trial.terms, fold) - before < BETWEEN_SHARE * (trial.held - chosen.held):
            return False
    return True


def _has_witnesses(work: Work, chosen: Chosen, trial: Chosen) -> bool:
    """Whether several images tell of what a trial has more; without images several blocks, or many rows of any."""
    if work.image is not None:
        return trial.witnesses(chosen, work.image) >= LEAST_LEANING
    return trial.witnesses(chosen, work.block) >= LEAST_LEANING or trial.witnesses(chosen) >= LEANING_ROWS


def _told(work: Work, terms: list[Candidate], fold: IntArray) -> float:
    """Log-likelihood that terms gain where every fold is predicted by the others."""
    vectors, precision = _stacked(terms)
    predicted = _cross_predicted(work, vectors, precision, fold)
    return 0.5 * float(np.sum(work.residual**2 - (work.residual - predicted) ** 2))


def weighed(work: Work, basis: Basis, left: FloatArray) -> Candidate:
    """A basis with the width and the evidence that it has, less its price, beside the terms that leave `left`."""
    item = work.candidate(basis)
    gain, item.width = evidence(item.gram, item.vectors @ left, basis.prior)
    item.gain = gain - basis.price
    return item


def confirm(work: Work, bases: Sequence[Basis]) -> Chosen:
    """The joint fit of bases under the work's noise, each with the evidence that it had beside those before it."""
    fitted = Chosen(left=work.residual)
    for basis in bases:
        item = weighed(work, basis, fitted.left)
        if item.gain > 0.0:
            trial = joint(work, [*fitted.terms, item])
            fitted = trial if trial.held > fitted.held else fitted
    return fitted
