"""What steps share hides neither a law nor a supply, and is no mere scatter where it has a cause."""

import numpy as np
import pytest

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.law_search import search_law
from arl_fixtures.reconcile.patterns import shared_part
from arl_fixtures.reconcile.pilot import Looker
from arl_fixtures.reconcile.problem import Problem
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.search import Search
from arl_fixtures.reconcile.shared_scatter import find_scatter
from arl_fixtures.reconcile.table import load_table

OF_STEPS = (
    "bench.repeatability", "detector.gain_temperature", "laser.power_decay", "laser.pulse_energy_jitter",
    "laser.thermal_rolloff", "optics.filter_shift", "optics.window_frost", "thermal.sensor_offset",
)  # fmt: skip
"""Effects that make the light of whole steps differ."""
OF_PIXELS = (
    "beam.profile_change", "beam.profile_shift", "detector.crosstalk", "detector.dark_offset",
    "detector.pixel_response", "optics.veiling_glare", "optics.vignetting", "optics.window_contamination",
)  # fmt: skip
"""Effects that make the light of pixels differ."""


def named(*effects):
    return [library()[name] for name in effects]


@pytest.fixture
def columns_of(tmp_path, make_table, save):
    def make(seed, change=None, **size):
        return load_table(save(tmp_path / f"{seed}.parquet", make_table(seed, change, **size)))

    return make


def looked_at(columns, channel):
    looker = Looker(Problem(columns))
    state = looker.problem.view.fresh_state()
    for each in looker.problem.data:
        looker.calibrate(each, state)
    return looker, next(d for d in looker.problem.data if d.channel.name == channel), state


def kinked_table(columns, _rng):
    """Offsets that a firmware holds for every 15 kelvin, with straight lines between them."""
    knots = np.arange(-20.0, 120.0, 15.0)
    offsets = np.array([0.0, 4.0, -3.0, 5.0, -4.0, 2.0, -5.0, 3.0, -1.0, 2.0]) * 1e-3
    columns["distance_m"] = columns["distance_m"] + np.interp(columns["tof_temperature_c"], knots, offsets)


def test_a_law_of_many_kinks_does_not_pass_for_scatter_between_steps(columns_of):
    looker, data, state = looked_at(columns_of(51, kinked_table, steps=24, duts=1), "distance_m")
    assert data.tau["step"] > 3.0  # in declared repeatabilities: this is where it hides
    law, chosen = search_law(looker, data, state, [])
    assert law.drivers[0] in {"tof_temperature_c", "housing_temperature_c"}
    assert chosen.likelier > 12.0
    corrected = state["distance_m"] + law.correction(looker.features, state["distance_m"])
    after, tau = data.fit_scatter(data.measured - corrected[data.use])
    assert tau["step"] < 2.0
    assert after > data.fit_scatter(data.residual(state))[0]


def shaken(columns, rng):
    key = (columns["step"] + 100 * (columns["dut"] == "S1")).astype(int)
    columns["distance_m"] = columns["distance_m"] + rng.normal(0.0, 2e-3, 200)[key]


def bent(columns, _rng):
    columns["distance_m"] = columns["distance_m"] + 3e-3 * ((columns["housing_temperature_c"] - 35.0) / 40.0) ** 2


def scatters_of(columns):
    looker, _, state = looked_at(columns, "distance_m")
    return [s for s in find_scatter(looker.problem, list(library().values()), state) if s.channel == "distance_m"]


def test_scatter_between_steps_is_told_from_what_follows_a_temperature(columns_of):
    (blind,) = [s for s in scatters_of(columns_of(52, shaken, steps=24)) if s.level == "step"]
    assert blind.driver == ""
    assert blind.value == pytest.approx(2e-3, rel=0.4)
    caused = [s for s in scatters_of(columns_of(53, bent, steps=24)) if s.level == "step"]
    assert [s.driver.endswith("_c") for s in caused] == [True]


def test_images_do_not_seem_to_differ_where_only_steps_do(columns_of):
    """Bright images know a step's error better than dark ones: none may keep another share of it."""

    def off(columns, rng):
        columns["intensity_counts"] = (
            columns["intensity_counts"] * (1.0 + 0.1 * rng.normal(size=5))[columns["step"].astype(int)]
        )
        bright = 1.0 + 9.0 * (columns["stage_angle_deg"] > 0.0)
        for name in ("sim_intensity_counts_std", "sim_distance_m_std"):
            columns[name] = columns[name] * bright
        del columns["sim_intensity_counts_repeat_std"]

    looker, data, state = looked_at(columns_of(56, off, duts=1, steps=5), "intensity_counts")
    data.rebuild({**data.tau, "frame": 5e-3})
    left = data.residual(state) - shared_part(data, data.residual(state))
    image = looker.problem.columns.group("step", "stage_angle_deg")[data.use]
    weight = data.root_weight**2 * data.scale
    mean = np.bincount(image, weight * left) / np.sqrt(np.bincount(image, weight * data.scale))
    assert np.max(np.abs(mean)) < 4.0


def test_a_supply_is_seen_although_its_readings_hardly_scatter(columns_of):
    """The readings' noise is a tenth of the swing: within steps it outweighs what the steps say."""

    def sagging(columns, rng):
        key = (columns["step"] + 100 * (columns["dut"] == "S1")).astype(int)
        sag = rng.normal(0.0, 0.02, 200)[key]
        columns["rail_5v0_v"] = 5.0 + sag + rng.normal(0.0, 2e-3, len(key))
        columns["intensity_counts"] = columns["intensity_counts"] * ((5.0 + sag) / 5.0) ** 3

    found = Search(columns_of(54, sagging, steps=20), named(*OF_STEPS, "electronics.rail_coupling")).run()
    assert [t.effect.id for t in found.best.terms] == ["electronics.rail_coupling"]


def test_outliers_of_a_large_table_do_not_pass_for_errors_of_whole_images(columns_of):
    def wild(columns, rng):
        n = len(columns["pixel_u"])
        noise = columns["sim_distance_m_std"] / np.sqrt(columns["n_frames"])
        hit = rng.random(n) < 0.1
        columns["distance_m"] = columns["distance_m"] + hit * 6.0 * noise * rng.normal(size=n)

    columns = columns_of(55, wild, duts=4, steps=60)
    assert columns.n > 12_000  # more rows than the first look samples
    assert scatters_of(columns) == []


@pytest.mark.parametrize("seed", [5, 6, 7])
def test_bright_rows_that_scatter_more_than_stated_are_no_errors_of_their_images(columns_of, seed):
    """The brightest stripe decides what an image is off by; its rows, alone, scatter by 1.8 times what is stated."""

    def unstated(columns, rng):
        noise = columns["sim_distance_m_std"] / np.sqrt(columns["n_frames"])
        bright = columns["surface"] == "stripe_80"
        columns["distance_m"] = columns["distance_m"] + 1.5 * noise * bright * rng.normal(size=len(noise))

    assert scatters_of(columns_of(seed, unstated, duts=3, steps=20)) == []


def test_a_pattern_is_found_at_whichever_period_it_has(columns_of):
    def comb(columns, _rng):
        columns["intensity_counts"] = columns["intensity_counts"] * (
            1.0 + 0.004 * np.sign(np.sin(2.0 * np.pi * (columns["pixel_u"] + 0.5) / 6.0))
        )

    found = Search(columns_of(56, comb, steps=20), named(*OF_PIXELS, "readout.column_pattern")).run()
    (term,) = found.best.terms
    assert term.effect.id == "readout.column_pattern"
    # a square comb is what six converters that read in turn make, three of each kind
    assert term.variant.options.get("converters", term.values.get("period")) == pytest.approx(6.0, rel=0.01)


def test_one_step_that_is_off_is_no_law_of_its_temperature(columns_of):
    """The warmest of nine steps is darker: a knee above the others would say no more than that."""

    def darker(columns, rng):
        means = np.bincount(columns["step"].astype(int), columns["housing_temperature_c"])
        columns["intensity_counts"] *= np.where(columns["step"] == np.argmax(means), 0.9, 1.0)
        for name in [n for n in columns if n.endswith("repeat_std")]:
            del columns[name]

    diagnosis, _, _ = diagnose(columns_of(4, darker, steps=9, duts=1), effects=named(*OF_STEPS))
    assert "laser.thermal_rolloff" not in [f.effect for f in diagnosis.findings]


def test_images_that_scatter_by_a_share_of_their_light_show_it_where_it_is_strong(columns_of):
    """Half of the pixels look at dark surfaces, where a few permille are a twentieth of the noise."""

    def flicker(columns, rng):
        image = np.unique(np.column_stack([columns["step"], columns["stage_angle_deg"], columns["dut"] == "S1"]),
                          axis=0, return_inverse=True)[1].ravel()  # fmt: skip
        columns["intensity_counts"] *= 1.0 + 0.0022 * rng.normal(size=image.max() + 1)[image]

    known = [library()[n] for n in ("bench.repeatability", "laser.pulse_energy_jitter", "laser.power_decay")]
    findings = diagnose(columns_of(91, flicker), effects=known)[0].findings
    assert [f.effect for f in findings] == ["bench.repeatability"]
    assert not diagnose(columns_of(92), effects=known)[0].findings


@pytest.mark.parametrize("seed", [1, 4])
def test_a_dark_level_found_anew_at_every_step_is_no_law_of_the_room(tmp_path, save, seed):
    """The clamp of a row of converters settles elsewhere at each step: as many counts to dark and bright pixels."""
    rng = np.random.default_rng(seed)
    step, angle, pixel = (a.ravel() for a in np.meshgrid(np.arange(14), np.arange(8), np.arange(40), indexing="ij"))
    board = (pixel + 3 * angle) % 5
    light = np.array([60.0, 150.0, 420.0, 1100.0, 2600.0])[board] * (1.0 + 0.003 * pixel)
    noise = np.sqrt(40.0 + 0.25 * light + (0.004 * light) ** 2)
    clamped = 1.6 * rng.normal(size=14)
    room = 22.0 + np.cumsum(rng.normal(0.0, 0.2, 14))
    made = {
        "step": step, "time_s": 720.0 * step + 20.0 * angle, "stage_angle_deg": 4.0 * angle, "pixel_u": 3 * pixel,
        "surface": np.array(["felt", "grey", "card", "paper", "white"])[board],
        "set_temperature_c": np.where(step < 7, -10.0 + 15.0 * step, 85.0 - 15.0 * (step - 7)),
        "ambient_temperature_c": room[step], "humidity_pct": rng.uniform(20.0, 60.0, 14)[step],
        "rail_1v8_v": 1.8 + 0.002 * rng.normal(size=step.size), "n_frames": np.full(step.size, 10.0),
        "sim_intensity_counts": light, "sim_intensity_counts_std": noise,
        "intensity_counts": light + clamped[step] + noise / np.sqrt(10.0) * rng.normal(size=step.size),
    }  # fmt: skip
    assert not diagnose(load_table(save(tmp_path / "table.parquet", made)))[0].findings
