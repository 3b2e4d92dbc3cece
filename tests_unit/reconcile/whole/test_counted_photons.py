"""What counts photons one by one loses them to dead time; what turns them into charge is full at the top."""

import numpy as np
import pyarrow as pa
import pytest

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.effects_counting import counts_photons
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of
from arl_fixtures.reconcile.view import View

NAMES = ("detector.pile_up", "detector.compression", "timing.range_walk", "target.reflectance_error")
FRAMES = 20


def signals(seed, per_photon, cells, background=20.0):
    """A target at 40 distances under six lights; `cells` that fire once a frame each, or a well that fills up."""
    rng = np.random.default_rng(seed)
    far, lamp = (a.ravel() for a in np.meshgrid(np.linspace(0.5, 4.0, 40), np.arange(6), indexing="ij"))
    photons = 3000.0 * (1.0 + lamp) / 6.0 / far**2
    if per_photon == 1.0:
        fired = rng.binomial(cells, -np.expm1(-(photons + background)[:, None] / cells), (photons.size, FRAMES))
        frames = fired - background
    else:  # electrons that leave the diode in proportion to the voltage that is left
        charge = rng.poisson((photons + background)[:, None], (photons.size, FRAMES))
        frames = per_photon * (cells * -np.expm1(-charge / cells) - background)
        frames = frames + 3.0 * rng.normal(size=frames.shape)
    extra = 0.0 if per_photon == 1.0 else 9.0
    return columns_of(pa.table({
        "step": lamp, "true_range_m": far, "n_frames": np.full(far.size, float(FRAMES)),
        "sim_signal_counts": per_photon * photons,
        "sim_signal_counts_std": np.sqrt(per_photon**2 * (photons + background) + extra),
        "signal_counts": frames.mean(axis=1), "sim_distance_m": far, "sim_distance_m_std": np.full(far.size, 0.01),
        "distance_m": far + 0.01 / np.sqrt(FRAMES) * rng.normal(size=far.size),
    }))  # fmt: skip


@pytest.mark.parametrize(
    ("per_photon", "name"), [(1.0, "detector.pile_up"), (0.25, "detector.compression")]
)
@pytest.mark.parametrize("cells", [2e5, 5e4])
def test_who_counts_photons_has_a_dead_time(per_photon, name, cells):
    columns = signals(3, per_photon, int(cells))
    assert counts_photons(View(columns), "signal_counts") == (per_photon == 1.0)
    findings = diagnose(columns, effects=[library()[n] for n in NAMES])[0].findings
    assert findings[0].effect == name


def test_a_signal_of_one_size_tells_nothing_of_how_it_is_counted():
    columns = signals(4, 1.0, 100_000)
    light = np.full(columns.n, 900.0)
    columns.numbers["sim_signal_counts"], columns.numbers["sim_signal_counts_std"] = light, np.sqrt(light)
    assert not counts_photons(View(columns), "signal_counts")
