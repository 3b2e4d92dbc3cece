"""What a simulation states of its own noise: the standard error of each row's mean, and of scatters of few frames."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaln
from scipy.stats import binom

from arl_fixtures.reconcile.columns import Channel, FloatArray
from arl_fixtures.reconcile.effects_common import per_table
from arl_fixtures.reconcile.roles import Role, is_other_light
from arl_fixtures.reconcile.view import View

MOST_SHARED = 3.0
"""Largest part of it that is allowed for: where nearly nothing is lost, what is lost still tells."""
MOST_FRAMES, WHOLE = 1000, 1e-4
"""Frames that shares are taken to be of at most, where the table does not count them; and how exactly."""
FEWEST_LACKING, CLEARLY_LACKING = 30, 3.0
"""Rows of either kind from which it is asked whether means are of returns only, and the log-likelihood for it."""
RARE = 1e-4
"""Probability below which frames that do or do not return make no such share by chance."""


def stated_error(view: View, channel: Channel) -> tuple[FloatArray, bool]:
    """Standard error of each row's mean by the simulation's own noise model, and whether it states one.

    A standard deviation of n frames scatters by sim_X_std · sqrt(1 − c4(n)²), the share p of n frames that return by
    sqrt(p (1 − p) / n), with p drawn to a half by one frame of each kind (Laplace's rule): none is ever certain.
    """
    frames, returns = frames_averaged(view, channel), frames_of_share(view, channel)
    if channel.role is Role.SCATTER:
        error = np.abs(view.sim[channel.name]) * np.sqrt(1.0 - shortfall(frames) ** 2)
        known = True
    elif returns is not None and not view.has(f"sim_{channel.name}_std"):
        share = (returns * np.clip(view.sim[channel.name], 0.0, 1.0) + 1.0) / (returns + 2.0)
        error, known = np.sqrt(share * (1.0 - share) / returns), True
    else:
        name = f"sim_{channel.name}_std"
        known = name in view.columns.numbers and bool(np.any(view.columns.numbers[name] > 0))
        error = view.number(name) / np.sqrt(frames) if known else np.ones(view.n)
    positive = error[np.isfinite(error) & (error > 0)]
    if len(positive) == 0:
        return np.ones(view.n), False
    low = 1e-3 * float(np.median(positive))
    return np.where(np.isfinite(error) & (error > low), error, np.median(positive)), known


def frames_averaged(view: View, channel: Channel) -> FloatArray:
    """Frames that a row's mean and scatter are of, (n,), at least 1.

    Those that `n_frames` counts; of light and ranges those of them that had a return, where a share of returns is
    measured beside them and rows of fewer scatter as if only these had been averaged.
    """
    frames = np.maximum(np.nan_to_num(view.frames(), nan=1.0), 1.0)
    fraction = view.channel(Role.FRACTION)
    parent = channel.parent or channel.name
    means = {c.name for role in (Role.INTENSITY, Role.DISTANCE) for c in view.channels(role)}
    if not fraction or parent not in means or is_other_light(parent):
        return frames
    share = view.columns.numbers.get(fraction)
    whole = View(view.columns)
    if share is None or not per_table(view, ("lost", parent), lambda: _are_of_returns(whole, share, parent)):
        return frames
    return np.maximum(np.round(frames * np.nan_to_num(share[view.rows], nan=1.0)), 1.0)


def _are_of_returns(view: View, share: FloatArray, name: str) -> bool:
    """Whether rows that lack returns lie off by what the others leave (as a Laplace distribution sees it)."""
    frames, one = view.frames(), view.columns.numbers.get(f"sim_{name}_std")
    if one is None:
        return False
    with np.errstate(invalid="ignore", divide="ignore"):
        off = (view.number(name) - view.sim[name]) / one * np.sqrt(frames)
    good = np.isfinite(off) & np.isfinite(share) & (share > 0.0)
    few, all_of_them = good & (share * frames < frames - 0.5), good & (share * frames >= frames - 0.5)
    if few.sum() < FEWEST_LACKING or all_of_them.sum() < FEWEST_LACKING:
        return False
    off = np.abs(off - np.median(off[all_of_them]))
    usual = max(float(np.mean(off[all_of_them])), 1e-300)
    root = np.sqrt(share[few])
    return bool(np.sum(np.log(root) + off[few] / usual * (1.0 - root)) > CLEARLY_LACKING)


def frames_of_share(view: View, channel: Channel) -> FloatArray | None:
    """Frames of which each row of a share tells how many return, (n,); None of others, or where nothing tells them.

    A table that does not count them shows them: shares of n frames are multiples of 1/n. That matters only where the
    simulation states a probability.
    """
    if channel.role is not Role.FRACTION:
        return None
    if view.has("n_frames"):
        return np.maximum(np.nan_to_num(view.frames(), nan=1.0), 1.0)

    def count() -> int | None:
        columns = (view.columns.numbers[name] for name in (channel.name, f"sim_{channel.name}"))
        told, simulated = (np.unique(x[np.isfinite(x)]) for x in columns)
        if not 2 <= len(told) <= MOST_FRAMES + 1 or len(simulated) < 2:  # n frames have n + 1 shares
            return None
        whole = (n for n in range(1, MOST_FRAMES + 1) if np.all(np.abs(told * n - np.round(told * n)) < WHOLE))
        return next(whole, None)

    found = per_table(view, ("frames of", channel.name), count)
    return None if found is None else np.full(view.n, float(found))


def shortfall(frames: FloatArray) -> FloatArray:
    """Mean standard deviation of n Gaussian frames over the true one: c4 = √(2/(n−1)) Γ(n/2) / Γ((n−1)/2)."""
    n = np.maximum(frames, 2.0)
    return np.asarray(np.sqrt(2.0 / (n - 1.0)) * np.exp(gammaln(n / 2.0) - gammaln((n - 1.0) / 2.0)))


def surprise_shared(view: View, channel: Channel, use: NDArray[np.int64]) -> float:
    """By how much less a likelihood of normal errors tells of shares of few frames that are lost, at least 1.

    A row that lacks one frame of fifty where one in 500 is lost lies far out, as one row in ten does. The excess
    kurtosis of a count is 1 / (n p q): whatever few rows have in common follows it (Johnson, Kotz, Kemp, Univariate
    Discrete Distributions, ch. 3).
    """
    frames = frames_of_share(view, channel)
    if frames is None:
        return 1.0
    frames = frames[use]
    share = np.clip(view.sim[channel.name][use], 0.0, 1.0)
    lost = float(np.median(frames * share * (1.0 - share)))
    return 1.0 + min(1.0 / max(lost, 1e-9), MOST_SHARED)


def by_chance(view: View, channel: Channel, use: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Rows (of `use`) whose share of returns so few frames bring by chance, at the simulation's probability.

    Nearly all frames of most rows return: those that lack one stand far out and yet are no wild readings. Held back,
    the mean of the others lies above the probability. No row where the channel is no share or frames are not counted.
    """
    frames = frames_of_share(view, channel)
    if frames is None:
        return np.zeros(len(use), dtype=bool)
    frames = frames[use]
    returns = np.round(frames * view.number(channel.name)[use])
    share = np.clip(view.sim[channel.name][use], 0.0, 1.0)
    return np.asarray(np.minimum(binom.cdf(returns, frames, share), binom.sf(returns - 1.0, frames, share)) > RARE)
