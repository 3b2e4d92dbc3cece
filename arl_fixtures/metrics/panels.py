"""Where on a flat target each pixel looks, from its centre ray."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from arl_fixtures.twin.frame import to_stage
from arl_fixtures.twin.projection import azimuth_elevation, pixel_rays
from arl_fixtures.twin.scene import Panel
from arl_fixtures.twin.settings import DutSettings

Float64Array = npt.NDArray[np.float64]
Int64Array = npt.NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class PanelView:
    """Positions on a panel of the pixels that see it, (m,) each.

    Attributes:
        aside_m: from the panel's middle, counter-clockwise.
        up_m: from the panel's middle, upwards.
        range_m: along the ray.
    """

    aside_m: Float64Array
    up_m: Float64Array
    range_m: Float64Array


def centre_rays(dut: DutSettings) -> Float64Array:
    """Unit centre rays in the stage frame, (H·W, 3): x along the nominal boresight, y left, z up."""
    v, u = np.meshgrid(np.arange(float(dut.rows)), np.arange(float(dut.columns)), indexing="ij")
    rays: Float64Array = (pixel_rays(dut.intrinsics, u, v) @ to_stage(dut.mount).T).reshape(-1, 3)
    return rays


def pixel_extent_rad(dut: DutSettings) -> tuple[Float64Array, Float64Array]:
    """Width and height of each pixel's field, (H·W,) each, radians: twice the larger half.

    Towards the image corners of a wide lens the outer half of a pixel sees much more than the inner one.
    """
    v, u = np.meshgrid(np.arange(float(dut.rows)), np.arange(float(dut.columns)), indexing="ij")
    middle = azimuth_elevation(pixel_rays(dut.intrinsics, u, v))
    extents = []
    for axis, (du, dv) in enumerate(((0.5, 0.0), (0.0, 0.5))):
        halves = [
            np.abs(azimuth_elevation(pixel_rays(dut.intrinsics, u + s * du, v + s * dv))[axis] - middle[axis])
            for s in (-1.0, 1.0)
        ]
        extents.append(2.0 * np.maximum(*halves).ravel())
    return extents[0], extents[1]


def view_panel(
    dut: DutSettings,
    rays: Float64Array,
    panel: Panel,
    *,
    stage_angle_deg: Float64Array,
    angle: Int64Array,
    pixel: Int64Array,
) -> PanelView:
    """Where pixels look on a panel.

    Args:
        dut: for the place of its optical centre.
        rays: (H·W, 3) as from `centre_rays`.
        panel: which.
        stage_angle_deg: (n,) angles of the sweep.
        angle: (m,) index of the stage angle of each sighting.
        pixel: (m,) flat pixel index of each sighting; its ray must meet the panel's plane in front of the DUT.
    """
    origin = np.array([dut.mount.forward_m, dut.mount.left_m, dut.height_m])
    azimuth = np.radians(panel.azimuth_deg + stage_angle_deg)
    cosine, sine = np.cos(azimuth)[angle], np.sin(azimuth)[angle]
    x, y, z = rays[pixel].T
    range_m = (panel.radius_m - origin[0] * cosine - origin[1] * sine) / (x * cosine + y * sine)
    aside_m = range_m * (y * cosine - x * sine) + origin[1] * cosine - origin[0] * sine
    return PanelView(aside_m=aside_m, up_m=range_m * z + origin[2] - panel.centre_z_m, range_m=range_m)
