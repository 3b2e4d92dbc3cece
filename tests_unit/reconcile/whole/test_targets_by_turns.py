"""A rangefinder before one target at a time: tables of it have no surfaces, but a column that names the target."""

import numpy as np
import pyarrow as pa
import pytest

from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of

TARGETS = {"black": 0.1, "grey": 0.5, "white": 0.9}


def stops(film: float, *, named: bool, seed: int = 3):
    """A rail with three targets at each stop; on the grey one lies an absorbing film that light passes twice."""
    rng = np.random.default_rng(seed)
    step, place, which = (part.ravel() for part in np.mgrid[0:8, 0:10, 0:3])
    target, range_m = np.array(list(TARGETS))[which], 0.5 + 0.45 * place
    reflectance = np.array(list(TARGETS.values()))[which]
    sim = 40.0 + 3.0e4 * reflectance / (1.0 + range_m) ** 2
    error = np.sqrt(30.0 + 0.4 * sim)
    passed = np.where(target == "grey", np.exp(-film) ** 2, 1.0)
    seen = 40.0 + (sim - 40.0) * passed + rng.normal(size=sim.size) * error / 5.0
    told = {"target": target} if named else {"reflectance": reflectance}
    return columns_of(pa.table({
        **told, "step": step, "true_range_m": range_m, "n_frames": np.full(sim.size, 25),
        "sim_intensity_counts": sim, "sim_intensity_counts_std": error, "intensity_counts": seen,
    }))  # fmt: skip


@pytest.mark.parametrize(("named", "where"), [(True, {"target": ["grey"]}), (False, {"reflectance": [0.5, 0.5]})])
def test_the_target_that_is_darker_is_told_by_its_own_column(named, where):
    first = diagnose(stops(0.01, named=named))[0].findings[0]
    assert first.effect == "target.reflectance_error"
    assert first.where == where
    assert first.parameters[0].low < np.exp(-0.02) - 1.0 < first.parameters[0].high


def test_targets_as_their_certificates_say_are_consistent():
    assert diagnose(stops(0.0, named=True))[0].verdict == "consistent"
