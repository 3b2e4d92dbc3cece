"""Light from elsewhere in the image, where the table holds only some of its pixels and the bench is known.

Stray light of the optics comes from the whole image: its mean, or its mirrored pixel. Both are rendered, smoothly:
what strays is out of focus.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from arl_fixtures.reconcile.effects_bench import Bench, bench_of
from arl_fixtures.reconcile.effects_common import distances, per_table, per_view
from arl_fixtures.reconcile.effects_mirror import Mirror
from arl_fixtures.reconcile.effects_rays import Optics, Spots, look
from arl_fixtures.reconcile.effects_render import distinct_spots
from arl_fixtures.reconcile.view import View

FloatArray = NDArray[np.float64]

_EVERY = 4.0
_SOFT_RAYS = 3
_HELD = 0.5
"""Share of an image's pixels from which the table's own pixels do."""
_MOST_KEPT = 100


def whole_image(view: View) -> tuple[FloatArray, dict[str, FloatArray]] | None:
    """Mean light of each row's whole image over that of the pixels that the table holds of it, and its mean ranges.

    The ranges are weighted by light, in the unit of each distance channel. None where the bench is not known.
    """
    bench = bench_of(view)
    if bench is None:
        return None
    fullness, range_m = per_table(view, "fullness", lambda: _fullness(bench))
    at = bench.index[view.rows]
    return fullness[at], dict.fromkeys(distances(view), (range_m + bench.ahead_m)[at] * bench.unit)


def _fullness(bench: Bench) -> tuple[FloatArray, FloatArray]:
    """Mean light of each nominal image (every fourth pixel) over the mean of its spots; the image's mean range."""
    spots, camera = bench.spots, bench.optics.camera
    light, _ = look(bench.optics, spots)
    held = np.bincount(bench.frame, light * np.exp(camera.log_beam(spots.u, spots.v))) / np.bincount(bench.frame)
    across, along = (
        part.ravel()
        for part in np.meshgrid(
            *(np.arange(0.5 * _EVERY - 0.5, 2.0 * c + 1.0, _EVERY) for c in (camera.cx, camera.cy)), indexing="ij"
        )
    )
    beam = np.exp(camera.log_beam(across, along))
    coarse = Optics(camera=camera, rays=1, soft_rad=_EVERY / camera.fx, scene=bench.optics.scene)
    whole, range_m = np.zeros(held.size), np.zeros(held.size)
    for index, one in enumerate(np.unique(bench.frame, return_index=True)[1]):
        image = Spots(
            u=across, v=along, stage_deg=np.full(across.size, spots.stage_deg[one]),
            height_m=np.full(across.size, spots.height_m[one]),
        )  # fmt: skip
        seen, moment = look(coarse, image)
        whole[index] = float(np.mean(seen * beam))
        range_m[index] = float(np.mean(moment * beam)) / whole[index]
    return np.asarray((whole / np.maximum(held, 1e-300))[bench.frame]), np.asarray(range_m[bench.frame])


def mirrored_image(
    view: View, mirror: Mirror, blur_px: float = 0.0
) -> tuple[FloatArray, dict[str, FloatArray]] | None:
    """Light of each mirrored pixel over the row's own simulated signal, and the ranges there.

    Through a Gaussian point spread of standard deviation `blur_px`. None where the bench is not known or the table
    holds the image itself; light is nil outside the image.
    """
    bench = bench_of(view)
    if bench is None or per_table(view, "holds the image", lambda: _holds_image(bench)):
        return None
    kept = per_view(view, "mirrored looks", dict[tuple[Mirror, float], tuple[FloatArray, FloatArray]])
    key = mirror, blur_px
    if key not in kept:
        while len(kept) >= _MOST_KEPT:
            kept.pop(next(iter(kept)))
        kept[key] = _mirrored(view, bench, *key)
    light, range_ = kept[key]
    return light, dict.fromkeys(distances(view), range_)


def _mirrored(
    view: View, bench: Bench, mirror: Mirror, blur_px: float
) -> tuple[FloatArray, FloatArray]:
    numbers, _, back = distinct_spots(view, bench)
    spots, camera = bench.spots.take(numbers), bench.optics.camera
    u, v = mirror.of(spots.u, spots.v)
    there = Spots(u=u, v=v, stage_deg=spots.stage_deg, height_m=spots.height_m)
    soft = Optics(
        camera=camera, rays=_SOFT_RAYS, soft_rad=1.0 / (_SOFT_RAYS * camera.fx), scene=bench.optics.scene,
        spread_px=blur_px,
    )  # fmt: skip
    light, moment = look(soft, there)
    inside = (np.abs(there.u - camera.cx) <= camera.cx + 0.5) & (np.abs(there.v - camera.cy) <= camera.cy + 0.5)
    own = look(bench.optics, spots)[0] + bench.pedestal[numbers]
    beam = np.exp(camera.log_beam(there.u, there.v) - camera.log_beam(spots.u, spots.v))
    share = np.where(inside, light * beam / np.maximum(own, 1e-9), 0.0)
    range_ = (moment / np.maximum(light, 1e-300) + bench.ahead_m[numbers]) * bench.unit
    return share[back], range_[back]


def _holds_image(bench: Bench) -> bool:
    camera = bench.optics.camera
    whole = (2.0 * camera.cx + 1.0) * (2.0 * camera.cy + 1.0)
    return len(np.unique(bench.spots.u * 4096.0 + bench.spots.v)) > _HELD * whole
