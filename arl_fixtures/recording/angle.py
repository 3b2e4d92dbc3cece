"""An angle being put together from the images of a bag."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping
from typing import Any, Final, final

import numpy as np
import numpy.typing as npt

from arl_fixtures.metrics.block import AngleBlock

_MAX_BYTES: Final = 1 << 30
PARTS: Final = 5
_IMAGES: Final = 4
"""Parts with pixels; the last one says which rows arrived."""
_NOTHING: Final = (0, np.nan, 0, np.nan, 1)


@final
class OpenAngle:
    """Takes images in any order of topics and gives the block of all frames whose five images are there.

    Args:
        dut: serial number.
        angle_index: position in the sweep.
        stage_angle_deg: stage angle, degrees.
        shape: frames, rows, columns as announced by the angle's first message.
        operating: signals.

    Raises:
        ValueError: a shape that no sensor has; from `add`: more images than announced, or of another size.
    """

    def __init__(
        self,
        *,
        dut: str,
        angle_index: int,
        stage_angle_deg: float,
        shape: tuple[int, int, int],
        operating: Mapping[str, float],
    ) -> None:
        frames, rows, columns = shape
        if min(shape) < 0 or frames * rows * columns * 12 > _MAX_BYTES:
            raise ValueError(f"{frames} frames of {rows} × {columns} pixels at one angle")
        self.dut, self.angle_index, self.stage_angle_deg = dut, angle_index, stage_angle_deg
        self.shape, self.operating = shape, operating
        self._intensity = np.empty((frames, 2, rows, columns), dtype=np.uint16)
        self._distance = np.empty((frames, 2, rows, columns), dtype=np.float32)
        self._rows = np.empty((frames, rows, 1), dtype=np.uint8)
        self._targets: tuple[npt.NDArray[Any], ...] = (
            self._intensity[:, 0],
            self._distance[:, 0],
            self._intensity[:, 1],
            self._distance[:, 1],
            self._rows,
        )
        self._stamps: list[list[int]] = [[] for _ in range(PARTS)]

    def add(self, part: int, stamp_ns: int, pixels: npt.NDArray[Any]) -> None:
        """Take an image; `part` counts as `DutTopics.images` does."""
        stamps, target = self._stamps[part], self._targets[part]
        if len(stamps) == len(target):
            raise ValueError(f"more than the {len(target)} frames announced for angle {self.angle_index}")
        if pixels.shape != target.shape[1:]:
            raise ValueError(f"image of {pixels.shape}, announced {target.shape[1:]} for angle {self.angle_index}")
        target[len(stamps)] = pixels
        stamps.append(stamp_ns)

    def block(self, absent: Collection[int] = ()) -> AngleBlock:
        """What is complete. Frames whose images are not all there are left out.

        Args:
            absent: parts that the recording does not have. They are not waited for: their pixels are without value (0
                counts, NaN metres, rows taken as arrived), so that what the others hold can be measured.
        """
        if not any(self._stamps[:_IMAGES]):
            return self._empty()
        self._fill(absent)
        stamps = self._stamps[0]
        whole = all(len(other) == self.shape[0] and other == stamps for other in self._stamps)
        kept = [list(range(self.shape[0]))] * PARTS if whole else self._common()
        intensity, distance, rows = self._intensity, self._distance, self._rows
        if not whole:
            intensity = np.stack([intensity[kept[0], 0], intensity[kept[2], 1]], axis=1)
            distance = np.stack([distance[kept[1], 0], distance[kept[3], 1]], axis=1)
            rows = rows[kept[4]]
        return AngleBlock(
            dut=self.dut,
            angle_index=self.angle_index,
            stage_angle_deg=self.stage_angle_deg,
            time_ns=np.array([stamps[k] for k in kept[0]], dtype=np.int64),
            intensity_counts=intensity,
            distance_m=distance,
            row_valid=rows[:, :, 0] != 0,
            operating=self.operating,
        )

    def _fill(self, absent: Collection[int]) -> None:
        """Put nothing where a topic is missing; its frames are those of the topic that has most."""
        most = max(self._stamps, key=len)
        for part in absent:
            self._targets[part][: len(most)] = _NOTHING[part]
            self._stamps[part] += most

    def _empty(self) -> AngleBlock:
        return AngleBlock(
            dut=self.dut,
            angle_index=self.angle_index,
            stage_angle_deg=self.stage_angle_deg,
            time_ns=np.empty(0, dtype=np.int64),
            intensity_counts=self._intensity[:0],
            distance_m=self._distance[:0],
            row_valid=self._rows[:0, :, 0] != 0,
            operating=self.operating,
        )

    def _common(self) -> list[list[int]]:
        """Positions, in each of the five topics, of the frames that all five have; equal stamps pair in order."""
        keys = [_numbered(stamps) for stamps in self._stamps]
        common = set(keys[0]).intersection(*keys[1:])
        ordered = [key for key in keys[0] if key in common]
        return [[positions[key] for key in ordered] for positions in keys]


def _numbered(stamps: list[int]) -> dict[tuple[int, int], int]:
    """Position of each (stamp, how many of that stamp came before)."""
    seen: Counter[int] = Counter()
    positions = {}
    for position, stamp in enumerate(stamps):
        positions[stamp, seen[stamp]] = position
        seen[stamp] += 1
    return positions
