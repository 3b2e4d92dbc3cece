"""Dirt lies where it falls: each stain of a window is a finding, one that is no ellipse is not two."""

from dataclasses import replace

import numpy as np
import pyarrow as pa
import pytest

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.fit import finish, fit
from arl_fixtures.reconcile.patterns import find_patterns
from arl_fixtures.reconcile.patterns_beside import add_spots
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.spots import without_idle
from arl_fixtures.reconcile.table import columns_of

RIVALS = [
    library()[name]
    for name in (
        "optics.window_contamination", "target.reflectance_error", "target.non_lambertian", "optics.vignetting",
        "optics.filter_shift", "beam.profile_change", "detector.compression",
    )
]  # fmt: skip


def line_scan(seed, stains, film=None):
    """A line scanner in a room of six walls; stains are (centre, half width, loss) with edges a beam's width soft.

    A film is (centre, standard deviation, depth at its middle): what ran down and dried, thinner ever farther out.
    """
    rng = np.random.default_rng(seed)
    step, place = (part.ravel().astype(float) for part in np.meshgrid(np.arange(6), np.arange(280), indexing="ij"))
    azimuth = place - 139.5
    wall = np.floor((azimuth + 140.0) / 47.0)
    light = 900.0 * np.array([0.8, 0.3, 0.6, 0.9, 0.4, 0.7])[wall.astype(int)]
    kept = np.ones(place.size)
    for centre, half, loss in stains:
        rim = np.tanh((azimuth - centre + half) / 1.2) - np.tanh((azimuth - centre - half) / 1.2)
        kept = kept * (1.0 - loss * 0.5 * rim) ** 2
    if film is not None:
        kept = kept * np.exp(-2.0 * film[2] * np.exp(-0.5 * ((azimuth - film[0]) / film[1]) ** 2))
    sigma = np.hypot(6.0, 0.015 * light)
    shared = 1.0 + 0.003 * rng.normal(size=6)[step.astype(int)]
    return columns_of(pa.table({
        "step": step, "housing_temperature_c": 10.0 + 8.0 * step, "azimuth_deg": azimuth,
        "time_s": 900.0 * step + 1.3 * place, "surface": np.array(list("abcdef"))[wall.astype(int)],
        "n_frames": np.full(place.size, 20.0), "sim_intensity_counts": light, "sim_intensity_counts_std": sigma,
        "sim_intensity_counts_repeat_std": 0.003 * light,
        "intensity_counts": light * kept * shared + sigma / np.sqrt(20.0) * rng.normal(size=place.size),
    }))  # fmt: skip


def test_two_stains_are_found_where_each_lies():
    found = diagnose(line_scan(5, [(52.0, 7.0, 0.03), (-77.0, 4.0, 0.02)]), effects=RIVALS)[0].findings
    assert [f.effect for f in found] == ["optics.window_contamination"] * 2
    centres = sorted(p.value for f in found for p in f.parameters if p.name == "centre_u")
    assert centres == pytest.approx([-77.0, 52.0], abs=1.5)


def test_one_stain_is_one_finding():
    assert len(diagnose(line_scan(6, [(20.0, 9.0, 0.04)]), effects=RIVALS)[0].findings) == 1


@pytest.mark.parametrize("seed", [7, 8])
def test_a_film_that_thins_out_is_as_deep_as_it_is(seed):
    (found,) = diagnose(line_scan(seed, [], film=(31.0, 9.0, 0.06)), effects=RIVALS)[0].findings
    said = {p.name: p for p in found.parameters}
    assert found.effect == "optics.window_contamination"
    assert said["loss"].low < 1.0 - np.exp(-0.12) < said["loss"].high
    assert said["loss"].high - said["loss"].low < 0.05
    assert said["radius_u"].low < 9.0 * np.sqrt(2.0 * np.log(2.0)) < said["radius_u"].high  # half of the middle's


def image(seed, kept):
    """56 pixels of an array in nine steps before a wall; `kept` is the share of light that each passes or tells."""
    rng = np.random.default_rng(seed)
    step, v, u = (x.ravel() for x in np.meshgrid(np.arange(9.0), [1.0, 11.0, 20.0, 30.0], np.arange(4.0, 125.0, 9.0),
                                                 indexing="ij"))  # fmt: skip
    light = 400.0 * rng.uniform(0.3, 1.0, step.size)
    sigma = np.sqrt(36.0 + light)
    shared = 1.0 + 0.003 * rng.normal(size=9)[step.astype(int)]
    return columns_of(pa.table({
        "step": step, "housing_temperature_c": 10.0 + 8.0 * step, "pixel_u": u, "pixel_v": v,
        "true_range_m": 2.0 + light / 400.0, "n_frames": np.full(step.size, 50.0),
        "sim_intensity_counts": light, "sim_intensity_counts_std": sigma,
        "sim_intensity_counts_repeat_std": 0.003 * light,
        "intensity_counts": light * kept(u, v) * shared + sigma / np.sqrt(50.0) * rng.normal(size=step.size),
    }))  # fmt: skip


def blots(u, v):
    """Drops that scatter light out of the beam on its way out and back, thick in the middle."""
    places = (92.0, 9.0), (27.0, 21.0), (60.0, 27.0)
    return np.exp(-sum(0.03 * np.exp(-(((u - x) / 11.0) ** 2) - ((v - y) / 6.0) ** 2) for x, y in places))


def test_stains_of_an_array_are_no_pattern_of_its_pixels():
    """One of them alone leaves the pixels as unlike as they were."""
    found = diagnose(image(7, blots))[0].findings
    assert [f.effect for f in found] == ["optics.window_contamination"] * 3
    centres = sorted(p.value for f in found for p in f.parameters if p.name == "centre_u")
    assert centres == pytest.approx([27.0, 60.0, 92.0], abs=4.0)


def test_a_spot_where_there_is_none_is_dropped():
    """A spot that was added while the others had not come to rest was paid by what these gained meanwhile."""
    _, _, decision = diagnose(image(7, blots))
    stains, problem = decision.best.terms, decision.problem
    places = {"loss": 0.004, "centre_u": 8.0, "radius_u": 5.0, "centre_v": 3.0, "radius_v": 4.0}
    idle = replace(stains[0], values={**stains[0].values, **places})
    more = finish(problem, fit(problem, (*stains, idle), rounds=4))
    left = without_idle(decision.search, more, 0).terms
    assert sorted(round(t.values["centre_u"]) for t in left) == sorted(round(t.values["centre_u"]) for t in stains)


def test_unlike_pixels_are_no_stains():
    gains = np.random.default_rng(3).normal(1.0, 0.02, (31, 128))
    found = diagnose(image(8, lambda u, v: gains[v.astype(int), u.astype(int)]))[0].findings
    assert [f.effect for f in found] == ["detector.pixel_response"]


def test_stains_that_fell_are_not_asked_for_again():
    """They would come back, and fall again, as long as the pattern that they stand for is there."""
    _, _, decision = diagnose(image(7, blots))
    decision.keep(())
    patterns = find_patterns(decision.problem, decision.effects, ())
    assert any(pattern.is_dense for pattern in patterns)
    assert not add_spots(decision, patterns)
