"""How images stand, told where a few of them see far more edges than the rest."""

import numpy as np
import pytest

from arl_fixtures.reconcile.noise import POSE, Level, fit_tau

IMAGES = 160


def poses(seed, spread):
    """A level of images whose edges tell of their poses unequally, and the sums that pure noise makes of them."""
    rng = np.random.default_rng(seed)
    weight = np.exp(spread * rng.normal(size=IMAGES))
    turn = np.linspace(0.0, np.pi, IMAGES)
    smooth = np.stack([np.ones(IMAGES), np.cos(turn), np.sin(turn), np.cos(2 * turn), np.sin(2 * turn)], axis=1)
    level = Level(name=POSE, code=np.arange(IMAGES), count=IMAGES, scale=np.ones(IMAGES), smooth=smooth)
    return level, weight, np.sqrt(weight) * rng.normal(size=IMAGES), turn


@pytest.mark.parametrize("seed", range(4))
def test_noise_alone_lets_no_image_stand_apart(seed):
    level, weight, sums, _ = poses(seed, spread=4.0)
    tau, gain = fit_tau(level.beyond_smooth(sums, weight), weight, lost=5.0)
    assert gain < 4.0
    assert tau * np.sqrt(np.median(weight)) < 1.0


@pytest.mark.parametrize("spread", [0.3, 4.0])
def test_what_follows_the_stage_is_no_scatter(spread):
    level, weight, sums, turn = poses(1, spread)
    drawn = sums + weight * 3.0 * np.cos(turn) / np.sqrt(np.median(weight))
    beyond = level.beyond_smooth(drawn, weight)
    assert np.sum(beyond**2 / weight) < 0.3 * np.sum(drawn**2 / weight)
