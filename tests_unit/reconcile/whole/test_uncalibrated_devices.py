"""Three devices against one nominal simulation, none calibrated: a gain and a zero each, in light and in range."""

import numpy as np
import pytest

from arl_fixtures.reconcile.calibrated_units import calibrate_simulation
from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.columns import Columns, find_channels
from arl_fixtures.reconcile.model_state import corrected_state, terms_of
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.search import Search
from arl_fixtures.reconcile.view import View

LIGHT, RANGE = "signal_counts", "distance_m"
SPEED_M_S = 299_792_458.0
GAINS, ZEROS = (0.012, -0.035, 0.028), (-7.0, 9.0, 3.0)
SCALES, OFFSETS_M = (0.0011, -0.0036, 0.0027), (0.0042, -0.0011, 0.0013)
TEMPERATURES_C = (-20.0, 5.0, 25.0, 45.0, 65.0, 85.0, 30.0, 0.0)


def crossing_s(temperature_c, slower):
    """When an amplifier's answer to a step, sampled every 20 ps, crosses its half; its pole slows with heat."""
    time = np.arange(0.0, 8e-9, 2e-11)
    tau = 1.2e-9 * (1.0 + slower * (temperature_c - 25.0))
    return np.interp(0.5, 1.0 - np.exp(-time / tau), time)


def table(*, slower=0.0, calibrated=False, gains=GAINS, zeros=ZEROS, scales=SCALES, offsets_m=OFFSETS_M, seed=5):
    rng = np.random.default_rng(seed)
    step, dut, board = (
        axis.ravel()
        for axis in np.meshgrid(np.arange(len(TEMPERATURES_C)), np.arange(3), np.arange(60), indexing="ij")
    )
    true_m = np.random.default_rng(1).uniform(0.6, 6.0, 60)[board]
    reflectance = np.random.default_rng(2).choice([0.1, 0.3, 0.6, 0.9], 60)[board]
    temperature = np.array(TEMPERATURES_C)[step] + rng.normal(0.0, 0.2, step.size)
    light = 900.0 * reflectance / np.maximum(true_m, 1.0) ** 0.5
    delay = np.array([crossing_s(x, slower) for x in temperature]) - crossing_s(25.0, slower)
    own = [np.zeros(step.size) if calibrated else np.array(x)[dut] for x in (gains, zeros, scales, offsets_m)]
    noise, blur = np.sqrt(25.0 + light), np.full(step.size, 0.012)
    numbers = {
        "step": step, "time_s": 1800.0 * step + 2.0 * board, "tof_temperature_c": temperature, "true_range_m": true_m,
        "reflectance": reflectance, "n_frames": np.full(step.size, 10.0),
        f"sim_{LIGHT}": light, f"sim_{LIGHT}_std": noise, f"sim_{RANGE}": true_m, f"sim_{RANGE}_std": blur,
        LIGHT: (1.0 + own[0]) * light + own[1] + rng.normal(0.0, noise / np.sqrt(10.0)),
        RANGE: (1.0 + own[2]) * (true_m + 0.5 * SPEED_M_S * delay) + own[3] + rng.normal(0.0, blur / np.sqrt(10.0)),
    }  # fmt: skip
    numbers = {name: np.asarray(values, dtype=float) for name, values in numbers.items()}
    return Columns(
        n=step.size, numbers=numbers, categories={"dut": (dut.astype(np.int64), ("a", "b", "c"))},
        channels=find_channels(set(numbers)),
    )  # fmt: skip


NAMES = (
    "timing.temperature_offset", "timing.clock_scale", "detector.dark_offset", "optics.veiling_glare",
    "air.multipath", "detector.compression", "target.reflectance_error",
)  # fmt: skip


def told(columns):
    return diagnose(columns, effects=[library()[name] for name in NAMES])


def test_what_hides_behind_their_constants_is_named_alone_and_foretells_their_next_readings(tmp_path):
    diagnosis, model, _ = told(table(slower=6e-4))
    assert [f.effect for f in diagnosis.findings] == ["timing.temperature_offset"]
    unseen = table(slower=6e-4, seed=6)
    calibrate_simulation(unseen, tuple(model.unit_columns), model.lines)
    view = View(unseen)
    state = corrected_state(model, terms_of(model, view, tmp_path), view)
    for name in (LIGHT, RANGE):
        error = unseen.numbers[f"sim_{name}_std"] / np.sqrt(10.0)
        left = (unseen.numbers[name] - state[name]) / error
        assert np.mean(left**2) < 1.1, name


def test_constants_alone_get_no_name_but_a_calibration_that_bears_their_values():
    diagnosis, model, _ = told(table())
    assert {f.effect for f in diagnosis.findings} == {"unknown"}
    assert all(f.drivers == ["dut"] for f in diagnosis.findings)
    for name, gains, zeros in ((LIGHT, GAINS, ZEROS), (RANGE, SCALES, OFFSETS_M)):
        finding = next(f for f in diagnosis.findings if f.channels == [name])
        values = {p.name: p for p in finding.parameters}
        for k, (gain, zero) in enumerate(zip(gains, zeros, strict=True)):
            for word, truth in (("gain", gain), ("zero", zero)):
                p = values[f"{word}_{k + 1}"]
                assert abs(p.value - truth) < 1.7 * (p.high - p.low) / 2.0
    assert set(model.lines[LIGHT]) == {"a", "b", "c"}


@pytest.mark.parametrize(
    "same",
    [
        {"zeros": (8.0, 8.0, 8.0)},
        {"gains": (0.0, 0.0, 0.0)},
        {"scales": (0.002, 0.002, 0.002), "offsets_m": (0.0, 0.0, 0.0)},
        {"zeros": (0.0, 9.0, 0.0)},
    ],
)
def test_what_devices_share_or_one_has_alone_is_no_calibration(same):
    assert Search(table(**same), []).lines == {}


def test_calibrated_devices_stay_consistent():
    diagnosis, model, _ = told(table(calibrated=True))
    assert diagnosis.verdict == "consistent"
    assert model.lines == {}
