"""One sweep: turn the stage angle by angle and take every DUT's frames while it stands still."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

from pydantic import Field

from arl_fixtures.devices.interfaces import Stage
from arl_fixtures.devices.port import Clock
from arl_fixtures.metrics.block import AngleBlock
from arl_fixtures.yaml_model import FileModel


class SweepSettings(FileModel):
    """Time limits of a sweep, and how long the stage must rest before a frame counts."""

    rest_s: float = Field(default=0.0, ge=0, description="from 'reached' to the first exposure that counts")
    move_timeout_s: float = Field(default=60.0, gt=0)
    frames_timeout_s: float = Field(default=5.0, gt=0, description="beyond the frames' own duration")


class AngleRecord(NamedTuple):
    """All DUTs at one stage angle."""

    angle_index: int
    stage_angle_deg: float
    time_ns: int
    blocks: dict[str, AngleBlock]


class FrameSource(NamedTuple):
    """How a sweep asks for frames: serial numbers, and a function that takes the same frames of all of them."""

    serials: Sequence[str]
    collect: Callable[[int, float, float, int, float], dict[str, AngleBlock]]


def sweep(
    stage: Stage,
    source: FrameSource,
    clock: Clock,
    angles_deg: Sequence[float],
    *,
    frames: int,
    settings: SweepSettings,
    between: Callable[[], None] = lambda: None,
) -> Iterator[AngleRecord]:
    """Drive through `angles_deg` and yield what was recorded at each.

    Frames count only if their exposure began after the stage reported that it stands. `between` runs once per
    angle while nothing moves (temperature control, interlock, progress).

    Raises:
        DeviceError: the stage does not arrive, or a DUT is silent; the message names it.
    """
    for index, angle_deg in enumerate(angles_deg):
        stage.move_to_deg(angle_deg)
        stage.wait_until_reached(settings.move_timeout_s)
        standing_s = clock.now_s + settings.rest_s
        actual_deg = stage.position_deg()
        blocks = source.collect(frames, standing_s, settings.frames_timeout_s, index, actual_deg)
        yield AngleRecord(index, actual_deg, clock.utc_ns(), blocks)
        between()
