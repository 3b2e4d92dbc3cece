"""A beam that widens from cycle to cycle keeps its power: what reaches the edges is missing in the middle."""

import numpy as np
import pyarrow as pa

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of

KNOWN = [library()[n] for n in ("beam.profile_change", "laser.power_decay", "optics.vignetting")]
U, V = 12, 6
AZ_EDGES, EL_EDGES = np.linspace(-27.0, 27.0, U + 1), np.linspace(-9.0, 9.0, V + 1)


def received(wider):
    """Power in each pixel's cone, of rays of which each leaves `wider` times farther off axis."""
    shares = []
    for edges, reach, order in ((AZ_EDGES, 24.0, 2.4), (EL_EDGES, 8.0, 2.0)):
        rays = np.linspace(-3.0 * reach, 3.0 * reach, 400_001)
        power = np.exp(-(np.abs(rays / reach) ** order))
        shares.append(np.histogram(rays * (1.0 + wider), bins=edges, weights=power)[0])
    return np.outer(*shares)


def campaign(seed, widest):
    """Nine cycles of four steps; the unit's gain was set in the first cycle."""
    rng = np.random.default_rng(seed)
    cycle, step, u, v = (a.ravel() for a in np.meshgrid(range(9), range(4), range(U), range(V), indexing="ij"))
    by_cycle = np.array([received(widest * k / 8.0) for k in range(9)])
    light, worn = (x * 1200.0 / by_cycle[0].max() for x in (by_cycle[0][u, v], by_cycle[cycle, u, v]))
    sigma = np.sqrt(light)
    return columns_of(pa.table({
        "cycle": 100.0 * cycle, "step": 1.0 * step, "pixel_u": 1.0 * u, "pixel_v": 1.0 * v,
        "azimuth_deg": 0.5 * (AZ_EDGES[:-1] + AZ_EDGES[1:])[u],
        "elevation_deg": 0.5 * (EL_EDGES[:-1] + EL_EDGES[1:])[v],
        "n_frames": np.full(u.size, 10.0), "intensity_counts": worn + sigma * rng.normal(size=u.size) / np.sqrt(10.0),
        "sim_intensity_counts": light, "sim_intensity_counts_std": sigma,
    }))  # fmt: skip


def test_a_beam_that_spreads_needs_no_laser_that_fades():
    found = diagnose(campaign(1, 0.06), effects=KNOWN)[0].findings
    assert [f.effect for f in found] == ["beam.profile_change"]
    values = {p.name: p for p in found[0].parameters}
    for axis in ("az", "el"):
        assert values[f"spread_{axis}"].low - 0.01 < 0.06 < values[f"spread_{axis}"].high + 0.01
