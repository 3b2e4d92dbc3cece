"""Point clouds of a recorded step, from range images and the K and δ recorded with them."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt

from arl_fixtures.errors import DataError
from arl_fixtures.metrics.block import AngleBlock
from arl_fixtures.recording import messages
from arl_fixtures.recording.bag_folder import BagFolder, BagReceipt
from arl_fixtures.recording.messages import DutTopics
from arl_fixtures.recording.metadata import DERIVED_FROM
from arl_fixtures.recording.names import topic_tokens
from arl_fixtures.recording.reader import CameraInfo, StepBag
from arl_fixtures.twin.projection import Intrinsics, pixel_rays

CLOUD_SUFFIX: Final = ".cloud"


def unit_rays(info: CameraInfo) -> npt.NDArray[np.float64]:
    """(H, W, 3) unit rays in the optical frame through the pixel centres, by the exact inverse of K and δ."""
    k, d = info.camera_matrix, [*info.distortion, 0.0, 0.0, 0.0]
    intrinsics = Intrinsics(
        fx=float(k[0, 0]),
        fy=float(k[1, 1]),
        cx=float(k[0, 2]),
        cy=float(k[1, 2]),
        **dict(zip(("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"), d, strict=False)),
    )
    u, v = np.meshgrid(np.arange(info.width, dtype=np.float64), np.arange(info.height, dtype=np.float64))
    return pixel_rays(intrinsics, u, v)


def write_cloud(bag: Path, out: Path | None = None) -> BagReceipt:
    """A new bag with a `sensor_msgs/PointCloud2` for each frame; of the second return only where there is any.

    Args:
        bag: bag folder of a step.
        out: folder of the new bag; by default beside the old one, `NAME.cloud`.

    Raises:
        DataError: the bag cannot be used; the message names file and topic.
        StorageError: the new bag is there already or cannot be written.
    """
    step = StepBag(bag)
    topics = {serial: DutTopics(token) for serial, token in topic_tokens(step.metadata.duts).items()}
    rays: dict[str, npt.NDArray[np.float64]] = {}
    custom = step.metadata.to_custom_data() | {DERIVED_FROM: bag.name}
    with BagFolder(out or bag.with_name(bag.name + CLOUD_SUFFIX), custom) as folder:
        for block in step.blocks():
            if block.dut not in rays:
                if block.dut not in step.camera_info:
                    raise DataError(f"{bag}: topic {topics[block.dut].camera_info} is missing: no K, no cloud")
                rays[block.dut] = unit_rays(step.camera_info[block.dut])
            _write(folder, topics[block.dut], block, rays[block.dut])
        return folder.close()


def _write(folder: BagFolder, topics: DutTopics, block: AngleBlock, rays: npt.NDArray[np.float64]) -> None:
    if block.distance_m.shape[2:] != rays.shape[:2]:
        raise DataError(f"DUT {block.dut!r}: images of {block.distance_m.shape[2:]}, CameraInfo of {rays.shape[:2]}")
    for k, time_ns in enumerate(block.time_ns.tolist()):
        for echo in (1, 2):
            distance_m = block.distance_m[k, echo - 1]
            if echo == 2 and not np.isfinite(distance_m).any():
                continue
            points_m = (rays * distance_m[:, :, np.newaxis]).astype(np.float32)
            intensity = block.intensity_counts[k, echo - 1].astype(np.float32)
            data = messages.point_cloud_cdr(time_ns, topics.frame_id, points_m, intensity)
            folder.file.message(folder.topic(topics.points(echo), messages.POINT_CLOUD), time_ns, data)
            folder.file.seal()
