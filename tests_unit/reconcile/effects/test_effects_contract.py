"""What every effect of the library must keep, whatever its physics."""

import math

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from rendered_bench import bench, make_columns

from arl_fixtures.reconcile.catalogue import built_in, library
from arl_fixtures.reconcile.effect import Kind
from arl_fixtures.reconcile.view import View

IDS = [
    "laser.thermal_rolloff",
    "laser.power_decay",
    "laser.pulse_energy_jitter",
    "electronics.rail_coupling",
    "beam.profile_shift",
    "beam.profile_change",
    "optics.vignetting",
    "optics.filter_shift",
    "optics.window_frost",
    "optics.window_contamination",
    "optics.veiling_glare",
    "optics.ghost",
    "optics.focal_drift",
    "optics.defocus",
    "detector.gain_temperature",
    "detector.pile_up",
    "detector.dark_offset",
    "detector.compression",
    "detector.crosstalk",
    "detector.pixel_response",
    "detector.dead_pixels",
    "readout.column_pattern",
    "readout.noise_excess",
    "timing.range_walk",
    "timing.temperature_offset",
    "timing.clock_scale",
    "timing.tdc_nonlinearity",
    "timing.row_skew",
    "timing.thermal_lag",
    "target.non_lambertian",
    "target.reflectance_error",
    "target.edge_mixing",
    "air.multipath",
    "stage.zero_offset",
    "stage.eccentricity",
    "stage.periodic_error",
    "mount.tilt",
    "bench.repeatability",
    "acquisition.frame_lag",
    "thermal.latent_heat",
    "thermal.sensor_offset",
    "thermal.contact_resistance",
]
LOSSES = (
    "laser.power_decay",
    "optics.window_frost",
    "optics.window_contamination",
    "detector.compression",
    "detector.pile_up",
)


def small_table():
    columns = bench(
        columns=(58, 68), rows=(12, 18), angles=(-4.5, 4.5, 11), steps=6, duts=2, cycles=2, back_and_forth=True
    )
    numbers, labels = dict(columns.numbers), {}
    for name, (codes, names) in columns.categories.items():
        labels[name] = np.array(names)[codes]
    numbers["sim_plate_temperature_c"] = numbers["plate_temperature_c"].copy()
    numbers["node_temperature_c"] = numbers["plate_temperature_c"] + 3.0
    numbers["sim_node_temperature_c"] = numbers["node_temperature_c"].copy()
    hole = np.random.default_rng(1).random(columns.n) < 0.02
    for name in ("sim_distance_m", "sim_distance_m_std"):
        numbers[name] = np.where(hole, np.nan, numbers[name])  # no return simulated
    return numbers, labels


NUMBERS, LABELS = small_table()
TABLE = make_columns(NUMBERS, LABELS, shuffle=None)[0]
VIEW = View(TABLE)
SHUFFLED, ORDER = make_columns(NUMBERS, LABELS, shuffle=11)
CASES = [(effect, variant) for effect in built_in() for variant in effect.variants(VIEW)]


def filled(variant, view, pick):
    """Values for all parameters; a field parameter gets one value per level."""
    values = {}
    for place, parameter in enumerate(variant.parameters):
        value = pick(parameter, place)
        if parameter.per:
            level = view.group(*parameter.per)
            values[parameter.name] = value * np.cos(level % 5)
        else:
            values[parameter.name] = value
    return values


def run(effect, variant, values, view):
    state = view.fresh_state()
    effect.apply(variant, values, state, view)
    return state


def test_the_library_holds_the_whole_vocabulary():
    assert sorted(library()) == sorted(IDS)
    assert {effect.id for effect, _ in CASES} == set(IDS)  # and each has something to say about a full table


def test_variants_are_told_apart_and_stay_within_the_budget():
    labels = [variant.label for _, variant in CASES]
    assert len(set(labels)) == len(labels)
    starts = sum(math.prod(len(p.starts) for p in variant.shapes()) for _, variant in CASES)
    assert starts <= 330  # every start is a fit in every round of every table


@pytest.mark.parametrize("effect", built_in(), ids=lambda effect: effect.id)
def test_null_amplitudes_change_nothing_and_the_simulation_is_never_written_to(effect):
    before = {name: values.copy() for name, values in VIEW.sim.items()}
    for variant in effect.variants(VIEW):
        null = filled(variant, VIEW, lambda p, _: p.null if p.is_amplitude else p.starts[-1])
        for name, values in run(effect, variant, null, VIEW).items():
            np.testing.assert_allclose(values, VIEW.sim[name], rtol=1e-12, atol=1e-12, err_msg=variant.label)
        run(effect, variant, filled(variant, VIEW, lambda p, _: p.typical if p.is_amplitude else p.starts[0]), VIEW)
    for name, values in before.items():
        np.testing.assert_array_equal(VIEW.sim[name], values)


@pytest.mark.parametrize("effect", built_in(), ids=lambda effect: effect.id)
def test_a_visible_size_moves_exactly_the_channels_that_the_variant_names(effect):
    known = {channel.name for channel in TABLE.channels}
    for variant in effect.variants(VIEW):
        visible = filled(variant, VIEW, lambda p, _: p.typical if p.is_amplitude else p.starts[0])
        state = run(effect, variant, visible, VIEW)
        moved = {name for name in known if not np.array_equal(state[name], VIEW.sim[name], equal_nan=True)}
        assert set(variant.channels) <= known, variant.label
        if effect.kind is Kind.GROUP_SCATTER:
            assert not moved
        else:
            assert moved, variant.label
            assert moved <= set(variant.channels), variant.label


@pytest.mark.parametrize("effect", built_in(), ids=lambda effect: effect.id)
def test_texts_are_plain_and_name_columns_of_the_table(effect):
    assert effect.source
    assert set(effect.confusable) <= set(IDS)
    for variant in effect.variants(VIEW):
        visible = filled(variant, VIEW, lambda p, _: p.typical if p.is_amplitude else p.starts[0])
        sentence = effect.sentence(variant, visible, VIEW)
        assert sentence.endswith(".")
        assert "nan" not in sentence
        assert effect.expression(variant)
        assert len(effect.next_experiment(variant)) > 20
        assert variant.drivers
        assert all(VIEW.has(name) for name in variant.drivers), variant.label
        for column, region in effect.where(variant, visible, VIEW).items():
            assert VIEW.has(column)
            assert region == sorted(region)


@settings(max_examples=150, deadline=None, suppress_health_check=list(HealthCheck))
@given(data=st.data())
def test_any_parameters_inside_their_ranges_stay_finite_and_follow_the_rows(data):
    effect, variant = data.draw(st.sampled_from(CASES))
    shares = data.draw(
        st.lists(st.floats(0.0, 1.0), min_size=len(variant.parameters), max_size=len(variant.parameters))
    )

    def pick(parameter, place):
        return parameter.low + shares[place] * (parameter.high - parameter.low)

    state = run(effect, variant, filled(variant, VIEW, pick), VIEW)
    for name, values in state.items():
        assert np.array_equal(np.isnan(values), np.isnan(VIEW.sim[name])), (variant.label, name)
        assert not np.isinf(values).any(), (variant.label, name)
        if name.endswith("_std"):
            assert np.nanmin(values) >= 0.0, (variant.label, name)
    other = View(SHUFFLED)
    values = {
        name: value[ORDER] if isinstance(value, np.ndarray) else value
        for name, value in filled(variant, VIEW, pick).items()
    }
    for name, shuffled in run(effect, variant, values, other).items():
        scale = np.nanmax(np.abs(state[name])) + 1.0
        np.testing.assert_allclose(shuffled, state[name][ORDER], rtol=1e-7, atol=1e-9 * scale, err_msg=variant.label)


@pytest.mark.parametrize("name", LOSSES)
def test_losses_only_take_light_and_more_of_them_takes_more(name):
    effect = library()[name]
    for variant in effect.variants(VIEW):
        kept = []
        for size in (0.5, 1.0, 2.0):
            values = filled(
                variant, VIEW, lambda p, _, size=size: size * p.typical if p.is_amplitude else p.starts[0]
            )
            kept.append(run(effect, variant, values, VIEW)["intensity_counts"])
        assert np.all(kept[0] <= VIEW.sim["intensity_counts"] * (1.0 + 1e-12))
        assert np.all(kept[1] <= kept[0] * (1.0 + 1e-12))
        assert np.all(kept[2] <= kept[1] * (1.0 + 1e-12))
        assert kept[2].sum() < kept[0].sum(), variant.label


def test_effects_of_a_table_without_pixels_angles_or_temperatures_are_those_it_can_carry():
    signal = np.linspace(100.0, 3000.0, 50)
    numbers = {"signal_counts": signal, "sim_signal_counts": signal, "distance_m": signal, "sim_distance_m": signal}
    columns, _ = make_columns(numbers, {})
    found = {effect.id for effect in built_in() for _ in effect.variants(View(columns))}
    assert {"timing.range_walk", "detector.compression", "detector.pile_up", "timing.clock_scale"} <= found
    assert not {name for name in found if name.startswith(("stage.", "optics.", "thermal.", "mount.", "laser."))}


def test_a_view_of_some_rows_sees_the_same_as_the_whole_table_for_local_physics():
    rows = np.flatnonzero(np.random.default_rng(5).random(TABLE.n) < 0.4)
    part = View(TABLE, rows)
    local = [case for case in CASES if case[0].id.startswith(("laser.", "beam.", "timing.", "stage.", "thermal."))]
    assert len(local) > 30
    for effect, variant in local:
        values = filled(variant, VIEW, lambda p, _: p.typical if p.is_amplitude else p.starts[0])
        whole, some = run(effect, variant, values, VIEW), run(effect, variant, values, part)
        for name in some:
            np.testing.assert_allclose(some[name], whole[name][rows], rtol=1e-9, atol=1e-12, err_msg=variant.label)
