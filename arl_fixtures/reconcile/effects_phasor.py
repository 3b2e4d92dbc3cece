"""Stray light of a camera that correlates a modulation: light from elsewhere is added with its phase.

A pixel's phasor is its light times `exp(2πj·range/ambiguity)`, `ambiguity` the range at which the phase has gone
round once. Light from another range lengthens or shortens it, and turns it towards that range (Schäfer, Lenzen,
Garbe, Opt. Express 22 (2014) 29835: scattered light is a sum of phasors).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from arl_fixtures.reconcile.effect import Parameter, State
from arl_fixtures.reconcile.effects_common import FloatArray, set_light, shape
from arl_fixtures.reconcile.effects_frame import brighter
from arl_fixtures.reconcile.roles import unit_of
from arl_fixtures.reconcile.view import View

ComplexArray = NDArray[np.complex128]


def ambiguity_shape(view: View, distance: str) -> Parameter:
    """The range at which a phase has gone round once, in the unit of `distance`: none of the table's lies beyond."""
    farthest = view.span(f"sim_{distance}")[1]
    return shape("ambiguity", unit_of(distance), farthest, 10.0 * farthest, 2.0 * farthest)


def phasor(light: FloatArray, range_: FloatArray, ambiguity: float) -> ComplexArray:
    """Light with the phase of its range."""
    return np.asarray(light * np.exp(2j * np.pi / ambiguity * range_))


def image_phasor(view: View, state: State, channel: str, distance: str, ambiguity: float) -> ComplexArray:
    """Mean phasor of each row's simulated image, shape (n,), as much brighter as the image is by earlier stages."""
    columns = view.columns
    code = columns.group(*columns.image_columns)
    light, far = columns.numbers[f"sim_{channel}"], columns.numbers[f"sim_{distance}"]
    good = np.isfinite(light) & np.isfinite(far) & (light > 0.0)
    each = phasor(np.where(good, light, 0.0), np.nan_to_num(far), ambiguity)
    count = np.maximum(np.bincount(code, good), 1.0)
    mean = (np.bincount(code, each.real) + 1j * np.bincount(code, each.imag)) / count
    return np.asarray(mean[code][view.rows] * brighter(view, state, channel))


def add_phasor(
    view: View, state: State, channel: str, distances: tuple[str, ...], *, stray: ComplexArray, kept: float,
    ambiguity: float,
) -> None:  # fmt: skip
    """Add light with its phase to a signal and to the distances.

    Args:
        view: rows under work; state: signal and distances are replaced.
        channel: the signal; distances: of it, the first one tells the phase.
        stray: phasors that come in; NaN counts as none. Light without a range has no phase, and stays.
        kept: share of the own light that stays in place.
        ambiguity: see `ambiguity_shape`.
    """
    own = kept * phasor(state[channel], state[distances[0]], ambiguity)
    total = own + np.nan_to_num(stray)
    with np.errstate(invalid="ignore", divide="ignore"):
        turned = np.angle(total / own) * ambiguity / (2.0 * np.pi)
    for distance in distances:
        state[distance] = state[distance] + np.where(np.isfinite(turned), turned, 0.0)
    light = np.abs(total)
    set_light(view, state, channel, np.where(np.isfinite(light), light, state[channel]))
