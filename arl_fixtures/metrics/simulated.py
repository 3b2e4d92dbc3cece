"""A sweep as the twin of a DUT would be recorded: its frames, its noise, its coding. For tests of metrics."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from arl_fixtures.metrics.block import AngleBlock
from arl_fixtures.twin.frame import Renderer
from arl_fixtures.twin.noise import code_frames, scatter
from arl_fixtures.twin.operating import operating_data

HOUSING_C = 25.0


def simulated_blocks(
    renderer: Renderer,
    stage_angle_deg: Sequence[float],
    *,
    frames: int = 10,
    seed: int = 0,
    off_deg: Sequence[float] | None = None,
    frame_gain_std: float = 0.0,
    operating: Mapping[str, float] | None = None,
) -> Iterator[AngleBlock]:
    """Frames of every angle of a sweep, first returns only.

    Args:
        renderer: the twin of the DUT as it is, in the chamber as it is.
        stage_angle_deg: angles as the stage reports them.
        frames: at each angle.
        seed: of the noise; frames are numbered over the sweep.
        off_deg: what the stage does not report: how far it stands from each angle.
        frame_gain_std: relative scatter of the intensity that all pixels of a frame share.
        operating: recorded at every angle; None for the unit's own at 25 °C, with noise.
    """
    dut = renderer.dut
    for k, angle_deg in enumerate(stage_angle_deg):
        actual_deg = angle_deg if off_deg is None else angle_deg + float(off_deg[k])
        spread = replace(scatter(renderer.expected(actual_deg), dut.noise), frame_gain_std=frame_gain_std)
        numbers = range(k * frames, (k + 1) * frames)
        counts, codes = code_frames(spread, dut.noise, seed=seed, frame_numbers=numbers)
        intensity = np.zeros((frames, 2, dut.rows, dut.columns), np.uint16)
        distance_m = np.full(intensity.shape, np.nan, np.float32)
        intensity[:, 0] = counts
        distance_m[:, 0] = np.where(codes == dut.noise.no_return_code, np.nan, codes * dut.noise.range_step_m)
        if operating is None:
            signals = operating_data(dut.operating, HOUSING_C, np.random.default_rng((seed, k)))
        yield AngleBlock(
            dut=dut.serial,
            angle_index=k,
            stage_angle_deg=angle_deg,
            time_ns=np.arange(frames) + 1_000_000 * k,
            intensity_counts=intensity,
            distance_m=distance_m,
            row_valid=np.ones((frames, dut.rows), bool),
            operating=signals if operating is None else operating,
        )
