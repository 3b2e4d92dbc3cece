"""Pixels that leak and pixels that die, against pulses that are added up and fields that are read back."""

import numpy as np
import pytest
from rendered_bench import corrected, make_columns, variant_of

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.findings import error_of_spread
from arl_fixtures.reconcile.terms import Term
from arl_fixtures.reconcile.view import View


def table(**columns):
    """Columns only; measured channels equal their simulation where not given."""
    numbers = {name: np.asarray(values, dtype=float) for name, values in columns.items()}
    for name in [name for name in numbers if name.startswith("sim_")]:
        numbers.setdefault(name.removeprefix("sim_"), numbers[name].copy())
    return View(make_columns(numbers, {}, shuffle=None)[0])


def test_crosstalk_of_pulses_is_the_centroid_of_all_that_arrives():
    """Sampled pulses of each pixel and its neighbours are added up, and their mean time is taken."""
    rng = np.random.default_rng(4)
    share, shape = 0.03, (5, 6)
    image, range_m = rng.uniform(100.0, 2000.0, shape), rng.uniform(1.0, 1.6, shape)
    at_m = np.linspace(0.0, 3.0, 3001)
    pulses = image[..., None] * np.exp(-0.5 * ((at_m - range_m[..., None]) / 0.1) ** 2)
    padded = np.pad(pulses, ((1, 1), (1, 1), (0, 0)), mode="edge")
    around = padded[:-2, 1:-1] + padded[2:, 1:-1] + padded[1:-1, :-2] + padded[1:-1, 2:]
    arrived = pulses + share * (around - 4.0 * pulses)
    v, u = np.mgrid[0:5, 0:6]
    view = table(
        pixel_u=u.ravel(), pixel_v=v.ravel(), stage_angle_deg=np.zeros(30), sim_signal_counts=image.ravel(),
        sim_distance_m=range_m.ravel(),
    )  # fmt: skip
    state = corrected(view, variant_of(view, "detector.crosstalk", direction="both", leaks="pulse"), share=share)
    centroid = (arrived @ at_m) / arrived.sum(axis=-1)
    np.testing.assert_allclose(state["distance_m"].reshape(shape), centroid, atol=1e-6)
    np.testing.assert_allclose(state["signal_counts"].reshape(shape), arrived.sum(-1) / (0.1 * 2506.6), rtol=1e-4)


def test_a_pixel_that_died_in_one_cycle_is_dead_in_the_next():
    """A field of pixels and cycles, read back on rows of a cycle that was not in the table."""
    pixel, cycle = (a.ravel() for a in np.meshgrid(np.arange(4), np.arange(1, 5)))
    view = table(
        pixel_u=pixel, cycle=cycle, stage_angle_deg=pixel, sim_signal_counts=np.full(16, 500.0),
        sim_valid_fraction=np.ones(16),
    )  # fmt: skip
    variant = variant_of(view, "detector.dead_pixels", since="cycle")
    per = variant.parameters[0].per
    key = tuple({"cycle": "3", "pixel_u": "2"}[name] for name in per if name != "dut")
    if "dut" in per:
        key = (key[0], "", *key[1:])
    term = Term(effect=library()[variant.effect], variant=variant, values={}, fields={"dead": {key: 1.0}})
    state = term.apply(view.fresh_state(), view)
    gone = (pixel == 2) & (cycle >= 3)
    np.testing.assert_array_equal(state["valid_fraction"], np.where(gone, 0.0, 1.0))
    np.testing.assert_array_equal(state["signal_counts"], np.where(gone, 0.0, 500.0))


def test_a_pixel_that_died_at_a_step_is_dead_in_later_steps_and_cycles_and_was_not_before():
    """Read back on a table with steps and cycles that the one it was found on did not have."""
    pixel, step, cycle = (a.ravel() for a in np.meshgrid(np.arange(4), np.arange(5), np.arange(1, 4)))
    n = pixel.size
    view = table(
        pixel_u=pixel, step=step, cycle=cycle, stage_angle_deg=pixel, sim_signal_counts=np.full(n, 500.0),
        sim_valid_fraction=np.ones(n),
    )  # fmt: skip
    variant = variant_of(view, "detector.dead_pixels", since="step")
    per = variant.parameters[0].per
    assert per[:2] == ("cycle", "step")
    key = tuple({"cycle": "2", "step": "3", "pixel_u": "1"}.get(name, "") for name in per)
    term = Term(effect=library()[variant.effect], variant=variant, values={}, fields={"dead": {key: 1.0}})
    state = term.apply(view.fresh_state(), view)
    gone = (pixel == 1) & ((cycle == 3) | ((cycle == 2) & (step >= 3)))
    np.testing.assert_array_equal(state["valid_fraction"], np.where(gone, 0.0, 1.0))


@pytest.mark.parametrize("tails", [6, 100])
def test_the_interval_of_a_spread_covers_that_of_all_pixels_also_with_heavy_tails(tails):
    rng = np.random.default_rng(tails)
    true = np.sqrt(tails / (tails - 2.0))
    covered = []
    for _ in range(600):
        gains = rng.standard_t(tails, size=160)
        size = float(np.std(gains))
        covered.append(abs(size - true) < 1.96 * size * error_of_spread(gains))
    assert 0.90 < np.mean(covered) < 0.98
