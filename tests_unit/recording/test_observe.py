"""Bags become observation tables: the twin agrees with what it emits, and a second simulator can take its place."""

from dataclasses import replace

import numpy as np
import pyarrow.parquet as pq
import pytest

from arl_fixtures.bench.config import load_bench
from arl_fixtures.cli.observe import Foreign, Twins, selection
from arl_fixtures.errors import ConfigError, DataError
from arl_fixtures.metrics.simulated import simulated_blocks
from arl_fixtures.recording.gauge import repeatability
from arl_fixtures.recording.metadata import StepMetadata
from arl_fixtures.recording.observe import Selection, observe, sweep_bag
from arl_fixtures.recording.writer import StepBagWriter
from arl_fixtures.twin.frame import Renderer

CONFIG = load_bench("emulated")
ANGLES = (-7.5, 0.0, 7.5)
FRAMES = 10


def record(folder, *, step=0, gain=1.0, seed=0):
    """One bag of the first DUT with three angles, its intensity scaled by `gain`."""
    dut = CONFIG.dut_settings[0]
    renderer = Renderer(dut.model_copy(update={"gain": dut.gain * gain}), CONFIG.scene)
    metadata = StepMetadata(
        campaign="c", cycle=0, step=step, step_id=f"s{step}", attempt=1, set_temperature_c=25.0, ramp=1,
        started_utc_ns=10**18 + step * 10**12, duts=(dut.serial,), software_version="0", bench_sha256="",
        profile_sha256="", limits_sha256="",
    )  # fmt: skip
    path = folder / f"s{step}"
    with StepBagWriter(path, metadata) as bag:
        for each in simulated_blocks(renderer, ANGLES, frames=FRAMES, seed=1000 * seed + step):
            time_ns = metadata.started_utc_ns + np.arange(FRAMES) * 40_000_000 + each.angle_index * 10**9
            bag.temperatures(int(time_ns[0]), {"T2": 25.0 + each.angle_index, "plate": 24.0})
            bag.block(replace(each, time_ns=time_ns, operating={"laser_current_a": 90.0 + each.angle_index}))
    return path


@pytest.fixture(scope="module")
def bags(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bags")
    return [record(folder, step=step) for step in range(3)]


def table_of(bags, out, simulate, **options):
    observe(bags, out, simulate, CONFIG.scene, **options)
    return pq.read_table(out)


def standardised(table, channel):
    measured, simulated = table[channel].to_numpy(), table[f"sim_{channel}"].to_numpy()
    error = table[f"sim_{channel}_std"].to_numpy() / np.sqrt(table["n_frames"].to_numpy())
    both = np.isfinite(measured) & np.isfinite(simulated)
    return ((measured - simulated) / error)[both]


def test_the_twin_explains_what_it_emits(bags, tmp_path):
    table = table_of(bags, tmp_path / "t.parquet", Twins(CONFIG, None).simulate)
    assert table.num_rows == 3 * len(ANGLES) * 32 * 128
    for channel in ("intensity_counts", "distance_m"):
        z = standardised(table, channel)
        assert abs(z.mean()) < 4 / np.sqrt(z.size)
        assert z.std() == pytest.approx(1.0, abs=5 / np.sqrt(z.size))
    first = table.filter(table.column("stage_angle_deg").to_numpy() == 0.0)
    assert set(first["housing_temperature_c"].to_pylist()) == {26.0}
    assert set(first["laser_current_a"].to_pylist()) == {91.0}
    assert set(table["surface"].to_pylist()) <= set(CONFIG.scene.surface_names)


def test_a_region_holds_the_same_values_as_the_whole(bags, tmp_path):
    twins = Twins(CONFIG, None)
    whole = table_of(bags[:1], tmp_path / "w.parquet", twins.simulate)
    chosen = Selection(first_u=10, last_u=20, stride_u=5, first_v=3, last_v=4)
    part = table_of(bags[:1], tmp_path / "p.parquet", twins.simulate, selection=chosen)
    assert set(part["pixel_u"].to_pylist()) == {10, 15, 20}
    assert part.num_rows == len(ANGLES) * 6
    keys = ("stage_angle_deg", "pixel_u", "pixel_v")
    every, some = (
        {tuple(row[key] for key in keys): row["distance_m"] for row in table.to_pylist()} for table in (whole, part)
    )
    assert all(every[place] == pytest.approx(distance, nan_ok=True) for place, distance in some.items())


def test_another_simulators_bags_take_the_twins_place(bags, tmp_path):
    other = tmp_path / "other"
    for step in range(3):
        record(other, step=step, gain=0.9, seed=7)
    table = table_of(bags, tmp_path / "t.parquet", Foreign(other, Twins(CONFIG, None)).simulate)
    ratio = np.nanmedian(table["sim_intensity_counts"].to_numpy() / table["intensity_counts"].to_numpy())
    assert ratio == pytest.approx(0.9, abs=0.01)
    with pytest.raises(DataError, match="no simulated bag of cycle 0, step 2"):
        table_of(bags, tmp_path / "u.parquet", Foreign(record_two(tmp_path), Twins(CONFIG, None)).simulate)
    assert not (tmp_path / "u.parquet").exists()
    assert not list(tmp_path.glob("u.parquet*"))


def record_two(tmp_path):
    folder = tmp_path / "two"
    for step in range(2):
        record(folder, step=step)
    return folder


def test_gauge_study_finds_the_scatter_that_all_values_of_a_step_share(tmp_path):
    rng = np.random.default_rng(3)
    scatters = 0.004 * rng.standard_normal(8)
    bags = [sweep_bag(record(tmp_path, step=step, gain=1 + scatters[step])) for step in range(8)]
    found = repeatability(bags)
    assert found["intensity_counts"] == pytest.approx(scatters.std(ddof=1), rel=0.1)
    assert found["distance_m"] < 1e-4
    with pytest.raises(DataError, match="at least 3 repeats"):
        repeatability(bags[:2])


@pytest.mark.parametrize("text", ["5", "9-3,0-1", "0-9/0,0-1", "a-b,c-d"])
def test_a_wrong_region_is_refused_in_one_line(text):
    with pytest.raises(ConfigError, match="--pixels"):
        selection(text)


def test_a_simulators_few_frames_tell_a_scatter_that_is_not_too_small(bags, tmp_path):
    other = tmp_path / "other"
    for step in range(3):
        record(other, step=step, gain=1.0, seed=7)
    twin, foreign = (
        table_of(bags, tmp_path / f"{name}.parquet", source.simulate)
        for name, source in (("a", Twins(CONFIG, None)), ("b", Foreign(other, Twins(CONFIG, None))))
    )
    ratio = foreign["sim_intensity_counts_std"].to_numpy() / twin["sim_intensity_counts_std"].to_numpy()
    assert np.nanmean(ratio) == pytest.approx(1.0, abs=0.02)
