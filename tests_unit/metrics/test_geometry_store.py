"""Expectations on disk: the same as rendered ones, and nothing but time depends on them."""

from __future__ import annotations

import numpy as np
import pytest

from arl_fixtures.metrics import geometry
from arl_fixtures.metrics.calibration import circles
from arl_fixtures.metrics.calibration.circles import circle_plan
from arl_fixtures.metrics.geometry import GeometryCache
from arl_fixtures.metrics.geometry_store import MOST_OF_A_DUT
from arl_fixtures.metrics.registry import expect
from arl_fixtures.twin.scene import SceneSettings
from arl_fixtures.twin.settings import DutSettings

DUT = DutSettings(serial="SN-1")
ANGLES_DEG = np.array([-45.0, 0.0, 45.0])


@pytest.fixture
def store(tmp_path):
    GeometryCache(DUT, store=tmp_path / "cache").at(ANGLES_DEG)
    return tmp_path / "cache"


def no_rendering(monkeypatch):
    def refuse(*_):
        pytest.fail("rendered anew")

    monkeypatch.setattr(geometry.Renderer, "expected", refuse)


def assert_same(found, rendered):
    kept, anew = found.stored, rendered.stored
    assert kept.keys() == anew.keys()
    assert all(np.array_equal(kept[name], anew[name]) and kept[name].dtype == anew[name].dtype for name in anew)


def test_a_later_process_finds_what_was_rendered(store, monkeypatch):
    rendered = GeometryCache(DUT).at(ANGLES_DEG)
    no_rendering(monkeypatch)
    assert_same(GeometryCache(DUT, store=store).at(ANGLES_DEG), rendered)


@pytest.mark.parametrize(
    ("dut", "scene"),
    [
        (DUT.model_copy(update={"height_m": 0.1}), None),
        (DUT, SceneSettings(panels=SceneSettings().panels[:4])),
    ],
)
def test_another_dut_or_chamber_is_not_taken_for_it(store, dut, scene):
    found = GeometryCache(dut, scene, store).at(ANGLES_DEG)
    assert_same(found, GeometryCache(dut, scene).at(ANGLES_DEG))
    assert len(list(store.glob("*.npz"))) == 2


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04 cut", None])
def test_a_damaged_file_costs_time_only(store, content):
    (file,) = store.glob("*.npz")
    if content is None:
        whole = bytearray(file.read_bytes())
        whole[len(whole) // 2] ^= 0xFF
        content = bytes(whole)
    file.write_bytes(content)
    assert_same(GeometryCache(DUT, store=store).at(ANGLES_DEG), GeometryCache(DUT).at(ANGLES_DEG))


def test_angles_that_never_repeat_do_not_fill_the_disk(store):
    cache = GeometryCache(DUT, store=store)
    for k in range(4):
        cache.at(ANGLES_DEG + 0.01 * (k + 1))
    assert len(list(store.glob("*.npz"))) == MOST_OF_A_DUT


def test_a_folder_that_cannot_be_written_costs_time_only(tmp_path):
    (tmp_path / "cache").write_text("in the way")
    found = GeometryCache(DUT, store=tmp_path / "cache").at(ANGLES_DEG)
    assert_same(found, GeometryCache(DUT).at(ANGLES_DEG))


def assert_same_plan(found, anew):
    for name in ("index", "owner", "u", "v", "scale", "twin", "contrast"):
        assert np.array_equal(getattr(found, name), getattr(anew, name), equal_nan=True)
    for one, other in zip(found.background, anew.background, strict=True):
        assert np.array_equal(one, other)
    assert np.array_equal(found.circles.jacobian, anew.circles.jacobian)
    assert np.array_equal(found.circles.pixels(), anew.circles.pixels())


def test_a_later_process_finds_the_circles_too(store, monkeypatch):
    anew = circle_plan(GeometryCache(DUT).at(ANGLES_DEG))
    expect(GeometryCache(DUT, store=store).at(ANGLES_DEG))
    monkeypatch.setattr(circles, "_plan", lambda _: pytest.fail("planned anew"))
    assert_same_plan(GeometryCache(DUT, store=store).at(ANGLES_DEG).derive(circle_plan), anew)


def test_a_damaged_plan_costs_time_only(store):
    anew = circle_plan(GeometryCache(DUT, store=store).at(ANGLES_DEG))
    (file,) = store.glob("*.circles.npz")
    with file.open("wb") as stream:
        np.savez(stream, index=np.arange(3))
    assert_same_plan(circle_plan(GeometryCache(DUT, store=store).at(ANGLES_DEG)), anew)
    assert_same_plan(circle_plan(GeometryCache(DUT, store=store).at(ANGLES_DEG)), anew)


def test_circles_of_angles_that_are_not_kept_are_not_kept_either(store):
    cache = GeometryCache(DUT, store=store)
    for k in range(4):
        expect(cache.at(ANGLES_DEG + 0.01 * (k + 1)))
    assert len(list(store.glob("*.images.npz"))) == MOST_OF_A_DUT
    assert len(list(store.glob("*.circles.npz"))) == MOST_OF_A_DUT - 1


def test_a_chamber_without_circles_has_no_plan_and_keeps_none(tmp_path):
    bare = SceneSettings(panels=tuple(panel for panel in SceneSettings().panels if panel.circles is None))
    found = GeometryCache(DUT, bare, tmp_path).at(ANGLES_DEG)
    assert found.derive(circle_plan) is None
    assert not list(tmp_path.glob("*.circles.npz"))
