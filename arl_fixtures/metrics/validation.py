"""How far a simulation's values lie from measured ones: bias and scatter apart, areas, transport distances.

* Area validation metric (AVM): area between the two empirical distribution functions, in the unit of the values.
  S. Ferson, W. Oberkampf, L. Ginzburg, "Model validation and predictive capability for the thermal challenge
  problem", Comput. Methods Appl. Mech. Engrg. 197 (2008) 2408–2430.
* Double validation metric (DVM): the pair of bias and corrected area, the area that is left when the simulation's
  distribution has been moved by the bias. P. Rosenberger, "Metrics for Specification, Validation, and Uncertainty
  Prediction for Credibility in Simulation of Active Perception Sensor Systems", dissertation, TU Darmstadt (2023),
  doi 10.26083/tuprints-00023034; after the modified area metric of I. Voyles and C. Roy, 17th AIAA Non-Deterministic
  Approaches Conference (2015).
* Wasserstein distance of order p: L. Vaserstein (1969); in one dimension the L^p distance of the quantile
  functions (C. Villani, "Optimal Transport", 2009, section 6). Of order 1 it equals the AVM; order 2 is reported
  because its square splits into bias² and a scatter term.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from arl_fixtures.errors import DataError

Float64Array = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class DoubleValidation:
    """Bias and scatter of a simulation, in the unit of the values.

    Attributes:
        bias: mean measured minus mean simulated.
        area: area validation metric.
        corrected_area: area that is left without the bias: wrong scatter or shape.
        wasserstein: Wasserstein distance of order 2.
    """

    bias: float
    area: float
    corrected_area: float
    wasserstein: float


def double_validation(measured: Float64Array, simulated: Float64Array) -> DoubleValidation:
    """All of them for two samples, which may differ in size.

    Args:
        measured: any shape; NaN is left out.
        simulated: likewise.

    Raises:
        DataError: a sample is empty.
    """
    x, y = _sorted(measured, "measured"), _sorted(simulated, "simulated")
    bias = float(x.mean() - y.mean())
    return DoubleValidation(
        bias=bias,
        area=_transport(x, y, 1.0),
        corrected_area=_transport(x, y + bias, 1.0),
        wasserstein=_transport(x, y, 2.0),
    )


def area_metric(measured: Float64Array, simulated: Float64Array) -> float:
    """Area between the empirical distribution functions of two samples.

    Raises:
        DataError: a sample is empty.
    """
    return _transport(_sorted(measured, "measured"), _sorted(simulated, "simulated"), 1.0)


def wasserstein(measured: Float64Array, simulated: Float64Array, order: float = 2.0) -> float:
    """Wasserstein distance of two samples.

    Raises:
        DataError: a sample is empty, or `order` is below 1.
    """
    if order < 1.0:
        raise DataError(f"the Wasserstein distance has an order of at least 1, not {order:g}")
    return _transport(_sorted(measured, "measured"), _sorted(simulated, "simulated"), order)


def _sorted(values: Float64Array, name: str) -> Float64Array:
    known = np.sort(np.asarray(values, dtype=np.float64).ravel())
    known = known[: int(np.searchsorted(known, np.inf, side="right"))]  # sort puts NaN last
    if not known.size:
        raise DataError(f"no {name} values to compare")
    return known


def _transport(x: Float64Array, y: Float64Array, order: float) -> float:
    """Both sorted. Between two neighbouring jumps of the quantile functions both are constant."""
    if x.size == y.size:
        return _mean_power(np.abs(x - y), np.full(1, 1.0 / x.size), order)
    jumps = np.union1d(np.arange(1, x.size + 1) / x.size, np.arange(1, y.size + 1) / y.size)
    width = np.diff(jumps, prepend=0.0)
    middle = jumps - 0.5 * width
    gap = np.abs(x[_rank(middle, x.size)] - y[_rank(middle, y.size)])
    return _mean_power(gap, width, order)


def _mean_power(gap: Float64Array, share: Float64Array, order: float) -> float:
    if order == 1.0:  # by far the most used, and powers are slow
        return float((gap * share).sum())
    largest = float(gap.max())
    # relative to the largest: powers of small gaps would leave the range of a float
    return largest * math.pow(float(((gap / largest) ** order * share).sum()), 1.0 / order) if largest > 0.0 else 0.0


def _rank(share: Float64Array, size: int) -> npt.NDArray[np.int64]:
    return np.clip((share * size).astype(np.int64), 0, size - 1)
