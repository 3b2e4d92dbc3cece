"""The cyclic error of a phase meter at two modulations, from samples of a wave that is no sine."""

import numpy as np
import pyarrow as pa

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of
from arl_fixtures.reconcile.view import View

LIGHT_M_S = 299_792_458.0
MODULATIONS_MHZ = np.array([15.0, 49.0])


def sampled_phase(phase, third):
    """Phase from four samples, a quarter of a period apart, of what correlates with a third harmonic."""
    quarter = phase[:, None] - np.arange(4) * np.pi / 2.0
    wave = 1.0 + np.cos(quarter) + third * np.cos(3.0 * quarter + 0.7)
    return np.arctan2(wave[:, 1] - wave[:, 3], wave[:, 0] - wave[:, 2])


def baseline(seed, third, scale=0.0):
    """Twenty-six pillars at uneven distances, eight sessions, each by a slow and a fast modulation."""
    rng = np.random.default_rng(seed)
    stop = np.sort(rng.uniform(4.0, 36.0, 26))
    session, place, which = (x.ravel() for x in np.meshgrid(np.arange(8), np.arange(26), np.arange(2), indexing="ij"))
    true = stop[place]
    turn = 4.0 * np.pi * MODULATIONS_MHZ[which] * 1e6 * true * (1.0 + scale) / LIGHT_M_S
    off = (sampled_phase(turn, third) - turn + np.pi) % (2.0 * np.pi) - np.pi
    measured = true * (1.0 + scale) + off * LIGHT_M_S / (4.0 * np.pi * MODULATIONS_MHZ[which] * 1e6)
    error = np.array([2.4e-3, 1.2e-3])[which]
    return columns_of(pa.table({
        "step": session.astype(float), "true_range_m": true, "modulation_mhz": MODULATIONS_MHZ[which],
        "head": np.array(["slow", "fast"])[which], "n_frames": np.full(true.size, 5.0),
        "sim_distance_m": true, "sim_distance_m_std": error,
        "distance_m": measured + error / np.sqrt(5.0) * rng.normal(size=true.size),
    }))  # fmt: skip


def test_a_cyclic_error_is_named_with_a_quarter_of_the_fastest_wave_as_its_period():
    (found,) = diagnose(baseline(3, 0.004))[0].findings
    assert found.effect == "timing.tdc_nonlinearity"
    assert found.drivers[:2] == ["sim_distance_m", "modulation_mhz"]
    period = next(p for p in found.parameters if p.name == "period")
    assert abs(period.value / (LIGHT_M_S / (2.0 * 49e6 * 4.0)) - 1.0) < 2e-3


def test_a_clock_beside_a_cyclic_error_is_named_as_well():
    found = diagnose(baseline(4, 0.004, scale=6e-5))[0].findings
    assert {f.effect for f in found} == {"timing.tdc_nonlinearity", "timing.clock_scale"}


def test_a_row_without_its_modulation_is_left_as_it_was():
    columns = baseline(5, 0.004)
    cyclic = library()["timing.tdc_nonlinearity"]
    (variant,) = (v for v in cyclic.variants(View(columns)) if "modulation" in v.options)
    columns.numbers["modulation_mhz"][:2] = np.nan, 0.0
    view = View(columns)
    state = view.fresh_state()
    cyclic.apply(variant, {"sine": 0.01, "cosine": 0.02, "period": 0.76}, state, view)
    moved = state["distance_m"] - view.sim["distance_m"]
    assert np.array_equal(moved[:2], [0.0, 0.0])
    assert np.all(np.abs(moved[2:]) > 0.0)
