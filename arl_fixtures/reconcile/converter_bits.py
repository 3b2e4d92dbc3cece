"""Weights of a converter's bits that are off: the mean of many frames of a signal that is read in codes.

Each bit that a code has set adds its own error (Kester, Data Conversion Handbook, 2005, ch. 2: superposition, the
major carries). Frames scatter over codes: near a carry the mean sees a part of the jump, an error function wide.
"""

from __future__ import annotations

import numpy as np
from scipy.special import ndtr

from arl_fixtures.reconcile.columns import FloatArray
from arl_fixtures.reconcile.effects_common import per_view
from arl_fixtures.reconcile.roles import Role, unit_of
from arl_fixtures.reconcile.view import View

FEWEST_EITHER = 0.03
"""Share of the rows that must have a bit set, and not: else it tells nothing, or is an offset."""
WIDEST = 0.5
"""Scatter of single frames, as a share of a bit's weight, from which its jumps are no more seen."""
OWN_SCATTER = 0.3
"""Standard deviation of where in a code a signal lies, in codes."""

Scatter = tuple[float, float]
"""Variance of single frames of no light, in codes squared, and what each code adds: the photon transfer line."""


def is_set(codes: FloatArray, weight: float, scatter: Scatter) -> FloatArray:
    """Share of frames in which a bit is set; (n,).

    Args:
        codes: expected codes, (n,). weight: of the bit, a power of two. scatter: of single frames (Janesick, Photon
            Transfer, 2007: bright ones scatter more).
    """
    place = np.mod(codes, 2.0 * weight)
    width = np.sqrt(np.maximum(scatter[0] + scatter[1] * codes, OWN_SCATTER**2))
    return np.asarray(sum(
        ndtr((place - (turn * 2.0 + 1.0) * weight) / width) - ndtr((place - (turn * 2.0 + 2.0) * weight) / width)
        for turn in (-1, 0, 1)
    ))  # fmt: skip


def weights_of(view: View, channel: str) -> tuple[FloatArray, Scatter]:
    """Weights of the bits that a signal in counts has now set and now not, and the scatter of its frames.

    A count is a code. No weights where the channel is no signal in counts, or has no such bits.
    """
    return per_view(view, ("bits", channel), lambda: _find_weights(view, channel))


def _find_weights(view: View, channel: str) -> tuple[FloatArray, Scatter]:
    none: tuple[FloatArray, Scatter] = (np.zeros(0), (0.0, 0.0))
    is_signal = any(c.name == channel for c in view.channels(Role.INTENSITY))
    if not (is_signal and unit_of(channel) == "counts"):
        return none
    codes, errors = view.sim[channel], f"sim_{channel}_std"
    noise = view.number(errors) if view.has(errors) else np.zeros(len(codes))
    here = np.isfinite(codes) & (codes > 0.0) & np.isfinite(noise)
    codes, noise = codes[here], noise[here]
    if codes.size == 0:
        return none
    scatter = _transfer(codes, noise**2)
    middle = float(np.median(noise))
    weights = np.exp2(np.arange(2, int(np.log2(max(codes.max(), 8.0))) + 1, dtype=np.float64))
    share = np.array([is_set(codes, weight, scatter).mean() for weight in weights])
    kept = weights[(np.abs(share - 0.5) < 0.5 - FEWEST_EITHER) & (middle < WIDEST * weights)]
    return kept, scatter


def _transfer(codes: FloatArray, variance: FloatArray) -> Scatter:
    """Line of the variance over the codes, through the medians of the darker and the brighter half."""
    dark = codes <= np.median(codes)
    if dark.all():
        return float(np.median(variance)), 0.0
    x, y = ((float(np.median(v[dark])), float(np.median(v[~dark]))) for v in (codes, variance))
    slope = max((y[1] - y[0]) / (x[1] - x[0]), 0.0)
    return max(y[0] - slope * x[0], 0.0), slope
