"""Light that a full well bends before the read-out adds its noise: frames scatter as if nothing had happened."""

import numpy as np
import pyarrow as pa
import pytest

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.model_file import model_of
from arl_fixtures.reconcile.model_state import corrected_state, terms_of
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.side_scatter import Side
from arl_fixtures.reconcile.table import columns_of
from arl_fixtures.reconcile.view import View

FRAMES, FULL_WELL = 16, 9000.0


def flat_fields(seed, *, behind):
    """Forty flat fields of eight illuminances; electrons fill a well, volt by volt (an ODE of its remaining room)."""
    rng = np.random.default_rng(seed)
    step = np.repeat(np.arange(40), 60)
    light = np.geomspace(60.0, 2900.0, 8)[step % 8]
    filled, room = np.zeros(len(light)), FULL_WELL
    for _ in range(2000):
        filled += light / 2000.0 * (1.0 - filled / room)
    sigma = np.sqrt(16.0 + 0.25 * light)
    slope = 1.0 if behind else (1.0 - filled / room)
    shared = 0.002 * rng.normal(size=40)[step]
    frames = filled[:, None] + sigma[:, None] * (
        rng.normal(size=(len(light), FRAMES)) * (1.0 if behind else np.reshape(slope, (-1, 1)))
    )
    return {
        "step": step, "pixel_u": np.tile(np.arange(60) % 10, 40), "pixel_v": np.tile(np.arange(60) // 10, 40),
        "n_frames": np.full(len(light), FRAMES),
        "sim_intensity_counts": light, "sim_intensity_counts_std": sigma,
        "sim_intensity_counts_repeat_std": 0.002 * light,
        "intensity_counts": frames.mean(axis=1) * (1.0 + shared), "intensity_counts_std": frames.std(axis=1, ddof=1),
    }  # fmt: skip


@pytest.mark.parametrize(("behind", "side"), [(True, Side.STILL), (False, Side.OWN)])
def test_a_full_well_is_found_whether_noise_comes_in_before_or_behind_it(behind, side):
    table = flat_fields(3, behind=behind)
    columns = columns_of(pa.table(table))
    diagnosis, model, _ = diagnose(columns)
    (found,) = diagnosis.findings
    assert "detector.compression" in {found.effect, *found.equivalent_to}
    assert found.term.side is side
    size = next(p for p in found.parameters if p.name in ("strength", "load"))
    top = float(found.term.variant.options["top"])
    assert size.low < top / FULL_WELL < size.high
    assert model.effects[0].scatters is side


def test_scatters_that_stay_are_predicted_to_stay(tmp_path):
    table = flat_fields(4, behind=True)
    columns = columns_of(pa.table(table))
    diagnosis, _, decision = diagnose(columns, effects=[library()["detector.compression"]])
    model = model_of(diagnosis, (), ("intensity_counts",), (np.inf, np.inf))
    view = View(columns)
    state = corrected_state(model, terms_of(model, view, tmp_path), view)
    assert np.array_equal(state["intensity_counts_std"], view.sim["intensity_counts_std"])
    assert decision.standing.left_share("intensity_counts") < 0.05
