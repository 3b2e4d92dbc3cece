"""Painted boards with a glossy face: small facets send light back, whatever the paint below them."""

import numpy as np
import pyarrow as pa
import pytest

from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of

WHITE = {"grey": 0.18, "light": 0.45, "white": 0.8}
FACETS, WITHIN = 4_000_000, np.radians(2.5)


def faced(angles, slope, rng):
    """Radiance that a face of random facets sends back to the source, by counting those that look at it."""
    steep = rng.normal(0.0, slope / np.sqrt(2.0), (2, FACETS))
    area = np.sqrt(1.0 + (steep**2).sum(axis=0))  # of a facet, over its place in the board's plane
    normal = np.stack([-steep[0], -steep[1], np.ones(FACETS)]) / area
    seen = []
    for angle in angles:
        cosine = normal.T @ np.array([np.sin(angle), 0.0, np.cos(angle)])
        looks = cosine > np.cos(WITHIN)
        seen.append(np.sum(area[looks] * cosine[looks]) / FACETS / np.cos(angle))
    return np.array(seen)


def boards(seed, gloss, slope=0.25):
    """Three boards, turned from 0 to 60 degrees at three ranges before a single beam."""
    rng = np.random.default_rng(seed)
    turns = np.arange(0.0, 61.0, 3.0)
    angle, far, kind, _ = (
        x.ravel()
        for x in np.meshgrid(np.arange(turns.size), [1.2, 2.0, 3.1], np.arange(3), np.arange(6), indexing="ij")
    )
    white = np.array(list(WHITE.values()))[kind.astype(int)]
    incidence = np.radians(turns)[angle.astype(int)]
    back = faced(np.radians(turns), slope, rng)
    sim = 8e3 * white * np.cos(incidence) / far**2
    true = sim + 8e3 * gloss * (back / back[0])[angle.astype(int)] / far**2
    noise = np.sqrt(20.0 + 0.4 * sim)
    return columns_of(pa.table({
        "surface": np.array(list(WHITE))[kind.astype(int)], "reflectance": white, "true_range_m": far,
        "incidence_deg": np.degrees(incidence), "n_frames": np.full(far.size, 20.0),
        "sim_intensity_counts": sim, "sim_intensity_counts_std": noise,
        "intensity_counts": true + noise / np.sqrt(20.0) * rng.normal(size=far.size),
    }))  # fmt: skip


@pytest.mark.parametrize("seed", [1, 2])
def test_a_face_that_is_alike_on_all_paints_is_named(seed):
    findings = diagnose(boards(seed, 0.02))[0].findings
    assert [f.effect for f in findings] == ["target.non_lambertian"]
    assert {p.name: p.value for p in findings[0].parameters}["slope"] == pytest.approx(0.25, rel=0.1)


def test_boards_of_lamberts_law_are_no_mismatch():
    assert diagnose(boards(3, 0.0))[0].findings == []
