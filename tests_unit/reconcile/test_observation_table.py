"""Reading tables: what is used, what is left out and why."""

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st

from arl_fixtures.errors import DataError
from arl_fixtures.reconcile.columns import find_channels
from arl_fixtures.reconcile.parcels import batches_of_parcels, read_rows
from arl_fixtures.reconcile.roles import Role, role_of, unit_of
from arl_fixtures.reconcile.table import columns_of, load_table


def test_infinities_are_not_observed_and_the_report_says_so():
    columns = columns_of(pa.table({"distance_m": [1.0, np.inf, 2.0] * 2, "sim_distance_m": [1.0, 1.5, 2.0] * 2}))
    assert np.isnan(columns.numbers["distance_m"][1])
    assert "2 infinite" in columns.ignored["distance_m (rows)"]


def test_an_unpaired_simulation_is_left_out_where_another_channel_can_be_used():
    columns = columns_of(
        pa.table({"distance_m": [1.0, 2.0] * 2, "sim_distance_m": [1.0, 2.0] * 2, "sim_phase_deg": [1.0, 2.0] * 2})
    )
    assert [c.name for c in columns.channels] == ["distance_m"]
    assert "phase_deg" in columns.ignored["sim_phase_deg"]


def test_scatter_is_a_channel_only_with_its_simulation():
    table = {"distance_m": [1.0, 2.0] * 2, "sim_distance_m": [1.0, 2.0] * 2, "distance_m_std": [0.1] * 4}
    assert [c.name for c in columns_of(pa.table(table)).channels] == ["distance_m"]
    table["sim_distance_m_std"] = [0.1] * 4
    channels = columns_of(pa.table(table)).channels
    assert [(c.name, c.role) for c in channels] == [("distance_m", Role.DISTANCE), ("distance_m_std", Role.SCATTER)]


def test_serial_numbers_and_booleans_are_categories_with_sorted_labels():
    columns = columns_of(
        pa.table(
            {
                "distance_m": [1.0, 2.0] * 2,
                "sim_distance_m": [1.0, 2.0] * 2,
                "dut": [12, 7] * 2,
                "mixed": [True, None] * 2,
            }
        )
    )
    codes, labels = columns.categories["dut"]
    assert [labels[c] for c in codes] == ["12", "7"] * 2
    codes, labels = columns.categories["mixed"]
    assert (list(codes), labels) == ([0, -1] * 2, ("true",))


@pytest.mark.parametrize(
    ("name", "role", "unit"),
    [
        ("intensity_counts", Role.INTENSITY, "counts"),
        ("photodiode_a", Role.INTENSITY, "A"),
        ("laser_current_a", Role.OTHER, "A"),
        ("plate_temperature_c", Role.TEMPERATURE, "°C"),
        ("rail_1v8_v", Role.OTHER, "V"),
        ("valid_fraction", Role.FRACTION, "1"),
    ],
)
def test_a_name_tells_role_and_unit(name, role, unit):
    assert (role_of(name, {name}), unit_of(name)) == (role, unit)


def test_of_a_large_table_whole_cycles_are_read_and_batches_hold_whole_steps(tmp_path):
    rng = np.random.default_rng(2)
    dut, cycle, step, pixel = (a.ravel() for a in np.meshgrid(*map(np.arange, (2, 90, 5, 8)), indexing="ij"))
    order = rng.permutation(len(dut))
    values = (10.0 * step + pixel)[order]
    table = {
        "dut": np.array(["a", "b"])[dut[order]],
        "cycle": cycle[order],
        "step": step[order],
        "distance_m": values,
    }
    path = tmp_path / "t.parquet"
    pq.write_table(pa.table({**table, "sim_distance_m": values}), path, row_group_size=1_000)
    columns = load_table(path, limit=4_000)
    size = np.bincount(columns.group("dut", "cycle"))
    assert set(size) == {40}
    assert 3_000 < columns.n < 5_000
    assert "of 7200 were searched" in columns.ignored["(rows)"]
    file = pq.ParquetFile(path)
    batches = batches_of_parcels(file, most=900)
    assert np.array_equal(np.sort(np.concatenate(batches)), np.arange(7_200))
    for rows in batches:
        piece = read_rows(path, file, rows)
        assert len(rows) <= 900
        assert np.array_equal(piece["distance_m"].to_numpy(), values[rows])
        assert set(piece.group_by(["dut", "cycle"]).aggregate([([], "count_all")])["count_all"].to_pylist()) == {40}


def test_of_a_large_table_without_steps_whole_images_are_read(tmp_path):
    angle, pixel = (a.ravel() for a in np.meshgrid(np.arange(400.0), np.arange(50.0), indexing="ij"))
    table = pa.table({"stage_angle_deg": angle, "pixel_u": pixel, "distance_m": pixel, "sim_distance_m": pixel})
    pq.write_table(table, tmp_path / "t.parquet")
    columns = load_table(tmp_path / "t.parquet", limit=6_000)
    count = np.unique(columns.numbers["stage_angle_deg"], return_counts=True)[1]
    assert set(count) == {50}
    assert 4_000 < columns.n < 8_000


@given(st.binary(max_size=200))
def test_bytes_that_are_no_table_give_one_line(tmp_path_factory, blob):
    path = tmp_path_factory.mktemp("t") / "t.parquet"
    path.write_bytes(blob)
    with pytest.raises(DataError) as caught:
        load_table(path)
    assert "\n" not in str(caught.value)


def test_a_lone_voltage_is_how_light_was_read_and_beside_a_signal_it_is_not():
    alone = find_channels({"voltage_v", "sim_voltage_v", "rail_5v0_v", "sim_rail_5v0_v"})
    assert {c.name: c.role for c in alone} == {"voltage_v": Role.INTENSITY, "rail_5v0_v": Role.OTHER}
    beside = find_channels({"voltage_v", "sim_voltage_v", "distance_m", "sim_distance_m"})
    assert {c.name: c.role for c in beside} == {"voltage_v": Role.OTHER, "distance_m": Role.DISTANCE}
    loaded = find_channels({"voltage_v", "sim_voltage_v", "load_current_a"})
    assert [c.role for c in loaded] == [Role.OTHER]
