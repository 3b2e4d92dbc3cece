"""Stale frames in sweeps of which whole angles are held out, and in sweeps whose stops are numbered as steps."""

import numpy as np
import pytest
from traced_bench import LIGHT, RANGE, trace

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.columns import Columns, find_channels
from arl_fixtures.reconcile.reconcile import diagnose

ANGLES = np.array([-13.7, -11.9, -9.1, -7.4, -5.2, -3.6, -1.4, 0.8, 2.9, 4.4, 7.5, 9.9, 11.7, 13.9])
NAMES = ("acquisition.frame_lag", "detector.crosstalk", "optics.defocus", "stage.zero_offset", "timing.clock_scale")


def swept(*, share, held_out=(), drawn=1.0, stops=False, seed=6, angles=ANGLES, stride=None):
    """A block of pixels over an uneven sweep; a share of every average still shows the angle before.

    With `stride` that is the one before in a whole sweep, of which the table has some angles only. Of its rows a
    share is `drawn`.
    """
    rng = np.random.default_rng(seed)
    step, place, v, u = (
        a.ravel()
        for a in np.meshgrid(
            np.arange(2), np.arange(len(angles)), np.arange(4.0, 28.0, 8.0), np.arange(57.0, 71.0), indexing="ij"
        )
    )  # fmt: skip
    stage, before = angles[place], angles[np.maximum(place - 1, 0)]
    if stride is not None:
        before = stage - stride
    far_scene = {"fx": 58.1}
    light, far = trace(u, v, stage, 0.10, **far_scene)
    old_light, old_far = trace(u, v, before, 0.10, **far_scene)
    beam = 4840.0
    sim, error = beam * light, np.sqrt(36.0 + 0.25 * beam * light)
    blur = np.hypot(0.004, 0.30 * error / sim)
    numbers = {
        "stage_angle_deg": stage, "pixel_u": u, "pixel_v": v, "n_frames": np.full(u.size, 10.0),
        "step": step * 20.0 + place if stops else step, "time_s": 2000.0 * step + 30.0 * place,
        "housing_temperature_c": 20.0 + 30.0 * step + 0.1 * place,
        f"sim_{LIGHT}": sim, f"sim_{LIGHT}_std": error, f"sim_{RANGE}": far, f"sim_{RANGE}_std": blur,
        LIGHT: sim + share * beam * (old_light - light) + error / np.sqrt(10.0) * rng.normal(size=u.size),
        RANGE: far + share * (old_far - far) + blur / np.sqrt(10.0) * rng.normal(size=u.size),
    }  # fmt: skip
    kept = ~np.isin(place, held_out) & (np.random.default_rng(seed + 1).random(u.size) < drawn)
    numbers = {name: np.asarray(values, dtype=float)[kept] for name, values in numbers.items()}
    return Columns(
        n=int(kept.sum()), numbers=numbers, categories={"dut": (np.zeros(int(kept.sum()), dtype=np.int64), ("a",))},
        channels=find_channels(set(numbers)),
    )  # fmt: skip


@pytest.mark.parametrize(
    "how", [{"held_out": (2, 4, 7, 11)}, {"held_out": (3, 8, 9), "stops": True}],
    ids=["angles held out", "stops numbered, too"],
)  # fmt: skip
def test_a_lag_is_found_though_the_position_before_is_missing(how):
    found = diagnose(swept(share=0.03, **how), effects=[library()[name] for name in NAMES])[0].findings
    assert [f.effect for f in found] == ["acquisition.frame_lag"]
    (share,) = (p for p in found[0].parameters if p.name == "share")
    assert share.value == pytest.approx(0.03, abs=0.006)


def test_a_lag_is_found_among_rows_that_were_drawn_by_chance():
    """Of many rows the last one of the same ray lies far back, over holes or not: others tell where the stage was."""
    angles = np.arange(-14.0, 14.1, 2.0)
    made = swept(share=0.2, held_out=(2, 5, 6, 8, 10, 11), drawn=0.3, angles=angles)
    found = diagnose(made, effects=[library()[name] for name in NAMES])[0].findings
    assert [f.effect for f in found] == ["acquisition.frame_lag"]
    (share,) = (p for p in found[0].parameters if p.name == "share")
    assert share.value == pytest.approx(0.2, abs=0.01)


@pytest.mark.parametrize("stride", [0.9, -0.9])
def test_a_lag_by_a_stride_of_a_sweep_that_was_thinned_is_one(stride):
    """Every frame of the sweep was late; angles were drawn from it as they came, or as it went back."""
    drawn = np.array([-14.4, -13.5, -10.8, -9.0, -6.3, -5.4, -1.8, 2.7, 3.6, 6.3, 9.9, 11.7, 14.4])
    made = swept(share=0.05, angles=drawn[:: int(np.sign(stride))], stride=stride)
    found = diagnose(made, effects=[library()[name] for name in NAMES])[0].findings
    assert [f.effect for f in found] == ["acquisition.frame_lag"]
    (share,) = (p for p in found[0].parameters if p.name == "share")
    assert share.value == pytest.approx(0.05, abs=0.01)
