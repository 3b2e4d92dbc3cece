"""The frame that a DUT is expected to see: what renderer, frame models and noise exchange."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Float32Array = npt.NDArray[np.float32]
Int8Array = npt.NDArray[np.int8]
BoolArray = npt.NDArray[np.bool_]


@dataclass(frozen=True, slots=True, kw_only=True)
class Expected:
    """One noise-free, unquantised frame. All arrays are (H, W), read only.

    Attributes:
        stage_angle_deg: φ, clockwise positive.
        intensity_counts: expected intensity, not clipped.
        distance_m: expected radial range.
        surface: number of the surface that the pixel's centre ray hits (`SceneSettings.surface_names`).
        mixed: the pixel's rays hit more than one surface.
        true_range_m: radial range of the centre ray.
        incidence_deg: incidence of the centre ray.
        reflectance: reflectance where the centre ray hits.
        azimuth_deg: α of the centre ray in the sensor frame, to the right.
        elevation_deg: β of the centre ray, upwards.
        dead: pixels that never answer.
        intensity_std_counts: one-frame scatter where it is not the noise model's; set by frame models.
        distance_std_m: likewise for the distance.
        frame_gain_std: relative scatter of the intensity from frame to frame that all pixels share.
    """

    stage_angle_deg: float
    intensity_counts: Float32Array
    distance_m: Float32Array
    surface: Int8Array
    mixed: BoolArray
    true_range_m: Float32Array
    incidence_deg: Float32Array
    reflectance: Float32Array
    azimuth_deg: Float32Array
    elevation_deg: Float32Array
    dead: BoolArray
    intensity_std_counts: Float32Array | None = None
    distance_std_m: Float32Array | None = None
    frame_gain_std: float = 0.0
