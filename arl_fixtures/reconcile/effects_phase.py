"""Waves whose phase is a range and whose height is a signal: of two surfaces in a pixel a phase meter adds both."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from arl_fixtures.reconcile.effect import State
from arl_fixtures.reconcile.effects_common import FloatArray
from arl_fixtures.reconcile.effects_sides import OFF, sides_of
from arl_fixtures.reconcile.view import View

ComplexArray = NDArray[np.complex128]


class Phase(NamedTuple):
    """A phase meter's channels, and the phase that its wave has per unit of the distance."""

    distance: str
    signal: str
    per_distance: float


def waves_turned(
    view: View, state: State, phase: Phase, turned: Callable[[FloatArray], ComplexArray]
) -> ComplexArray:  # fmt: skip
    """What multiplies each row's wave, (n,), where a surface's own is multiplied by `turned` of its distance.

    A row that sees two surfaces (see `sides_of`) has the wave (1 − f)·own + f·other. Its simulated wave tells f.
    """
    change = turned(state[phase.distance])
    sides = sides_of(view)
    if sides is None:
        return change

    names = f"sim_{phase.distance}", f"sim_{phase.signal}"
    range_, light = (view.number(name) for name in names)
    (near, far), (dim, bright) = (sides.seen(view, name) for name in names)
    here, own, other = (
        size * np.exp(1j * phase.per_distance * at) for size, at in ((light, range_), (dim, near), (bright, far))
    )
    with np.errstate(invalid="ignore", divide="ignore"):
        part = np.real((here - own) * np.conj(other - own)) / np.abs(other - own) ** 2
        part = np.where(np.abs(part - 0.5) < 0.5 + OFF, np.clip(part, 0.0, 1.0), np.nan)
        whole = (1.0 - part) * own + part * other
        both = ((1.0 - part) * own * turned(near) + part * other * turned(far)) / whole
    told = np.isfinite(both) & (np.abs(whole - here) < OFF * light)
    return np.asarray(np.where(told, both, change), dtype=np.complex128)
