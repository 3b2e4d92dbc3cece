"""The twin of each DUT as the bench file describes it: the nominal model, with found effects switched on."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import final

from arl_fixtures.bench.config import BenchConfig
from arl_fixtures.reconcile.twin_model import FoundEffects
from arl_fixtures.twin.conditions import Conditions, FrameModel, altered
from arl_fixtures.twin.expected import Expected
from arl_fixtures.twin.frame import Renderer
from arl_fixtures.twin.noise import Scatter, predicted, scatter


@final
class Twin:
    """The simulation of one DUT.

    Args:
        renderer: the nominal model.
        models: effects beyond it, in the order they act.
    """

    def __init__(self, renderer: Renderer, models: Sequence[FrameModel] = ()) -> None:
        self.renderer, self.models = renderer, tuple(models)

    def expected(self, stage_angle_deg: float, conditions: Conditions | None = None) -> Expected:
        """The expected frame at a stage angle.

        Args:
            stage_angle_deg: degrees, clockwise positive.
            conditions: temperatures and operating data, for effects that depend on them.

        Raises:
            DataError: the conditions lack something that drives an effect.
        """
        frame = self.renderer.expected(stage_angle_deg)
        return altered(frame, conditions or Conditions(stage_angle_deg=stage_angle_deg), self.models)

    def predicted(self, stage_angle_deg: float, conditions: Conditions | None = None) -> Scatter:
        """Mean and one-frame scatter of what the sensor will read there."""
        noise = self.renderer.dut.noise
        return predicted(scatter(self.expected(stage_angle_deg, conditions), noise), noise)


def twins_of(config: BenchConfig, model: Path | None = None) -> dict[str, Twin]:
    """The twin of each DUT by serial number.

    Args:
        config: the bench file; its `twin_effects` name a model file.
        model: another model file, in place of the bench file's.

    Raises:
        ConfigError: the model cannot be read, or names an effect that is not in the library.
    """
    path = model or config.twin_effects_path
    return {
        dut.serial: Twin(
            Renderer(dut, config.scene), () if path is None else (FoundEffects(path, dut, config.scene),)
        )
        for dut in config.dut_settings
    }
