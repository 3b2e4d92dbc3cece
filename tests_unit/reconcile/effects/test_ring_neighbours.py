"""A scanner's beam has a width: at the edge of a box it sees the wall behind it, too, and rings have neighbours."""

import numpy as np
from rendered_bench import make_columns
from scipy.special import ndtr

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.effects_surface import borders, neighbours
from arl_fixtures.reconcile.fit import fit
from arl_fixtures.reconcile.pilot import Looker
from arl_fixtures.reconcile.problem import Problem
from arl_fixtures.reconcile.screen import screen
from arl_fixtures.reconcile.steadiness import is_unsteady
from arl_fixtures.reconcile.terms import Term
from arl_fixtures.reconcile.view import View

BOX_DEG, BEAM_DEG = 18.3, 0.2


def scan(*, beam_deg=BEAM_DEG, gap=None, marked=True):
    """Boxes 0.3 m before a wall, in ten rings of two steps; simulated by one ray, seen by a Gaussian beam."""
    rng = np.random.default_rng(8)
    step, ring, place = (a.ravel() for a in np.meshgrid(np.arange(2), np.arange(10), np.arange(150), indexing="ij"))
    azimuth, elevation = 0.5 * place - 37.0 + 0.01 * step, 2.0 * ring - 9.0
    first = np.floor(azimuth / BOX_DEG)
    inside = first % 2 == 0
    to_edge = np.minimum(azimuth - BOX_DEG * first, BOX_DEG * (first + 1.0) - azimuth)
    far = 4.0 / np.cos(np.radians(azimuth)) / np.cos(np.radians(elevation))  # flat walls
    near, light = np.where(inside, far, far + 0.3), np.where(inside, 900.0, 600.0)
    there, other = np.where(inside, far + 0.3, far), np.where(inside, 600.0, 900.0)
    over = ndtr(-to_edge / beam_deg) if beam_deg else np.zeros(azimuth.size)
    seen = ((1.0 - over) * light * near + over * other * there) / ((1.0 - over) * light + over * other)
    numbers = {
        "step": step, "azimuth_deg": azimuth, "elevation_deg": elevation, "n_frames": np.full(step.size, 8.0),
        "sim_distance_m": near, "sim_distance_m_std": np.full(step.size, 0.01),
        "distance_m": seen + rng.normal(0.0, 0.01 / np.sqrt(8.0), step.size),
        "sim_intensity_counts": light, "sim_intensity_counts_std": np.full(step.size, 20.0),
        "intensity_counts": light + rng.normal(0.0, 20.0 / np.sqrt(8.0), step.size),
    }  # fmt: skip
    labels = {"surface": np.where(inside, "box", "wall")}
    if marked:
        labels["mixed"] = np.where(to_edge < 0.6, "true", "false")
    keep = np.ones(step.size, dtype=bool) if gap is None else np.abs(azimuth - gap) > 2.0
    taken = ({name: values[keep] for name, values in part.items()} for part in (numbers, labels))
    return make_columns(*taken)[0]


def best_of(columns):
    """The first candidate of mixing at edges, and the threshold."""
    problem, effect = Problem(columns), library()["target.edge_mixing"]
    found = screen(problem, [(effect, v) for v in effect.variants(problem.view)], with_chance=True)
    return found.candidates[0], found.threshold(0.99)


def test_a_beam_that_is_split_over_an_edge_is_mixing_of_the_next_rays_surfaces():
    candidate, threshold = best_of(scan())
    assert candidate.gain > 5.0 * threshold
    assert candidate.term.values["share"] > 0.0


def test_where_in_a_ray_the_edge_lies_does_not_make_the_mixing_unsteady():
    problem = Problem(scan())
    effect = library()["target.edge_mixing"]
    variant = next(v for v in effect.variants(problem.view) if v.options["kind"] == "range")
    term = fit(problem, [Term(effect=effect, variant=variant, values={"share": 0.1})]).terms[0]
    assert not is_unsteady(Looker(problem), [term], term)


def test_a_ray_without_width_mixes_nothing():
    candidate, threshold = best_of(scan(beam_deg=0.0))
    assert candidate.gain < threshold


def test_a_hole_in_a_ring_is_no_border():
    view = View(scan(marked=False, gap=BOX_DEG))
    at = borders(view)
    assert at.any()
    assert np.abs(view.number("azimuth_deg")[at] - BOX_DEG).min() > 3.0
    assert np.mean(at) < 0.15
    along = neighbours(view, "sim_distance_m")[:2]
    assert all((codes >= 0).mean() > 0.9 for codes, _ in along)


def test_rays_that_an_image_lacks_are_those_of_the_others():
    """Of ten images of a scene at rest each holds every fifth ray of a ring, and hardly two next to each other."""
    rng = np.random.default_rng(3)
    image, ring, place = (a.ravel() for a in np.meshgrid(np.arange(10), np.arange(8), np.arange(90), indexing="ij"))
    kept = rng.random(image.size) < 0.2
    azimuth, elevation = 4.0 * place[kept] - 180.0, 2.0 * ring[kept] - 7.0
    near = (azimuth > 0.0) ^ (elevation > 0.0)
    numbers = {"step": image[kept], "azimuth_deg": azimuth, "elevation_deg": elevation,
               "sim_distance_m": np.where(near, 3.0, 5.0), "distance_m": np.where(near, 3.0, 5.0)}  # fmt: skip
    view = View(make_columns(numbers, {})[0])
    azimuth, elevation = view.number("azimuth_deg"), view.number("elevation_deg")
    expected = (np.abs(np.abs(azimuth) - 2.0) < 3.0) | (np.abs(np.abs(elevation) - 1.0) < 0.5)
    expected |= azimuth == 0.0
    at = borders(view)
    assert np.mean(at[expected]) > 0.8
    assert not at[~expected & (azimuth > -175.0) & (azimuth < 175.0)].any()
