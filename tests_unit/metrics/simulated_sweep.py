"""Sweeps of an emulated DUT for the tests of the metrics: the twin's frames, its noise, its coding."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

from arl_fixtures.metrics.block import AngleBlock
from arl_fixtures.metrics.conditions import Conditions
from arl_fixtures.metrics.geometry import GeometryCache
from arl_fixtures.metrics.measurement import Measurement
from arl_fixtures.metrics.simulated import simulated_blocks
from arl_fixtures.metrics.statistics import SweepStatistics, SweepSummary
from arl_fixtures.metrics.step import StepData
from arl_fixtures.twin.frame import Renderer
from arl_fixtures.twin.operating import operating_data
from arl_fixtures.twin.scene import SceneSettings
from arl_fixtures.twin.settings import DutSettings

FULL_SWEEP_DEG = tuple(-60.0 + 0.9 * k for k in range(134))


@dataclass
class SimulatedBench:
    """A DUT as its file says (`dut`) and as it is (`actual`), in a chamber as drawn and as it is."""

    dut: DutSettings
    actual: DutSettings | None = None
    scene: SceneSettings = field(default_factory=SceneSettings)
    actual_scene: SceneSettings | None = None
    angles_deg: Sequence[float] = FULL_SWEEP_DEG
    frames: int = 10
    frame_gain_std: float = 0.0

    def __post_init__(self) -> None:
        self.geometry = GeometryCache(self.dut, self.scene)
        self.renderer = Renderer(self.actual or self.dut, self.actual_scene or self.scene)

    def blocks(self, seed: int, operating: dict[str, float] | None = None) -> Iterator[AngleBlock]:
        return simulated_blocks(
            self.renderer,
            self.angles_deg,
            frames=self.frames,
            seed=seed,
            frame_gain_std=self.frame_gain_std,
            operating=operating_data(self.renderer.dut.operating, 25.0) if operating is None else operating,
        )

    def sweep(self, seed: int) -> SweepSummary:
        statistics = SweepStatistics(self.dut.serial)
        for block in self.blocks(seed):
            statistics.add(block)
        return statistics.summary()

    def step(self, seed: int = 0, *, sweep: SweepSummary | None = None, **more: Any) -> StepData:
        sweep = sweep or self.sweep(seed)
        conditions = more.pop("conditions", Conditions(set_temperature_c=25.0))
        more.setdefault("expected_angles", len(self.angles_deg))
        return StepData(
            dut=self.dut,
            conditions=conditions,
            sweep=sweep,
            geometry=self.geometry.at(sweep.stage_angle_deg),
            **more,
        )


def value_of(measured: list[Measurement], metric: str, scope: str = "") -> Measurement:
    """The one measurement of this metric and scope."""
    (found,) = [one for one in measured if one.metric == metric and one.scope == scope]
    return found
