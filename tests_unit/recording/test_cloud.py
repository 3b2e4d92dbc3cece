from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt
import pytest
from rosbags.highlevel import AnyReader

from arl_fixtures.errors import DataError
from arl_fixtures.metrics.block import AngleBlock
from arl_fixtures.recording.bag_folder import BagReceipt
from arl_fixtures.recording.cloud import unit_rays, write_cloud
from arl_fixtures.recording.metadata import StepMetadata
from arl_fixtures.recording.reader import CameraInfo
from arl_fixtures.recording.writer import StepBagWriter

NOMINAL = CameraInfo(
    camera_matrix=np.array([[58.1, 0.0, 63.5], [0.0, 66.0, 15.5], [0.0, 0.0, 1.0]]),
    distortion=(0.0, 0.0, 0.0, 0.0, 0.0, 0.198, 0.0, 0.0),
    height=32,
    width=128,
)
PLUMB_BOB = dataclasses.replace(NOMINAL, distortion=(-0.05, 0.01, 1e-3, -5e-4, -1e-3))


@pytest.mark.parametrize("info", [NOMINAL, PLUMB_BOB], ids=["rational", "plumb bob"])
def test_rays_project_back_onto_their_pixels_to_the_corners(info: CameraInfo) -> None:
    rays = unit_rays(info)
    np.testing.assert_allclose(np.linalg.norm(rays, axis=2), 1.0, atol=1e-12)
    image, _ = cv2.projectPoints(
        rays.reshape(-1, 3), np.zeros(3), np.zeros(3), info.camera_matrix, np.array(info.distortion)
    )
    v, u = np.mgrid[0:32, 0:128]
    seen = image.reshape(32, 128, 2)
    # plumb bob does not reach the outermost columns with these coefficients
    inside = slice(None) if info is NOMINAL else slice(24, 104)
    np.testing.assert_allclose(seen[:, inside, 0], u[:, inside], atol=1e-6)
    np.testing.assert_allclose(seen[:, inside, 1], v[:, inside], atol=1e-6)


def points_of(path: Path) -> dict[str, list[npt.NDArray[np.float32]]]:
    found: dict[str, list[npt.NDArray[np.float32]]] = {}
    with AnyReader([path]) as reader:
        for connection, _, raw in reader.messages():
            cloud = reader.deserialize(raw, connection.msgtype)
            assert [field.name for field in cloud.fields] == ["x", "y", "z", "intensity"]
            assert cloud.row_step * cloud.height == cloud.data.size
            array = cloud.data.view("<f4").reshape(cloud.height, cloud.width, 4)
            found.setdefault(connection.topic, []).append(array)
    return found


def test_a_cloud_has_the_ranges_and_directions_of_its_bag(
    make_bag: Callable[[str], BagReceipt], blocks: list[AngleBlock]
) -> None:
    receipt = write_cloud(make_bag("step").path)
    assert receipt.path.name == "step.cloud"
    clouds = points_of(receipt.path)
    assert {topic.split("/", 2)[2] for topic in clouds} == {"return1/points", "return2/points"}
    mine = next(value for topic, value in sorted(clouds.items()) if topic.endswith("return1/points"))
    ranges = np.linalg.norm(np.stack(mine)[..., :3].astype(np.float64), axis=-1)
    expected = [each for each in blocks if each.dut == "SN-1"], [each for each in blocks if each.dut == "SN_1"]
    candidates = [np.concatenate([each.distance_m[:, 0] for each in group]) for group in expected]
    assert any(np.allclose(ranges, candidate, rtol=1e-6, equal_nan=True) for candidate in candidates)


def test_an_empty_second_return_makes_no_cloud(
    tmp_path: Path, metadata: StepMetadata, blocks: list[AngleBlock]
) -> None:
    distance_m = blocks[0].distance_m.copy()
    distance_m[1:, 1] = np.nan
    with StepBagWriter(tmp_path / "step", metadata) as writer:
        writer.camera_info("SN-1", camera_matrix=np.eye(3), distortion=[0.0] * 5, height=8, width=16)
        writer.block(dataclasses.replace(blocks[0], distance_m=distance_m))
    clouds = points_of(write_cloud(tmp_path / "step", tmp_path / "out").path)
    assert sorted(len(value) for value in clouds.values()) == [1, 4]


def test_without_intrinsics_there_is_no_cloud(
    tmp_path: Path, metadata: StepMetadata, blocks: list[AngleBlock]
) -> None:
    with StepBagWriter(tmp_path / "step", metadata) as writer:
        writer.block(blocks[0])
    with pytest.raises(DataError, match=r"topic /dut_SN_1_\w+/camera_info is missing"):
        write_cloud(tmp_path / "step")
    assert not (tmp_path / "step.cloud").exists()
