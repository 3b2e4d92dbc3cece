"""Empirical laws: they find the shape, prefer the simple one, predict unseen steps, and stay silent on noise."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from arl_fixtures.reconcile import law_of_rest
from arl_fixtures.reconcile.channel_data import ChannelData
from arl_fixtures.reconcile.columns import Columns, FloatArray
from arl_fixtures.reconcile.features import category_id
from arl_fixtures.reconcile.law import Axis, Law, thresholds
from arl_fixtures.reconcile.law_basis import MAP_KNOTS, Basis, curve_axis, map_of, members, tables_of
from arl_fixtures.reconcile.law_evidence import evidence
from arl_fixtures.reconcile.law_fit import Chosen
from arl_fixtures.reconcile.law_search import gain_of_others, is_law, search_law
from arl_fixtures.reconcile.locate import locate
from arl_fixtures.reconcile.pilot import Looker
from arl_fixtures.reconcile.problem import Problem
from arl_fixtures.reconcile.table import load_table


@pytest.fixture
def problem_of(tmp_path, make_table, save):
    def make(seed: int, change=None, **shape: int) -> tuple[Looker, ChannelData]:
        columns: Columns = load_table(save(tmp_path / f"{seed}.parquet", make_table(seed, change, **shape)))
        looker = Looker(Problem(columns))
        data = next(d for d in looker.problem.data if d.channel.name == "distance_m")
        looker.calibrate(data, looker.problem.view.fresh_state())
        return looker, data

    return make


def searched(looker: Looker, data: ChannelData, *leading: str) -> tuple[Law, Chosen, FloatArray]:
    state = looker.problem.view.fresh_state()
    law, chosen = search_law(looker, data, state, leading)
    return law, chosen, law.correction(looker.features, state["distance_m"])  # metres on the view's rows


def turning(columns, _rng):
    columns["distance_m"] = columns["distance_m"] + 2e-3 * np.sin(np.radians(4.0 * columns["stage_angle_deg"]))


def warm_rows(columns, _rng):
    rows = np.exp(-(((columns["pixel_v"] - 10.0) / 6.0) ** 2))
    columns["distance_m"] = columns["distance_m"] + 5e-5 * rows * (columns["tof_temperature_c"] - 40.0)


def flicker(columns, rng):
    phase = rng.uniform(0.0, 6.28, 200)[(columns["step"] + 50 * (columns["dut"] == "S1")).astype(int)]
    columns["distance_m"] = columns["distance_m"] + 4e-3 * np.sin(columns["pixel_v"] / 4.0 + phase)


@pytest.mark.parametrize(
    ("change", "drivers"),
    [(turning, {"stage_angle_deg"}), (warm_rows, {"pixel_v", "elevation_deg"})],
    ids=["wave in angle", "rows times temperature"],
)
def test_a_law_has_the_right_columns_and_what_it_says_is_the_truth(problem_of, make_table, change, drivers):
    looker, data = problem_of(11, change)
    law, chosen, correction = searched(looker, data)
    assert set(law.drivers[:2]) & drivers
    assert is_law(chosen)
    truth = make_table(11, change)["distance_m"] - make_table(11)["distance_m"]
    left = correction - truth
    left = left - left.mean()  # a constant is calibration
    assert np.mean(left**2) < 0.15 * np.var(truth)


def test_what_a_law_says_beyond_the_columns_of_a_name_may_stand_beside_it(problem_of, make_table):
    def both(columns, rng):
        turning(columns, rng)
        warm_rows(columns, rng)

    looker, data = problem_of(17, both)
    bare = looker.problem.view.fresh_state()
    turned = make_table(17, turning)["distance_m"] - make_table(17)["distance_m"]
    named = bare | {"distance_m": bare["distance_m"] + turned}
    _, chosen = search_law(looker, data, bare, ())
    told = [set(term.basis.columns) for term in chosen.terms]
    of_turn = set().union(*(columns for columns in told if not any("temperature" in c for c in columns)))
    assert 0 < sum(bool(columns & of_turn) for columns in told) < len(told)
    of_rows = search_law(looker, data, named, ())[1].plain
    assert of_rows > 50.0
    assert gain_of_others(looker, data, named, chosen, of_turn) > 0.9 * of_rows
    assert gain_of_others(looker, data, named, chosen, {"no column"}) is None  # it says nothing of that
    assert gain_of_others(looker, data, named, chosen, set().union(*told)) is None  # and nothing else


@pytest.mark.parametrize("seed", [21, 22])
def test_noise_has_no_law_and_no_place(problem_of, seed):
    looker, data = problem_of(seed)
    _, chosen, _ = searched(looker, data)
    assert not is_law(chosen)
    assert locate(looker, data, looker.problem.view.fresh_state()) is None


def test_what_cannot_be_reckoned_costs_a_law_and_not_the_answer(problem_of, monkeypatch):
    looker, data = problem_of(5, turning)

    def singular(*_args):
        raise np.linalg.LinAlgError("Singular matrix")

    monkeypatch.setattr(law_of_rest, "locate", singular)
    state = looker.problem.view.fresh_state()
    assert law_of_rest.law_of_rest(looker, data, state, looker.look(data, state)) is None
    assert "Singular matrix" in looker.failed["law of distance_m"]


def test_a_line_is_said_as_a_line(problem_of):
    def tilt(columns, _rng):
        columns["distance_m"] = columns["distance_m"] + 1e-4 * columns["stage_angle_deg"]

    looker, data = problem_of(31, tilt)
    law, _, _ = searched(looker, data)
    first = law.terms[0]
    assert [a.kind for a in first.axes] == ["linear"]
    assert first.value / first.axes[0].width == pytest.approx(1e-4, rel=0.15)


def test_a_wave_that_only_joins_the_levels_that_were_measured_is_no_law(problem_of):
    def uneven(columns, _rng):  # each temperature has its own sign: what lies between two of them nobody knows
        levels = np.unique(columns["set_temperature_c"])
        signs = np.resize([-1.0, 1.0, -1.0, -1.0, 1.0, -1.0, 1.0], len(levels))
        sign = signs[np.searchsorted(levels, columns["set_temperature_c"])]
        columns["distance_m"] = columns["distance_m"] + 2e-3 * sign * np.where(columns["pixel_v"] < 16, 1.0, -1.0)

    looker, data = problem_of(52, uneven, steps=28)
    _, chosen, _ = searched(looker, data, "tof_temperature_c", "elevation_deg")
    assert is_law(chosen)
    assert [t.basis.waves for t in chosen.terms if t.basis.waves] == []


def test_a_jump_between_two_temperatures_is_placed_between_them_and_predicts_others(problem_of, make_table):
    def hop(columns, _rng):
        columns["distance_m"] = columns["distance_m"] + 4e-3 * (columns["housing_temperature_c"] > 46.0)

    looker, data = problem_of(61, hop, steps=8, duts=1)
    law, chosen, _ = searched(looker, data)
    assert is_law(chosen)
    made = []
    for degrees in (30.0, 41.0, 51.0, 60.0):  # 36 and 57 °C were measured
        shifted = {n: degrees + (9.0 if n == "tof_temperature_c" else 0.0) for n in law.drivers if "temperature" in n}
        assert set(shifted) == set(law.drivers)
        made.append(law.correction({n: np.array([x]) for n, x in shifted.items()}, np.ones(1))[0])
    assert np.ptp(made) == pytest.approx(4e-3, rel=0.2)


@given(st.lists(st.floats(-50.0, 150.0), min_size=2, max_size=9, unique=True), st.integers(0, 9))
def test_a_column_of_few_levels_is_parted_between_them(levels, seed):
    levels = sorted(levels)
    assume(np.min(np.diff(levels)) > 0.1 * (levels[-1] - levels[0]))
    spread = np.random.default_rng(seed).uniform(-1e-3, 1e-3, 20 * len(levels))
    values = np.repeat(levels, 20) + spread * np.ptp(levels)
    parted = thresholds(values, (0.5,))
    assert len(parted) == len(levels) - 1
    assert np.all(np.searchsorted(levels, parted) == np.arange(1, len(levels)))


def test_a_pattern_that_every_step_has_anew_has_a_place_but_no_law(problem_of):
    looker, data = problem_of(41, flicker)
    place = locate(looker, data, looker.problem.view.fresh_state())
    assert place is not None
    assert set(place.columns) <= {"pixel_v", "elevation_deg", "step"}
    assert "step" in place.columns


def test_a_map_falls_apart_into_products_of_curves_that_say_the_same():
    rng = np.random.default_rng(3)
    features = {"a": rng.uniform(0.0, 4.0, 500), "b": rng.uniform(-1.0, 1.0, 500)}
    first, second = (curve_axis(name, values, MAP_KNOTS) for name, values in features.items())
    assert first is not None
    assert second is not None
    basis = map_of(first, second, 0.0)
    values = np.outer(np.linspace(0.0, 1.0, first.count), np.linspace(1.0, -1.0, second.count)).ravel()
    direct = values @ basis.vectors(features)
    terms = basis.closed(values)
    assert len(terms) == 1  # of rank one
    assert terms[0][1] * terms[0][0][0](features) * terms[0][0][1](features) == pytest.approx(direct, abs=1e-9)


def test_hats_of_a_curve_sum_to_one_and_say_what_the_closed_curve_says():
    axis = Axis(column="x", kind="curve", edges=(0.0, 1.0, 3.0, 4.0))
    x = np.array([-1.0, 0.0, 0.25, 2.0, 4.0, 9.0, np.nan])
    hats = members(axis, x)
    assert hats[:, :-1].sum(axis=0) == pytest.approx(np.ones(6))
    closed = Axis(column="x", kind="curve", edges=axis.edges, values=(1.0, 2.0, -1.0, 5.0))
    assert np.array(closed.values) @ hats == pytest.approx(closed({"x": x}))


def test_evidence_prefers_no_bend_where_there_is_none():
    rng = np.random.default_rng(9)
    vectors = rng.normal(size=(10, 2000))
    gram, noise = vectors @ vectors.T, vectors @ rng.normal(size=2000)
    assert evidence(gram, noise, np.eye(10))[0] < 3.0
    strong = vectors @ (rng.normal(size=2000) + 0.3 * rng.normal(size=10) @ vectors)
    gain, width = evidence(gram, strong, np.eye(10))
    assert gain > 300.0
    assert width == pytest.approx(0.3, rel=0.6)


@given(
    labels=st.sets(st.text(min_size=1, max_size=6), min_size=3, max_size=9),
    new=st.text(min_size=7, max_size=9),
    middle=st.floats(-2.0, 2.0),
)
def test_a_table_over_labels_says_of_a_new_one_what_the_known_ones_share(labels, new, middle):
    known = sorted(labels)
    numbers = np.array([category_id(label) for label in known])
    assume(np.unique(numbers).size == numbers.size and category_id(new) not in numbers)
    (axis,) = tables_of("run", numbers, category=True)
    own = middle + np.linspace(-1.0, 1.0, len(known))
    order = np.argsort(numbers)
    values = np.zeros(axis.count)
    values[1::2] = own[order]
    ((axes, factor),) = Basis(axes=(axis,), price=0.0).closed(values)
    of_known = factor * axes[0]({"run": numbers})
    (of_new,) = factor * axes[0]({"run": np.array([category_id(new)])})
    np.testing.assert_allclose(of_known, own)
    assert abs(of_new) <= abs(own.mean()) + 1e-12
    assert of_new * own.mean() >= 0.0
    error = own.std() / np.sqrt(len(known) - 1)
    assert abs(of_new - own.mean()) <= error
