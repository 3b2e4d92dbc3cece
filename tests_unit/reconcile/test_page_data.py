"""Binned means and their null band against dense linear algebra and tables without any mismatch."""

import numpy as np
import pyarrow as pa
import pytest

from arl_fixtures.reconcile.page_data import NULL_Z, Mismatch, axis_of, inside, pixel_tiles
from arl_fixtures.reconcile.problem import Problem
from arl_fixtures.reconcile.table import columns_of
from arl_fixtures.reconcile.view import View


def problem_of(columns):
    return Problem(
        columns_of(pa.table({n: pa.array(v.tolist() if v.dtype.kind == "U" else v) for n, v in columns.items()}))
    )


def mismatches(problem):
    state = problem.view.fresh_state()
    for d in problem.data:
        d.rebuild(d.fit_scatter(d.residual(state))[1])
        yield Mismatch(d, state, state)


@pytest.mark.parametrize("centred", [True, False])
def test_the_error_of_a_bin_is_that_of_the_full_covariance(make_table, centred):
    columns = {n: v[::9] for n, v in make_table(3, steps=8).items()}
    problem = problem_of(columns)
    state = problem.view.fresh_state()
    d = problem.data[0]
    m = Mismatch(d, state, state, keep_constant=not centred)
    m.tau = {level.name: 0.7 * (k + 1) * float(np.median(d.stated / d.scale)) for k, level in enumerate(d.levels)}
    axis = axis_of(problem.view, "housing_temperature_c", most=5, own=2)
    covariance = np.diag(1.0 / m.weight)
    for level in d.levels:
        share = level.scale / d.scale
        tau = max(m.tau[level.name], level.floor)
        covariance += tau**2 * np.outer(share, share) * (level.code[:, None] == level.code)
    rows = np.zeros((axis.count, len(d.use)))
    rows[axis.code[d.use], np.arange(len(d.use))] = m.weight
    rows /= rows.sum(axis=1, keepdims=True)
    if centred:
        units = np.zeros((len(d.use), len(d.use)))
        for unit in range(d.units):
            here = d.unit == unit
            units[np.ix_(here, here)] = m.weight[here] / m.weight[here].sum()
        rows = rows - rows @ units
    profile = m.profile(axis.code, axis.count)
    assert profile.error == pytest.approx(np.sqrt(np.diag(rows @ covariance @ rows.T)), rel=1e-9)
    assert profile.rows.sum() == len(d.use)
    plain = d.residual(state) / d.scale
    assert profile.before == pytest.approx(rows @ plain, rel=1e-9, abs=1e-15)


@pytest.mark.parametrize("shared", [0.0, 1.0, 4.0])
def test_about_95_of_100_bins_of_tables_without_mismatch_lie_within_the_null_band(make_table, shared):
    columns = ("step", "set_temperature_c", "stage_angle_deg", "pixel_u", "true_range_m", "surface", "elevation_deg")
    scores = []
    for seed in range(6):
        problem = problem_of(make_table(100 + seed, shared=shared))
        for m in mismatches(problem):
            axes = [axis_of(problem.view, name) for name in columns]
            tiles = pixel_tiles(problem.view)
            for code, count in [*((a.code, a.count) for a in axes), (tiles.code, tiles.rows * tiles.columns)]:
                profile = m.profile(code, count)
                scores.append(profile.before / profile.error)
    z = np.concatenate(scores)
    z = z[np.isfinite(z)]
    assert len(z) > 1000
    assert 0.92 < np.mean(np.abs(z) < NULL_Z) < 0.985


def test_rows_of_a_step_are_no_independent_witnesses(make_table):
    """With ten times the repeatability the band over steps grows, the one over pixels far less."""
    errors = {}
    for shared in (0.0, 10.0):
        problem = problem_of(make_table(5, shared=shared))
        m = next(iter(m for m in mismatches(problem) if m.data.channel.name == "intensity_counts"))
        for name in ("step", "pixel_u"):
            axis = axis_of(problem.view, name)
            errors[name, shared] = float(np.median(m.profile(axis.code, axis.count).error))
    growth = {name: errors[name, 10.0] / errors[name, 0.0] for name in ("step", "pixel_u")}
    assert growth["step"] > 8.0
    assert growth["pixel_u"] < 0.3 * growth["step"]


def test_bins_hold_every_row_once_and_do_not_crowd(make_table):
    view = problem_of(make_table(1)).view
    for name in ("tof_temperature_c", "sim_intensity_counts", "pixel_u", "surface"):
        axis = axis_of(view, name)
        assert axis.code.min() == 0
        assert axis.code.max() == axis.count - 1
        if name == "surface":
            assert [axis.names[k] for k in axis.code[:5]] == [
                view.codes("surface")[1][k] for k in view.codes("surface")[0][:5]
            ]
        else:
            place = np.log(axis.at) if axis.log else axis.at
            assert np.diff(place).min() > (place[-1] - place[0]) / 400.0
    assert axis_of(view, "sim_intensity_counts").log
    assert not axis_of(view, "time_s").log
    assert axis_of(view, "pixel_u").at.tolist() == sorted(set(view.number("pixel_u").tolist()))
    assert axis_of(view, "cycle") is None


def test_a_region_keeps_its_rows_and_an_empty_one_keeps_all(make_table):
    view = problem_of(make_table(1)).view
    mask = inside(view, {"surface": ["wall", "stripe_80"], "set_temperature_c": [0.0, 60.0], "dut": ["S1"]})
    codes, labels = view.codes("surface")
    expected = (
        np.isin(codes, [labels.index("wall"), labels.index("stripe_80")])
        & (view.number("set_temperature_c") >= 0.0) & (view.number("set_temperature_c") <= 60.0)
        & view.selects("dut", "S1")
    )  # fmt: skip
    assert np.array_equal(mask, expected)
    assert inside(view, {"dut": ["no such"]}).all()
    assert np.array_equal(
        inside(view, {"dut": ["S1"], "surface": ["wall"]}, but=("surface",)), view.selects("dut", "S1")
    )


@pytest.mark.parametrize(("every", "size", "single"), [(1, 1, False), (2, 2, False), (3, 1, True)])
def test_an_image_is_shown_by_pixels_or_by_tiles_that_its_rows_fill(every, size, single):
    u, v = (a.ravel().astype(float) for a in np.meshgrid(np.arange(96), np.arange(64)))
    keep = (u % every == 0) & (v % every == 0)
    table = pa.table({"pixel_u": u[keep], "pixel_v": v[keep], "x_m": u[keep], "sim_x_m": u[keep]})
    view = View(columns_of(table))
    tiles = pixel_tiles(view)
    assert (tiles.size, len(tiles.u) > 0) == (size, single)
    assert tiles.code.min() == 0
    assert tiles.code.max() < tiles.rows * tiles.columns
    if single:
        assert np.array_equal(tiles.u[tiles.code], u[keep])
        assert np.array_equal(tiles.v[tiles.code], v[keep])
    else:
        assert np.array_equal(tiles.code, (v[keep] // tiles.size) * tiles.columns + u[keep] // tiles.size)
