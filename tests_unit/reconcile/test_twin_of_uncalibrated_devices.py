"""Lines of devices that nobody calibrated go back into the twin: each device's frames get its own gain and zero."""

from pathlib import Path

import numpy as np
import pytest

from arl_fixtures.reconcile.twin_model import FoundEffects
from arl_fixtures.twin.conditions import Conditions
from arl_fixtures.twin.expected import Expected
from arl_fixtures.twin.scene import SceneSettings
from arl_fixtures.twin.settings import DutSettings

MODEL = """
schema: arl-model/1
unit_columns: [dut]
lines:
  intensity_counts: {a: [0.02, -5.0], b: [-0.04, 3.0]}
  distance_m: {a: [0.001, 0.004], b: [-0.002, -0.006]}
"""


def frame() -> Expected:
    """Six pixels before one wall; the last one sees nothing."""
    shape = (2, 3)
    return Expected(
        stage_angle_deg=0.0,
        intensity_counts=np.array([[100.0, 250.0, 500.0], [900.0, 40.0, 0.0]], np.float32),
        distance_m=np.array([[0.5, 1.0, 2.0], [3.0, 4.0, np.nan]], np.float32),
        surface=np.zeros(shape, np.int8),
        mixed=np.zeros(shape, np.bool_),
        **dict.fromkeys(("true_range_m", "incidence_deg", "reflectance"), np.full(shape, 0.5, np.float32)),
        **dict.fromkeys(("azimuth_deg", "elevation_deg"), np.zeros(shape, np.float32)),
        dead=np.zeros(shape, np.bool_),
    )


# A device that the model has never seen gets the mean of those it has.
@pytest.mark.parametrize(
    ("dut", "light", "zero", "scale", "offset_m"),
    [("a", 1.02, -5.0, 1.001, 0.004), ("b", 0.96, 3.0, 0.998, -0.006), ("new", 0.99, -1.0, 0.9995, -0.001)],
)
def test_a_frame_of_the_twin_gets_the_gain_and_zero_of_its_device(
    tmp_path: Path, dut: str, light: float, zero: float, scale: float, offset_m: float
) -> None:
    (tmp_path / "model.yaml").write_text(MODEL, encoding="utf-8")
    nominal = frame()
    found = FoundEffects(tmp_path, DutSettings(serial="a", columns=3, rows=2), SceneSettings())
    repaired = found.alter(nominal, Conditions(dut=dut))
    assert repaired.intensity_counts == pytest.approx(light * nominal.intensity_counts + zero, rel=1e-6)
    seen = np.isfinite(nominal.distance_m)
    assert repaired.distance_m[seen] == pytest.approx(scale * nominal.distance_m[seen] + offset_m, rel=1e-6)
    assert not np.isfinite(repaired.distance_m[~seen]).any()
    assert not repaired.dead.any()
