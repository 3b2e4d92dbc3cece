"""P_o's change of place and width: how far the beam moved and widened since the reference.

The first moment of the map is no measure of that: the field of view cuts the beam off, and a beam that moves by
0.5° moves the moment of its visible part by 0.14° only. Instead the reference map is registered to the present one:

    log P(α, β) − log P_ref(α, β) = s + q((α − δ_α)/(1 + κ_α), (β − δ_β)/(1 + κ_β)) − q(α, β)

with (α, β) the pixels' directions by the reference's K: what is measured is the beam against the receiver, in the
image; whether K moved is the calibration's to tell. q is a smooth polynomial through log P_ref, so that each pixel's
own response cancels and only the beam's slope is taken from the polynomial. Weighted least squares (Gauss–Newton)
with bisquare weights, because a local loss is not a shift. δ and κ get the uncertainty of both maps' repeatability;
a χ² above its degrees of freedom (a change that is neither shift nor width nor level) widens it. Certificates and
target positions act on both maps alike and cancel.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import numpy.typing as npt

from arl_fixtures.metrics.measurement import Measurement
from arl_fixtures.metrics.metric import Metric
from arl_fixtures.metrics.power_map import power_map
from arl_fixtures.metrics.reference import NotMeasurableError, Reference
from arl_fixtures.metrics.step import NO_REFERENCE, StepData
from arl_fixtures.quantity import Contribution, Kind, Quantity
from arl_fixtures.twin.projection import azimuth_elevation, pixel_rays

Float64Array = npt.NDArray[np.float64]

DEGREE: Final = 6
ITERATIONS: Final = 12
SURFACE_ROUNDS: Final = 3
CONVERGED: Final = 1e-6
"""Squared length of the last move in standard errors."""
TUKEY: Final = 4.685
"""Bisquare constant for 95 % efficiency on normal residuals."""
MAD_TO_SIGMA: Final = 1.4826
FEWEST_PIXELS: Final = 500
PARAMETERS: Final = 5


@dataclass(frozen=True, slots=True, kw_only=True)
class Registration:
    """Level (log), shift in α and β (degrees), relative width in α and β; with covariance and dof."""

    values: Float64Array
    covariance: Float64Array
    dof: float


@dataclass(frozen=True, slots=True)
class SmoothSurface:
    """Polynomial of total degree `DEGREE` in the scaled directions."""

    coefficients: Float64Array
    scale: tuple[float, float]

    @classmethod
    def through(
        cls, alpha: Float64Array, beta: Float64Array, values: Float64Array, weight: Float64Array
    ) -> SmoothSurface:
        """Weighted least squares fit, pixels far off it left out in a second round; all (m,)."""
        scale = float(np.abs(alpha).max()), float(np.abs(beta).max())
        design = _monomials(alpha / scale[0], beta / scale[1])
        coefficients = np.zeros(design.shape[1])
        trust = np.ones_like(values)
        for _ in range(SURFACE_ROUNDS):
            weighted = design * (weight * trust)[:, None]
            coefficients = np.linalg.lstsq(weighted.T @ design, weighted.T @ values, rcond=None)[0].astype(np.float64)
            standard = np.abs(values - design @ coefficients) * np.sqrt(weight)
            trust = (standard < TUKEY * MAD_TO_SIGMA * np.median(standard)).astype(np.float64)
        return cls(coefficients, scale)

    def with_slopes(self, alpha: Float64Array, beta: Float64Array) -> tuple[Float64Array, Float64Array, Float64Array]:
        """Value and its derivatives by α and β per degree, (m,) each."""
        x, y = _powers(alpha / self.scale[0]), _powers(beta / self.scale[1])
        grid = np.zeros((DEGREE + 1, DEGREE + 1))
        for value, (i, j) in zip(self.coefficients, _EXPONENTS, strict=True):
            grid[i, j] = value
        order = np.arange(1, DEGREE + 1)
        along_y = grid @ y
        by_y = (grid[:, 1:] * order) @ y[:-1]
        by_x = (x[:-1] * order[:, None] * along_y[1:]).sum(axis=0)
        return (x * along_y).sum(axis=0), by_x / self.scale[0], (x * by_y).sum(axis=0) / self.scale[1]


_EXPONENTS: Final = tuple((i, j) for i in range(DEGREE + 1) for j in range(DEGREE + 1 - i))


def _powers(x: Float64Array) -> Float64Array:
    """x⁰ … x^DEGREE, (DEGREE + 1, m)."""
    powers = np.ones((DEGREE + 1, x.size))
    for k in range(DEGREE):
        np.multiply(powers[k], x, out=powers[k + 1])
    return powers


def _monomials(x: Float64Array, y: Float64Array) -> Float64Array:
    powers_x, powers_y = _powers(x), _powers(y)
    return np.stack([powers_x[i] * powers_y[j] for i, j in _EXPONENTS], axis=1)


def register(step: StepData) -> Registration:
    """Shift and width of the beam against the reference.

    Raises:
        NotMeasurableError: no map, no reference, or too few pixels in common.
    """
    now, reference = step.derive(power_map), step.need_reference()
    then, then_variance = reference.array("power"), reference.array("power.variance")
    both = np.isfinite(now.power) & np.isfinite(then) & (then > 0.0) & (now.power > 0.0)
    if int(both.sum()) < FEWEST_PIXELS:
        raise NotMeasurableError(f"only {int(both.sum())} pixels in both power maps{step.shortfall}")
    azimuth_deg, elevation_deg = _directions(step, reference)
    alpha, beta = azimuth_deg[both], elevation_deg[both]
    change = np.log(now.power[both]) - np.log(then[both])
    variance = now.variance[both] / now.power[both] ** 2 + then_variance[both] / then[both] ** 2
    surface = SmoothSurface.through(alpha, beta, np.log(then[both]), 1.0 / variance)
    fit, gain_matrix = _fit(surface, alpha, beta, change, 1.0 / variance)
    sensitivities = np.zeros((PARAMETERS, both.size))
    sensitivities[:, both.ravel()] = gain_matrix
    gains = now.sharing.gain_variance + float(reference.array("power.gain_variance"))
    shared = gains * now.sharing.covariance(sensitivities)
    return replace(fit, covariance=fit.covariance + shared)


def _directions(step: StepData, reference: Reference) -> tuple[Float64Array, Float64Array]:
    """Azimuth and elevation of the pixels by the K that the reference was calibrated to, (H, W) each, degrees."""
    if "intrinsics.values" not in reference.arrays:
        return step.geometry.azimuth_deg, step.geometry.elevation_deg
    names = [str(name) for name in reference.array("intrinsics.names")]
    values = reference.array("intrinsics.values").tolist()
    camera = step.dut.intrinsics.model_copy(update=dict(zip(names, values, strict=True)))
    v, u = np.meshgrid(np.arange(float(step.dut.rows)), np.arange(float(step.dut.columns)), indexing="ij")
    azimuth_rad, elevation_rad = azimuth_elevation(pixel_rays(camera, u, v))
    return np.degrees(azimuth_rad), np.degrees(elevation_rad)


def _fit(
    surface: SmoothSurface, alpha: Float64Array, beta: Float64Array, change: Float64Array, weight: Float64Array
) -> tuple[Registration, Float64Array]:
    """The registration from pixel noise alone, and what each pixel's relative error does to it, (parameters, m)."""
    values = np.zeros(PARAMETERS)
    rest, *_ = surface.with_slopes(alpha, beta)
    trust = np.ones_like(change)
    jacobian = np.empty((len(change), PARAMETERS))
    covariance = np.zeros((PARAMETERS, PARAMETERS))
    chi2 = 1.0
    for _ in range(ITERATIONS):
        level, shift_a, shift_b, width_a, width_b = values
        a, b = (alpha - shift_a) / (1.0 + width_a), (beta - shift_b) / (1.0 + width_b)
        value, by_a, by_b = surface.with_slopes(a, b)
        residual = change - (level + value - rest)
        # derivatives of the model: a falls by 1/(1+κ) per degree of shift and by a/(1+κ) per unit of width
        jacobian = np.stack(
            [
                np.ones_like(a),
                -by_a / (1.0 + width_a),
                -by_b / (1.0 + width_b),
                -by_a * a / (1.0 + width_a),
                -by_b * b / (1.0 + width_b),
            ],
            axis=1,
        )
        standard = residual * np.sqrt(weight)
        spread = MAD_TO_SIGMA * float(np.median(np.abs(standard)))
        trust = np.clip(1.0 - (standard / (TUKEY * max(spread, 1e-12))) ** 2, 0.0, None) ** 2
        normal = jacobian.T @ (jacobian * (weight * trust)[:, None])
        try:
            covariance = np.linalg.inv(normal).astype(np.float64)
        except np.linalg.LinAlgError:
            raise NotMeasurableError("the power map is too flat to tell a shift from a change of level") from None
        move = covariance @ (jacobian.T @ (weight * trust * residual))
        values, chi2 = values + move, spread**2
        if float(move @ normal @ move) < CONVERGED:
            break
    if not (np.isfinite(values).all() and (np.diag(covariance) > 0.0).all()):
        raise NotMeasurableError("the change of the power map is nothing like a shift, a width or a level")
    # the weights' own loss of information: E[w]²/E[w²] of the bisquare is 0.95 at normal residuals
    inflation = max(chi2, 1.0) * float((trust**2).mean() / trust.mean())
    found = Registration(values=values, covariance=covariance * inflation, dof=float(len(change) - PARAMETERS))
    return found, covariance @ (jacobian * (weight * trust)[:, None]).T


SCOPES: Final = ("azimuth", "elevation")


def evaluate(step: StepData) -> list[Measurement]:
    """Shift in degrees and relative width in percent, in azimuth and elevation."""
    try:
        fit = step.derive(register)
    except NotMeasurableError as reason:
        attempted = str(reason) != NO_REFERENCE
        return [
            step.unmeasured(name, str(reason), scope=scope, attempted=attempted)
            for name in METRIC.names
            for scope in SCOPES
        ]
    sigma = np.sqrt(np.diag(fit.covariance))
    measured = []
    for k, scope in enumerate(SCOPES, start=1):
        shift = Contribution("repeatability", float(sigma[k]), Kind.A, fit.dof)
        width = Contribution("repeatability", 100.0 * float(sigma[k + 2]), Kind.A, fit.dof)
        measured += [
            step.measured(
                "power_centroid_shift", Quantity.of(float(fit.values[k]), "deg", shift), scope=scope, relative=True
            ),
            step.measured(
                "power_width_change",
                Quantity.of(100.0 * float(fit.values[k + 2]), "%", width),
                scope=scope,
                relative=True,
            ),
        ]
    return measured


METRIC = Metric(
    names=("power_centroid_shift", "power_width_change"),
    evaluate=evaluate,
    units={"power_centroid_shift": "deg", "power_width_change": "%"},
)
