"""Maps from a bag: what was put into the DUT is seen in them, and what is missing says why."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from report_samples import journal, report_of, step_id, step_of, value

from arl_fixtures.bench.config import load_bench
from arl_fixtures.bench.keep import keep_bench
from arl_fixtures.errors import ConfigError, DataError
from arl_fixtures.journal.entries import Bag
from arl_fixtures.metrics.collect import collect
from arl_fixtures.metrics.conditions import Conditions
from arl_fixtures.metrics.geometry import GeometryCache
from arl_fixtures.metrics.registry import remember
from arl_fixtures.metrics.simulated import simulated_blocks
from arl_fixtures.metrics.step import StepData
from arl_fixtures.recording.metadata import StepMetadata
from arl_fixtures.recording.reader import StepBag
from arl_fixtures.recording.writer import StepBagWriter
from arl_fixtures.report.blocks import Picture
from arl_fixtures.report.cycles import load_cycles
from arl_fixtures.report.document import make_report
from arl_fixtures.report.maps import MapMaker
from arl_fixtures.report.write import map_maker
from arl_fixtures.twin.frame import Renderer

STEP = step_id(0, 0, 25.0)
BENCH = """
name: one-dut
clock: virtual
chiller: {driver: huber_pb, url: emulated}
thermometer: {driver: dcon, url: emulated, housings: [2]}
stage: {driver: tmcl, url: emulated}
relays: {driver: conrad, url: emulated}
duts: {driver: hfl110, url: emulated, units: [dut.yaml]}
"""
ANGLES = tuple(-60.0 + 1.8 * k for k in range(67))
FRAMES = 4


def record(path: Path, dut, seed):
    metadata = StepMetadata(
        campaign="trial",
        cycle=0,
        step=0,
        step_id=STEP,
        attempt=1,
        set_temperature_c=25.0,
        ramp=1,
        started_utc_ns=0,
        duts=(dut.serial,),
        software_version="0",
        bench_sha256="",
        profile_sha256="",
        limits_sha256="",
    )
    with StepBagWriter(path, metadata) as bag:
        for block in simulated_blocks(Renderer(dut), ANGLES, frames=FRAMES, seed=seed, operating={}):
            bag.block(block)
        return bag.close()


@pytest.fixture(scope="module")
def campaign(tmp_path_factory):
    """A folder with bench file, bag of a DUT whose beam has shifted, its reference, and the journal."""
    folder = tmp_path_factory.mktemp("campaign")
    (folder / "one-dut.yaml").write_text(BENCH)
    (folder / "dut.yaml").write_text("serial: SN-1\n")
    bench = load_bench(str(folder / "one-dut.yaml"))
    (dut,) = bench.dut_settings
    shifted = dut.model_copy(update={"beam": dut.beam.model_copy(update={"azimuth_shift_deg": 3.0})})
    receipt = record(folder / "bags" / STEP, shifted, 1)
    record(folder / "before", dut, 2)
    sweep = collect(StepBag(folder / "before").blocks(), ["SN-1"]).statistics["SN-1"].summary()
    geometry = GeometryCache(dut, bench.scene).at(sweep.stage_angle_deg)
    step = StepData(dut=dut, conditions=Conditions(set_temperature_c=25.0), sweep=sweep, geometry=geometry)
    (folder / "references").mkdir()
    remember(step).save(folder / "references" / "SN-1.npz")
    bag = Bag(
        step_id=STEP,
        attempt=1,
        path=f"bags/{STEP}",
        sha256=receipt.sha256,
        size_bytes=receipt.size_bytes,
        message_count=receipt.message_count,
    )
    journal(folder, step_of(0, 0, 25.0, value(STEP, "SN-1", 0.0), bag=bag), [STEP], bench_sha256=bench.sha256)
    return folder


def maps_of(folder, maker=None):
    (cycle,) = load_cycles([folder])
    maker = maker or map_maker(cycle.record, str(folder / "one-dut.yaml"))
    return maker.of_attempt(cycle.record, cycle.at_temperature(25.0))["SN-1"]


def test_maps_show_what_has_become_of_the_dut(campaign):
    power, change, sigma_i, sigma_d, error = maps_of(campaign)
    assert np.nanmean(power.values) == pytest.approx(1.0, abs=1e-6)
    # a beam that moved to the right brings light there and takes it from the left
    left, right = np.nanmean(change.values[:, :16]), np.nanmean(change.values[:, -16:])
    assert right > 1.0
    assert left < -1.0
    assert 10.0 < np.nanmedian(sigma_i.values) < 50.0
    assert 2.0 < np.nanmedian(sigma_d.values) < 12.0
    assert abs(np.nanmedian(error.values)) < 0.2


def test_the_report_holds_a_sheet_of_maps_and_is_the_same_twice(campaign):
    cycles = load_cycles([campaign])
    pages = [make_report(cycles, map_maker(cycles[0].record, str(campaign / "one-dut.yaml"))) for _ in range(2)]
    assert pages[0].pictures == pages[1].pictures
    assert pages[0].pictures["maps-1-1.png"].startswith(b"\x89PNG")
    assert any(
        isinstance(block, Picture) and block.name == "maps-1-1.png" for s in pages[0].sections for block in s.blocks
    )


def copied(campaign, tmp_path):
    return Path(shutil.copytree(campaign, tmp_path / "copy"))


def test_a_bag_that_is_gone_leaves_the_maps_missing_and_names_no_folder(campaign, tmp_path):
    folder = copied(campaign, tmp_path)
    shutil.rmtree(folder / "bags")
    reasons = {each.reason for each in maps_of(folder)}
    assert all(each.values is None for each in maps_of(folder))
    assert len(reasons) == 1
    assert f"bags/{STEP}" in reasons.pop()
    assert str(tmp_path) not in "".join(each.reason for each in maps_of(folder))


def test_a_bag_that_was_changed_is_not_shown(campaign, tmp_path):
    folder = copied(campaign, tmp_path)
    (file,) = (folder / "bags" / STEP).glob("*.mcap")
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 1
    file.write_bytes(content)
    assert all(each.values is None and each.reason for each in maps_of(folder))


def test_without_its_reference_only_the_change_is_missing(campaign, tmp_path):
    folder = copied(campaign, tmp_path)
    shutil.rmtree(folder / "references")
    missing = [each.title for each in maps_of(folder) if each.values is None]
    assert missing == ["change of P_o against the reference / %"]


def test_without_the_bench_file_the_report_still_comes(campaign):
    (cycle,) = load_cycles([campaign])
    maker = map_maker(cycle.record)
    assert {each.reason for each in maps_of(campaign, maker)} == {
        f"the bench file with SHA-256 {cycle.record.identity.bench_sha256[:12]}… is not at hand (--bench FILE)"
    }
    assert report_of(campaign / "session-0001.jsonl").verdict.text == "PASS"


def test_the_copies_that_a_session_keeps_are_all_that_the_maps_need(campaign, tmp_path):
    folder = copied(campaign, tmp_path)
    keep_bench(load_bench(str(folder / "one-dut.yaml")), folder)
    (folder / "one-dut.yaml").unlink()
    (folder / "dut.yaml").unlink()
    (cycle,) = load_cycles([folder])
    assert all(each.values is not None for each in maps_of(folder, map_maker(cycle.record)))


def test_copies_that_were_changed_are_not_used(campaign, tmp_path):
    folder = copied(campaign, tmp_path)
    kept = keep_bench(load_bench(str(folder / "one-dut.yaml")), folder)
    (kept / "dut-001.yaml").write_text("serial: SN-1\nrows: 16\n")
    (cycle,) = load_cycles([folder])
    assert {each.values is None for each in maps_of(folder, map_maker(cycle.record))} == {True}


def test_a_bench_file_that_changes_while_the_session_begins_is_refused(campaign, tmp_path):
    folder = copied(campaign, tmp_path)
    bench = load_bench(str(folder / "one-dut.yaml"))
    (folder / "dut.yaml").write_text("serial: SN-2\n")
    with pytest.raises(ConfigError, match="changed while the session began"):
        keep_bench(bench, folder)


def test_maps_of_steps_that_are_asked_for_and_none_of_others(campaign):
    (cycle,) = load_cycles([campaign])
    assert [each.begin.step_id for each in cycle.selected([STEP])] == [STEP]
    assert [each.begin.step_id for each in cycle.selected(["all"])] == [STEP]
    with pytest.raises(DataError, match="no finished step 'c0000-99'"):
        cycle.selected(["c0000-99"])


def test_a_bench_without_the_dut_is_named(campaign, tmp_path):
    (tmp_path / "one-dut.yaml").write_text(BENCH)
    (tmp_path / "dut.yaml").write_text("serial: SN-2\n")
    maker = MapMaker(load_bench(str(tmp_path / "one-dut.yaml")))
    assert {each.reason for each in maps_of(campaign, maker)} == {"the bench file has no DUT SN-1"}
