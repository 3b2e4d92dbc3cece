"""A recorded step back as the blocks it was written from: same arrays, same numbers, bit for bit."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, final

import numpy as np
import numpy.typing as npt
from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError

from arl_fixtures.errors import DataError
from arl_fixtures.metrics.block import AngleBlock
from arl_fixtures.metrics.statistics import MOST_FRAMES
from arl_fixtures.recording import messages
from arl_fixtures.recording.angle import PARTS, OpenAngle
from arl_fixtures.recording.bag_folder import METADATA_RECORD
from arl_fixtures.recording.images import ImageParser
from arl_fixtures.recording.messages import DutTopics
from arl_fixtures.recording.metadata import StepMetadata
from arl_fixtures.recording.names import topic_tokens
from arl_fixtures.recording.scan import McapScan, Message
from arl_fixtures.recording.writer import ANGLE_KEYS


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraInfo:
    """Intrinsics as recorded.

    Attributes:
        camera_matrix: (3, 3) K, pixels.
        distortion: coefficients in OpenCV's order.
        height: rows.
        width: columns.
    """

    camera_matrix: npt.NDArray[np.float64]
    distortion: tuple[float, ...]
    height: int
    width: int


@final
class StepBag:
    """One bag, read in one pass by `blocks`; the other contents are complete once that has run to its end.

    Args:
        path: bag folder.

    Raises:
        DataError: the folder, its metadata or its file cannot be used; from `blocks` also, once it has given all that
            is there: the file is cut or damaged, or a topic is missing. The message names file and topic.

    Attributes:
        path: bag folder.
        metadata: identity of the step.
        camera_info: intrinsics by serial number.
        temperatures_c: by name, (time in nanoseconds, degrees Celsius) in order.
        stage: (time in nanoseconds, angle in radians).
        short: (serial number, angle index, frames expected, frames there) of angles with frames missing.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._files, custom = _folder(path)
        self.metadata = StepMetadata.from_custom_data(custom, str(path / "metadata.yaml"))
        self.camera_info: dict[str, CameraInfo] = {}
        self.temperatures_c: dict[str, list[tuple[int, float]]] = {}
        self.stage: list[tuple[int, float]] = []
        self.short: list[tuple[str, int, int, int]] = []
        self._open: dict[str, OpenAngle] = {}
        self._announced: set[str] = set()
        self._seen: set[tuple[str, int]] = set()
        tokens = topic_tokens(self.metadata.duts)
        self._routes: dict[str, tuple[str, int]] = {}
        for serial, token in tokens.items():
            topics = DutTopics(token)
            self._routes[topics.operating] = (serial, -1)
            self._routes[topics.camera_info] = (serial, -2)
            self._routes |= {topic: (serial, k) for k, (topic, _) in enumerate(topics.images())}
        self._parsers = {topic: ImageParser(topic) for topic in self._routes}
        self._required = [topic for topic, (_, k) in self._routes.items() if k != -2]

    def blocks(self) -> Iterator[AngleBlock]:
        """All blocks, in the order they were recorded; each DUT's angle ends where its next begins."""
        declared: set[str] = set()
        for file in self._files:
            scan = McapScan(file)
            for message in scan.messages():
                yield from self._take(message)
            if scan.fault:
                raise DataError(f"{file}: is cut short: {scan.fault}; keep what is whole with `arl recover`")
            if scan.damaged_chunks:
                raise DataError(f"{file}: {scan.damaged_chunks} chunks are damaged (checksum)")
            declared |= scan.topics().keys()
        for dut in list(self._open):
            yield self._finish(dut)
        missing = [topic for topic in self._required if topic not in declared]
        if missing:
            raise DataError(f"{self.path}: {self._missed(missing)}")

    def _missed(self, topics: list[str]) -> str:
        """Which topics are missing, in words; a DUT of which there is none is named once."""
        by_dut: dict[str, list[str]] = {}
        for topic in topics:
            by_dut.setdefault(self._routes[topic][0], []).append(topic)
        all_of = {dut: sum(self._routes[topic][0] == dut for topic in self._required) for dut in by_dut}
        said = [
            f"every topic of DUT {dut!r}" if len(found) == all_of[dut] else f"topic {', '.join(found)} of DUT {dut!r}"
            for dut, found in by_dut.items()
        ]
        return f"{' and '.join(said)} is missing"

    def _take(self, message: Message) -> Iterable[AngleBlock]:
        """The blocks that a message ends."""
        route = self._routes.get(message.topic)
        if route is None:
            return self._bench(message)
        dut, part = route
        if part >= 0:
            self._image(dut, part, message)
            return ()
        if part == -2:
            self.camera_info[dut] = _camera_info(message)
            return ()
        done = (self._finish(dut),) if dut in self._open else ()
        self._announced.add(dut)
        self._open[dut] = self._begin(dut, message)
        return done

    def _image(self, dut: str, part: int, message: Message) -> None:
        if dut not in self._open and (dut in self._announced or not self.stage):
            return
        try:
            stamp_ns, pixels = self._parsers[message.topic](message.data)
            if dut not in self._open:
                self._open[dut] = self._unannounced(dut, *pixels.shape[:2])
            self._open[dut].add(part, stamp_ns, pixels)
            self._seen.add((dut, part))
        except ValueError as error:
            raise DataError(f"{self.path}: topic {message.topic}: {error}") from None

    def _unannounced(self, dut: str, rows: int, columns: int) -> OpenAngle:
        """An angle of a DUT without operating data: the stage says which."""
        return OpenAngle(
            dut=dut,
            angle_index=len(self.stage) - 1,
            stage_angle_deg=float(np.degrees(self.stage[-1][1])),
            shape=(MOST_FRAMES, rows, columns),
            operating={},
        )

    def _begin(self, dut: str, message: Message) -> OpenAngle:
        values = _diagnostic_values(message)
        try:
            return OpenAngle(
                dut=dut,
                angle_index=int(values["angle_index"]),
                stage_angle_deg=float(values["stage_angle_deg"]),
                shape=(int(values["frames"]), int(values["rows"]), int(values["columns"])),
                operating={key: float(value) for key, value in values.items() if key not in ANGLE_KEYS},
            )
        except KeyError as error:
            raise DataError(f"{self.path}: topic {message.topic}: key {error} is missing") from None
        except ValueError as error:
            raise DataError(f"{self.path}: topic {message.topic}: {error}") from None

    def _finish(self, dut: str) -> AngleBlock:
        angle = self._open.pop(dut)
        block = angle.block([part for part in range(PARTS) if (dut, part) not in self._seen])
        if len(block.time_ns) != angle.shape[0] and dut in self._announced:
            self.short.append((dut, angle.angle_index, angle.shape[0], len(block.time_ns)))
        return block

    def _bench(self, message: Message) -> Iterable[AngleBlock]:
        if message.msgtype == messages.TEMPERATURE:
            series = self.temperatures_c.setdefault(message.topic.rsplit("/", 1)[-1], [])
            series.append((message.log_time_ns, messages.parse_temperature(message.data)))
        elif message.topic == messages.STAGE_TOPIC:
            done = [self._finish(dut) for dut in list(self._open) if dut not in self._announced]
            self.stage.append((message.log_time_ns, float(_deserialize(message).position[0])))
            return done
        return ()


def read_step(path: Path) -> tuple[StepMetadata, Iterator[AngleBlock]]:
    """Metadata of a step and its blocks, exactly as they were written.

    Raises:
        DataError: see `StepBag`.
    """
    bag = StepBag(path)
    return bag.metadata, bag.blocks()


def _folder(path: Path) -> tuple[list[Path], dict[str, str]]:
    """MCAP files of a bag folder and its custom data, from the first file's head or else from metadata.yaml."""
    yaml = path / "metadata.yaml"
    if not yaml.is_file():
        missing = "metadata.yaml" if path.is_dir() else "the folder"
        raise DataError(f"{path}: is no whole bag: {missing} is missing; keep what is whole with `arl recover`")
    plain = list(path.glob("*.mcap"))
    if len(plain) == 1:
        scan = McapScan(plain[0])
        scan.head()
        if METADATA_RECORD in scan.metadata:
            return plain, scan.metadata[METADATA_RECORD]
    return _from_yaml(path, yaml)


def _from_yaml(path: Path, yaml: Path) -> tuple[list[Path], dict[str, str]]:
    try:
        information = YAML(typ="safe").load(yaml.read_text("utf-8"))["rosbag2_bagfile_information"]
        files = [path / str(name) for name in information["relative_file_paths"]]
        storage = information["storage_identifier"]
        custom = {str(key): str(value) for key, value in (information.get("custom_data") or {}).items()}
    except OSError as error:
        raise DataError(f"{yaml}: cannot read: {error.strerror}") from None
    except (YAMLError, UnicodeDecodeError, KeyError, TypeError, AttributeError):
        raise DataError(f"{yaml}: is not the metadata of a rosbag2 bag") from None
    if storage != "mcap":
        raise DataError(f"{path}: is stored as {storage!r}; this tool reads rosbag2 bags with MCAP storage")
    for file in files:
        if not file.resolve().is_relative_to(path.resolve()):
            raise DataError(f"{yaml}: names a file outside the bag: {file}")
    return files, custom


def _diagnostic_values(message: Message) -> dict[str, str]:
    array = _deserialize(message)
    return {pair.key: pair.value for status in array.status for pair in status.values}


def _camera_info(message: Message) -> CameraInfo:
    info = _deserialize(message)
    return CameraInfo(
        camera_matrix=np.array(info.k, dtype=np.float64).reshape(3, 3),
        distortion=tuple(float(value) for value in info.d),
        height=int(info.height),
        width=int(info.width),
    )


def _deserialize(message: Message) -> Any:  # noqa: ANN401 - rosbags makes its message classes at run time
    try:
        return messages.typestore().deserialize_cdr(message.data, message.msgtype)
    except Exception as error:  # rosbags raises whatever its generated decoder stumbles over
        raise DataError(f"topic {message.topic}: not a {message.msgtype}: {error}") from None
