"""A camera that does not move: pixels and conditions are told by images, of which steps may have few."""

from types import SimpleNamespace

import numpy as np
import pyarrow as pa

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.misfit import is_misfit
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.search import Search
from arl_fixtures.reconcile.table import columns_of
from arl_fixtures.reconcile.terms import Term, default_values, forward


def camera(seed, *, steps, images, change):
    """Images of 16 by 12 pixels of one scene, ten frames each; `change` bends what is measured before its noise."""
    rng = np.random.default_rng(seed)
    image, v, u = (a.ravel() for a in np.meshgrid(np.arange(steps * images), np.arange(12), np.arange(16)))
    step, size = image // images, image.size
    light = 300.0 + 40.0 * ((3 * u + 5 * v) % 23)
    noise = 2.0 + 0.3 * np.sqrt(light)
    columns = {
        "step": step.astype(float), "image": image.astype(float), "time_s": 40.0 * image, "pixel_u": u.astype(float),
        "pixel_v": v.astype(float), "tof_temperature_c": 15.0 + 12.0 * step + 0.1 * (image % images),
        "n_frames": np.full(size, 10.0), "sim_intensity_counts": light, "sim_intensity_counts_std": noise,
    }  # fmt: skip
    true, wider = change(columns, light, noise, rng)
    frames = true + wider * rng.normal(size=(10, size))
    columns["intensity_counts"] = frames.mean(axis=0)
    columns["intensity_counts_std"] = frames.std(axis=0, ddof=1)
    return columns_of(pa.table(columns))


def said(table, *effects):
    return [f.effect for f in diagnose(table, effects=[library()[name] for name in effects])[0].findings]


def test_a_pattern_of_pixels_is_seen_in_half_of_the_images_and_again_in_the_other():
    def uneven(_columns, light, noise, _rng):
        gain = 0.004 * np.random.default_rng(9).normal(size=12 * 16)
        pixel = np.arange(12 * 16).reshape(12, 16)
        u, v = _columns["pixel_u"].astype(int), _columns["pixel_v"].astype(int)
        return light * (1.0 + gain[pixel[v, u]]), noise

    table = camera(4, steps=2, images=6, change=uneven)
    assert said(table, "detector.pixel_response", "optics.vignetting") == ["detector.pixel_response"]


def test_frames_that_scatter_more_in_the_hottest_of_four_steps_are_named():
    def noisy(columns, light, noise, _rng):
        return light, noise * np.where(columns["tof_temperature_c"] > 48.0, 1.09, 1.0)

    table = camera(5, steps=4, images=6, change=noisy)
    assert said(table, "readout.noise_excess", "laser.pulse_energy_jitter") == ["readout.noise_excess"]
    quiet = camera(5, steps=4, images=6, change=lambda _c, light, noise, _r: (light, noise))
    assert said(quiet, "readout.noise_excess", "laser.pulse_energy_jitter") == []


def test_a_faint_pattern_of_pixels_is_told_from_none():
    """Six parts in ten thousand, a third of a pixel's error over all images: no single pixel shows it."""
    gain = np.random.default_rng(17).normal(size=(12, 16))

    def uneven(size):
        def change(columns, light, noise, _rng):
            pixel = gain[columns["pixel_v"].astype(int), columns["pixel_u"].astype(int)]
            return light * (1.0 + size * pixel), noise

        return change

    names = ("detector.pixel_response", "optics.vignetting")
    assert said(camera(6, steps=4, images=6, change=uneven(0.0006)), *names) == ["detector.pixel_response"]
    assert said(camera(6, steps=4, images=6, change=uneven(0.0)), *names) == []


def test_an_effect_on_means_is_not_seen_by_scatters_alone():
    """Frames scatter as they would under a wide glare of the scene; in one table their means hold it as well."""
    effect = library()["optics.veiling_glare"]
    for share, seen in ((1.0, True), (0.0, False)):

        def glaring(columns, light, noise, _rng, share=share):
            veil = 0.4 * np.bincount(columns["image"].astype(int), light)[columns["image"].astype(int)] / 192.0
            return light + share * veil, 2.0 + 0.3 * np.sqrt(light + veil)

        problem = Search(camera(8, steps=4, images=6, change=glaring), [effect]).full
        variant = next(v for v in effect.variants(problem.view))
        term = Term(effect=effect, variant=variant, values={**default_values(variant), "share": 0.4})
        state = forward((term,), problem.view)
        ranked = SimpleNamespace(fit=SimpleNamespace(terms=(term,), state=state), gain=9.0)
        assert is_misfit(problem, SimpleNamespace(terms=()), ranked, {}) is not seen
