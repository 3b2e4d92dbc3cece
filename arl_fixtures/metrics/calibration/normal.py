"""The normal matrix of the adjustment: a few parameters that all centres share, and one stage angle for each stop.

No centre depends on more than one stage angle, so that part of the matrix is diagonal, and everything is solved by
systems of the size of the shared parameters (Schur complement).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Float64Array = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class NormalMatrix:
    """[[shared, border], [borderᵀ, diag(own)]] of q shared parameters and n stage angles, or a stack of such.

    Attributes:
        shared: (…, q, q).
        border: (…, q, n).
        own: (…, n) of the stage angles.
    """

    shared: Float64Array
    border: Float64Array
    own: Float64Array

    @property
    def complement(self) -> Float64Array:
        """Normal matrix of the shared parameters, whatever the stage angles may be, (…, q, q)."""
        over = self.border / self.own[..., None, :]
        complement: Float64Array = self.shared - over @ np.swapaxes(self.border, -1, -2)
        return complement

    def solve_shared(self, right: Float64Array, right_own: Float64Array) -> Float64Array:
        """The shared parameters of the solution, (…, q), for right sides (…, q) and (…, n).

        Raises:
            numpy.linalg.LinAlgError: the matrix is singular.
        """
        reduced = right - np.einsum("...qn,...n->...q", self.border, right_own / self.own)
        return np.linalg.solve(self.complement, reduced[..., None])[..., 0]

    def solve(self, right: Float64Array) -> Float64Array:
        """The solution (q + n,) for one right side (q + n,)."""
        q = len(self.shared)
        shared = self.solve_shared(right[:q], right[q:])
        return np.concatenate([shared, (right[q:] - shared @ self.border) / self.own])

    def covariance(self) -> Float64Array:
        """Rows of the inverse that belong to the shared parameters, (q, q + n)."""
        inverse = np.linalg.inv(self.complement).astype(np.float64)
        return np.concatenate([inverse, -inverse @ (self.border / self.own)], axis=1)
