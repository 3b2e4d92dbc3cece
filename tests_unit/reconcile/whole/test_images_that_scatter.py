"""Images of a step that scatter by more than pixels do: no supply's doing, and told though nobody declared it."""

import numpy as np
import pyarrow as pa
import pytest

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.channel_data import ChannelData
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.search import Search
from arl_fixtures.reconcile.table import columns_of

RAILS = ("rail_1v0_v", "rail_1v8_v", "rail_3v3_v", "rail_5v0_v", "rail_12v0_v")
NAMES = ("electronics.rail_coupling", "bench.repeatability", "detector.pixel_response", "detector.gain_temperature")


def flickering(seed, *, of_images, of_pixels=0.005, held=1.0):
    """Light of 26 pixels of two devices at five angles of eight steps; every image, and every pixel, is off.

    A share of the rows is held.
    """
    rng = np.random.default_rng(seed)
    axes = np.meshgrid(np.arange(2), np.arange(8), np.arange(5), np.arange(26), indexing="ij")
    dut, step, angle, pixel = (a.ravel() for a in axes)
    kept = rng.random(dut.size) > 0.05
    dut, step, angle, pixel = (a[kept] for a in (dut, step, angle, pixel))
    light = np.exp(rng.uniform(np.log(70.0), np.log(3000.0), (5, 26)))[angle, pixel]
    image = dut * 40 + step * 5 + angle
    off = of_images * rng.normal(size=80)[image] + of_pixels * rng.normal(size=(2, 26))[dut, pixel]
    error = np.sqrt(50.0 + 0.4 * light)
    table = {
        "dut": np.array(["A", "B"])[dut], "step": step.astype(float), "stage_angle_deg": 9.0 * angle - 20.0,
        "pixel_u": pixel * 5.0, "pixel_v": np.full(pixel.size, 3.0), "n_frames": np.full(pixel.size, 5.0),
        "housing_temperature_c": 11.0 * step - 5.0, "sim_intensity_counts": light, "sim_intensity_counts_std": error,
        "intensity_counts": light * (1.0 + off) + error / np.sqrt(5.0) * rng.normal(size=pixel.size),
    }  # fmt: skip
    table |= {name: float(name[5:-2].replace("v", ".")) + 1e-3 * rng.normal(size=80)[image] for name in RAILS}
    some = np.random.default_rng(seed).random(pixel.size) < held
    return columns_of(pa.table({name: values[some] for name, values in table.items()}))


def test_a_supply_that_is_read_with_every_image_has_no_part_in_it():
    columns = flickering(2, of_images=0.024)
    found = {f.effect: f for f in diagnose(columns, effects=[library()[name] for name in NAMES])[0].findings}
    assert found.keys() - {"detector.pixel_response"} == {"bench.repeatability"}
    assert "stage angle of a step" in found["bench.repeatability"].expression


def test_what_images_share_is_weighed_as_all_their_errors_ask():
    """The approximate likelihood of a change against that of the whole covariance matrix."""
    columns = flickering(1, of_images=0.024)
    problem = Search(columns, []).full
    (d,), residual = problem.data, problem.data[0].residual(problem.view.fresh_state())
    rail = columns.numbers[RAILS[0]][d.use]
    change = d.scale * (rail - rail.mean())
    tangent = d.whiten(change)
    told = float(tangent @ d.whiten(residual)) / float(tangent @ tangent), float(tangent @ tangent) ** -0.5
    exact, error = by_generalised_least_squares(d, change, residual)
    assert told[1] == pytest.approx(error, rel=0.1)
    assert abs(told[0] - exact) < error


def by_generalised_least_squares(d: ChannelData, change, residual):
    covariance = np.diag(d.root_weight**-2.0)
    for level in d.levels:
        member = level.code[:, None] == np.arange(level.count)
        shared = np.where(member, (d.tau[level.name] * level.scale)[:, None], 0.0)
        covariance += shared @ shared.T
    regressors = np.column_stack([change, *(np.where(d.unit == k, d.scale, 0.0) for k in np.unique(d.unit))])
    weighed = np.linalg.solve(covariance, regressors)
    inverse = np.linalg.inv(regressors.T @ weighed)
    return float((inverse @ (weighed.T @ residual))[0]), float(np.sqrt(inverse[0, 0]))


def test_images_that_scatter_by_less_than_their_rows_are_none():
    columns = flickering(4, of_images=0.002, of_pixels=0.0)
    assert diagnose(columns, effects=[library()[name] for name in NAMES])[0].findings == []


@pytest.mark.parametrize("seed", range(4))
def test_a_channel_is_as_likely_in_whichever_order_its_scatters_are_told(seed):
    """Else a name gains by what it lets the scatters of another channel do."""
    problem = Search(flickering(seed, of_images=0.006, of_pixels=0.002, held=0.2), []).full
    (d,), residual = problem.data, problem.data[0].residual(problem.view.fresh_state())
    likelihood = {}
    for first in ({"frame", "step"}, {"pixel", "angle"}):
        d.levels = tuple(sorted(d.levels, key=lambda level: level.name not in first))
        likelihood[min(first)] = [d.fit_scatter(residual, lost=lost)[0] for lost in (0.0, 3.0)]
    assert likelihood["frame"] == pytest.approx(likelihood["angle"], abs=1e-6)
