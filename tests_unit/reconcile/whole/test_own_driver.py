"""Beside a strong name: what has a driver of its own, and what only goes with what the name's shape leaves."""

import numpy as np
import pyarrow as pa

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.fit import finish, fit
from arl_fixtures.reconcile.own_driver import has_own_driver, mends_shape
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.search import Search
from arl_fixtures.reconcile.steadiness import is_unsteady
from arl_fixtures.reconcile.table import columns_of
from arl_fixtures.reconcile.terms import Term


def named(columns, *effects):
    found = diagnose(columns_of(pa.table(columns)), effects=[library()[name] for name in effects])[0].findings
    return {f.effect for f in found}


def late_mm(light, need):
    """Lateness of a double-exponential pulse that gathers a charge above a level, weak ones half of theirs."""
    time_ns = np.arange(0.0, 40.0, 0.02)
    pulse = np.exp(-time_ns / 4.5) - np.exp(-time_ns / 1.7)
    pulse /= pulse.max()
    heights, late = np.geomspace(15.0, 8000.0, 160), []
    for height in heights:
        charge = np.cumsum(np.maximum(height * pulse - 12.0, 0.0)) * 0.02
        late.append(np.interp(min(need, 0.5 * charge[-1]), charge, time_ns))
    return 150.0 * 0.06 * np.interp(np.log(light), np.log(heights), late)


def panels(seed, need, scale=1.0, skew_mm=0.0):
    """Images of 16 by 9 pixels of panels at many distances: strong returns come from near, as everywhere."""
    rng = np.random.default_rng(seed)
    step, v, u = (
        a.ravel().astype(float) for a in np.meshgrid(np.arange(16), np.arange(9), np.arange(16), indexing="ij")
    )
    panel = (u // 4 + (v + step) // 9).astype(int) % 4
    mm = 1000.0 + 900.0 * ((3 * u + 5 * v + 7 * step) % 17) / 17.0
    light = 4000.0 * np.array([0.05, 0.18, 0.5, 0.8])[panel] / (mm / 1000.0) ** 2
    sigma = np.sqrt(36.0 + 0.25 * light)
    sigma_mm = np.hypot(4.0, 300.0 * sigma / light)
    real = mm * scale + late_mm(light, need) + skew_mm * (u - 7.5)
    return {
        "step": step, "time_s": 600.0 * step, "pixel_u": u, "pixel_v": v, "n_frames": np.full(u.size, 10.0),
        "sim_intensity_counts": light, "sim_intensity_counts_std": sigma, "sim_distance_mm": mm,
        "sim_distance_mm_std": sigma_mm, "sim_distance_mm_repeat_std": np.full(u.size, 0.2),
        "intensity_counts": light + sigma / np.sqrt(10.0) * rng.normal(size=u.size),
        "distance_mm": real + sigma_mm / np.sqrt(10.0) * rng.normal(size=u.size)
        + 0.2 * rng.normal(size=16)[step.astype(int)],
    }  # fmt: skip


def together(table, *names):
    """A search of the table, and the joint fit of the first variants of effects."""
    effects = [library()[name] for name in names]
    search = Search(columns_of(pa.table(table)), effects)
    terms = []
    for effect in effects:
        variant = next(iter(effect.variants(search.full.view)))
        start = {p.name: p.typical if p.is_amplitude else p.starts[0] for p in variant.parameters}
        terms.append(Term(effect=effect, variant=variant, values=start))
    return search, finish(search.full, fit(search.full, tuple(terms), rounds=6))


def test_what_the_shape_of_a_walk_leaves_is_no_scale():
    """Returns are near where they are strong: a scale takes up what the walk's law leaves, a real one does more."""
    for scale, mends in ((1.0, True), (1.01, False)):
        search, both = together(panels(1, 400.0, scale=scale), "timing.range_walk", "timing.clock_scale")
        assert both.terms[1].values["scale"] != 0.0
        assert mends_shape(search.full, both.terms, both.terms[0]) is mends


def test_what_the_shape_of_a_walk_leaves_is_not_held_against_a_skew():
    search, both = together(panels(2, 400.0, skew_mm=0.2), "timing.range_walk", "timing.row_skew")
    assert not is_unsteady(search.looker, both.terms, both.terms[1])


def test_a_dark_signal_is_told_from_a_gain_of_the_same_temperature_by_the_signals(make_table):
    """The gain is a breakdown voltage's, the dark current a diode's with its gap: one temperature drives both."""

    def warm(columns, dark):
        heat = columns["tof_temperature_c"] - 9.0
        share = 150.0 / (165.0 + 0.14 * (heat - 25.0))
        gain = (1.0 - (150.0 / 165.0) ** 2) / (1.0 - share**2)
        current = dark * np.exp(-0.62 / 8.617e-5 * (1.0 / (heat + 273.15) - 1.0 / 353.15))
        columns["intensity_counts"] = columns["intensity_counts"] * gain + current

    for dark, other in ((3.0, "detector.dark_offset"), (0.0, "laser.thermal_rolloff")):
        table = make_table(12, lambda columns, _rng, dark=dark: warm(columns, dark), duts=2)
        search, both = together(table, "detector.gain_temperature", other)
        assert has_own_driver(search.full, both.terms, both.terms[0]) is (dark > 0.0)


def test_a_gain_that_takes_the_shot_noise_along_is_told_from_a_rail_that_drifts_with_it(make_table):
    """Fewer photons are detected when warm, so noise follows their number; a supply sags with the temperature."""
    sigma = {}

    def warm(columns, rng):
        columns["rail_3v3_v"] = 3.3 - 5e-5 * columns["housing_temperature_c"] + 0.002 * rng.normal(size=len(sigma_of))
        columns["intensity_counts"] = columns["intensity_counts"] * (
            1.0 - 0.0017 * (columns["tof_temperature_c"] - 34.0)
        )
        sigma["real"] = np.sqrt(36.0 + 0.25 * columns["intensity_counts"])

    sigma_of = make_table(31, steps=8)["step"]
    table = make_table(31, warm, steps=8)
    rng = np.random.default_rng(3)
    table["intensity_counts_std"] = sigma["real"] * np.sqrt(rng.chisquare(9, size=len(sigma_of)) / 9.0)
    table["sim_intensity_counts_std"] = np.sqrt(36.0 + 0.25 * table["sim_intensity_counts"])
    assert named(table, "detector.gain_temperature", "electronics.rail_coupling") == {"detector.gain_temperature"}


def limited(light):
    """Charge of Gaussian pulses behind an amplifier that gives way softly (a diode's law, not the tool's)."""
    time = np.linspace(-4.0, 4.0, 401)
    pulse = np.exp(-0.5 * time**2)
    table = np.geomspace(1.0, 8000.0, 200)
    charge = [np.sum(40000.0 * np.log1p(height * pulse / 40000.0)) / np.sum(pulse) for height in table]
    return np.interp(light, table, charge)


def test_glare_is_told_from_what_the_shape_of_a_compression_leaves_by_images_of_unlike_light():
    """Glare is a curve over the signal for nine tenths: weak pixels have more, as of a law that is too steep."""
    rng = np.random.default_rng(11)
    step, v, u = (
        a.ravel().astype(float) for a in np.meshgrid(np.arange(10), np.arange(16), np.arange(20), indexing="ij")
    )
    panel = (u // 4 + v // 4 + step).astype(int) % 4
    near = np.where(u < 8.0 + 0.25 * step, 1.0, 2.0)  # a near wall comes into view
    light = 3000.0 * np.array([0.05, 0.2, 0.5, 0.9])[panel] / near**2 * (1.0 + 0.1 * np.sin(0.9 * u + 1.7 * v))
    mean = np.bincount(step.astype(int), light)[step.astype(int)] / 320.0
    sigma = np.sqrt(36.0 + 0.25 * light)
    for glare, mends in ((0.0, True), (0.004, False)):
        real = limited(light + glare * (mean - light))
        table = {
            "step": step, "pixel_u": u, "pixel_v": v, "stage_angle_deg": 5.0 * step,
            "n_frames": np.full(u.size, 40.0), "sim_intensity_counts": light,
            "sim_intensity_counts_std": sigma,
            "intensity_counts": real + sigma / np.sqrt(40.0) * rng.normal(size=u.size),
        }  # fmt: skip
        search, both = together(table, "detector.compression", "optics.veiling_glare")
        assert mends_shape(search.full, both.terms, both.terms[0]) is mends
