"""Effects of a model file in the twin's own frames: as the renderer has them, through whichever lens and scene."""

from pathlib import Path

import numpy as np
import pytest
from scipy.ndimage import convolve

from arl_fixtures.reconcile.twin_model import FoundEffects
from arl_fixtures.twin.conditions import Conditions
from arl_fixtures.twin.expected import Expected
from arl_fixtures.twin.frame import Renderer
from arl_fixtures.twin.projection import Intrinsics
from arl_fixtures.twin.scene import SceneSettings
from arl_fixtures.twin.settings import DutSettings, Mount

TILT = """
schema: arl-model/1
effects:
- effect: mount.tilt
  options: {}
  values: {yaw: 0.3, pitch: 0.9, roll: 0.0}
  channels: [intensity_counts, distance_m]
  drivers: [azimuth_deg, elevation_deg]
"""
LEAK = """
schema: arl-model/1
effects:
- effect: detector.crosstalk
  options: {channel: intensity_counts, direction: both, leaks: charge}
  values: {share: 0.02}
  channels: [intensity_counts]
  drivers: [pixel_u, pixel_v]
"""
TURNED_DEG, PITCHED_DEG = 0.3, 0.9
ANGLES_DEG = (-31.4, 0.0, 12.7)
NARROW = Intrinsics(fx=90.0, fy=96.0, cx=40.2, cy=11.0, k4=0.1)
DUTS = [
    DutSettings(serial="nominal", height_m=0.1),
    DutSettings(serial="narrow", height_m=-0.06, intrinsics=NARROW, columns=80, rows=24, gain=0.7, offset_counts=6.0),
]


def altered(folder: Path, model: str, dut: DutSettings, angle_deg: float) -> tuple[Expected, Expected]:
    """A nominal frame, and with the model."""
    (folder / "model.yaml").write_text(model, encoding="utf-8")
    nominal = Renderer(dut).expected(angle_deg)
    found = FoundEffects(folder, dut, SceneSettings())
    return nominal, found.alter(nominal, Conditions(dut=dut.serial, stage_angle_deg=angle_deg))


@pytest.mark.parametrize("angle_deg", ANGLES_DEG)
@pytest.mark.parametrize("dut", DUTS, ids=lambda dut: dut.serial)
def test_a_tilted_sensor_sees_what_its_renderer_shows(tmp_path: Path, dut: DutSettings, angle_deg: float) -> None:
    nominal, repaired = altered(tmp_path, TILT, dut, angle_deg)
    mount = Mount(yaw_deg=-TURNED_DEG, pitch_deg=PITCHED_DEG)
    tilted = Renderer(dut.model_copy(update={"mount": mount})).expected(angle_deg)
    for name, least in (("intensity_counts", 1.0), ("distance_m", 1e-3)):
        # the nominal lens just covers the sensor: the outermost corners see the ray at its fold
        inner = (getattr(frame, name)[1:-1, 1:-1].astype(float) for frame in (nominal, repaired, tilted))
        was, now, should = inner
        assert np.abs(should - was).max() > 50.0 * least  # or there is nothing to see
        assert np.abs(now - should).max() < least, name


@pytest.mark.parametrize("dut", DUTS, ids=lambda dut: dut.serial)
def test_beyond_the_edge_of_the_image_no_pixel_takes_or_gives(tmp_path: Path, dut: DutSettings) -> None:
    nominal, repaired = altered(tmp_path, LEAK, dut, 12.7)
    light = nominal.intensity_counts.astype(float)
    four = np.array([[0.0, 1.0, 0.0], [1.0, -4.0, 1.0], [0.0, 1.0, 0.0]])
    expected = light + 0.02 * convolve(light, four, mode="nearest")
    assert repaired.intensity_counts == pytest.approx(expected, rel=1e-5)
