"""A name that had a little of what a law says gains nothing beside the law: it does not stay."""

import numpy as np
import pyarrow as pa

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.gate import drop_needless
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of
from arl_fixtures.reconcile.terms import Term, default_values

SCANS, RAYS, SLABS = 90, 36, 40


def dusty_road(seed):
    """A scanner in dust that comes in gusts and thins out along the path: light is lost slab by slab."""
    rng = np.random.default_rng(seed)
    dust = np.zeros(SCANS)
    for k in range(1, SCANS):
        dust[k] = 0.8 * dust[k - 1] + (rng.random() < 0.14) * rng.uniform(3.0, 16.0)
    scan, ray = (a.ravel() for a in np.meshgrid(np.arange(SCANS), np.arange(RAYS), indexing="ij"))
    load = (dust + 0.4)[scan]
    range_m = np.round(10.0 + 45.0 * np.abs(np.sin(np.arange(RAYS) * 0.9)), 2)[ray]
    kept = np.ones(scan.size)
    for place in np.linspace(0.0, 1.0, SLABS):
        kept *= 1.0 - 2.0 * range_m / SLABS * 4e-5 * load * (1.0 - 0.5 * np.exp(-6.0 * place))
    simulated = 4.5e4 / (range_m + 9.0) ** 1.5
    gain = np.mean(kept)  # the user's
    scatter = np.sqrt(16.0 + 0.5 * simulated + (0.01 * simulated) ** 2)
    noise = rng.standard_t(5, scan.size) / np.sqrt(5.0 / 3.0) * scatter / 2.0
    noise += 0.004 * simulated * rng.normal(size=SCANS // 6)[scan // 6]
    return {
        "step": scan // 6, "time_s": 20.0 * scan, "dust_mg_m3": load,
        "wind_speed_m_s": np.abs(2.0 + rng.normal(size=SCANS))[scan],
        "laser_temperature_c": (38.0 + 0.03 * np.arange(SCANS) + 0.2 * rng.normal(size=SCANS))[scan],
        "azimuth_deg": np.linspace(-70.0, 70.0, RAYS)[ray], "true_range_m": range_m,
        "sim_intensity_counts": gain * simulated, "sim_intensity_counts_std": scatter,
        "n_frames": np.full(scan.size, 4), "intensity_counts": simulated * kept + noise,
        "sim_distance_m": range_m, "sim_distance_m_std": np.full(scan.size, 0.02),
        "distance_m": range_m + rng.normal(0.0, 0.01, scan.size),
    }  # fmt: skip


def beside_its_law(more):
    """A decision on dust with a fall-off of the beam beside the law, of which there is as much as `more` says."""
    columns = dusty_road(2)
    columns["intensity_counts"] = columns["intensity_counts"] * np.exp(-more * (columns["azimuth_deg"] / 70.0) ** 4)
    decision = diagnose(columns_of(pa.table(columns)))[2]
    assert [law.channel for law in decision.laws] == ["intensity_counts"]
    if not decision.best.terms:
        effect = library()["beam.profile_change"]
        variant = next(v for v in effect.variants(decision.problem.view) if v.options["kind"] == "edge")
        decision.keep([Term(effect=effect, variant=variant, values=default_values(variant))])
    return decision


def test_a_name_that_gains_nothing_beside_a_law_falls():
    decision = beside_its_law(0.0)
    assert drop_needless(decision)
    assert decision.best.terms == ()


def test_a_name_that_says_something_of_its_own_stays():
    decision = beside_its_law(0.05)
    (term,) = decision.best.terms
    assert not drop_needless(decision)
    assert decision.best.terms == (term,)
