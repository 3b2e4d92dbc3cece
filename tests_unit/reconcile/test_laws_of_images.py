"""Where blocks are parts of images, a term of a law must not harm images that took no part in its fit."""

import numpy as np
import pyarrow as pa
import pytest

from arl_fixtures.reconcile.law import Axis
from arl_fixtures.reconcile.law_basis import PRICE_ONE, Basis
from arl_fixtures.reconcile.law_fit import holds_between, joint, weighed
from arl_fixtures.reconcile.law_work import Work
from arl_fixtures.reconcile.pilot import Looker
from arl_fixtures.reconcile.problem import Problem
from arl_fixtures.reconcile.table import columns_of

LIGHT = "intensity_counts"
TWICE = (1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 2.0, 2.5, 3.0, 3.5, 4.0, 4.5)
"""Metres to a wall that moves away twice."""
ONCE = (1.0, 1.4, 1.8, 2.2, 2.6, 3.0, 3.4, 3.8, 4.2, 1.0, 1.0, 1.0)
"""The same, once, and at last the wall is back: there alone darker is not later."""


def glare_table(places, drift):
    """A camera before a wall; 2 % of the light spreads over the image, the gain drifts from image to image.

    Within an image glare adds most to what is darker than its mean: a law of the signal and of the image's number
    tells the same as long as the one goes down with the other.
    """
    rng = np.random.default_rng(2)
    image, v, u = (a.ravel() for a in np.meshgrid(np.arange(12), np.arange(16), np.arange(16), indexing="ij"))
    far = np.array(places)[image]
    tile = np.where((u // 3 + v // 4) % 2 == 0, 0.8, 0.25)
    light = 9000.0 * tile * np.exp(-((u - 7.5) ** 2 + (v - 7.5) ** 2) / 90.0) / far**2
    mean = (np.bincount(image, light) / 256.0)[image]
    seen = (0.98 * light + 0.02 * mean) * (1.0 + drift * image / 12.0)
    error = 0.02 * light + 1.0
    return columns_of(pa.table({
        "step": image // 6, "frame_id": image + 4 * (image // 6), "pixel_u": u, "pixel_v": v,
        "sim_intensity_counts": light, "sim_intensity_counts_std": error,
        LIGHT: seen + error * rng.normal(size=light.size),
    }))  # fmt: skip


def work_of(columns):
    looker = Looker(Problem(columns))
    (data,) = (d for d in looker.problem.data if d.channel.name == LIGHT)
    state = looker.problem.view.fresh_state()
    looker.calibrate(data, state)
    return looker, Work(data, state, looker.features, {**data.tau, "pixel": 0.0, "frame": 0.0})


def test_blocks_are_parts_of_images_here():
    looker, work = work_of(glare_table(TWICE, 0.0))
    assert looker.problem.groups.block_name == "patches of pixels"
    assert np.array_equal(np.unique(work.image_fold), np.arange(4))
    order = work.features["frame_id"]
    assert all(order[work.image_fold == k].max() < order[work.image_fold == k + 1].min() for k in range(3))


@pytest.mark.parametrize(("places", "holds"), [(TWICE, True), (ONCE, False)], ids=["twice", "once"])
def test_a_term_must_not_harm_images_ahead(places, holds):
    """Both laws gain by the image's number on pixels that were not seen; ahead, only the one of two ladders does."""
    _, work = work_of(glare_table(places, 0.01))
    middle = float(np.median(work.features["sim_intensity_counts"]))
    darker = Basis(axes=(Axis(column="sim_intensity_counts", kind="log", middle=middle),), price=PRICE_ONE)
    later = Basis(axes=(Axis(column="frame_id", kind="linear", middle=8.0, width=16.0),), price=PRICE_ONE)
    chosen = joint(work, [weighed(work, darker, work.residual)])
    trial = joint(work, [*chosen.terms, weighed(work, later, chosen.left)])
    assert trial.held > chosen.held + 4.0
    assert holds_between(work, chosen, trial) == holds
