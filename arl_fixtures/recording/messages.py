"""ROS 2 messages of a step but for its images: topics, types, and their CDR bytes through rosbags' typestore."""

from __future__ import annotations

import functools
import math
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

from arl_fixtures.errors import DataError

IMAGE: Final = "sensor_msgs/msg/Image"
CAMERA_INFO: Final = "sensor_msgs/msg/CameraInfo"
TEMPERATURE: Final = "sensor_msgs/msg/Temperature"
JOINT_STATE: Final = "sensor_msgs/msg/JointState"
DIAGNOSTICS: Final = "diagnostic_msgs/msg/DiagnosticArray"
POINT_CLOUD: Final = "sensor_msgs/msg/PointCloud2"

STAGE_TOPIC: Final = "/bench/stage"


@functools.cache
def typestore() -> Typestore:
    """Message definitions of ROS 2 Jazzy, the long-term release; these types are equal in all since Humble."""
    return get_typestore(Stores.ROS2_JAZZY)


@dataclass(frozen=True, slots=True)
class DutTopics:
    """Topics of one DUT.

    Attributes:
        token: the DUT's name in topics.
    """

    token: str

    def intensity(self, echo: int) -> str:
        """Intensity image of return 1 or 2."""
        return f"/{self.token}/return{echo}/intensity"

    def distance(self, echo: int) -> str:
        """Range image of return 1 or 2."""
        return f"/{self.token}/return{echo}/distance"

    def points(self, echo: int) -> str:
        """Point cloud of return 1 or 2."""
        return f"/{self.token}/return{echo}/points"

    @property
    def row_valid(self) -> str:
        """Mask of rows that arrived."""
        return f"/{self.token}/row_valid"

    @property
    def camera_info(self) -> str:
        """Intrinsics."""
        return f"/{self.token}/camera_info"

    @property
    def operating(self) -> str:
        """One message per angle: the angle and the operating data. Opens the angle's frames."""
        return f"/{self.token}/operating"

    @property
    def telemetry(self) -> str:
        """Telemetry at its own rate."""
        return f"/{self.token}/telemetry"

    @property
    def frame_id(self) -> str:
        """Optical frame: x right, y down, z forward."""
        return f"{self.token}_optical_frame"

    def images(self) -> tuple[tuple[str, str], ...]:
        """The five image topics of a frame with their encodings, in the order they are written."""
        return (
            (self.intensity(1), "mono16"),
            (self.distance(1), "32FC1"),
            (self.intensity(2), "mono16"),
            (self.distance(2), "32FC1"),
            (self.row_valid, "mono8"),
        )


def temperature_topic(name: str) -> str:
    """Topic of one temperature (`T0` ... `T4`, `coolant`)."""
    return f"/bench/temperature/{name}"


def _header(time_ns: int, frame_id: str) -> Any:  # noqa: ANN401 - rosbags makes its message classes at run time
    types = typestore().types
    stamp = types["builtin_interfaces/msg/Time"](sec=time_ns // 10**9, nanosec=time_ns % 10**9)
    return types["std_msgs/msg/Header"](stamp=stamp, frame_id=frame_id)


def _cdr(message: object, msgtype: str) -> bytes:
    return bytes(typestore().serialize_cdr(message, msgtype))


def temperature_cdr(time_ns: int, name: str, value_c: float) -> bytes:
    """`sensor_msgs/Temperature`, degrees Celsius; variance 0 means unknown."""
    make = typestore().types[TEMPERATURE]
    return _cdr(make(header=_header(time_ns, name), temperature=value_c, variance=0.0), TEMPERATURE)


def _text(text: str) -> str:
    """What a device sent may not be valid Unicode; what goes into a message has to be."""
    return text.encode("utf-8", "backslashreplace").decode().replace("\x00", "\\x00")


def parse_temperature(data: memoryview) -> float:
    """Value of a Temperature's CDR, degrees Celsius: it and the variance are the message's last 16 bytes.

    Raises:
        DataError: too short, or big-endian.
    """
    if len(data) < 32 or data[1] != 1:
        raise DataError(f"not a sensor_msgs/Temperature: {len(data)} bytes")
    (value_c,) = struct.unpack_from("<d", data, len(data) - 16)
    return float(value_c)


def stage_cdr(time_ns: int, angle_deg: float) -> bytes:
    """`sensor_msgs/JointState` of joint `stage`: radians, clockwise positive seen from above, as the stage counts."""
    empty = np.zeros(0, dtype=np.float64)
    message = typestore().types[JOINT_STATE](
        header=_header(time_ns, "chamber"),
        name=["stage"],
        position=np.array([math.radians(angle_deg)]),
        velocity=empty,
        effort=empty,
    )
    return _cdr(message, JOINT_STATE)


def camera_info_cdr(
    time_ns: int,
    frame_id: str,
    *,
    camera_matrix: npt.ArrayLike,
    distortion: Sequence[float],
    height: int,
    width: int,
) -> bytes:
    """`sensor_msgs/CameraInfo`.

    Args:
        time_ns: stamp.
        frame_id: optical frame.
        camera_matrix: (3, 3) K in pixels.
        distortion: OpenCV's order k1 k2 p1 p2 k3 (5) or k1 k2 p1 p2 k3 k4 k5 k6 (8).
        height: rows.
        width: columns.

    Raises:
        DataError: another number of coefficients.
    """
    models = {5: "plumb_bob", 8: "rational_polynomial"}
    if len(distortion) not in models:
        raise DataError(f"CameraInfo of {frame_id}: {len(distortion)} distortion coefficients; expected 5 or 8")
    types = typestore().types
    k = np.asarray(camera_matrix, dtype=np.float64).reshape(3, 3)
    message = types[CAMERA_INFO](
        header=_header(time_ns, frame_id),
        height=height,
        width=width,
        distortion_model=models[len(distortion)],
        d=np.asarray(distortion, dtype=np.float64),
        k=k.ravel(),
        r=np.eye(3).ravel(),
        p=np.hstack([k, np.zeros((3, 1))]).ravel(),
        binning_x=0,
        binning_y=0,
        roi=types["sensor_msgs/msg/RegionOfInterest"](x_offset=0, y_offset=0, height=0, width=0, do_rectify=False),
    )
    return _cdr(message, CAMERA_INFO)


def diagnostics_cdr(
    time_ns: int, frame_id: str, *, name: str, hardware_id: str, values: Mapping[str, float | int | str]
) -> bytes:
    """`diagnostic_msgs/DiagnosticArray` with one status, level OK.

    Numbers are written as Python's `repr` does, which reads back to equal bits. NumPy scalars are refused by type.
    """
    types = typestore().types
    pair = types["diagnostic_msgs/msg/KeyValue"]
    status = types["diagnostic_msgs/msg/DiagnosticStatus"](
        level=0,
        name=_text(name),
        message="",
        hardware_id=_text(hardware_id),
        values=[
            pair(key=_text(key), value=_text(value if isinstance(value, str) else repr(value)))
            for key, value in values.items()
        ],
    )
    return _cdr(types[DIAGNOSTICS](header=_header(time_ns, frame_id), status=[status]), DIAGNOSTICS)


def point_cloud_cdr(
    time_ns: int, frame_id: str, points_m: npt.NDArray[np.float32], intensity: npt.NDArray[np.float32]
) -> bytes:
    """`sensor_msgs/PointCloud2`, organised like the image: x, y, z in metres and intensity in counts, float32.

    Args:
        time_ns: stamp.
        frame_id: optical frame.
        points_m: (H, W, 3); NaN where there is no return.
        intensity: (H, W) counts.
    """
    types = typestore().types
    height, width = intensity.shape
    data = np.concatenate([points_m, intensity[:, :, np.newaxis]], axis=2).astype("<f4", copy=False)
    field = types["sensor_msgs/msg/PointField"]
    message = types[POINT_CLOUD](
        header=_header(time_ns, frame_id),
        height=height,
        width=width,
        fields=[
            field(name=name, offset=4 * k, datatype=7, count=1) for k, name in enumerate(("x", "y", "z", "intensity"))
        ],
        is_bigendian=False,
        point_step=16,
        row_step=16 * width,
        data=data.reshape(-1).view(np.uint8),
        is_dense=False,
    )
    return _cdr(message, POINT_CLOUD)
