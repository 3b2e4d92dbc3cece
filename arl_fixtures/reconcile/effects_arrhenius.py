"""How much faster a process runs that heat speeds up (Arrhenius' law)."""

from __future__ import annotations

import numpy as np

from arl_fixtures.reconcile.effects_common import FloatArray

_BOLTZMANN_EV = 8.617e-5
_COLDEST_K = 150.0


def arrhenius(celsius: FloatArray, energy_ev: float, origin_c: float, *, most: float = 30.0) -> FloatArray:
    """Rate at temperatures over that at `origin_c`, exp(−E/k·(1/T − 1/T_origin)), its log from −30 to `most`."""
    kelvin = np.maximum(celsius + 273.15, _COLDEST_K)
    return np.exp(np.clip(-energy_ev / _BOLTZMANN_EV * (1.0 / kelvin - 1.0 / (origin_c + 273.15)), -30.0, most))
