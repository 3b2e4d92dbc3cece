"""Bits whose weights are off: frames are converted one by one, and what their mean shows is told by the bit."""

import json

import numpy as np
import pyarrow.parquet as pq
import pytest

from arl_fixtures.reconcile.command import predict, reconcile
from arl_fixtures.reconcile.converter_bits import is_set

FRAMES = 25


def converted(light, sigma, rng, errors):
    """Mean of frames that a converter by successive approximation digitises with weights that are off."""
    frames = light[:, None] + sigma[:, None] * rng.normal(size=(light.size, FRAMES))
    rest, read = np.maximum(np.round(frames), 0.0), np.zeros(frames.shape)
    for bit in range(12, -1, -1):
        there = rest >= 2.0**bit
        rest, read = rest - there * 2.0**bit, read + there * (2.0**bit + errors.get(bit, 0.0))
    return read.mean(axis=1)


def table(seed, steps, errors):
    rng = np.random.default_rng(seed)
    step = np.repeat(np.arange(steps), 240)
    light = rng.uniform(150.0, 3900.0, step.size)
    sigma = np.sqrt(36.0 + 0.25 * light)
    gain = 1.0 + 2e-4 * rng.normal(size=steps)[step]
    made = {
        "step": step.astype(float), "housing_temperature_c": -20.0 + 6.0 * step,
        "n_frames": np.full(step.size, FRAMES), "sim_intensity_counts": light,
        "sim_intensity_counts_std": sigma, "sim_intensity_counts_repeat_std": 2e-4 * light,
        "intensity_counts": converted(light * gain, sigma, rng, errors),
    }  # fmt: skip
    return made, converted(np.repeat(light, 40), np.repeat(sigma, 40), rng, errors).reshape(-1, 40).mean(axis=1)


@pytest.mark.parametrize("errors", [{10: 4.0}, {11: -5.0, 9: 2.5}])
def test_a_bit_that_is_off_is_told_by_its_weight_and_foretold(save, tmp_path, errors):
    seen, unseen, truth = table(1, 14, errors)[0], *table(2, 3, errors)
    reconcile(save(tmp_path / "t.parquet", seen), tmp_path / "out")
    (finding,) = json.loads((tmp_path / "out" / "diagnosis.json").read_text())["findings"]
    assert finding["effect"] == "unknown"
    assert finding["drivers"] == ["sim_intensity_counts"]
    assert f"[bit {2 ** max(errors)} of sim_intensity_counts]" in finding["law"]["expression"]
    simulated = {name: values for name, values in unseen.items() if name != "intensity_counts"}
    predict(tmp_path / "out", save(tmp_path / "u.parquet", simulated), tmp_path / "p.parquet")
    said = pq.read_table(tmp_path / "p.parquet")["corrected_intensity_counts"].to_numpy()
    left, before = (float(np.sum((x - truth) ** 2)) for x in (said, unseen["sim_intensity_counts"]))
    assert 1.0 - left / before > 0.8


def test_frames_that_scatter_over_a_carry_have_the_bit_set_in_a_part_of_them():
    rng = np.random.default_rng(3)
    for code in (1000.0, 1024.0, 1100.0, 1530.0, 2047.0):
        frames = np.round(code + 40.0 * rng.normal(size=200_000)).astype(int)
        for scatter in ((1600.0, 0.0), (0.0, 1600.0 / code)):
            assert is_set(np.array([code]), 512.0, scatter)[0] == pytest.approx(np.mean((frames >> 9) & 1), abs=0.01)


@pytest.mark.parametrize(
    ("seed", "cold"),
    [(7, "housing_temperature_c"), (12, "step")],  # the last two steps are the coldest ones
)
def test_a_bit_that_is_off_in_the_cold_is_told_with_it_and_not_by_what_steps_share(save, tmp_path, seed, cold):
    def of_cold(seed, cycles, cycle):
        """Frames in which a line of one bit contacts the less often the colder it is, of steps that scatter."""
        rng = np.random.default_rng(seed)
        step = np.repeat(np.arange(16 * cycles), 150)
        celsius = np.array([20, -5, 5, 15, 30, 50, 65, 85, 70, 57, 45, 30, 17, 3, -10, -25] * cycles)[step] + 0.0
        light = np.exp(rng.uniform(np.log(90.0), np.log(3200.0), step.size))
        sigma = np.sqrt(30.0 + 0.3 * light)
        gain = 1.0 + 3.4e-3 * rng.normal(size=16 * cycles)[step]
        open_line = 0.15 / (1.0 + np.exp((celsius + 5.0) / 2.0))
        frames = np.round((light * gain)[:, None] + sigma[:, None] * rng.normal(size=(step.size, FRAMES)))
        pulled_up = (rng.random(frames.shape) < open_line[:, None]) & (frames.astype(int) & 64 == 0)
        steady = np.round(light[:, None] + sigma[:, None] * rng.normal(size=(step.size, 400)))
        truth = light + 64.0 * open_line * np.mean(steady.astype(int) & 64 == 0, axis=1)
        return {
            "cycle": (cycle + step // 16).astype(float), "step": (step % 16).astype(float),
            "housing_temperature_c": celsius, "n_frames": np.full(step.size, FRAMES),
            "sim_intensity_counts": light, "sim_intensity_counts_std": sigma,
            "intensity_counts": (frames + 64.0 * pulled_up).mean(axis=1),
        }, truth  # fmt: skip

    seen, (unseen, truth) = of_cold(seed, 2, 1)[0], of_cold(seed + 1, 1, 3)
    reconcile(save(tmp_path / "t.parquet", seen), tmp_path / "out")
    (finding,) = json.loads((tmp_path / "out" / "diagnosis.json").read_text())["findings"]
    assert finding["effect"] == "unknown"
    assert set(finding["drivers"]) == {"sim_intensity_counts", cold}
    assert "[bit 64 of sim_intensity_counts]" in finding["law"]["expression"]
    simulated = {name: values for name, values in unseen.items() if name != "intensity_counts"}
    predict(tmp_path / "out", save(tmp_path / "u.parquet", simulated), tmp_path / "p.parquet")
    said = pq.read_table(tmp_path / "p.parquet")["corrected_intensity_counts"].to_numpy()
    noise = unseen["sim_intensity_counts_std"]
    left, before = (float(np.sum(((x - truth) / noise) ** 2)) for x in (said, unseen["sim_intensity_counts"]))
    assert 1.0 - left / before > 0.75
