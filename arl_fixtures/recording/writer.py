"""One bag per temperature step."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Final, Self, final

import numpy as np
import numpy.typing as npt

from arl_fixtures.errors import DataError
from arl_fixtures.metrics.block import AngleBlock
from arl_fixtures.recording import messages
from arl_fixtures.recording.bag_folder import BagFolder, BagReceipt
from arl_fixtures.recording.images import UInt64Array, image_records
from arl_fixtures.recording.messages import DutTopics
from arl_fixtures.recording.metadata import StepMetadata
from arl_fixtures.recording.names import topic_tokens

ANGLE_KEYS: Final = ("angle_index", "stage_angle_deg", "frames", "rows", "columns")
"""Keys of an operating-data message that name the angle; all others are signals."""
MAX_CHUNK_BYTES: Final = 1024 * 1024
"""Frames of one angle are cut into runs of about this size; ten frames of a DUT are half of it."""


@final
class StepBagWriter:
    """Record a step: blocks of frames, temperatures, stage, telemetry.

    Frames are copied at once; compressing and writing happen on a worker behind a bounded queue. Use it as a context
    manager: on an error the bag stays `.part` and never looks whole.

    Args:
        path: folder of the bag, not yet there.
        metadata: identity of the step; its `duts` are the ones that may be recorded.

    Raises:
        StorageError: from any method, when the bag cannot be written (folder there, disk full).
    """

    def __init__(self, path: Path, metadata: StepMetadata) -> None:
        self.metadata = metadata
        self._topics = {serial: DutTopics(token) for serial, token in topic_tokens(metadata.duts).items()}
        self._last_ns = dict.fromkeys(metadata.duts, metadata.started_utc_ns)
        self._bag = BagFolder(path, metadata.to_custom_data())
        for topics in self._topics.values():
            self._bag.topic(topics.operating, messages.DIAGNOSTICS)
            for topic, _ in topics.images():
                self._bag.topic(topic, messages.IMAGE)

    @property
    def path(self) -> Path:
        """Folder the bag will have once it is whole."""
        return self._bag.path

    def camera_info(
        self,
        dut: str,
        *,
        camera_matrix: npt.ArrayLike,
        distortion: Sequence[float],
        height: int,
        width: int,
    ) -> None:
        """Record a DUT's intrinsics, (3, 3) K in pixels and 5 or 8 coefficients in OpenCV's order."""
        topics = self._of(dut)
        time_ns = self.metadata.started_utc_ns
        data = messages.camera_info_cdr(
            time_ns,
            topics.frame_id,
            camera_matrix=camera_matrix,
            distortion=distortion,
            height=height,
            width=width,
        )
        self._small(topics.camera_info, messages.CAMERA_INFO, time_ns, data)

    def block(self, block: AngleBlock) -> None:
        """Record one angle of one DUT: first its operating data, then its images.

        Log times never go back, so that tools which sort by them keep the order; the stamps in the messages are
        the exposure times as they are.

        Raises:
            DataError: arrays of the block that do not fit together, or a signal that names the angle.
        """
        topics = self._of(block.dut)
        _check(block)
        count = len(block.time_ns)
        last_ns = self._last_ns[block.dut]
        log_ns = np.maximum(np.maximum.accumulate(block.time_ns), last_ns).astype(np.uint64)
        first_ns = int(log_ns[0]) if count else last_ns
        values: dict[str, float | int | str] = {
            "angle_index": block.angle_index,
            "stage_angle_deg": float(block.stage_angle_deg),
            "frames": count,
            "rows": block.intensity_counts.shape[2],
            "columns": block.intensity_counts.shape[3],
        }
        values |= {key: float(value) for key, value in block.operating.items()}
        data = messages.diagnostics_cdr(
            first_ns, topics.frame_id, name=f"{block.dut}: operating data", hardware_id=block.dut, values=values
        )
        self._bag.file.message(self._bag.topic(topics.operating, messages.DIAGNOSTICS), first_ns, data)
        if count:
            self._images(topics, block, log_ns)
            self._last_ns[block.dut] = int(log_ns[-1])

    def temperatures(self, time_ns: int, values_c: Mapping[str, float | None]) -> None:
        """Record temperatures in degrees Celsius by name (`T0` ... `T4`, `coolant`); None, an open sensor, as NaN."""
        for name, value_c in values_c.items():
            data = messages.temperature_cdr(time_ns, name, math.nan if value_c is None else value_c)
            self._small(messages.temperature_topic(name), messages.TEMPERATURE, time_ns, data)

    def stage(self, time_ns: int, angle_deg: float) -> None:
        """Record the stage angle, degrees."""
        self._small(messages.STAGE_TOPIC, messages.JOINT_STATE, time_ns, messages.stage_cdr(time_ns, angle_deg))

    def telemetry(self, time_ns: int, dut: str, values: Mapping[str, float | int | str]) -> None:
        """Record telemetry of a DUT as it came."""
        topics = self._of(dut)
        data = messages.diagnostics_cdr(
            time_ns, topics.frame_id, name=f"{dut}: telemetry", hardware_id=dut, values=values
        )
        self._small(topics.telemetry, messages.DIAGNOSTICS, time_ns, data)

    def close(self) -> BagReceipt:
        """Bring the bag to the disk and give it its name."""
        return self._bag.close()

    def abort(self) -> None:
        """Stop; the folder stays `.part`."""
        self._bag.abort()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._bag.__exit__(kind, error, trace)

    def _of(self, dut: str) -> DutTopics:
        if dut not in self._topics:
            raise DataError(f"bag {self.path.name}: DUT {dut!r} is not one of this step's: {', '.join(self._topics)}")
        return self._topics[dut]

    def _small(self, topic: str, msgtype: str, time_ns: int, data: bytes) -> None:
        durable = msgtype == messages.CAMERA_INFO
        channel = self._bag.topic(topic, msgtype, "transient_local" if durable else "volatile")
        self._bag.file.message(channel, time_ns, data)
        self._bag.file.seal()

    def _images(self, topics: DutTopics, block: AngleBlock, log_ns: UInt64Array) -> None:
        row_valid = np.where(block.row_valid, np.uint8(255), np.uint8(0))[:, :, np.newaxis]
        images: tuple[npt.NDArray[Any], ...] = (
            block.intensity_counts[:, 0],
            block.distance_m[:, 0],
            block.intensity_counts[:, 1],
            block.distance_m[:, 1],
            row_valid,
        )
        frame_bytes = 12 * block.intensity_counts[0, 0].size
        run = max(1, MAX_CHUNK_BYTES // frame_bytes)
        for start in range(0, len(log_ns), run):
            part = slice(start, start + run)
            for (topic, encoding), pixels in zip(topics.images(), images, strict=True):
                channel = self._bag.topic(topic, messages.IMAGE)
                records = image_records(
                    channel,
                    topics.frame_id,
                    encoding,
                    first_sequence=self._bag.file.counts[channel],
                    log_time_ns=log_ns[part],
                    stamp_ns=block.time_ns[part],
                    images=pixels[part],
                )
                self._bag.file.append(channel, records.data, log_ns[part], records.shape[1])
            self._bag.file.seal()


def _check(block: AngleBlock) -> None:
    where = f"block of DUT {block.dut!r} at angle {block.angle_index}"
    count = len(block.time_ns)
    shape = block.intensity_counts.shape
    if len(shape) != 4 or shape[:2] != (count, 2):
        raise DataError(f"{where}: intensity of shape {shape}; expected ({count}, 2, H, W)")
    if block.distance_m.shape != shape or block.row_valid.shape != (count, shape[2]):
        raise DataError(f"{where}: distance {block.distance_m.shape} or row mask {block.row_valid.shape} do not fit")
    if block.intensity_counts.dtype != np.uint16 or block.distance_m.dtype != np.float32:
        raise DataError(f"{where}: expected uint16 counts and float32 metres")
    clash = [key for key in block.operating if key in ANGLE_KEYS]
    if clash:
        raise DataError(f"{where}: {clash[0]!r} cannot be the name of a signal")
