"""Pixels that die in the course of a campaign that looks at each of them once a cycle."""

import numpy as np
import pyarrow as pa

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of

KNOWN = [library()[n] for n in ("detector.dead_pixels", "detector.pixel_response", "laser.power_decay")]


def campaign(seed, deaths):
    """Twenty frames of each pixel of four devices at five cycles; `deaths` are (device, column, row, cycle)."""
    rng = np.random.default_rng(seed)
    dut, cycle, v, u = (
        a.ravel() for a in np.meshgrid(range(4), (0, 200, 400, 700, 1000), range(6), range(12), indexing="ij")
    )
    dead = np.zeros(u.size, dtype=bool)
    for device, column, row, since in deaths:
        dead |= (dut == device) & (u == column) & (v == row) & (cycle >= since)
    answers = rng.binomial(20, np.where(dead, 0.0, 0.95)) / 20.0
    light = 900.0 + 40.0 * np.cos(u / 3.0)
    sigma = np.sqrt(light)
    return columns_of(pa.table({
        "dut": np.array(list("ABCD"))[dut], "cycle": 1.0 * cycle, "pixel_u": 1.0 * u, "pixel_v": 1.0 * v,
        "n_frames": np.full(u.size, 20.0), "valid_fraction": answers, "sim_valid_fraction": np.full(u.size, 0.95),
        "sim_valid_fraction_std": np.full(u.size, np.sqrt(0.95 * 0.05)),
        "intensity_counts": np.where(dead, 0.0, light + sigma * rng.normal(size=u.size) / np.sqrt(20.0)),
        "sim_intensity_counts": light, "sim_intensity_counts_std": sigma,
    }))  # fmt: skip


def test_pixels_that_die_on_the_way_are_counted():
    deaths = [(0, 3, 2, 300), (0, 4, 2, 300), (2, 11, 5, 900), (3, 0, 0, 100)]
    findings = diagnose(campaign(1, deaths), effects=KNOWN)[0].findings
    assert [f.effect for f in findings] == ["detector.dead_pixels"]
    assert findings[0].parameters[0].value == 4


def test_pixels_that_all_live_are_no_finding():
    assert not diagnose(campaign(2, []), effects=KNOWN)[0].findings
