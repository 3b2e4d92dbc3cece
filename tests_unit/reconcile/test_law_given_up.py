"""A law that cannot be reckoned costs that law: the rest of the answer comes, and says so."""

import numpy as np
import pyarrow as pa

from arl_fixtures.reconcile import law_search
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of

GUARD = law_search._that_work  # before a fixture takes it away


def odd_zone(seed):
    """Pixels of one half that dim where it is damp: nothing of the library."""
    rng = np.random.default_rng(seed)
    step, pixel = (a.ravel() for a in np.meshgrid(np.arange(24.0), np.arange(40.0), indexing="ij"))
    damp = rng.uniform(20.0, 80.0, 24)[step.astype(int)]
    simulated = 400.0 + 5.0 * pixel
    return columns_of(pa.table({
        "step": step, "pixel_u": pixel, "humidity_pct": damp, "n_frames": np.full(step.size, 10),
        "sim_intensity_counts": simulated, "sim_intensity_counts_std": np.full(step.size, 9.0),
        "intensity_counts": simulated * (1.0 - 4e-4 * damp * (pixel > 20.0)) + rng.normal(0.0, 2.8, step.size),
    }))  # fmt: skip


def test_a_law_that_is_given_up_is_told(monkeypatch):
    def broken(*_):
        raise KeyError("stage_angle_deg")
        yield

    whole = diagnose(odd_zone(1), effects=[])[0]
    assert [f.effect for f in whole.findings] == ["unknown"]
    assert "law of intensity_counts" not in whole.notes
    monkeypatch.setattr(law_search, "_that_work", GUARD)
    monkeypatch.setattr(law_search, "_from_start", broken)
    less = diagnose(odd_zone(1), effects=[])[0]
    assert "stage_angle_deg" in less.notes["law of intensity_counts"]
