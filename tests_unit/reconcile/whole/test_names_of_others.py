"""Tables whose columns have other names and units than the observation format's."""

import json

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st

from arl_fixtures.reconcile import reconcile as diagnosing
from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.columns import Given
from arl_fixtures.reconcile.command import predict, reconcile
from arl_fixtures.reconcile.effects_common import temperature_drivers
from arl_fixtures.reconcile.roles import Role, role_of
from arl_fixtures.reconcile.synonyms import find_synonyms
from arl_fixtures.reconcile.table import load_table
from arl_fixtures.reconcile.view import View


def of_another_lab(columns):
    """The bench's table in the words of someone else: kelvin, minutes, columns and rows."""
    renamed = {
        "pixel_u": "col", "pixel_v": "row", "azimuth_deg": "az_deg", "elevation_deg": "el_deg",
        "stage_angle_deg": "turntable_deg", "housing_temperature_c": "housing_temperature_degc",
    }  # fmt: skip
    made = {renamed.get(name, name): values for name, values in columns.items()}
    made["tof_temperature_k"] = made.pop("tof_temperature_c") + 273.15
    made["elapsed_min"] = made.pop("time_s") / 60.0
    return made


FEW = (
    "timing.temperature_offset", "timing.thermal_lag", "timing.range_walk", "timing.clock_scale",
    "detector.gain_temperature", "mount.tilt", "target.reflectance_error",
)  # fmt: skip
"""What may be named: columns and units are tried here, not the whole library."""


def cooler_is_farther(columns, _rng):
    columns["distance_m"] = columns["distance_m"] + 4e-5 * (columns["tof_temperature_c"] - 40.0)


@pytest.fixture(scope="module")
def theirs(tmp_path_factory, make_table, save):
    """The table in their words, and the folder of its diagnosis (to be read only)."""
    folder, table = tmp_path_factory.mktemp("theirs"), of_another_lab(make_table(3, cooler_is_farther, steps=6))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(diagnosing, "library", lambda: {name: library()[name] for name in FEW})
        reconcile(save(folder / "theirs.parquet", table), folder / "out")
    return table, folder / "out"


def test_the_answer_is_that_of_the_formats_names_in_the_tables_own(theirs, tmp_path, make_table, save, knows_only):
    knows_only(*FEW)
    table, out = make_table(3, cooler_is_farther, steps=6), {"ours": tmp_path / "ours", "theirs": theirs[1]}
    reconcile(save(tmp_path / "ours.parquet", table), out["ours"])
    ours, theirs = (json.loads((out[n] / "diagnosis.json").read_text())["findings"] for n in ("ours", "theirs"))
    assert [f["effect"] for f in theirs] == [f["effect"] for f in ours] == ["timing.temperature_offset"]
    assert [p["value"] for p in theirs[0]["law"]["parameters"]] == pytest.approx(
        [p["value"] for p in ours[0]["law"]["parameters"]]
    )
    assert "tof_temperature_k" in theirs[0]["drivers"]
    assert "(tof_temperature_k - 273.15)" in theirs[0]["law"]["expression"]
    said = json.dumps(theirs)
    assert not any(name in said for name in ("tof_temperature_c", "azimuth_deg", "pixel_u"))
    pages = [(out[name] / "diagnosis.html").read_text() for name in ("ours", "theirs")]
    assert pages[1].count("<svg") == pages[0].count("<svg")  # the pictures find their columns
    assert "time_s = (60 * elapsed_min)" in pages[1]


def test_a_model_foretells_tables_in_the_same_words(theirs, tmp_path, save):
    table, out = theirs
    few = {name: values[:3] for name, values in table.items() if name not in ("distance_m", "intensity_counts")}
    predict(out, save(tmp_path / "few.parquet", few), tmp_path / "said.parquet")
    said = pq.read_table(tmp_path / "said.parquet")["corrected_distance_m"].to_numpy()
    true = few["sim_distance_m"] + 4e-5 * (few["tof_temperature_k"] - 273.15 - 40.0)
    assert np.all(np.abs(said - said.mean() - true + true.mean()) < 1e-4)


def test_what_is_meant_by_two_columns_is_meant_by_none():
    x = np.arange(4.0)
    assert find_synonyms({"az_deg": x, "beam_azimuth_deg": x}, ()) == {}
    assert find_synonyms({"az_deg": x, "azimuth_deg": x}, ()) == {}
    assert find_synonyms({"az_deg": x, "sim_az_deg": x}, ()) == {}  # a channel keeps its name
    assert find_synonyms({"col": x, "row": x + 0.5}, ()) == {}  # no numbers of pixels
    assert find_synonyms({"gain_k": x}, ()) == {}  # nothing is at 3 K


def test_the_angles_of_a_mirror_are_those_of_its_rays():
    x = np.linspace(-20.0, 20.0, 5)
    known = {"azimuth_deg": Given("mirror_x_deg"), "elevation_deg": Given("mirror_y_deg")}
    assert find_synonyms({"mirror_x_deg": x, "mirror_y_deg": x}, ()) == known


@given(st.floats(100.0, 900.0), st.floats(1e-3, 1e3))
def test_units_come_back(kelvin, minutes):
    assert Given("t_k", 1.0, -273.15).back(kelvin - 273.15) == pytest.approx(kelvin)
    assert Given("t_min", 60.0).back(60.0 * minutes) == pytest.approx(minutes)


@pytest.mark.parametrize(
    ("name", "role"),
    [
        ("counts", Role.INTENSITY), ("peak_v", Role.INTENSITY), ("level_adu", Role.INTENSITY), ("lamp_v", Role.OTHER),
        ("tof_ps", Role.DISTANCE), ("depth_cm", Role.DISTANCE), ("case_degc", Role.TEMPERATURE),
        ("pulse_width_ns", Role.OTHER),
        ("supply_power_w", Role.OTHER),
        ("tec_power_mw", Role.OTHER),
        ("laser_power_w", Role.INTENSITY),
        ("detector_power_uw", Role.INTENSITY),
        ("optical_pump_power_w", Role.INTENSITY),
    ],
)  # fmt: skip
def test_roles_of_channels_that_others_have(name, role):
    assert role_of(name, {name}) is role


def test_a_time_of_flight_is_a_distance(tmp_path, make_table, save, walk, knows_only):
    """The walk of a threshold in picoseconds, there and back: test_reconcile_command.py has it in metres."""
    knows_only(*FEW)
    columns = make_table(5, walk, steps=4)
    for name in [n for n in columns if "distance_m" in n]:
        columns[name.replace("distance_m", "tof_ps")] = columns.pop(name) * 2e12 / 299_792_458.0
    path = save(tmp_path / "ps.parquet", columns)
    assert any(c.role is Role.DISTANCE for c in load_table(path).channels)
    assert [f.effect for f in reconcile(path, tmp_path / "ps").findings] == ["timing.range_walk"]


def test_channels_are_never_renamed(tmp_path):
    pixels = np.arange(40)
    table = {"az_deg": pixels * 1.0, "sim_az_deg": pixels * 1.0, "plate_degc": 20.0 + pixels}
    pq.write_table(pa.table(table), tmp_path / "table.parquet")
    columns = load_table(tmp_path / "table.parquet")
    assert [c.name for c in columns.channels] == ["az_deg"]
    assert set(columns.given) == {"plate_c"}


def test_a_window_is_nearer_to_its_frost_than_the_dew_point_of_the_room(tmp_path):
    rng = np.random.default_rng(1)
    table = {
        name: rng.uniform(-20.0, 40.0, 50) for name in ("dew_point_c", "board_c", "window_c", "room_c", "laser_c")
    }
    table |= {"echo_counts": rng.uniform(1.0, 2.0, 50), "sim_echo_counts": rng.uniform(1.0, 2.0, 50)}
    pq.write_table(pa.table(table), tmp_path / "table.parquet")
    view = View(load_table(tmp_path / "table.parquet"))
    assert temperature_drivers(view, "window_temperature_c", limit=1) == ("window_c",)
    assert temperature_drivers(view, "laser_temperature_c", "housing_temperature_c")[0] == "laser_c"
    assert "window_c" not in temperature_drivers(view, "board_temperature_c")
    assert set(temperature_drivers(view)) == {"board_c", "window_c", "laser_c"}


def test_shots_of_a_table_without_steps_share_the_energy_of_their_pulse(tmp_path, save):
    """Photons of twelve pixels in 400 pulses, each with an energy of its own; without that nothing is found."""
    for jitter, found in ((0.03, ["laser.pulse_energy_jitter"]), (0.0, [])):
        rng = np.random.default_rng(7)
        shot, pixel = (a.ravel() for a in np.meshgrid(np.arange(400), np.arange(12), indexing="ij"))
        light = np.linspace(300.0, 2500.0, 12)[pixel]
        energy = rng.gamma(1.0 / jitter**2, jitter**2, 400) if jitter else np.ones(400)
        table = {
            "shot_id": shot, "channel_no": pixel, "sim_echo_adu": light, "sim_echo_adu_std": np.sqrt(light),
            "echo_adu": rng.poisson(light * energy[shot]).astype(float),
        }  # fmt: skip
        diagnosis = reconcile(save(tmp_path / f"{jitter}.parquet", table), tmp_path / f"{jitter}")
        assert [f.effect for f in diagnosis.findings] == found


def test_a_laser_in_milliamperes_and_kelvin_rolls_off(tmp_path, save):
    """Threshold and slope at a junction that its own heat warms, light and heat in balance; currents at random."""
    rng = np.random.default_rng(4)
    current, sink = rng.uniform(20.0, 160.0, 400), rng.choice(np.linspace(288.0, 343.0, 6), 400)

    def light(sink_k):
        junction, out = np.array(sink_k), np.zeros(400)
        for _ in range(200):
            threshold = 25.0 * np.exp((junction - 298.0) / 90.0)
            out = 0.5 * np.exp(-(junction - 298.0) / 500.0) * np.logaddexp(0.0, (current - threshold) / 0.7) * 0.7
            junction = 0.5 * junction + 0.5 * (sink_k + 0.08 * (1.8 * current - out))
        return out

    cold, seen = light(np.full(400, 298.0)), light(sink)
    scatter = np.hypot(0.1, 0.005 * cold)
    table = {
        "bias_ma": current, "heatsink_k": sink, "n_frames": np.full(400, 2.0), "sim_monitor_uw": cold,
        "sim_monitor_uw_std": scatter, "monitor_uw": seen + scatter / np.sqrt(2.0) * rng.normal(size=400),
    }  # fmt: skip
    (found,) = reconcile(save(tmp_path / "table.parquet", table), tmp_path / "out").findings
    assert found.effect == "laser.thermal_rolloff"
    assert {"bias_ma", "heatsink_k"} <= set(found.drivers)
