"""Temperatures of the bench: coolant, plate, DUT housings and ambient.

Housings hang on the plate, the plate on the coolant, and the coolant reaches the plate some seconds after it
left the chiller. The network of plate and housings is linear, so each sub-step uses its exact propagator
(matrix exponential, inputs held): the sub-step length does not limit stability or accuracy of the network, only
how finely set-point and power are sampled.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from typing import Final, final

import numpy as np
from pydantic import Field
from scipy.linalg import expm

from arl_fixtures.yaml_model import FiniteModel

SECONDS_PER_MINUTE: Final = 60.0

Matrix = tuple[tuple[float, ...], ...]


class ThermalSettings(FiniteModel):
    """Heat capacities, conductances and the chiller's dynamics; the defaults are the nominal bench."""

    coolant_lag_s: float = Field(default=60.0, gt=0)
    coolant_heating_k_per_min: float = Field(default=3.0, gt=0)
    coolant_cooling_k_per_min: float = Field(default=2.0, gt=0)
    transport_delay_s: float = Field(default=15.0, ge=0)
    plate_capacity_j_per_k: float = Field(default=4500.0, gt=0)
    plate_to_coolant_w_per_k: float = Field(default=150.0, ge=0)
    housing_count: int = Field(default=3, ge=0)
    housing_capacity_j_per_k: float = Field(default=900.0, gt=0)
    housing_to_plate_w_per_k: float = Field(default=25.0, ge=0)
    housing_to_ambient_w_per_k: float = Field(default=0.6, ge=0)
    self_heating_w: float = Field(default=12.0, ge=0)
    ambient_c: float = 23.0
    start_c: float | None = None
    """Temperature of coolant, plate and housings at the start; the ambient temperature where not given."""
    substep_s: float = Field(default=0.5, gt=0, le=5.0)


@final
class ThermalPlant:
    """State of the thermal network, advanced along the bench clock.

    The state changes at multiples of `substep_s` after the first `advance`, so that it does not depend on how
    often somebody looks at it.

    Args:
        settings: parameters of the network.
        start_s: bench time of the initial state; the time of the first `advance` where not given.
    """

    def __init__(self, settings: ThermalSettings | None = None, *, start_s: float | None = None) -> None:
        self._settings = settings = settings or ThermalSettings()
        self._time_s = start_s
        step_s = settings.substep_s
        start_c = settings.ambient_c if settings.start_c is None else settings.start_c
        self._coolant_c = start_c
        # one entry per sub-step: the coolant that enters the plate now left the chiller at the far end
        self._hose_c = deque([start_c] * round(settings.transport_delay_s / step_s))
        self._nodes_c: tuple[float, ...] = (start_c,) * (1 + settings.housing_count)
        self._coolant_share = -math.expm1(-step_s / settings.coolant_lag_s)
        self._coolant_rise_k = settings.coolant_heating_k_per_min / SECONDS_PER_MINUTE * step_s
        self._coolant_fall_k = settings.coolant_cooling_k_per_min / SECONDS_PER_MINUTE * step_s
        self._flowing = propagator(settings, circulating=True)
        self._standing = propagator(settings, circulating=False)

    @property
    def settings(self) -> ThermalSettings:
        """The parameters it was made with."""
        return self._settings

    @property
    def coolant_c(self) -> float:
        """Coolant temperature in the chiller's bath, degrees Celsius."""
        return self._coolant_c

    @property
    def plate_c(self) -> float:
        """Plate temperature, degrees Celsius."""
        return self._nodes_c[0]

    @property
    def housing_c(self) -> tuple[float, ...]:
        """Temperature of each housing, degrees Celsius."""
        return self._nodes_c[1:]

    @property
    def ambient_c(self) -> float:
        """Air temperature in the chamber, degrees Celsius."""
        return self._settings.ambient_c

    def advance(self, now_s: float, setpoint_c: float, powered: Sequence[bool], circulating: bool = True) -> None:
        """Let the plant run to `now_s` with inputs that have held since the last call.

        A time before the last call is no error and changes nothing. Call it before the inputs change, too.

        Args:
            now_s: bench time.
            setpoint_c: what the chiller controls its coolant to, degrees Celsius.
            powered: for each housing whether its DUT heats it.
            circulating: whether the coolant pump runs; while it stands, the coolant in the hose stays there
                and the plate exchanges no heat with it.
        """
        if self._time_s is None:
            self._time_s = now_s
        settings = self._settings
        step_s = settings.substep_s
        # the allowance keeps 10.0 from being 19.99999 sub-steps of 0.5 s
        count = int((now_s - self._time_s) / step_s + 1e-9)
        if count <= 0:
            return
        if len(powered) != settings.housing_count:
            msg = f"thermal plant has {settings.housing_count} housings, got {len(powered)} power states"
            raise ValueError(msg)
        self._time_s += count * step_s
        matrix = self._flowing if circulating else self._standing
        power_w = tuple(settings.self_heating_w if on else 0.0 for on in powered)
        coolant_c, nodes_c, hose_c = self._coolant_c, self._nodes_c, self._hose_c
        share, rise_k, fall_k = self._coolant_share, self._coolant_rise_k, self._coolant_fall_k
        ambient_c = settings.ambient_c
        for _ in range(count):
            change_k = min(rise_k, max(-fall_k, share * (setpoint_c - coolant_c)))
            # the mean over the sub-step is what the exact propagator wants of an input that changes within it
            leaving_c = coolant_c + 0.5 * change_k
            coolant_c += change_k
            if circulating:
                hose_c.append(leaving_c)
                entering_c = hose_c.popleft()
            else:
                entering_c = 0.0
            inputs = (*nodes_c, entering_c, ambient_c, *power_w)
            nodes_c = tuple([sum([a * x for a, x in zip(row, inputs, strict=True)]) for row in matrix])
        self._coolant_c, self._nodes_c = coolant_c, nodes_c


def propagator(settings: ThermalSettings, *, circulating: bool) -> Matrix:
    """Exact one-sub-step map of plate and housings with held inputs.

    With C dT/dt = L T + M u the augmented matrix [[C⁻¹L, C⁻¹M], [0, 0]] is exponentiated once.

    Returns:
        Matrix (1 + n, 1 + n + 2 + n): rows plate and housings; columns plate, housings, entering coolant,
        ambient (degrees Celsius) and self-heating of each housing (watts).
    """
    count = settings.housing_count
    nodes, width = 1 + count, 1 + count + 2 + count
    coolant, ambient = nodes, nodes + 1
    rates = np.zeros((width, width))
    to_coolant = settings.plate_to_coolant_w_per_k if circulating else 0.0
    rates[0, 0] = -(to_coolant + count * settings.housing_to_plate_w_per_k)
    rates[0, 1:nodes] = settings.housing_to_plate_w_per_k
    rates[0, coolant] = to_coolant
    rates[0] /= settings.plate_capacity_j_per_k
    for housing in range(1, nodes):
        rates[housing, 0] = settings.housing_to_plate_w_per_k
        rates[housing, housing] = -(settings.housing_to_plate_w_per_k + settings.housing_to_ambient_w_per_k)
        rates[housing, ambient] = settings.housing_to_ambient_w_per_k
        rates[housing, nodes + 1 + housing] = 1.0
        rates[housing] /= settings.housing_capacity_j_per_k
    exact = expm(rates * settings.substep_s)[:nodes]
    return tuple(tuple(float(value) for value in row) for row in exact)
