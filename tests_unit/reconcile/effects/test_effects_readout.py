"""Read-out and book-keeping: operators against converters and scatters made by other means."""

import numpy as np
import pytest
from operator_tables import fit, table
from rendered_bench import bench, corrected, left_over, variant_of

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.effect import Kind
from arl_fixtures.reconcile.view import View


def test_column_pattern_holds_four_interleaved_converters_of_different_gain():
    column = np.tile(np.arange(32.0), 20)
    gains = np.array([1.012, 0.994, 0.988, 1.006])[column.astype(int) % 4]
    light = np.repeat(np.linspace(200.0, 2000.0, 20), 32)
    view = table(pixel_u=column, sim_signal_counts=light, signal_counts=light * gains)
    periodic = variant_of(view, "readout.column_pattern", axis="pixel_u", kind="periodic")
    assert 4.0 in periodic.shapes()[0].starts
    start = {"cosine": 1.0, "sine": 1.0, "gain_cosine": 0.001, "gain_sine": 0.001, "period": 4.0}
    values = fit(view, periodic, "signal_counts", start)
    assert values["period"] == pytest.approx(4.0, abs=0.001)
    assert np.hypot(values["gain_cosine"], values["gain_sine"]) == pytest.approx(0.0134, abs=5e-4)
    assert left_over(view, corrected(view, periodic, **values), "signal_counts") < 1e-3


@pytest.mark.parametrize("kind", ["taps", "gains"])
def test_each_of_four_converters_may_be_off_by_itself(kind):
    column = np.tile(np.arange(32.0), 20)
    own = np.array([0.0, 3.0, -4.0, 1.0])[column.astype(int) % 4]  # no wave of one period says this
    light = np.repeat(np.linspace(200.0, 2000.0, 20), 32)
    measured = light + own if kind == "taps" else light * (1.0 + own / 1000.0)
    view = table(pixel_u=column, sim_signal_counts=light, signal_counts=measured)
    variant = variant_of(view, "readout.column_pattern", axis="pixel_u", kind=kind, converters=4)
    values = fit(
        view, variant, "signal_counts", {f"tap_{k}": 1.0 / (1.0 if kind == "taps" else 1e3) for k in (1, 2, 3)}
    )
    scale = 1.0 if kind == "taps" else 1000.0
    assert [scale * values[f"tap_{k}"] for k in (1, 2, 3)] == pytest.approx([3.0, -4.0, 1.0], rel=1e-3)
    assert "4 converters" in library()["readout.column_pattern"].sentence(variant, values, view)


def test_every_second_column_sees_half_of_the_converters_and_no_parity():
    column = np.tile(np.arange(0.0, 64.0, 2.0), 20)
    own = np.array([3.0, 9.0, -4.0, 9.0, -1.0, 9.0, 2.0, 9.0])[column.astype(int) % 8]
    light = np.repeat(np.linspace(200.0, 2000.0, 20), 32)
    view = table(pixel_u=column, sim_signal_counts=light, signal_counts=light + own)
    variants = list(library()["readout.column_pattern"].variants(view))
    assert {v.options["kind"] for v in variants} == {"periodic", "blocks", "taps", "gains", "both"}
    (eight,) = (v for v in variants if v.options["kind"] == "taps" and v.options["converters"] == 8)
    values = fit(view, eight, "signal_counts", {p.name: 1.0 for p in eight.parameters})
    assert values == pytest.approx({"tap_0": 3.0, "tap_2": -4.0, "tap_4": -1.0, "tap_6": 2.0}, rel=1e-3)
    assert left_over(view, corrected(view, eight, **values), "signal_counts") < 1e-3


def test_converters_of_which_only_some_are_seen_need_not_sum_to_nothing():
    column = np.tile(np.arange(0.0, 32.0, 2.0), 20)
    own = np.array([6.0, -7.0, 2.0, -1.0])[column.astype(int) % 4]  # these sum to nothing, 6 and 2 do not
    light = np.repeat(np.linspace(200.0, 2000.0, 20), 16)
    view = table(pixel_u=column, sim_signal_counts=light, signal_counts=light + own)
    variant = variant_of(view, "readout.column_pattern", kind="taps", converters=4)
    values = fit(view, variant, "signal_counts", {p.name: 1.0 for p in variant.parameters})
    np.testing.assert_allclose(corrected(view, variant, **values)["signal_counts"], light + own, atol=1e-6)
    assert "up to 4 counts" in library()["readout.column_pattern"].sentence(variant, values, view)


def test_a_level_is_no_pattern_of_the_converters_that_are_seen():
    column = np.tile(np.array([k for k in range(17) if k % 8 != 7], dtype=float), 20)  # none of the eighth
    light = np.repeat(np.linspace(200.0, 2000.0, 20), 15)
    view = table(pixel_u=column, sim_signal_counts=light, signal_counts=light + 5.0 + 0.01 * np.cos(light))
    (eight,) = (
        v
        for v in library()["readout.column_pattern"].variants(view)
        if v.options["kind"] == "taps" and v.options["converters"] == 8
    )
    values = fit(view, eight, "signal_counts", {p.name: 1.0 + 0.1 * k for k, p in enumerate(eight.parameters)})
    assert left_over(view, corrected(view, eight, **values), "signal_counts") > 0.5


def test_noise_excess_beyond_a_knee_says_where():
    warm = np.linspace(-10.0, 85.0, 400)
    view = table(
        tof_temperature_c=warm, sim_signal_counts=500.0, sim_signal_counts_std=10.0,
        signal_counts_std=np.where(warm > 60.0, 14.0, 10.0),
    )  # fmt: skip
    variant = variant_of(view, "readout.noise_excess", condition="split", column="tof_temperature_c")
    values = {"factor_below": 0.0, "factor_above": 0.4, "knee": 60.0}
    assert left_over(view, corrected(view, variant, **values), "signal_counts_std") < 0.02
    assert library()["readout.noise_excess"].where(variant, values, view) == {"tof_temperature_c": [60.0, 85.0]}


def test_repeatability_is_a_group_scatter_and_moves_nothing():
    view = View(bench(columns=(58, 62), rows=(12, 14), angles=(-1.8, 1.8, 5), steps=6))
    effect = library()["bench.repeatability"]
    assert effect.kind is Kind.GROUP_SCATTER
    groups = {(v.options["channel"], v.options["group"]) for v in effect.variants(view)}
    assert ("distance_m", "step") in groups
    assert ("intensity_counts", "frame") in groups
    state = corrected(view, variant_of(view, "bench.repeatability"), scatter=5.0)
    for name, values in state.items():
        np.testing.assert_array_equal(values, view.sim[name])
