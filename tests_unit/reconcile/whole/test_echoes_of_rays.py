"""A receiver that reads the peak of a waveform, before a bench of which strewn pixels see a part."""

import numpy as np
import pytest
from traced_bench import RANGE, THIRDS, table, trace

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.effects_render import ray_echoes
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.view import View

KNOWN = [library()[name] for name in ("target.edge_mixing", "timing.tdc_nonlinearity", "stage.zero_offset")]


def rays_of(numbers, height_m=0.10):
    """Light and range of each of the nine rays, (rows, 9): one place of a pixel at a time."""
    u, v, stage = (numbers[name] for name in ("pixel_u", "pixel_v", "stage_angle_deg"))
    seen = [trace(u + du, v + dv, stage, height_m, places=(0.0,)) for du in THIRDS for dv in THIRDS]
    return np.stack([light for light, _ in seen], axis=1), np.stack([far for _, far in seen], axis=1)


def peaks_of_waveforms(light, far, sigma_m):
    """Where a sampled sum of pulses is highest."""
    metres = np.arange(0.9, 2.4, 0.004)
    wave = np.zeros((len(light), metres.size))
    for ray in range(light.shape[1]):
        wave += light[:, ray : ray + 1] * np.exp(-0.5 * ((metres - far[:, ray : ray + 1]) / sigma_m) ** 2)
    return metres[np.argmax(wave, axis=1)]


@pytest.fixture(scope="module")
def recorded():
    """The nominal table with ranges at the peaks of waveforms, 0.13 m wide, where rays see several ranges."""
    columns = table(seed=4, angles=25, pixels=24, noise=True)
    light, far = rays_of(columns.numbers)
    mean = np.sum(light * far, axis=1) / np.sum(light, axis=1)
    several = np.ptp(far, axis=1) > 0.05
    moved = np.where(several, peaks_of_waveforms(light, far, 0.13) - mean, 0.0)
    columns.numbers[RANGE] = columns.numbers[RANGE] + moved
    return columns, moved


def test_the_peak_of_the_rays_echoes_is_named(recorded):
    found = diagnose(recorded[0], effects=KNOWN)[0].findings
    assert [f.effect for f in found] == ["target.edge_mixing"]
    assert found[0].held_out.explained > 0.9
    assert {p.name: p.value for p in found[0].parameters}["share"] == pytest.approx(1.0, abs=0.15)


def test_rays_are_those_of_pixels_that_see_several_ranges(recorded):
    columns, moved = recorded
    light, far, spot = ray_echoes(View(columns))
    assert np.all(spot[np.abs(moved) > 1e-3] >= 0)
    own_light, own_far = rays_of(columns.numbers)
    mine = np.flatnonzero(spot >= 0)
    for seen, traced in ((light, own_light), (far, own_far)):
        row, ray = (np.sort(x, axis=1) for x in (traced[mine], seen[spot[mine]]))
        assert row / row.sum(axis=1, keepdims=True) == pytest.approx(ray / ray.sum(axis=1, keepdims=True), rel=1e-3)
