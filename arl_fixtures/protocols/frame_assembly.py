"""From packets of one sensor, as UDP delivers them, to frames: rows in any order, never mixed between frames."""

from __future__ import annotations

from collections import OrderedDict, deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final, Literal, final

from arl_fixtures.protocols.hfl110 import CALIBRATION, LAYOUT_BY_LENGTH, NUMBERS, NUMBERS_OFFSET, ROWS

REMEMBERED_FRAMES: Final = 32
"""Numbers of finished frames, against rows that come late."""
RESTART_PAUSE_S: Final = 1.0
"""After such a pause nothing can be late any more, but a sensor may have restarted and count from 0 again."""
OPEN_FRAMES: Final = 8
"""More unfinished frames than this can only be garbage in the number field: the oldest is given up."""
REORDER_ROWS: Final = 8
"""Where the packet number says nothing: how far a row may come out of its place."""
BELIEVABLE_GAP: Final = 250
"""A larger jump of the frame number is a restart or garbage, not lost frames."""

PacketNumbers = Literal["frames", "packets", "unknown"]


@dataclass(slots=True, eq=False)
class AssembledFrame:
    """One frame, complete or given up.

    Attributes:
        key: what its packets have in common.
        first_s: bench time at which its first packet arrived.
        last_s: bench time of its last packet.
        calibration: the bytes that are the same in all its rows.
        cut: it was under way already when listening began, and its beginning was never heard.
        rows: payload of each row number, None where it never came.
        arrived: how many rows came.
    """

    key: int
    first_s: float
    last_s: float
    calibration: bytes
    cut: bool
    rows: list[bytes | None] = field(default_factory=lambda: [None] * ROWS)
    arrived: int = 0


@dataclass(slots=True)
class AssemblyCounts:
    """What happened so far. Frames cut by the beginning of listening are not counted.

    Attributes:
        packets: packets received.
        frames: frames delivered, complete or not.
        incomplete_frames: of these with missing rows.
        lost_rows: rows missing in delivered frames.
        lost_frames: frames of which nothing came, by the frame number.
        duplicates: rows that came twice.
        late_packets: rows of frames already delivered or given up.
        malformed: packets of no known length, row number or calibration.
    """

    packets: int = 0
    frames: int = 0
    incomplete_frames: int = 0
    lost_rows: int = 0
    lost_frames: int = 0
    duplicates: int = 0
    late_packets: int = 0
    malformed: int = 0


@final
class FrameAssembler:
    """Collects the rows of one sensor's frames.

    A frame is delivered when it is complete, when a later one is, or when nothing of it has come for `timeout_s`.

    Args:
        packet_numbers: what the packet number field counts. With `frames` it is the frame's key; with `packets`
            the frame's key is that number less the row number; with `unknown` a frame ends where row numbers
            start again, or after a pause.
        timeout_s: after the last packet of an incomplete frame, bench time. It only matters when nothing follows
            the frame, so it may be long: a sender or host that stalls for a moment loses nothing.
        pause_s: with `unknown`, a longer pause between packets ends a frame; less than a frame period.
    """

    def __init__(
        self, packet_numbers: PacketNumbers = "frames", *, timeout_s: float = 0.250, pause_s: float = 0.030
    ) -> None:
        self.counts = AssemblyCounts()
        self._numbers = packet_numbers
        self._timeout_s, self._pause_s = timeout_s, pause_s
        self._open: OrderedDict[int, AssembledFrame] = OrderedDict()
        self._finished: deque[int] = deque(maxlen=REMEMBERED_FRAMES)
        self._done: list[AssembledFrame] = []
        self._heard_s = float("-inf")
        self._calibration = b""
        self._listening_begins = True
        self._last_complete: int | None = None
        self._since_complete = 0
        self._order_key, self._highest_row, self._previous_s = 0, -1, float("-inf")

    def feed(self, packets: Sequence[tuple[bytes, float]]) -> list[AssembledFrame]:
        """Take packets in the order of their arrival.

        Args:
            packets: payload and bench time of arrival of each.

        Returns:
            Frames that are finished, in the order in which they began.
        """
        if not packets:
            return self._take()
        if packets[0][1] - self._heard_s > RESTART_PAUSE_S:
            self._finished.clear()
        self._heard_s = packets[-1][1]
        unpack, lengths = NUMBERS.unpack_from, LAYOUT_BY_LENGTH
        trusted = self._numbers == "frames"
        current: AssembledFrame | None = None
        current_number = -1
        malformed = 0
        for payload, time_s in packets:
            if len(payload) not in lengths:
                malformed += 1
                continue
            number, row = unpack(payload, NUMBERS_OFFSET)
            if row >= ROWS:
                malformed += 1
                continue
            if current is None or number != current_number or not trusted:
                current, current_number = self._frame_of(number, row, payload, time_s), number
                if current is None:
                    continue
            rows = current.rows
            if rows[row] is not None:
                self.counts.duplicates += 1
            elif payload[CALIBRATION] == current.calibration or self._is_first_good_row(current, payload):
                rows[row] = payload
                current.arrived += 1
                current.last_s = time_s
                if current.arrived == ROWS:
                    self._finish_up_to(current)
                    current = None
            else:
                malformed += 1
        self.counts.packets += len(packets)
        self.counts.malformed += malformed
        return self._take()

    def expire(self, now_s: float) -> list[AssembledFrame]:
        """Give up frames of which nothing has come for the time-out.

        Returns:
            These frames, with the rows that came.
        """
        while self._open:
            oldest = next(iter(self._open.values()))
            if now_s - oldest.last_s <= self._timeout_s:
                break
            self._finish_up_to(oldest)
        return self._take()

    def reset(self) -> None:
        """Forget what is half received: the port was emptied, so it can never be complete. Counts stay."""
        self._open.clear()
        self._finished.clear()
        self._listening_begins = True
        self._last_complete = None
        self._highest_row, self._previous_s = -1, float("-inf")

    def _frame_of(self, number: int, row: int, payload: bytes, time_s: float) -> AssembledFrame | None:
        """The frame a packet belongs to; None if that frame is over."""
        key: int | None = number
        if self._numbers == "packets":
            key = (number - row) % 2**32
        elif self._numbers == "unknown":
            key = self._key_by_order(row, payload, time_s)
        frame = None if key is None else self._open.get(key)
        if frame is not None:
            return frame
        if key is None or key in self._finished:
            self.counts.late_packets += 1
            return None
        frame = AssembledFrame(
            key=key,
            first_s=time_s,
            last_s=time_s,
            calibration=payload[CALIBRATION],
            cut=self._listening_begins and row > 0,
        )
        self._listening_begins = False
        self._open[key] = frame
        if len(self._open) > OPEN_FRAMES:
            self._finish_up_to(next(iter(self._open.values())))
        return frame

    def _key_by_order(self, row: int, payload: bytes, time_s: float) -> int | None:
        """The frame that a row continues or begins, judged by row numbers and pauses; None if it came too late."""
        frame = self._open.get(self._order_key)
        paused = time_s - self._previous_s > self._pause_s
        self._previous_s = time_s
        if frame is None and not paused and row >= ROWS - REORDER_ROWS:
            # the end of a frame just finished, not the beginning of one
            return None
        if (
            frame is None
            or paused
            or row < self._highest_row - REORDER_ROWS
            or (frame.rows[row] is not None and frame.rows[row] != payload)
        ):
            self._order_key += 1
            self._highest_row = row
        elif row > self._highest_row + ROWS // 2:
            # either half a frame was lost or this is a late row of the frame before: better lose it than mix
            return None
        self._highest_row = max(self._highest_row, row)
        return self._order_key

    def _is_first_good_row(self, frame: AssembledFrame, payload: bytes) -> bool:
        """Whether not this row is corrupt but those that came before it; if so they are dropped."""
        if payload[CALIBRATION] != self._calibration:
            return False
        self.counts.malformed += frame.arrived
        frame.rows[:], frame.arrived = [None] * ROWS, 0
        frame.calibration = self._calibration
        return True

    def _finish_up_to(self, last: AssembledFrame) -> None:
        """Deliver `last` and every frame that began before it."""
        while self._open:
            key, frame = self._open.popitem(last=False)
            self._finished.append(key)
            self._done.append(frame)
            self._count(frame)
            if frame is last:
                return

    def _count(self, frame: AssembledFrame) -> None:
        if frame.cut:
            return
        counts, missing = self.counts, ROWS - frame.arrived
        counts.frames += 1
        counts.incomplete_frames += missing > 0
        counts.lost_rows += missing
        self._since_complete += 1
        if missing:
            return
        self._calibration = frame.calibration
        if self._last_complete is not None and self._numbers != "unknown":
            step = (frame.key - self._last_complete) % 2**32
            if self._numbers == "packets":
                step //= ROWS
            if step < BELIEVABLE_GAP:
                counts.lost_frames += max(step - self._since_complete, 0)
        self._last_complete, self._since_complete = frame.key, 0

    def _take(self) -> list[AssembledFrame]:
        done, self._done = self._done, []
        return done
