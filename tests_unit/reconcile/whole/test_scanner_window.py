"""A scanner has rays and no pixels: a stain on its cover lies at some of them, wherever the sensor is turned."""

import numpy as np
import pyarrow as pa
import pytest
from rendered_bench import variant_of

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of
from arl_fixtures.reconcile.view import View

BEAM_MM, COVER_MM = 6.0, 40.0


def hidden(azimuth, elevation, stain):
    """Share of a beam's cross-section that a disc of dirt on a round cover hides, drawn at random over the beam."""
    centre_az, centre_el, radius_mm = stain
    rng = np.random.default_rng(1)
    spread = np.sqrt(rng.random(400)) * np.exp(2j * np.pi * rng.random(400)) * BEAM_MM / 2.0
    across = np.radians(np.mod(azimuth - centre_az + 180.0, 360.0) - 180.0) * COVER_MM
    above = (np.tan(np.radians(elevation)) - np.tan(np.radians(centre_el))) * COVER_MM
    return np.mean(np.hypot(across[:, None] + spread.real, above[:, None] + spread.imag) < radius_mm, axis=1)


def scanned_room(seed, stain=None, rings=False):
    """A scanner of 16 beams in a square room with boards on its walls, turned to two angles."""
    rng = np.random.default_rng(seed)
    step, stage, place, beam = (
        a.ravel().astype(float) for a in np.meshgrid(*(np.arange(n) for n in (3, 2, 60, 16)), indexing="ij")
    )
    azimuth, elevation = place * 6.0 + 0.5 * step, 2.0 * beam - 15.0
    bearing = np.radians(np.mod(azimuth + 17.0 * stage, 360.0))
    far = 3.0 / np.maximum(np.abs(np.cos(bearing)), np.abs(np.sin(bearing)))
    board = np.floor(np.degrees(bearing) / 9.0).astype(int) % 4
    light = 5e4 * np.array([0.1, 0.3, 0.55, 0.8])[board] / far**2
    sigma = np.hypot(15.0, 0.02 * light)
    kept = 1.0 if stain is None else (1.0 - 0.25 * hidden(azimuth, elevation, stain)) ** 2
    shared = 1.0 + 0.002 * rng.normal(size=3)[step.astype(int)]
    return columns_of(pa.table({
        "step": step, "stage_angle_deg": 17.0 * stage, "azimuth_deg": azimuth, "elevation_deg": elevation,
        **({"pixel_v": beam} if rings else {}), "time_s": 600.0 * step + 30.0 * stage + 0.1 * place,
        "housing_temperature_c": 25.0 + 10.0 * step, "surface": np.array(["a", "b", "c", "d"])[board],
        "n_frames": np.full(step.size, 10.0), "sim_intensity_counts": light, "sim_intensity_counts_std": sigma,
        "sim_intensity_counts_repeat_std": 0.002 * light,
        "intensity_counts": light * kept * shared + sigma / np.sqrt(10.0) * rng.normal(size=step.size),
    }))  # fmt: skip


@pytest.mark.parametrize(("stain", "rings"), [((200.0, -3.0, 8.0), False), ((3.0, 5.0, 6.0), True)])
def test_a_stain_on_a_scanners_cover_is_found_where_it_lies(stain, rings):
    table = scanned_room(3, stain, rings)
    (found,) = diagnose(table)[0].findings
    assert found.effect == "optics.window_contamination"
    values = {p.name: p.value for p in found.parameters}
    assert np.mod(values["centre_u"] - stain[0] + 180.0, 360.0) - 180.0 == pytest.approx(0.0, abs=2.5)
    across = np.degrees(stain[2] / COVER_MM)
    assert 0.7 * across < values["radius_u"] < 1.5 * across


def test_a_clean_cover_is_found_clean():
    assert diagnose(scanned_room(4))[0].verdict == "consistent"


def test_pixels_of_a_lens_are_taken_by_their_numbers():
    u = np.tile(np.arange(32.0), 8)
    table = columns_of(pa.table({
        "pixel_u": u, "azimuth_deg": 2.0 * u, "elevation_deg": 1e-3 * (u - 16.0) ** 2,
        "step": np.repeat(np.arange(8.0), 32), "intensity_counts": 100.0 + u, "sim_intensity_counts": 100.0 + u,
    }))  # fmt: skip
    view = View(table)
    variant = variant_of(view, "optics.window_contamination")
    assert variant.drivers == ("pixel_u",)
    values = {"loss": 0.1, "centre_u": 8.0, "radius_u": 2.0}
    said = library()["optics.window_contamination"].sentence(variant, values, view)
    assert "(pixels u = 8 ± 2)" in said
