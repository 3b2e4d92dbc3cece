"""The simulated side of an observation table: from the twin, or from a second set of bags."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from arl_fixtures.errors import DataError
from arl_fixtures.metrics.geometry import Geometry, GeometryCache
from arl_fixtures.metrics.statistics import SweepSummary
from arl_fixtures.reconcile.stated import shortfall
from arl_fixtures.twin.conditions import Conditions, FrameModel, altered
from arl_fixtures.twin.frame import Renderer
from arl_fixtures.twin.noise import predicted, scatter

Float32Array = npt.NDArray[np.float32]


@dataclass(frozen=True, slots=True, kw_only=True)
class Simulation:
    """What a simulation says of one DUT's sweep; n angles in ascending order, (n, H, W) each.

    Attributes:
        intensity_counts: mean; NaN where no return is expected.
        intensity_std_counts: one frame's scatter.
        distance_m: mean radial range.
        distance_std_m: one frame's scatter.
        valid_fraction: share of frames with a return.
        geometry: what each pixel sees.
    """

    intensity_counts: Float32Array
    intensity_std_counts: Float32Array
    distance_m: Float32Array
    distance_std_m: Float32Array
    valid_fraction: Float32Array
    geometry: Geometry


def from_twin(
    renderer: Renderer,
    cache: GeometryCache,
    stage_angle_deg: npt.NDArray[np.float64],
    conditions: Sequence[Conditions],
    models: Sequence[FrameModel] = (),
) -> Simulation:
    """The twin's simulation at the angles of a sweep, with the frame models switched on.

    Args:
        renderer: the twin of the DUT.
        cache: its geometry.
        stage_angle_deg: (n,) angles as in the sweep.
        conditions: of each angle, for models that depend on temperatures.
        models: effects beyond the nominal model.
    """
    geometry = cache.at(stage_angle_deg)
    noise = renderer.dut.noise
    spreads = [
        predicted(scatter(altered(renderer.expected(float(angle)), each, models), noise), noise)
        for angle, each in zip(stage_angle_deg, conditions, strict=True)
    ]
    return Simulation(
        intensity_counts=np.stack([spread.intensity_counts for spread in spreads]),
        intensity_std_counts=np.stack([spread.intensity_std_counts for spread in spreads]),
        distance_m=np.stack([spread.distance_m for spread in spreads]),
        distance_std_m=np.stack([spread.distance_std_m for spread in spreads]),
        valid_fraction=np.stack([spread.returns for spread in spreads]).astype(np.float32),
        geometry=geometry,
    )


def from_sweep(simulated: SweepSummary, recorded: SweepSummary, cache: GeometryCache) -> Simulation:
    """A foreign simulator's bag as the simulation; its angles must be those of the recording.

    Raises:
        DataError: the two sweeps do not fit together.
    """
    if simulated.shape != recorded.shape:
        raise DataError(f"{recorded.dut}: simulated images are {simulated.shape}, recorded ones {recorded.shape}")
    if len(simulated.stage_angle_deg) != len(recorded.stage_angle_deg) or not np.allclose(
        simulated.stage_angle_deg, recorded.stage_angle_deg, atol=0.02
    ):
        raise DataError(f"{recorded.dut}: simulated and recorded stage angles differ")
    light = shortfall(simulated.intensity_returns.astype(np.float64))  # few frames tell too small a scatter
    far = shortfall(simulated.distance_returns.astype(np.float64))
    return Simulation(
        intensity_counts=simulated.intensity_counts,
        intensity_std_counts=(np.sqrt(simulated.intensity_variance) / light).astype(np.float32),
        distance_m=simulated.distance_m,
        distance_std_m=(np.sqrt(simulated.distance_variance) / far).astype(np.float32),
        valid_fraction=(simulated.distance_returns / np.maximum(simulated.arrived, 1)).astype(np.float32),
        geometry=cache.at(recorded.stage_angle_deg),
    )
