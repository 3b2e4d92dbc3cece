"""Images of a camera that no stage turns: told apart by time or by the lamp, and each with an error of its own."""

import numpy as np
import pyarrow as pa
import pytest

from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of
from arl_fixtures.reconcile.view import View

LEVELS = np.array([0.1, 0.3, 0.6, 0.9])


def camera(seed: int, *, steps: int, shared: float, clock: bool = True) -> dict[str, np.ndarray]:
    """A lamp of four levels, set anew for every image and a little off each time."""
    rng = np.random.default_rng(seed)
    step, lamp, v, u = (
        a.ravel().astype(float)
        for a in np.meshgrid(np.arange(steps), np.arange(4), np.arange(10), np.arange(12), indexing="ij")
    )
    image = (4 * step + lamp).astype(int)
    light = 4000.0 * LEVELS[lamp.astype(int)]
    sigma = np.sqrt(20.0 + 0.3 * light)
    off = shared * rng.normal(size=4 * steps)[image]
    made = {
        "step": step, "lamp_level": LEVELS[lamp.astype(int)], "pixel_u": u, "pixel_v": v,
        "housing_temperature_c": -10.0 + 95.0 * step / (steps - 1), "n_frames": np.full(u.size, 16.0),
        "sim_intensity_counts": light, "sim_intensity_counts_std": sigma,
        "intensity_counts": light * (1.0 + off) + sigma / 4.0 * rng.normal(size=u.size),
    }  # fmt: skip
    if clock:
        made["time_s"] = 900.0 * step + 60.0 * lamp
    return made


@pytest.mark.parametrize("clock", [True, False])
def test_a_neighbour_is_one_of_the_same_image(clock):
    table = columns_of(pa.table(camera(1, steps=5, shared=0.0, clock=clock)))
    assert table.image_columns[-1] == ("time_s" if clock else "lamp_level")
    view = View(table)
    state = view.fresh_state()
    beside = view.neighbour(state, "intensity_counts", du=1, dv=0)
    inner = view.number("pixel_u") < 11.0
    np.testing.assert_array_equal(beside[inner], state["intensity_counts"][inner])
    np.testing.assert_allclose(view.frame_mean(state, "intensity_counts"), state["intensity_counts"])


def test_regions_may_lie_off_the_raster():
    made = camera(1, steps=5, shared=0.0)
    made["pixel_u"], made["pixel_v"] = 3.0 * made["pixel_u"] + 1.3, made["pixel_v"] + 0.5
    view = View(columns_of(pa.table(made)))
    state = {**view.fresh_state(), "intensity_counts": np.arange(float(view.n))}
    assert np.isnan(view.neighbour(state, "intensity_counts", du=1, dv=0)).all()
    beside = view.neighbour(state, "intensity_counts", du=3, dv=0)
    inner = view.number("pixel_u") < 34.0
    np.testing.assert_array_equal(beside[inner], state["intensity_counts"][inner] + 1.0)
    assert np.isnan(beside[~inner]).all()
    assert diagnose(view.columns)[0].findings == []


@pytest.mark.parametrize(("steps", "seed"), [(3, 11), (3, 12), (8, 13), (8, 14)])
def test_a_lamp_that_is_off_in_each_image_is_no_law(steps, seed):
    diagnosis, _, _ = diagnose(columns_of(pa.table(camera(seed, steps=steps, shared=0.004))))
    assert [f.effect for f in diagnosis.findings if f.effect != "bench.repeatability"] == []
