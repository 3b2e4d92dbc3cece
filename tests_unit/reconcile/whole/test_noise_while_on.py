"""A lamp that is on for a part of a run adds its shot noise: the scatter follows its switch, whatever its name."""

import numpy as np
import pyarrow as pa
import pytest

from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of

FRAMES = 40


def lit(seed, photons, switch, told=bool):
    """Static target for hours; the scatter of each record is that of its own frames, photon by photon."""
    rng = np.random.default_rng(seed)
    n = 640
    time = np.arange(n) * 12.0
    on = (time // 960.0) % 2 == 1
    temperature = 25.0 + 3.0 * (1.0 - np.exp(-time / 3000.0)) + rng.normal(0.0, 0.05, n)
    frames = 900.0 + 30.0 * rng.normal(size=(n, FRAMES))
    drawn = rng.poisson(photons, (n, FRAMES)) - photons  # the mean of what the lamp adds is taken away as background
    frames = frames + np.where(on[:, None], drawn, 0.0)
    return columns_of(pa.table({
        "time_s": time, "housing_temperature_c": temperature, "true_range_m": np.full(n, 1.2),
        switch: on.astype(told).tolist(),
        "n_frames": np.full(n, float(FRAMES)), "sim_signal_counts": np.full(n, 900.0),
        "sim_signal_counts_std": np.full(n, 30.0), "signal_counts": frames.mean(axis=1),
        "signal_counts_std": frames.std(axis=1, ddof=1),
    }))  # fmt: skip


@pytest.mark.parametrize(("switch", "told", "on"), [("lamp_on", bool, ["true"]), ("shutter", float, [1.0, 1.0])])
def test_a_lamp_s_shot_noise_is_found_while_it_is_on(switch, told, on):
    (finding,) = diagnose(lit(1, 90.0, switch, told))[0].findings
    assert finding.effect == "readout.noise_excess"
    assert finding.drivers == [switch]
    assert finding.where[switch] == on


def test_a_lamp_that_adds_no_photons_is_no_finding():
    assert not diagnose(lit(2, 0.0, "lamp_on"))[0].findings


def test_scatter_under_one_of_three_named_conditions_is_found_there():
    made = lit(3, 0.0, "lamp_on")
    rng = np.random.default_rng(3)
    blower = np.array(["off", "low", "high"])[np.arange(made.n) // 40 % 3]
    numbers = made.numbers["signal_counts_std"]
    numbers *= np.where(blower == "high", np.sqrt(1.0 + 0.25 * rng.chisquare(40, made.n) / 40.0), 1.0)
    table = pa.table({
        "time_s": made.numbers["time_s"], "blower": blower, "n_frames": made.numbers["n_frames"],
        **{n: made.numbers[n] for n in made.numbers if "signal" in n},
    })  # fmt: skip
    (finding,) = diagnose(columns_of(table))[0].findings
    assert finding.effect == "readout.noise_excess"
    assert finding.where["blower"] == ["high"]


def test_a_beat_that_jitters_beyond_the_laser_s_coherence_is_more_noise_there():
    rng = np.random.default_rng(4)
    away = rng.uniform(2.0, 60.0, 900)
    late = np.maximum(away - 30.0, 0.0) / 30.0  # phase noise of the delay beyond the reference arm's
    frames = rng.normal(size=(900, FRAMES)) + late[:, None] * 0.6 * rng.normal(size=(900, FRAMES))
    made = columns_of(pa.table({
        "step": np.arange(900) // 90, "true_range_m": away, "humidity_pct": rng.uniform(30.0, 60.0, 900),
        "n_frames": np.full(900, float(FRAMES)), "sim_distance_m": away, "sim_distance_m_std": np.full(900, 1e-3),
        "distance_m": away + 1e-3 * frames.mean(axis=1), "distance_m_std": 1e-3 * frames.std(axis=1, ddof=1),
    }))  # fmt: skip
    (finding,) = diagnose(made)[0].findings
    assert finding.effect == "readout.noise_excess"
    assert finding.drivers == ["true_range_m"]
    assert 15.0 < finding.where["true_range_m"][0] < 45.0


def test_daylight_s_shot_noise_is_found_though_its_column_is_no_temperature_of_the_bench():
    rng = np.random.default_rng(12)
    klux = rng.choice([0.0, 5.0, 20.0, 45.0, 70.0, 90.0], 60)[np.arange(1200) // 20]
    photons = rng.poisson(klux[:, None], (1200, 24)) - klux[:, None]
    frames = 1e-3 * rng.normal(size=(1200, 24)) + 7.5e-5 * photons
    made = columns_of(pa.table({
        "step": np.arange(1200) // 20, "ambient_klux": klux, "housing_temperature_c": rng.uniform(20.0, 40.0, 1200),
        "n_frames": np.full(1200, 24.0), "sim_distance_m": np.full(1200, 1.0),
        "sim_distance_m_std": np.full(1200, 1e-3),
        "distance_m": 1.0 + frames.mean(axis=1), "distance_m_std": frames.std(axis=1, ddof=1),
    }))  # fmt: skip
    (finding,) = diagnose(made)[0].findings
    assert finding.effect == "readout.noise_excess"
    assert finding.drivers == ["ambient_klux"]


def test_an_avalanche_s_excess_noise_is_found_at_the_bias_that_was_set():
    """Electrons that multiply by chance: a gain of each that grows from a few to many near breakdown."""
    rng = np.random.default_rng(7)
    bias = np.array([90.0, 110.0, 125.0])[np.arange(720) // 8 % 3]
    spread = np.where(bias > 120.0, 1.2, 0.0)  # of a single electron's gain about its mean
    electrons = rng.poisson(400.0, (720, FRAMES))
    frames = electrons + spread[:, None] * np.sqrt(electrons) * rng.normal(size=(720, FRAMES))
    made = columns_of(pa.table({
        "step": np.arange(720) // 60, "bias_v": bias, "housing_temperature_c": rng.uniform(-5.0, 70.0, 720),
        "n_frames": np.full(720, float(FRAMES)), "sim_signal_counts": np.full(720, 400.0),
        "sim_signal_counts_std": np.full(720, 20.0),
        "signal_counts": frames.mean(axis=1), "signal_counts_std": frames.std(axis=1, ddof=1),
    }))  # fmt: skip
    (finding,) = diagnose(made)[0].findings
    assert finding.effect == "readout.noise_excess"
    assert finding.where["bias_v"] == [125.0, 125.0]
