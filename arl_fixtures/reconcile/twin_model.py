"""`model.yaml` back in the twin: the found effects as a frame model, so that the simulation is repaired.

A frame becomes a small observation table (one row a pixel) on which the model's effects act as they do on any
table. Effects that need more than one frame (what the sweep saw before, the history of temperatures) find only
this one there and leave it as it is.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any, final

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from arl_fixtures.reconcile.calibrated_units import calibrate_simulation
from arl_fixtures.reconcile.effects_bench import BENCH
from arl_fixtures.reconcile.effects_common import per_table
from arl_fixtures.reconcile.known_bench import known_bench
from arl_fixtures.reconcile.model_file import read_model
from arl_fixtures.reconcile.model_state import corrected_state, terms_of
from arl_fixtures.reconcile.table import columns_of
from arl_fixtures.reconcile.view import View
from arl_fixtures.twin.conditions import Conditions
from arl_fixtures.twin.expected import Expected
from arl_fixtures.twin.noise import scatter
from arl_fixtures.twin.scene import SceneSettings
from arl_fixtures.twin.settings import DutSettings

Float32Array = npt.NDArray[np.float32]


@final
class FoundEffects:
    """The effects of a model file, acting on expected frames (a `FrameModel`).

    Args:
        path: `model.yaml`, or the folder that holds it.
        dut: the sensor whose frames are altered; its nominal noise is that whose scatter effects may change.
        scene: what it looks at.

    Raises:
        ConfigError: the model cannot be read, or names an effect that is not in the library.
    """

    def __init__(self, path: Path, dut: DutSettings, scene: SceneSettings) -> None:
        self._path = path / "model.yaml" if path.is_dir() else path
        self._model = read_model(self._path)
        self._dut, self._scene = dut, scene

    def alter(self, expected: Expected, conditions: Conditions) -> Expected:
        """The frame with the effects.

        Raises:
            DataError: the conditions lack something that drives an effect.
        """
        model = self._model
        if not (model.effects or model.unknown or model.calibration or model.lines):
            return expected
        spread = scatter(expected, self._dut.noise)
        shape = expected.intensity_counts.shape
        table = pa.table(
            {
                "sim_intensity_counts": expected.intensity_counts.ravel(),
                "sim_distance_m": expected.distance_m.ravel(),
                "sim_intensity_counts_std": spread.intensity_std_counts.ravel(),
                "sim_distance_m_std": spread.distance_std_m.ravel(),
                "sim_valid_fraction": spread.returns.ravel().astype(np.float32),
                **_covariates(expected, conditions, self._scene.surface_names),
            }
        )
        columns = columns_of(table, path="frame", for_prediction=True)
        calibrate_simulation(columns, tuple(model.unit_columns), model.lines)
        view = View(columns)
        per_table(view, BENCH, lambda: known_bench(self._dut, self._scene, conditions.stage_angle_deg))
        state = corrected_state(self._model, terms_of(self._model, view, self._path), view)

        def image(name: str, nominal: Float32Array) -> Float32Array:
            found = state.get(name)
            if found is None:
                return nominal
            values = found.reshape(shape).astype(np.float32)
            return np.where(np.isfinite(values), values, nominal)

        lost = image("valid_fraction", np.ones(shape, np.float32)) < 0.5
        return replace(
            expected,
            intensity_counts=image("intensity_counts", expected.intensity_counts),
            distance_m=image("distance_m", expected.distance_m),
            intensity_std_counts=np.maximum(image("intensity_counts_std", spread.intensity_std_counts), 0),
            distance_std_m=np.maximum(image("distance_m_std", spread.distance_std_m), 0),
            dead=expected.dead | (lost & spread.returns),
        )


def _covariates(expected: Expected, conditions: Conditions, surfaces: tuple[str, ...]) -> dict[str, Any]:
    height, width = expected.intensity_counts.shape
    v, u = np.meshgrid(np.arange(height), np.arange(width), indexing="ij")
    count = height * width
    return {
        "dut": [conditions.dut] * count,
        **{name: np.full(count, value) for name, value in conditions.covariates().items()},
        "pixel_u": u.ravel(),
        "pixel_v": v.ravel(),
        "azimuth_deg": expected.azimuth_deg.ravel(),
        "elevation_deg": expected.elevation_deg.ravel(),
        "surface": pa.DictionaryArray.from_arrays(expected.surface.ravel(), pa.array(surfaces)),
        "mixed": expected.mixed.ravel(),
        "true_range_m": expected.true_range_m.ravel(),
        "incidence_deg": expected.incidence_deg.ravel(),
        "reflectance": expected.reflectance.ravel(),
        "n_frames": np.ones(count, dtype=np.int64),
    }
