"""Noise that neighbours in an image share: a lens does not make it, a read-out does, and frames do not repeat it.

Crosstalk of amplifiers, interpolation of dead pixels and median filters leave a noise of patches. Rows are then fewer
witnesses than they are many, and what chance makes of patches passes for a picture. Physics makes pictures, too, so
the likeness of neighbours counts only where it does not come again at the same place in another step, ends after a
few pixels, and is found where the scene is the same in all of them.
"""

from __future__ import annotations

import numpy as np

from arl_fixtures.reconcile.channel_data import ChannelData
from arl_fixtures.reconcile.columns import FloatArray, IntArray
from arl_fixtures.reconcile.noise import NESTED, PATCH, level_of
from arl_fixtures.reconcile.roles import Role
from arl_fixtures.reconcile.view import View

ACROSS = 3
"""Pixels along each side of a patch."""
FAR = 4
"""Pixels beyond which noise of neighbours has ended, and a picture has not."""
LEAST_ALIKE, SURE = 0.1, 6.0
"""Correlation of neighbours beyond that of pixels `FAR` away, and its significance, from which noise is shared."""
HELD_BACK = 2.5
"""Standard errors to which a row is held back."""
MOST_POWER = 1.5
"""Variance of rows, in what is stated, beyond which they hold more than noise."""
FEWEST_VISITS, FEWEST_PAIRS = 3, 200
SAME_SCENE = 0.1
"""Share by which the simulated values of rows may differ that see the same."""


def add_patches(data: ChannelData, view: View, frame: IntArray, place: IntArray) -> None:
    """Give a channel the scatter of patches of neighbouring pixels, where images show one.

    Args:
        data: of a signal or a distance; view: its rows.
        frame: image of each row of the whole table; place: pixel at an angle, which comes again in every step.
    """
    if data.channel.role not in {Role.INTENSITY, Role.DISTANCE}:
        return
    if not (view.varies("pixel_u") or view.varies("pixel_v")):
        return
    rows = view.rows[data.use]
    u, v = (
        np.nan_to_num(view.number(name))[data.use].astype(np.int64) if view.varies(name) else np.zeros(len(rows), int)
        for name in ("pixel_u", "pixel_v")
    )
    image = np.unique(frame[rows], return_inverse=True)[1].astype(np.int64)
    left = _not_repeated(data, view, place[rows])
    if left is None or not _is_shared(left, image, u, v, view.sim[data.channel.name][data.use]):
        return
    patch = np.unique(np.stack([image, u // ACROSS, v // ACROSS]), axis=1, return_inverse=True)[1].ravel()
    level = level_of(PATCH, patch, data.stated)
    if level is not None:
        first = next((k for k, other in enumerate(data.levels) if other.name in NESTED), len(data.levels))
        data.levels = (*data.levels[:first], level, *data.levels[first:])
        data.rebuild(data.tau)


def _not_repeated(data: ChannelData, view: View, place: IntArray) -> FloatArray | None:
    """What rows are off beside what their place is in all steps, standard errors held back; None where few repeat."""
    code = np.unique(place, return_inverse=True)[1].astype(np.int64)
    visits = np.bincount(code)[code]
    if np.median(visits) < FEWEST_VISITS:
        return None
    z = np.clip(data.residual(view.sim) * data.root_weight, -HELD_BACK, HELD_BACK)
    own = z - (np.bincount(code, z) / np.bincount(code))[code]
    return np.where(visits >= FEWEST_VISITS, own * np.sqrt(visits / np.maximum(visits - 1.0, 1.0)), np.nan)


def _is_shared(left: FloatArray, image: IntArray, u: IntArray, v: IntArray, sim: FloatArray) -> bool:
    """Whether neighbours are alike, and pixels a little farther away are not."""
    width = int(u.max() - u.min()) + 2 * FAR + 2
    height = int(v.max() - v.min()) + 2 * FAR + 2
    key = (image * height + (v - v.min())) * width + (u - u.min())
    order = np.argsort(key, kind="stable")
    near: list[FloatArray] = []
    far: list[FloatArray] = []
    for step, found in ((1, near), (FAR, far)):
        for shift in (step, step * width):
            at = np.minimum(np.searchsorted(key[order], key + shift), len(key) - 1)
            other = order[at]
            same = (key[other] == key + shift) & (np.abs(sim[other] - sim) < SAME_SCENE * np.abs(sim))
            product = (left * left[other])[same]
            found.append(product[np.isfinite(product)])
    close, away = np.concatenate(near), np.concatenate(far)
    if min(len(close), len(away)) < FEWEST_PAIRS:
        return False
    power = float(np.nanmean(left**2))
    beyond = (float(close.mean()) - float(away.mean())) / power
    error = float(np.hypot(close.std() / np.sqrt(len(close)), away.std() / np.sqrt(len(away)))) / power
    return power < MOST_POWER and beyond > LEAST_ALIKE and beyond > SURE * error
