"""Constants per zone beside errors that all zones of a step share, against dense generalised least squares."""

from types import SimpleNamespace

import numpy as np
import pyarrow as pa
import pytest

from arl_fixtures.reconcile.constants import calibrated, constants_of, reach_of, zeros_of
from arl_fixtures.reconcile.features import features_of
from arl_fixtures.reconcile.held_out import mean_square
from arl_fixtures.reconcile.problem import Problem
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of
from arl_fixtures.reconcile.view import View

SIGMA_M, SHARED_M = 1e-3, 5e-4


def zone_table(seed: int, *, offset_m: float = 3e-3, steps: int = 6, zones: int = 5, rows: int = 20) -> pa.Table:
    """Distances of a zone sensor in a climate chamber: zones have offsets, all zones of a step share an error."""
    rng = np.random.default_rng(seed)
    step, zone, place = (
        a.ravel() for a in np.meshgrid(np.arange(steps), np.arange(zones), np.arange(rows), indexing="ij")
    )
    distance = 0.2 + 0.05 * place
    offset = rng.normal(0.0, offset_m, zones)[zone]
    shared = rng.normal(0.0, SHARED_M, steps)[step]
    return pa.table({
        "zone": zone, "step": step, "tof_temperature_c": 10.0 * step + rng.normal(0.0, 0.2, step.size),
        "true_range_m": distance, "sim_distance_m": distance, "sim_distance_m_std": np.full(step.size, SIGMA_M),
        "sim_distance_m_repeat_std": np.full(step.size, SHARED_M),
        "distance_m": distance + offset + shared + rng.normal(0.0, SIGMA_M, step.size),
    })  # fmt: skip


def test_whitening_with_constants_is_generalised_least_squares():
    problem = Problem(columns_of(zone_table(1)))
    (channel,) = problem.data
    residual = channel.residual(problem.view.fresh_state())
    step = problem.view.number("step")
    covariance = SIGMA_M**2 * np.eye(len(step)) + SHARED_M**2 * (step[:, None] == step)
    zones = (problem.view.number("zone")[:, None] == np.arange(5)).astype(float)
    inverse = np.linalg.inv(covariance)
    fitted = np.linalg.solve(zones.T @ inverse @ zones, zones.T @ inverse @ residual)
    left = residual - zones @ fitted
    channel.rebuild({"step": 1.0})
    z = channel.whiten(residual)
    assert z @ z == pytest.approx(left @ inverse @ left, rel=1e-6)
    assert channel.constants(residual) == pytest.approx(fitted, rel=1e-6)


def test_gains_hold_where_pixels_and_angles_cross_and_rows_are_missing():
    """Two devices' images over a sweep, a third of the rows lost: dense generalised least squares is the judge."""
    rng = np.random.default_rng(11)
    shape = (2, 6, 5, 12)
    device, step, angle, pixel = (a.ravel() for a in np.meshgrid(*map(np.arange, shape), indexing="ij"))
    light = rng.uniform(300.0, 900.0, shape[2:])[angle, pixel]
    own, seen = rng.normal(0.0, 0.05, (2, 12))[device, pixel], rng.normal(0.0, 0.02, (2, 5))[device, angle]
    shared = rng.normal(0.0, 0.01, (2, 6))[device, step]
    sigma = 0.004 * light
    kept = rng.random(light.size) > 0.2 + 0.25 * (pixel / 12.0) * (angle / 5.0)
    table = pa.table({
        "dut": np.where(device == 0, "a", "b")[kept], "step": step[kept], "stage_angle_deg": 2.0 * angle[kept],
        "pixel_u": pixel[kept], "pixel_v": np.zeros(kept.sum()), "sim_intensity_counts": light[kept],
        "sim_intensity_counts_std": sigma[kept],
        "intensity_counts": (light * (1.03 + own + seen + shared) + sigma * rng.normal(size=light.size))[kept],
    })  # fmt: skip
    problem = Problem(columns_of(table))
    (channel,) = problem.data
    tau = {"pixel": 0.05, "angle": 0.02, "step": 0.01}
    channel.rebuild(tau)
    residual = channel.residual(problem.view.fresh_state())
    covariance = np.diag(channel.stated**2)
    for level in channel.levels:
        same = level.code[:, None] == level.code
        covariance += tau.get(level.name, 0.0) ** 2 * same * np.outer(level.scale, level.scale)
    units = channel.scale[:, None] * (channel.unit[:, None] == np.arange(2))
    inverse = np.linalg.inv(covariance)
    exact = np.linalg.inv(units.T @ inverse @ units)
    assert channel.constants(residual) == pytest.approx(exact @ units.T @ inverse @ residual, rel=1e-5)
    assert channel.constant_errors == pytest.approx(np.sqrt(np.diag(exact)), rel=1e-5)


@pytest.mark.parametrize("seed", range(6))
def test_what_all_zones_share_in_a_step_is_no_finding(seed):
    assert diagnose(columns_of(zone_table(seed + 10, offset_m=0.0)))[0].findings == []


@pytest.mark.parametrize(("fitted_here", "seed"), [(True, 3), (True, 4), (False, 3), (False, 4)])
def test_a_simulation_calibrated_on_these_rows_agrees_better_than_steps_let_it(fitted_here, seed):
    """Steps share errors ten times those of their mean: only a calibration on these rows can be closer."""
    table = zone_table(seed, offset_m=0.0, steps=12, zones=1, rows=200).to_pydict()
    own = np.mean(np.array(table["distance_m"]) - np.array(table["sim_distance_m"]))
    off = own if fitted_here else own + 2.0 * SHARED_M
    problem = Problem(columns_of(pa.table({**table, "sim_distance_m": np.array(table["sim_distance_m"]) + off})))
    (channel,) = problem.data
    residual = channel.residual(problem.view.fresh_state())
    error = np.array([SHARED_M / np.sqrt(12.0)])
    assert (calibrated(channel, residual, residual, error, np.zeros(1)).here > 0.7) == fitted_here


@pytest.mark.parametrize(("elsewhere", "seed"), [(True, 3), (True, 4), (False, 3), (False, 4)])
def test_a_calibration_on_other_rows_took_the_effects_mean_away(elsewhere, seed):
    """By four errors of the mean, which steps that are off by chance leave: it is in one of both means only."""
    problem = Problem(columns_of(zone_table(seed, offset_m=0.0, steps=12, zones=1, rows=200)))
    (channel,) = problem.data
    error = np.array([SHARED_M / np.sqrt(12.0)])
    chance = channel.residual(problem.view.fresh_state())
    apart = 4.0 * error[0] * channel.scale
    untouched, left = (chance, chance - apart) if elsewhere else (chance + apart, chance)
    found = calibrated(channel, untouched, left, error, 4.0 * error)
    assert (found.here + found.elsewhere > 0.7) == elsewhere


@pytest.mark.parametrize("refitted", [True, False])
def test_a_single_step_tells_of_a_calibration_by_what_its_findings_make_of_the_mean(refitted):
    """One step of a receiver behind a long-tailed pair (tanh): what is foretold is the recording, not its curve only.

    A user who fits the gain on these rows takes the mean loss away, one who does not leaves it in.
    """
    rng = np.random.default_rng(15)
    signal = rng.uniform(50.0, 2500.0, 900)
    truth = 6000.0 * np.tanh(signal / 6000.0)
    noise = 0.004 * signal
    gain = float(np.sum(truth * signal / noise**2) / np.sum((signal / noise) ** 2)) if refitted else 1.0
    table = columns_of(pa.table({
        "step": np.zeros(900), "true_range_m": rng.uniform(0.5, 4.0, 900), "sim_intensity_counts": gain * signal,
        "sim_intensity_counts_std": noise, "intensity_counts": truth + rng.normal(0.0, noise),
    }))  # fmt: skip
    _, _, decision = diagnose(table)
    assert [t.effect.id for t in decision.terms] == ["detector.compression"]
    corrected = decision.final_state()["intensity_counts"]
    foretold = corrected * (1.0 + constants_of(decision).get("intensity_counts", {}).get("", 0.0))
    left = np.mean(((foretold - truth) / noise) ** 2) / np.mean(((gain * signal - truth) / noise) ** 2)
    assert left < 0.1


def test_a_single_step_keeps_the_gain_that_a_user_fitted_beside_a_zero():
    """Panels before a dim wall gleam by a tenth; a user fits gain and zero to the one recording, mostly of wall."""
    rng = np.random.default_rng(9)
    light = np.r_[rng.uniform(60.0, 100.0, 500), rng.uniform(400.0, 2500.0, 200)]
    sigma = np.sqrt(20.0 + 0.03 * light**1.3)
    truth = light * (1.0 + 0.1 * (light > 300.0))
    seen = truth + sigma * rng.normal(size=light.size)
    fit = np.linalg.lstsq(np.column_stack([light, np.ones(light.size)]) / sigma[:, None], seen / sigma, rcond=None)[0]
    sim = fit[0] * light + fit[1]
    problem = Problem(columns_of(pa.table({
        "step": np.zeros(light.size), "true_range_m": rng.uniform(1.0, 2.0, light.size), "sim_intensity_counts": sim,
        "sim_intensity_counts_std": sigma, "intensity_counts": seen,
    })))  # fmt: skip
    problem.data[0].free_zero()
    state = problem.view.fresh_state()
    named = state["intensity_counts"] * np.where(light > 300.0, 1.1, 1.0)
    decision = SimpleNamespace(
        search=SimpleNamespace(scaled={}),
        problem=problem, final_state=lambda: {**state, "intensity_counts": named}, laws=[], terms=[]
    )
    gains = constants_of(decision)
    gain, zero = gains["intensity_counts"][""], zeros_of(decision, gains)["intensity_counts"][""]
    foretold = named * (1.0 + gain) + zero
    assert np.mean(((foretold - truth) / sigma) ** 2) < 0.1 * np.mean(((sim - truth) / sigma) ** 2)


@pytest.mark.parametrize("seed", [2, 3])
def test_gain_and_zero_that_a_user_fitted_are_taken_back_together(seed):
    """Facets that gleam aslant by 0.6 %, steps that differ by 0.4 %; gain and zero are fitted to these rows."""
    rng = np.random.default_rng(seed)
    step = np.repeat(np.arange(6), 500)
    light, aslant = rng.uniform(60.0, 3000.0, step.size), rng.uniform(0.0, 0.3, step.size)
    sigma = np.sqrt(20.0 + 0.2 * light)
    truth = light * (1.0 + 0.06 * np.tan(aslant) ** 2)
    shared = 0.004 * rng.normal(size=6)
    seen = truth * (1.0 + shared - shared.mean())[step] + sigma * rng.normal(size=step.size)
    fit = np.linalg.lstsq(np.column_stack([light, np.ones(light.size)]) / sigma[:, None], seen / sigma, rcond=None)[0]
    sim = fit[0] * light + fit[1]
    problem = Problem(columns_of(pa.table({
        "step": step.astype(float), "incidence_deg": np.degrees(aslant), "sim_intensity_counts": sim,
        "sim_intensity_counts_std": sigma, "intensity_counts": seen,
    })))  # fmt: skip
    problem.data[0].free_zero()
    state = problem.view.fresh_state()
    named = state["intensity_counts"] * (1.0 + 0.06 * np.tan(aslant) ** 2)
    decision = SimpleNamespace(
        search=SimpleNamespace(scaled={}),
        problem=problem, final_state=lambda: {**state, "intensity_counts": named}, laws=[], terms=[]
    )
    gains = constants_of(decision)
    zero = zeros_of(decision, gains).get("intensity_counts", {}).get("", 0.0)
    foretold = named * (1.0 + gains.get("intensity_counts", {}).get("", 0.0)) + zero
    assert np.mean(((foretold - truth) / sigma) ** 2) < 0.2 * np.mean(((sim - truth) / sigma) ** 2)


def test_a_single_step_keeps_the_gain_beside_a_law_that_is_nil_at_the_other_end():
    """A gleam of 2 % head-on that is said as a loss aslant: what rows of this very step show is both together."""
    rng = np.random.default_rng(4)
    slant = rng.uniform(0.0, 1.2, 900)
    light = rng.uniform(300.0, 2000.0, slant.size)
    sigma, gleam = 0.01 * light, 0.02 * np.exp(-((slant / 0.5) ** 2))
    truth = light * (1.0 + gleam)
    problem = Problem(columns_of(pa.table({
        "step": np.zeros(light.size), "incidence_deg": np.degrees(slant), "sim_intensity_counts": light,
        "sim_intensity_counts_std": sigma, "intensity_counts": truth + sigma * rng.normal(size=light.size),
    })))  # fmt: skip
    state = problem.view.fresh_state()
    named = state["intensity_counts"] * (1.0 + gleam - 0.02)
    decision = SimpleNamespace(
        search=SimpleNamespace(scaled={}),
        problem=problem, final_state=lambda: {**state, "intensity_counts": named}, laws=[], terms=[]
    )
    gain = constants_of(decision)["intensity_counts"][""]
    foretold = named * (1.0 + gain)
    assert np.mean(((foretold - truth) / sigma) ** 2) < 0.05 * np.mean(((light - truth) / sigma) ** 2)


def test_a_gain_of_what_is_corrected_is_no_misfit():
    """After a strong effect the user's gain belongs to the corrected value, not to the simulation's."""
    rng = np.random.default_rng(8)
    light = np.tile(np.linspace(200.0, 4000.0, 40), 25)
    sigma = 0.002 * light
    truth = light / (1.0 + light / 16_000.0)
    table = columns_of(pa.table({
        "step": np.repeat(np.arange(25.0), 40), "sim_intensity_counts": light, "sim_intensity_counts_std": sigma,
        "intensity_counts": 1.06 * truth + sigma * rng.normal(size=light.size),
    }))  # fmt: skip
    (channel,) = Problem(table).data
    assert mean_square(channel, {"intensity_counts": truth}, centred=True) == pytest.approx(1.0, abs=0.15)
    assert mean_square(channel, {"intensity_counts": light}, centred=True) > 100.0


def test_a_gain_and_what_a_step_shares_cannot_stand_for_a_curve_together():
    """Four steps tell no scatter of their own, so a step's gain is free; beside a unit's it must not bend the signal.

    The receiver's supply rail limits it: a long-tailed pair, whose output is tanh of its input.
    """
    rng = np.random.default_rng(5)
    rows = 800
    signal = rng.uniform(50.0, 2500.0, rows)
    seen = 3200.0 * np.tanh(signal / 3200.0)
    seen *= np.mean(signal / seen)
    noise = 0.01 * signal
    table = pa.table({
        "step": np.arange(rows) * 4 // rows, "true_range_m": rng.uniform(0.5, 4.0, rows),
        "sim_intensity_counts": signal, "sim_intensity_counts_std": noise,
        "intensity_counts": seen + rng.normal(0.0, noise),
    })  # fmt: skip
    findings = diagnose(columns_of(table))[0].findings
    assert [f.effect for f in findings] == ["detector.compression"]


def test_a_constant_reaches_as_far_as_the_mean_change_of_a_step():
    """A pattern without a mean leaves no constant to be calibrated away; one that a step has is its own size."""
    problem = Problem(columns_of(zone_table(5, zones=1)))
    (channel,) = problem.data
    step, place = problem.view.number("step"), np.tile(np.arange(20), 6)
    pattern = 2e-3 * np.where(place % 2 == 1, 1.0, -1.0)
    assert reach_of(channel, pattern) == pytest.approx([0.0], abs=1e-9)
    assert reach_of(channel, pattern - 4e-4 * (step == 3)) == pytest.approx([4e-4])


@pytest.mark.parametrize("fitted_here", [True, False])
def test_a_mean_that_unlike_steps_leave_is_no_fitted_zero(fitted_here):
    """Eight steps whose gains differ by half a percent; what a finding adds only a fit on these rows takes back."""
    rng = np.random.default_rng(12)
    step = np.repeat(np.arange(8), 200)
    light = rng.uniform(80.0, 2500.0, step.size)
    sigma = 5.0 + 0.004 * light
    seen = light * (1.0 + 0.005 * rng.normal(size=8)[step]) + sigma * rng.normal(size=step.size)
    truth = light + 2.0 * (light < 1500.0)
    seen = seen + truth - light
    zero = np.average(seen - light, weights=sigma**-2.0) if fitted_here else 0.0
    problem = Problem(columns_of(pa.table({
        "step": step, "sim_intensity_counts": light + zero, "sim_intensity_counts_std": sigma,
        "sim_intensity_counts_repeat_std": 0.005 * light, "intensity_counts": seen,
    })))  # fmt: skip
    problem.data[0].free_zero()
    state = problem.view.fresh_state()
    corrected = {**state, "intensity_counts": state["intensity_counts"] + truth - light}
    found = zeros_of(SimpleNamespace(problem=problem, final_state=lambda: corrected), {})
    if fitted_here:
        mean = np.average(truth - light, weights=sigma**-2.0)
        assert found["intensity_counts"][""] == pytest.approx(-mean, rel=0.2)
    else:
        assert found == {}


@pytest.mark.parametrize("seed", [1, 5, 6])
def test_an_empirical_law_is_nil_wherever_among_the_rows_the_recording_says(make_table, seed):
    """Delays that grow from one end of the sweep; a law of them has its zero in the middle, where there is none."""

    def later(columns, _rng):
        columns["distance_m"] += 4e-5 * (columns["stage_angle_deg"] + 24.3)

    made = make_table(seed, later, duts=1, steps=8, shared=2.5)
    made["sim_distance_m_repeat_std"] = np.full(made["step"].size, 1e-3)
    columns = columns_of(pa.table(made))
    diagnosis = diagnose(columns, effects=[])[0]
    law = next(f.law for f in diagnosis.findings if f.law is not None)
    told = law.correction(features_of(View(columns)), np.ones(columns.n)) + diagnosis.constants["distance_m"]["S0"]
    truth = 4e-5 * (made["stage_angle_deg"] + 24.3)
    assert np.mean((told - truth) ** 2) < 0.3 * np.mean(truth**2)
