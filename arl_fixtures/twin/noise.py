"""Noise and coding: from an expected frame to the numbers that a sensor sends.

A frame's noise is a function of the unit's seed and the frame's number alone. Frames that nobody hears need not be
computed, and leaving them out changes none of the others.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Final, final

import numpy as np
import numpy.typing as npt
from pydantic import Field
from scipy.special import ndtri

from arl_fixtures.twin.expected import BoolArray, Expected, Float32Array
from arl_fixtures.yaml_model import FiniteModel

UInt16Array = npt.NDArray[np.uint16]

CODE_LIMIT: Final = 65534
"""Largest range code of a return; the code above it says that there is none."""


class NoiseSettings(FiniteModel):
    """Noise model and coding of a sensor.

    σ_I² = read_noise² + shot_counts·I + (relative·I)² and σ_D² = distance_floor² + (distance_slope·σ_I/I)².
    """

    read_noise_counts: float = Field(default=6.0, ge=0, description="σ_I without light")
    shot_counts: float = Field(default=0.25, ge=0, description="σ_I² per count of intensity")
    relative: float = Field(default=0.004, ge=0, description="σ_I per intensity, of bright pixels")
    distance_floor_m: float = Field(default=0.004, ge=0, description="σ_D of bright pixels")
    distance_slope_m: float = Field(default=0.30, ge=0, description="σ_D per relative intensity noise")
    distance_factor: float = Field(default=1.0, ge=0, description="this unit's factor on σ_D")
    detection_counts: float = Field(default=30.0, ge=0, description="expected intensity below which nothing returns")
    full_counts: int = Field(default=4095, gt=0, le=65535, description="full scale")
    range_step_m: float = Field(default=1 / 256, gt=0, description="metres per range code")
    no_return_code: int = Field(default=65535, ge=0, le=65535, description="range code of a pixel without a return")


@dataclass(frozen=True, slots=True, kw_only=True)
class Scatter:
    """Mean and one-frame scatter of what a sensor will read, (H, W) each.

    Attributes:
        intensity_counts: mean intensity, not clipped.
        intensity_std_counts: scatter that each pixel has for itself.
        distance_m: mean distance.
        distance_std_m: its scatter.
        returns: False where there is no return.
        frame_gain_std: relative scatter from frame to frame that all pixels share.
    """

    intensity_counts: Float32Array
    intensity_std_counts: Float32Array
    distance_m: Float32Array
    distance_std_m: Float32Array
    returns: BoolArray
    frame_gain_std: float = 0.0


def scatter(expected: Expected, noise: NoiseSettings) -> Scatter:
    """The nominal noise model on an expected frame; scatter that a frame model has set stays as it is."""
    intensity = expected.intensity_counts
    returns = (intensity >= noise.detection_counts) & ~expected.dead
    # the floor keeps pixels without a return from dividing by zero; they are masked anyway
    light = np.maximum(intensity, np.float32(1.0))
    intensity_std = expected.intensity_std_counts
    if intensity_std is None:
        variance = noise.read_noise_counts**2 + light * (noise.shot_counts + light * noise.relative**2)
        intensity_std = np.sqrt(variance, dtype=np.float32)
    distance_std = expected.distance_std_m
    if distance_std is None:
        slope = noise.distance_slope_m * intensity_std / light
        variance = noise.distance_factor**2 * (noise.distance_floor_m**2 + slope * slope)
        distance_std = np.sqrt(variance, dtype=np.float32)
    return Scatter(
        intensity_counts=intensity,
        intensity_std_counts=intensity_std,
        distance_m=expected.distance_m,
        distance_std_m=distance_std,
        returns=returns,
        frame_gain_std=expected.frame_gain_std,
    )


def frame_generator(seed: int, frame_number: int) -> np.random.Generator:
    """The random numbers of one frame of one unit."""
    return np.random.Generator(np.random.SFC64(np.random.SeedSequence((seed, frame_number))))


@final
class CountedNoise:
    """A few random numbers for each of many counts: a counter-based generator, set instead of made anew.

    Args:
        seed: of the unit; another one than `frame_generator` uses gives numbers independent of its frames'.
    """

    def __init__(self, seed: int) -> None:
        key = np.random.SeedSequence(seed).generate_state(2, np.uint64)
        self._bits = np.random.Philox(key=key)
        self._generator = np.random.Generator(self._bits)
        self._state = self._bits.state

    def at(self, number: int) -> np.random.Generator:
        """The generator at the beginning of the numbers of one count (below 2⁶⁴); valid until the next call."""
        self._state["state"]["counter"][:] = (0, number, 0, 0)
        self._bits.state = self._state
        return self._generator


@cache
def normal_table() -> Float32Array:
    """Standard normal numbers for 65536 equally likely integers.

    The middle quantiles of the distribution, scaled to unit variance. Looking numbers up takes a fifth of the time
    of drawing exact ones, which would be half of the cost of a frame. They end at 4.3 σ; kurtosis is 2.999.
    """
    quantiles: npt.NDArray[np.float64] = ndtri((np.arange(65536) + 0.5) / 65536)
    table: Float32Array = (quantiles / quantiles.std()).astype(np.float32)
    table.flags.writeable = False
    return table


@final
class FrameCoder:
    """Frames with the same expectation as they are sent, with noise.

    Args:
        spread: what the frames have in common.
        noise: coding parameters.
    """

    def __init__(self, spread: Scatter, noise: NoiseSettings) -> None:
        per_metre = np.float32(1 / noise.range_step_m)
        self._mean = np.stack([spread.intensity_counts, spread.distance_m * per_metre])
        self._std = np.stack([spread.intensity_std_counts, spread.distance_std_m * per_metre])
        self._silent = None if spread.returns.all() else ~spread.returns
        self._gain_std = spread.frame_gain_std
        self._noise = noise
        self.returns = spread.returns
        """Where there is a return, (H, W)."""

    def code(self, seed: int, frame_numbers: Sequence[int]) -> tuple[UInt16Array, UInt16Array]:
        """First returns of some frames.

        Args:
            seed: of the unit.
            frame_numbers: of the frames to make, each at least 0.

        Returns:
            Intensity in counts and range codes, (n, H, W) each; 0 and the no-return code where there is no return.
        """
        table, noise = normal_table(), self._noise
        values = np.empty((len(frame_numbers), *self._mean.shape), dtype=np.float32)
        words = -(-self._mean.size // 4)
        for frame, number in zip(values, frame_numbers, strict=True):
            generator = frame_generator(seed, number)
            bits = generator.integers(0, 2**64 - 1, words, dtype=np.uint64, endpoint=True).view(np.uint16)
            table.take(bits[: frame.size], out=frame.reshape(-1), mode="clip")
            frame *= self._std
            frame += self._mean
            if self._gain_std > 0:
                frame[0] += self._mean[0] * np.float32(self._gain_std * generator.standard_normal())
        np.rint(values, out=values)
        np.clip(values, 0, CODE_LIMIT, out=values)
        codes = values.astype(np.uint16)
        intensity, distance = codes[:, 0], codes[:, 1]
        np.minimum(intensity, noise.full_counts, out=intensity)
        if self._silent is not None:
            np.copyto(intensity, 0, where=self._silent)
            np.copyto(distance, noise.no_return_code, where=self._silent)
        return intensity, distance


def code_frames(
    spread: Scatter, noise: NoiseSettings, *, seed: int, frame_numbers: Sequence[int]
) -> tuple[UInt16Array, UInt16Array]:
    """Some frames as `FrameCoder` makes them, for one use."""
    return FrameCoder(spread, noise).code(seed, frame_numbers)


def predicted(spread: Scatter, noise: NoiseSettings) -> Scatter:
    """What the mean and scatter of many coded frames will be: clipped and rounded, NaN without a return.

    Clipping at full scale is applied to the mean, as an instrument's mean would show it far from full scale; the
    scatter of saturated pixels is 0. Rounding adds a twelfth of the step's square to the variances.
    """
    hidden = ~spread.returns
    intensity = np.clip(spread.intensity_counts, 0, noise.full_counts)
    shared = spread.frame_gain_std * spread.intensity_counts
    intensity_std = np.sqrt(spread.intensity_std_counts**2 + shared**2 + np.float32(1 / 12))
    intensity_std = np.where(spread.intensity_counts > noise.full_counts, np.float32(0), intensity_std)
    distance_std = np.sqrt(spread.distance_std_m**2 + np.float32(noise.range_step_m**2 / 12))
    nan = np.float32(np.nan)
    return Scatter(
        intensity_counts=np.where(hidden, nan, intensity),
        intensity_std_counts=np.where(hidden, nan, intensity_std),
        distance_m=np.where(hidden, nan, spread.distance_m),
        distance_std_m=np.where(hidden, nan, distance_std),
        returns=spread.returns,
    )
