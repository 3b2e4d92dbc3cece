"""Noise and coding: from an expected frame to the numbers that a sensor sends.

A frame's noise is a function of the unit's seed and the frame's number alone. Frames that nobody hears need not be
computed, and leaving them out changes none of the others.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt
from pydantic import Field

from arl_fixtures.twin.expected import BoolArray, Expected, Float32Array
from arl_fixtures.yaml_model import FileModel

UInt16Array = npt.NDArray[np.uint16]

CODE_LIMIT: Final = 65534
"""Largest range code of a return; the code above it says that there is none."""


class NoiseSettings(FileModel):
    """Noise model and coding of a sensor.

    σ_I² = read_noise² + shot_counts·I + (relative·I)² and σ_D² = distance_floor² + (distance_slope·σ_I/I)².
    """

    read_noise_counts: float = Field(default=6.0, ge=0)
    shot_counts: float = Field(default=0.25, ge=0)
    relative: float = Field(default=0.004, ge=0)
    distance_floor_m: float = Field(default=0.004, ge=0)
    distance_slope_m: float = Field(default=0.30, ge=0)
    distance_factor: float = Field(default=1.0, ge=0)
    """This unit's factor on σ_D."""
    detection_counts: float = Field(default=30.0, ge=0)
    """Expected intensity below which there is no return."""
    full_counts: int = Field(default=4095, gt=0, le=65535)
    range_step_m: float = Field(default=1 / 256, gt=0)
    no_return_code: int = Field(default=65535, ge=0, le=65535)


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


def frame_generator(seed: int, frame_number: int, *, stream: int = 0) -> np.random.Generator:
    """The random numbers of one frame of one unit; streams keep different uses of the same frame apart."""
    return np.random.Generator(np.random.SFC64(np.random.SeedSequence((seed, stream, frame_number))))


def code_frames(
    spread: Scatter, noise: NoiseSettings, *, seed: int, frame_numbers: Sequence[int]
) -> tuple[UInt16Array, UInt16Array]:
    """First returns as they are sent, with noise.

    Args:
        spread: what the frames have in common.
        noise: coding parameters.
        seed: of the unit.
        frame_numbers: of the frames to make, each at least 0.

    Returns:
        Intensity in counts and range codes, (n, H, W) each; 0 and the no-return code where there is no return.
    """
    shape = spread.intensity_counts.shape
    count = len(frame_numbers)
    normal = np.empty((count, 2, *shape), dtype=np.float32)
    intensity, distance = normal[:, 0], normal[:, 1]
    gains = np.ones((count, 1, 1), dtype=np.float32)
    for index, number in enumerate(frame_numbers):
        generator = frame_generator(seed, number)
        generator.standard_normal(dtype=np.float32, out=normal[index])
        if spread.frame_gain_std > 0:
            gains[index] = 1 + spread.frame_gain_std * generator.standard_normal()
    per_metre = np.float32(1 / noise.range_step_m)
    intensity *= spread.intensity_std_counts
    intensity += gains * spread.intensity_counts if spread.frame_gain_std > 0 else spread.intensity_counts
    distance *= spread.distance_std_m * per_metre
    distance += spread.distance_m * per_metre
    codes = np.empty(normal.shape, dtype=np.uint16)
    silent = ~spread.returns
    for kind, (most, nothing) in enumerate(((noise.full_counts, 0), (CODE_LIMIT, noise.no_return_code))):
        values = normal[:, kind]
        np.rint(values, out=values)
        np.clip(values, 0, most, out=values)
        codes[:, kind] = values
        np.copyto(codes[:, kind], nothing, where=silent)
    return codes[:, 0], codes[:, 1]


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
