"""Dry friction: heating and cooling differ after full soak, and unseen schedules of temperatures are foretold."""

import json

import numpy as np
import pyarrow.parquet as pq
import pytest

from arl_fixtures.errors import DataError
from arl_fixtures.reconcile.columns import Columns
from arl_fixtures.reconcile.command import predict, reconcile
from arl_fixtures.reconcile.features import features_of
from arl_fixtures.reconcile.roles import Role, play_name
from arl_fixtures.reconcile.table import load_table
from arl_fixtures.reconcile.view import View

HOUSING, PLAY = "housing_temperature_c", play_name("housing_temperature_c")
SHARED = 0.004


def seated_lens(seed, levels_c, *, cycles):
    """A lens in its seat: the friction force builds up with what the barrel moves beneath it (Dahl's equation, 1968).

    Marched in tenths of a kelvin along the ramps; the light that it loses goes with the force.
    """
    rng = np.random.default_rng(seed)
    force, forces, here = 0.0, [], levels_c[0]
    for level in levels_c:
        for _ in range(round(abs(level - here) / 0.1)):
            way = np.sign(level - here)
            force += 0.1 * way * (1.0 - force * way) / 9.0
        here = level
        forces.append(force)
    cycle, step, pixel = (
        a.ravel() for a in np.meshgrid(np.arange(cycles), np.arange(len(levels_c)), np.arange(60), indexing="ij")
    )
    light = np.geomspace(150.0, 3000.0, 60)[pixel]
    sigma = 0.02 * light
    through = 1.0 - 0.006 * np.array(forces)[step]
    gain = 1.0 + SHARED * rng.normal(size=(cycles, len(levels_c)))[cycle, step]
    table = {
        "cycle": cycle + 1.0, "step": step.astype(float), "time_s": 1200.0 * step + 0.1 * pixel,
        "set_temperature_c": levels_c[step], "ramp": np.sign(np.diff(levels_c, prepend=-99.0) + 0.1)[step],
        HOUSING: levels_c[step] + rng.normal(0.0, 0.6, (cycles, len(levels_c)))[cycle, step],
        "ambient_temperature_c": 22.0 + rng.normal(0.0, 0.3, (cycles, len(levels_c)))[cycle, step],
        "sim_intensity_counts": light, "sim_intensity_counts_std": sigma, "n_frames": np.full(step.size, 4.0),
        "sim_intensity_counts_repeat_std": SHARED * light,
        "intensity_counts": light * through * gain + 0.5 * sigma * rng.normal(size=step.size),
    }  # fmt: skip
    return table, light * through


def up_and_down(highest, kelvin):
    rising = np.arange(-40.0, highest + 1.0, kelvin)
    return np.concatenate([rising, rising[::-1]])


def test_what_sticks_is_told_by_the_way_of_the_temperature_and_foretold_for_other_ways(save, tmp_path):
    seen, _ = seated_lens(3, up_and_down(80.0, 15.0), cycles=4)
    unseen, truth = seated_lens(4, up_and_down(65.0, 21.0), cycles=1)
    reconcile(save(tmp_path / "t.parquet", seen), tmp_path / "out")
    (finding,) = json.loads((tmp_path / "out" / "diagnosis.json").read_text())["findings"]
    assert finding["effect"] == "unknown"
    assert finding["drivers"] == ["ramp", HOUSING]
    simulated = {name: values for name, values in unseen.items() if name != "intensity_counts"}
    predict(tmp_path / "out", save(tmp_path / "u.parquet", simulated), tmp_path / "p.parquet")
    said = pq.read_table(tmp_path / "p.parquet")["corrected_intensity_counts"].to_numpy()
    left, before = (
        float(np.sum(((x - truth) / unseen["sim_intensity_counts_std"]) ** 2))
        for x in (said, unseen["sim_intensity_counts"])
    )
    assert 1.0 - left / before > 0.75


def test_a_table_to_be_predicted_needs_the_temperature_whose_way_counts(save, tmp_path):
    seen, _ = seated_lens(3, up_and_down(80.0, 15.0), cycles=4)
    reconcile(save(tmp_path / "t.parquet", seen), tmp_path / "out")
    unseen, _ = seated_lens(4, up_and_down(65.0, 21.0), cycles=1)
    simulated = {name: values for name, values in unseen.items() if name != "intensity_counts"}

    def foretold(name, **columns):
        path = save(tmp_path / f"{name}.parquet", {**simulated, **columns})
        predict(tmp_path / "out", path, tmp_path / "said.parquet")
        return pq.read_table(tmp_path / "said.parquet")["corrected_intensity_counts"].to_numpy()

    own = foretold("own")
    assert np.array_equal(own, foretold("other", case_temperature_c=simulated["ambient_temperature_c"]))
    still = foretold("still", **{HOUSING: np.full(own.size, 25.0)})
    assert np.allclose(still / simulated["sim_intensity_counts"], (still / simulated["sim_intensity_counts"])[0])
    del simulated[HOUSING]
    with pytest.raises(DataError, match=f"lacks column '{HOUSING}'"):
        foretold("lacking")


def leans(save, tmp_path, name, **columns):
    rows = len(next(iter(columns.values())))
    made = {**columns, "sim_intensity_counts": np.full(rows, 9.0), "intensity_counts": np.full(rows, 9.0)}
    table: Columns = load_table(save(tmp_path / f"{name}.parquet", made))
    assert [c.role for c in table.channels] == [Role.INTENSITY]
    return features_of(View(table)).get(PLAY)


def test_a_play_is_taken_up_before_anything_turns(save, tmp_path):
    order = np.array([2, 0, 1, 5, 3, 4, 6])  # rows come in no order
    way = np.array([0.0, 6.0, 40.0, 52.0, 46.0, 34.0, -20.0])
    found = leans(save, tmp_path, "turning", step=order.astype(float), **{HOUSING: way[order]})
    assert np.array_equal(found, [1.0, 0.0, 0.5, -0.5, 1.0, 0.5, -1.0])


def test_each_run_begins_in_the_middle_and_an_unread_temperature_tells_nothing(save, tmp_path):
    columns = {
        "cycle": np.repeat([1.0, 2.0], 3), "step": np.tile([0.0, 1.0, 2.0], 2),
        HOUSING: np.array([20.0, 60.0, 54.0, 60.0, 57.0, np.nan]),
    }  # fmt: skip
    found = leans(save, tmp_path, "runs", **columns)
    assert np.array_equal(found, [0.0, 1.0, 0.5, 0.0, -0.25, np.nan], equal_nan=True)
    assert leans(save, tmp_path, "no order", **{HOUSING: columns[HOUSING]}) is None
