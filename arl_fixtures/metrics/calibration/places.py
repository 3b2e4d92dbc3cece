"""What an estimate owes to each place on the sensor, and what it is worth when errors of one place are alike.

The circles of one row of the targets pass the same places of the image one after the other, at the same height in the
pixel grid, so their errors are alike there, whichever circle, target and stage angle it is. Independent are places,
not single centres: the covariance is cluster-robust. Residuals of a place that pulls the estimate its own way are too
small, the more so the fewer places there are; so a place counts with what the estimate changes by when that place is
left out: the jackknife over clusters, CR3 (Bell and McCaffrey, Survey Methodology 28 (2002) 169; MacKinnon, Nielsen
and Webb, Stata Journal 23 (2023) 942). Degrees of freedom are the effective number of places, from the shares that
they have in the variance of a parameter (Satterthwaite; Carter, Schnepel and Steigerwald, Review of Economics and
Statistics 99 (2017) 698).

Errors that a place has then and now cancel in a change to the extent that they are alike: the change's covariance is
that of the differences of the places' influences.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from arl_fixtures.metrics.calibration.camera import CircleField
from arl_fixtures.metrics.calibration.normal import NormalMatrix
from arl_fixtures.metrics.reference import NotMeasurableError

Float64Array = npt.NDArray[np.float64]
Int64Array = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]

PLACE_PX: Final = (8.0, 16.0)
"""Columns of one place, for errors in u and in v. Both depend on where a circle lies in the grid of the samples.
Along a row its position in u goes through the grid with every step of the stage, and what is left is alike over two
widths of a circle; its height stays nearly the same, so errors in v are alike over more of the row."""
MOST_COLUMNS: Final = 1 << 16
"""Places of one row; names of places must not depend on what a sweep saw."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PlaceInfluence:
    """What the estimate of p parameters changes by when one of g places is left out.

    Attributes:
        place: (g,) name of each, the same in every sweep; those of u come before those of v.
        in_v: (g,) whether it is a place of the centres' v.
        influence: (g, p) change of the parameters.
        share: (g, p) variance that a place's centres have in each parameter, were all errors independent and as
            large as assumed.
    """

    place: Int64Array
    in_v: BoolArray
    influence: Float64Array
    share: Float64Array

    @property
    def covariance(self) -> Float64Array:
        """(p, p) covariance of the parameters from the centres."""
        covariance: Float64Array = self.influence.T @ self.influence
        return covariance

    def variance(self, k: int) -> tuple[float, float]:
        """Variance of parameter k from the centres, and its degrees of freedom."""
        return self._variance(k, self.influence[:, k])

    def variance_of_change(self, k: int, place: Int64Array, then: Float64Array) -> tuple[float, float]:
        """Variance of parameter k's change against a reference, and its degrees of freedom.

        Args:
            k: which parameter.
            place: (j,) names of the places of the reference.
            then: (j,) their influence on the parameter.
        """
        _, here, there = np.intersect1d(self.place, place, assume_unique=True, return_indices=True)
        change = self.influence[:, k].copy()
        change[here] -= then[there]
        total, dof = self._variance(k, change)
        # places that were seen then only: nothing cancels
        gone = np.delete(then, there)
        return total + float(gone @ gone), dof

    def _variance(self, k: int, influence: Float64Array) -> tuple[float, float]:
        total, spread = 0.0, 0.0
        for of_axis in (~self.in_v, self.in_v):
            part = float(influence[of_axis] @ influence[of_axis])
            share = self.share[of_axis, k]
            total += part
            if part > 0.0:
                spread += part**2 * float(share @ share) / float(share.sum()) ** 2
        return total, (max(total**2 / spread, 1.0) if spread > 0.0 else np.inf)


def places(field: CircleField, used: BoolArray, known: Mapping[str, float]) -> Int64Array:
    """Names of the places of each used centre in the image, (k, 2) for u and for v: row by `PLACE_PX` columns.

    A row goes by the height that the bench file gives it, without the known offsets of the targets, so that it is
    called the same in every sweep.
    """
    raised_m = np.array([known.get(f"{board}.up_m", 0.0) for board in field.boards])[field.board]
    height_um = np.rint(1e6 * (field.up_m - raised_m)[used]).astype(np.int64)
    u_px = field.pixels()[used, 0]
    names = []
    for axis, width_px in enumerate(PLACE_PX):
        column = np.floor(u_px / width_px).astype(np.int64)
        names.append((height_um * MOST_COLUMNS + column) * len(PLACE_PX) + axis)
    return np.stack(names, axis=1)


def influence(
    place: Int64Array,
    design: tuple[Float64Array, Float64Array],
    stage: Float64Array,
    angle: Int64Array,
    normal: NormalMatrix,
    residuals: Float64Array,
    parameters: int,
) -> PlaceInfluence:
    """Leave every place out once.

    Without a place, whose centres have the derivatives A and the residuals r, the normal matrix is N − AᵀA and the
    estimate differs by (N − AᵀA)⁻¹ Aᵀ r.

    Args:
        place: (k, 2) of `places`.
        design: derivatives of the whitened u and of the whitened v by the q shared parameters, (k, q) each.
        stage: (k, 2) derivatives of the same by the own stage angle.
        angle: (k,) number of that.
        normal: N, priors included.
        residuals: (k, 2), whitened.
        parameters: how many of the shared parameters are asked for, the first ones.

    Raises:
        NotMeasurableError: a parameter hangs on a single place.
    """
    names, in_v, changes, shares = [], [], [], []
    covariance = normal.covariance()[:parameters]
    for axis, shared in enumerate(design):
        q, n = normal.border.shape
        found, of_place = np.unique(place[:, axis], return_inverse=True)
        slope, residual = stage[:, axis], residuals[:, axis]
        gain = shared @ covariance[:, :q].T + slope[:, None] * covariance[:, q + angle].T
        own = _Sums(of_place * n + angle, len(found) * n)
        whole = _Sums(of_place, len(found))
        without = NormalMatrix(
            normal.shared - np.stack([rows.T @ rows for rows in whole.parts(shared)]),
            normal.border - own(slope[:, None] * shared).reshape(-1, n, q).swapaxes(1, 2),
            normal.own - own(slope[:, None] ** 2).reshape(-1, n),
        )
        right_own = own((slope * residual)[:, None]).reshape(-1, n)
        try:
            change = without.solve_shared(whole(residual[:, None] * shared), right_own)
        except np.linalg.LinAlgError:
            raise NotMeasurableError("the circles seen at one place of the image decide K alone") from None
        changes.append(change[:, :parameters])
        shares.append(whole(gain**2))
        names.append(found)
        in_v.append(np.full(len(found), axis == 1))
    return PlaceInfluence(
        place=np.concatenate(names).astype(np.int64),
        in_v=np.concatenate(in_v),
        influence=np.concatenate(changes),
        share=np.concatenate(shares),
    )


class _Sums:
    """Sums of rows that carry the same number, of those below a count."""

    def __init__(self, number: Int64Array, count: int) -> None:
        self._order = np.argsort(number, kind="stable")
        self._found, self._first = np.unique(number[self._order], return_index=True)
        self._count = count

    def parts(self, rows: Float64Array) -> list[Float64Array]:
        """The rows of each number that occurs."""
        return np.split(rows[self._order], self._first[1:])

    def __call__(self, rows: Float64Array) -> Float64Array:
        sums = np.zeros((self._count, rows.shape[1]))
        sums[self._found] = np.add.reduceat(rows[self._order], self._first, axis=0)
        return sums
