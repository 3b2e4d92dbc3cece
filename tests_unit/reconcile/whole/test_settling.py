"""What takes the place of an effect is judged without what that effect had taught the gains of pixels."""

from dataclasses import replace

import numpy as np
import pyarrow as pa
import pytest

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.search import Search
from arl_fixtures.reconcile.settling import _swapped, following
from arl_fixtures.reconcile.table import columns_of

BENT = 0.25


def camera(seed, change=None):
    """60 pixels that see six grey levels each; `change` bends the light before noise."""
    rng = np.random.default_rng(seed)
    pixel, level, step = (a.ravel() for a in np.meshgrid(np.arange(60), np.arange(6), np.arange(6), indexing="ij"))
    light = 250.0 * 1.7**level
    seen = light if change is None else change(light, pixel, step)
    sigma = np.hypot(5.0, 0.01 * light)
    return columns_of(pa.table({
        "step": step.astype(float), "pixel_u": (pixel % 12).astype(float), "pixel_v": (pixel // 12).astype(float),
        "stage_angle_deg": 3.0 * level, "n_frames": np.full(pixel.size, 10.0), "sim_intensity_counts": light,
        "sim_intensity_counts_std": sigma,
        "intensity_counts": seen * (1.0 + 0.002 * rng.normal(size=6)[step])
        + sigma / np.sqrt(10.0) * rng.normal(size=pixel.size),
    }))  # fmt: skip


def bent(light, *_):
    return light * (1.0 - BENT * np.tanh(light / 3500.0))


def test_gains_that_followed_an_effect_do_not_bring_it_back_under_another_name():
    search = Search(camera(1, bent), [library()["detector.compression"]])
    (d,) = search.full.data
    sim = search.full.view.sim
    name = d.channel.name
    truth, off = {**sim, name: bent(sim[name])}, {**sim, name: 0.1 * sim[name]}
    d.follow(truth)
    scale, levels, tau = d.scale, d.levels, dict(d.tau)
    leak = search.full.log_likelihood(off) - search.full.log_likelihood(sim)
    with following((search.full, search.small), ()):
        fair = search.full.log_likelihood(off) - search.full.log_likelihood(sim)
        np.testing.assert_array_equal(d.scale, sim[name][d.use])
    assert leak > 0.0  # a signal that is switched off, and a free gain of each pixel that holds the bent one
    assert fair < 0.0
    assert d.scale is scale
    assert d.levels is levels
    assert d.tau == tau


@pytest.mark.parametrize("error", [ValueError, KeyError])
def test_gains_are_theirs_again_after_a_failure(error):
    search = Search(camera(2), [library()["detector.compression"]])
    (d,) = search.full.data
    scale = d.scale
    with pytest.raises(error), following((search.full,), ()):
        raise error
    assert d.scale is scale


def test_a_bent_response_beside_columns_of_unequal_gain_keeps_its_name():
    def both(light, pixel, _step):
        return bent(light) * (1.0 + 0.01 * np.array([0.0, 1.0, -1.0, 0.5])[pixel % 12 % 4])

    named = [
        library()[name] for name in ("detector.compression", "readout.column_pattern", "detector.pile_up",
                                     "optics.vignetting", "target.reflectance_error")
    ]  # fmt: skip
    findings = diagnose(camera(3, both), effects=named)[0].findings
    assert {f.effect for f in findings} == {"detector.compression", "readout.column_pattern"}


def test_an_effect_is_not_replaced_by_one_that_only_its_fit_favours(monkeypatch):
    """A candidate's fit may find a better scatter of the steps than a fit that goes on from where it stood."""
    effects = [library()[n] for n in ("detector.compression", "detector.pile_up", "optics.veiling_glare")]
    search = Search(camera(3, bent), effects)
    found = search.run()
    (term,) = found.best.terms
    rank = search.rank
    monkeypatch.setattr(search, "rank", lambda *given: [replace(r, gain=r.gain + 1000.0) for r in rank(*given)])
    kept = _swapped(search, found.best, (), term.label, found.stages[0])
    assert [t.label for t in kept.terms] == [term.label]
