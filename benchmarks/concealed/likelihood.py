"""How visible a mismatch is: the oracle's lambda = sqrt(2 Δ log L) under correlated noise and refitted nuisances."""

import numpy as np


def whiten(residual: np.ndarray, sigma: np.ndarray, shared: np.ndarray | None, group: np.ndarray) -> np.ndarray:
    """Residuals made independent with unit variance.

    The covariance is diag(sigma²) + Σ over groups of r rᵀ; its inverse square root per group has rank one beyond the
    diagonal: with b = r/sigma and B = Σ b², w = z − b (b·z)/B · (1 − 1/√(1+B)).

    Args:
        residual: (N,) or (N, K), columns are whitened alike.
        sigma: (N,) independent standard deviation.
        shared: (N,) scale of what a group shares, or None.
        group: (N,) group numbers.
    """
    z = residual / (sigma if residual.ndim == 1 else sigma[:, None])
    if shared is None or not np.any(shared):
        return z
    _, where = np.unique(group, return_inverse=True)
    b = shared / sigma
    total = np.bincount(where, weights=b * b)
    shrink = np.where(total > 0, (1.0 - 1.0 / np.sqrt(1.0 + total)) / np.maximum(total, 1e-300), 0.0)
    columns = z[:, None] if z.ndim == 1 else z
    out = np.empty_like(columns)
    for k in range(columns.shape[1]):
        along = np.bincount(where, weights=b * columns[:, k])
        out[:, k] = columns[:, k] - b * (along * shrink)[where]
    return out[:, 0] if z.ndim == 1 else out


def projected(
    shift: np.ndarray, sigma: np.ndarray, shared: np.ndarray | None, group: np.ndarray, nuisance: np.ndarray | None
) -> np.ndarray:
    """A shift of the mean, whitened, without what the nuisance columns (N, K) can take up."""
    w = whiten(shift, sigma, shared, group)
    if nuisance is not None and nuisance.size:
        basis, _ = np.linalg.qr(whiten(nuisance, sigma, shared, group))
        w = w - basis @ (basis.T @ w)
    return w


def mean_information(
    shift: np.ndarray, sigma: np.ndarray, shared: np.ndarray | None, group: np.ndarray, nuisance: np.ndarray | None
) -> float:
    """λ² of a shift of the mean: whitened energy that the nuisance columns cannot take up."""
    seen = np.isfinite(shift) & np.isfinite(sigma)
    left = None if nuisance is None else nuisance[seen]
    w = projected(shift[seen], sigma[seen], None if shared is None else shared[seen], group[seen], left)
    return float(w @ w)


def mean_information_unknown_repeat(
    shift: np.ndarray,
    sigma: np.ndarray,
    shape: np.ndarray,
    true_scale: float,
    group: np.ndarray,
    nuisance: np.ndarray | None,
) -> float:
    """λ² of a shift where nobody says how much a group shares: that scatter is free when the shift is denied.

    A null with more shared scatter explains a shift that follows the groups: the expected 2 Δ log L is least, over
    the null's scale τ (times `shape`), of the shift's energy under τ plus what the wrong τ itself costs.
    """
    seen = np.isfinite(shift) & np.isfinite(sigma)
    shift, sigma, shape, group = shift[seen], sigma[seen], shape[seen], group[seen]
    nuisance = None if nuisance is None else nuisance[seen]
    _, where = np.unique(group, return_inverse=True)
    weight = np.bincount(where, weights=(shape / sigma) ** 2)
    true = true_scale**2 * weight
    # the largest scale that could matter carries the whole shift
    top = float(np.sqrt(np.sum((shift / sigma) ** 2) / max(weight.sum(), 1e-300)))
    scales = true_scale + np.concatenate([[0.0], top * np.geomspace(0.02, 3.0, 14)])
    costs = []
    for scale in scales:
        null = scale**2 * weight
        excess = (true - null) / (1 + null)
        wrong = excess - np.log1p(excess)
        costs.append(float(wrong.sum()) + mean_information(shift, sigma, scale * shape, group, nuisance))
    return max(min(costs), 0.0)


def scatter_information(std: np.ndarray, sim_std: np.ndarray, frames: np.ndarray | float) -> float:
    """λ² of a change of one-frame scatter.

    Args:
        std: true one-frame scatter.
        sim_std: the simulation's.
        frames: normal deviates seen per row: all n frames where the sample scatter is recorded, else 1 (the mean).
    """
    ratio = std / sim_std
    return float(np.sum(frames * np.where(ratio > 0, ratio**2 - 1 - 2 * np.log(ratio), 0.0)))


def common_scatter_information(
    scale: np.ndarray, sigma: np.ndarray, known: np.ndarray | None, group: np.ndarray
) -> float:
    """λ² of scatter shared by a group beyond what is known: Σ (T/K − 1 − log T/K), T and K the variances of the
    group's mean with and without it, in units of its independent variance."""
    _, where = np.unique(group, return_inverse=True)
    extra = np.bincount(where, weights=(scale / sigma) ** 2)
    base = 0.0 if known is None else np.bincount(where, weights=(known / sigma) ** 2)
    ratio = (1.0 + base + extra) / (1.0 + base)
    return float(np.sum(ratio - 1.0 - np.log(ratio)))
