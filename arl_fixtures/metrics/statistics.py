"""From frames to what the metrics need: mean, scatter and counts per pixel and stage angle, one block at a time.

Frames are reduced as they come, from the sweep or from a bag, by the same code: a sweep's frames never lie in
memory together, and both ways give identical results.

Temporal scatter is split in two. What all pixels of a frame share (pulse energy jitter for the intensity, a timing
offset for the distance) is estimated per frame by weighted least squares over the image and taken out of the
pixels' own scatter. The weights need only be roughly inverse to the variance; a pixel's own share in the estimate
(its leverage) is corrected for.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, NamedTuple, final

import numpy as np
import numpy.typing as npt

from arl_fixtures.errors import DataError
from arl_fixtures.metrics.block import AngleBlock

Float32Array = npt.NDArray[np.float32]
Float64Array = npt.NDArray[np.float64]
UInt8Array = npt.NDArray[np.uint8]
BoolArray = npt.NDArray[np.bool_]
Int64Array = npt.NDArray[np.int64]

READ_NOISE_COUNTS2: Final = 36.0
SHOT_NOISE_COUNTS: Final = 0.25
SLOPE_TO_FLOOR: Final = 75.0
"""Rough noise model for the weights only: σ_I² ≈ 36 + 0.25 I, σ_D ∝ √(1 + (75 σ_I/I)²)."""
MOST_FRAMES: Final = 255


@dataclass(frozen=True, slots=True, kw_only=True)
class SweepSummary:
    """A sweep of one DUT, reduced; n angles in ascending order, image H × W, first return only.

    Attributes:
        dut: serial number.
        stage_angle_deg: (n,) stage angle at rest.
        angle_index: (n,) position in the sweep as it was driven.
        time_ns: (n,) exposure start of the first frame, bench UTC.
        frames: (n,) frames taken.
        arrived: (n, H, W) frames whose row arrived; less than `frames` where packets were lost.
        intensity_returns: (n, H, W) frames with an intensity above 0.
        distance_returns: (n, H, W) frames with a distance.
        constant: (n, H, W) the intensity was the same in every frame.
        intensity_counts: (n, H, W) mean over the frames with a return; NaN where there is none.
        distance_m: (n, H, W) likewise.
        intensity_variance: (n, H, W) temporal variance of the pixel's own part, counts², ddof 1; NaN below 2 returns.
        distance_variance: (n, H, W) likewise, m².
        intensity_common_variance: (n,) variance of the frame's common relative gain, as estimated, noise included.
        intensity_common_floor: (n,) what pixel noise alone gives that estimate.
        distance_common_variance: (n,) variance of the frame's common distance offset, m².
        distance_common_floor: (n,) what pixel noise alone gives that estimate, m².
        second_returns: pixels × frames of the sweep that carry a second return.
        operating: signal name to (n,) value at each angle; NaN where it was not reported.
    """

    dut: str
    stage_angle_deg: Float64Array
    angle_index: Int64Array
    time_ns: Int64Array
    frames: Int64Array
    arrived: UInt8Array
    intensity_returns: UInt8Array
    distance_returns: UInt8Array
    constant: BoolArray
    intensity_counts: Float32Array
    distance_m: Float32Array
    intensity_variance: Float32Array
    distance_variance: Float32Array
    intensity_common_variance: Float64Array
    intensity_common_floor: Float64Array
    distance_common_variance: Float64Array
    distance_common_floor: Float64Array
    second_returns: int
    operating: Mapping[str, Float64Array]

    @property
    def shape(self) -> tuple[int, int]:
        """Image height and width."""
        return self.arrived.shape[1], self.arrived.shape[2]

    @property
    def lost_rows(self) -> int:
        """Rows of all frames whose packet never came."""
        lost = self.frames[:, None] - self.arrived.max(axis=2).astype(np.int64)
        return int(lost.sum())


class _Channel(NamedTuple):
    """One channel of one angle: (pixels,) mean, own variance, returns; the common part's variance and its floor."""

    mean: Float32Array
    variance: Float32Array
    returns: Float32Array
    common: float
    floor: float


@dataclass(frozen=True, slots=True)
class _Reduced:
    """One angle, reduced."""

    stage_angle_deg: float
    angle_index: int
    time_ns: int
    arrived: UInt8Array
    constant: BoolArray
    frames: int
    shape: tuple[int, int]
    intensity: _Channel
    distance: _Channel
    second_returns: int
    operating: Mapping[str, float]


@final
class SweepStatistics:
    """Collects the blocks of one DUT's sweep; `summary()` may be asked at any time.

    Args:
        dut: serial number; blocks of another DUT are refused.
    """

    def __init__(self, dut: str) -> None:
        self.dut = dut
        self._angles: list[_Reduced] = []

    def __len__(self) -> int:
        return len(self._angles)

    def add(self, block: AngleBlock) -> None:
        """Reduce one stage angle's frames. Blocks may come in any order of angles.

        Raises:
            DataError: the block is of another DUT, of another image size, or too long.
        """
        if block.dut != self.dut:
            raise DataError(f"block of DUT {block.dut} offered to the statistics of {self.dut}")
        n, _, *shape = block.intensity_counts.shape
        if self._angles and self._angles[0].shape != tuple(shape):
            raise DataError(f"{self.dut}: image size changed within the sweep to {shape}")
        if n > MOST_FRAMES:
            raise DataError(f"{self.dut}: {n} frames at one angle; at most {MOST_FRAMES}")
        if n:
            self._angles.append(_reduce(block))

    @property
    def stage_angle_deg(self) -> Float64Array:
        """(n,) stage angles so far, ascending."""
        return np.array([angle.stage_angle_deg for angle in self._ascending])

    @property
    def _ascending(self) -> list[_Reduced]:
        return sorted(self._angles, key=lambda angle: (angle.stage_angle_deg, angle.angle_index))

    def summary(self) -> SweepSummary:
        """Everything added so far, in ascending order of the stage angle.

        Raises:
            DataError: nothing was added.
        """
        if not self._angles:
            raise DataError(f"{self.dut}: no frames were recorded")
        angles = self._ascending
        shape = angles[0].shape
        signals = sorted({name for angle in angles for name in angle.operating})
        return SweepSummary(
            dut=self.dut,
            stage_angle_deg=self.stage_angle_deg,
            angle_index=np.array([angle.angle_index for angle in angles], dtype=np.int64),
            time_ns=np.array([angle.time_ns for angle in angles], dtype=np.int64),
            frames=np.array([angle.frames for angle in angles], dtype=np.int64),
            arrived=np.stack([np.broadcast_to(angle.arrived[:, None], angle.shape) for angle in angles]),
            intensity_returns=_stacked([angle.intensity.returns for angle in angles], shape, np.uint8),
            distance_returns=_stacked([angle.distance.returns for angle in angles], shape, np.uint8),
            constant=_stacked([angle.constant for angle in angles], shape, np.bool_),
            intensity_counts=_stacked([angle.intensity.mean for angle in angles], shape),
            distance_m=_stacked([angle.distance.mean for angle in angles], shape),
            intensity_variance=_stacked([angle.intensity.variance for angle in angles], shape),
            distance_variance=_stacked([angle.distance.variance for angle in angles], shape),
            intensity_common_variance=np.array([angle.intensity.common for angle in angles]),
            intensity_common_floor=np.array([angle.intensity.floor for angle in angles]),
            distance_common_variance=np.array([angle.distance.common for angle in angles]),
            distance_common_floor=np.array([angle.distance.floor for angle in angles]),
            second_returns=sum(angle.second_returns for angle in angles),
            operating={
                name: np.array([angle.operating.get(name, np.nan) for angle in angles], dtype=np.float64)
                for name in signals
            },
        )


def _stacked(
    rows: Sequence[npt.NDArray[Any]], shape: tuple[int, int], dtype: npt.DTypeLike = np.float32
) -> npt.NDArray[Any]:
    return np.stack([row.reshape(shape) for row in rows], dtype=dtype, casting="unsafe")


def _reduce(block: AngleBlock) -> _Reduced:
    n, returns_kept, height, width = block.intensity_counts.shape
    counts = block.intensity_counts[:, 0].reshape(n, -1)
    intensity = counts.astype(np.float32)
    lit = intensity > 0
    lit_count = np.add.reduce(lit, axis=0, dtype=np.float32)
    mean_counts = _mean(intensity, lit_count)
    shot: Float32Array = np.float32(READ_NOISE_COUNTS2) + np.float32(SHOT_NOISE_COUNTS) * mean_counts
    squared = mean_counts * mean_counts

    distance = block.distance_m[:, 0].reshape(n, -1)
    timed = np.isfinite(distance)
    timed_count = np.add.reduce(timed, axis=0, dtype=np.float32)
    if timed_count.min(initial=n) < n:
        distance = np.where(timed, distance, np.float32(0.0))
    # without intensities every distance weighs the same
    light: Float32Array = np.divide(squared, squared + np.float32(SLOPE_TO_FLOOR**2) * shot, dtype=np.float32)
    weight = light if mean_counts.any() else shot

    second = block.distance_m[:, 1] if returns_kept > 1 else np.empty(0, np.float32)
    return _Reduced(
        stage_angle_deg=float(block.stage_angle_deg),
        angle_index=block.angle_index,
        time_ns=int(block.time_ns[0]),
        arrived=block.row_valid.sum(axis=0, dtype=np.uint8),
        constant=(counts == counts[0]).all(axis=0),
        frames=n,
        shape=(height, width),
        intensity=_split(intensity, lit, lit_count, mean_counts, mean_counts, np.reciprocal(shot)),
        distance=_split(distance, timed, timed_count, _mean(distance, timed_count), np.ones_like(shot), weight),
        second_returns=int(np.count_nonzero(np.isfinite(second))),
        operating=dict(block.operating),
    )


def _mean(values: Float32Array, returns: Float32Array) -> Float32Array:
    mean: Float32Array = np.add.reduce(values, axis=0) / np.maximum(returns, np.float32(1.0))
    return mean


def _split(
    values: Float32Array,
    valid: BoolArray,
    returns: Float32Array,
    mean: Float32Array,
    pattern: Float32Array,
    weight: Float32Array,
) -> _Channel:
    """Take out of each frame what its pixels share, and give both parts' variances.

    Args:
        values: (n, pixels), 0 where there is no return.
        valid: (n, pixels) which values are returns.
        returns: (pixels,) how many are.
        mean: (pixels,) mean of the returns.
        pattern: (pixels,) how the common part acts: the mean for a gain, ones for an offset.
        weight: (pixels,) roughly inverse to the variance.
    """
    n = len(values)
    whole = returns == np.float32(n)
    holes = not whole.all()
    residual = values - mean
    if holes:
        residual *= valid
    lever = weight * pattern * whole
    strength = float(pattern @ lever)
    common = np.zeros(n, dtype=np.float32)
    own_share = np.zeros_like(mean)
    if strength > 0.0 and n > 1:
        common = (residual @ lever) / np.float32(strength)
        shared = common[:, None] * pattern
        if holes:
            shared *= valid
        residual -= shared
        own_share = lever * pattern / np.float32(strength)
    np.multiply(residual, residual, out=residual)
    one = np.float32(1.0)
    variance = np.add.reduce(residual, axis=0) / (np.maximum(returns - one, one) * (one - own_share))
    floor = float((lever * lever) @ variance) / strength**2 if strength > 0.0 else 0.0
    common_variance = float(common @ common) / max(n - 1, 1)
    mean[returns < 1] = np.nan
    variance[returns < 2] = np.nan
    return _Channel(mean, variance, returns, common_variance, floor)
