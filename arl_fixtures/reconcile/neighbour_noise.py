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
from arl_fixtures.reconcile.noise import PATCH, level_of
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
    image = frame[rows]
    left = _not_repeated(data, view, place[rows], image)
    if left is None or not _is_shared(left, image, u, v, view.sim[data.channel.name][data.use]):
        return
    level = level_of(PATCH, _key(image, u // ACROSS, v // ACROSS)[0], data.stated)
    if level is not None:
        data.share_within(level)


def _not_repeated(data: ChannelData, view: View, place: IntArray, image: IntArray) -> FloatArray | None:
    """What rows are off beside what their place is in all steps, standard errors held back; None where few repeat.

    What an image is off as a whole, by a gain or an offset, is no likeness of neighbours: steps scatter as well.
    """
    code = np.unique(place, return_inverse=True)[1].astype(np.int64)
    visits = np.bincount(code)[code]
    if np.median(visits) < FEWEST_VISITS:
        return None
    z, whole = data.residual(view.sim) * data.root_weight, data.scale * data.root_weight
    one = np.unique(image, return_inverse=True)[1].astype(np.int64)
    level = np.bincount(one, z * whole) / np.maximum(np.bincount(one, whole**2), 1e-300)
    z = np.clip(z - level[one] * whole, -HELD_BACK, HELD_BACK)
    own = z - (np.bincount(code, z) / np.bincount(code))[code]
    return np.where(visits >= FEWEST_VISITS, own * np.sqrt(visits / np.maximum(visits - 1.0, 1.0)), np.nan)


def _key(image: IntArray, u: IntArray, v: IntArray) -> tuple[IntArray, int]:
    """One number for each place in each image, room beside the images included, and how far apart rows of it are."""
    width, height = (int(np.ptp(x)) + 2 * FAR + 2 for x in (u, v))
    return (image * height + (v - v.min())) * width + (u - u.min()), width


def _is_shared(left: FloatArray, image: IntArray, u: IntArray, v: IntArray, sim: FloatArray) -> bool:
    """Whether neighbours are alike, and pixels a little farther away are not."""
    power = float(np.nanmean(left**2))
    if power > MOST_POWER:
        return False
    key, width = _key(image, u, v)
    order = np.argsort(key, kind="stable")
    ordered = key[order]
    near: list[FloatArray] = []
    far: list[FloatArray] = []
    for step, found in ((1, near), (FAR, far)):
        for shift in (step, step * width):
            at = np.minimum(np.searchsorted(ordered, key + shift), len(key) - 1)
            other = order[at]
            same = (key[other] == key + shift) & (np.abs(sim[other] - sim) < SAME_SCENE * np.abs(sim))
            product = (left * left[other])[same]
            found.append(product[np.isfinite(product)])
    close, away = np.concatenate(near), np.concatenate(far)
    if min(len(close), len(away)) < FEWEST_PAIRS:
        return False
    beyond = (float(close.mean()) - float(away.mean())) / power
    error = float(np.hypot(close.std() / np.sqrt(len(close)), away.std() / np.sqrt(len(away)))) / power
    return beyond > LEAST_ALIKE and beyond > SURE * error
