"""Faults as data: what is wrong with which device, from when, for how long.

A fault is written in a YAML list, on the command line (`parse_fault`) or in a test, and handed to the `FaultBook`
of the plant. Faults of the wire (silence, garbage, a cut line …) are carried out by `FaultyWire` around an
emulator; faults of behaviour (a stuck sensor, a stalled stage …) are state of the emulator they concern.
"""

from __future__ import annotations

import heapq
import itertools
import math
import re
from typing import Final, NamedTuple, Self, final

from pydantic import Field, ValidationError, model_validator

from arl_fixtures.emulators.fault_kinds import FAULT_KINDS, FaultKind
from arl_fixtures.errors import ConfigError
from arl_fixtures.yaml_model import FileModel


class Fault(FileModel):
    """One fault of one device.

    Attributes:
        device: name on the bench (`chiller`, `thermometer`, `stage`, `relays`, `dut_1` …; `dut` means every
            DUT, `bench` everything).
        kind: what is wrong.
        start_s: bench time at which it begins.
        duration_s: how long it lasts, endless by default.
        value: meaning and default in `FAULT_KINDS`.
        channel: thermometer channel (from 0) or relay (from 1) concerned; all where not given.
    """

    device: str = Field(pattern=r"^[a-z]+(_[0-9]+)?$")
    kind: FaultKind
    start_s: float = Field(default=0.0, allow_inf_nan=False)
    duration_s: float = Field(default=math.inf, ge=0)
    value: float | None = Field(default=None, allow_inf_nan=False)
    channel: int | None = Field(default=None, ge=0)

    @model_validator(mode="after")
    def _applies(self) -> Self:
        info = FAULT_KINDS[self.kind]
        if self.role not in info.devices:
            known = ", ".join(sorted(info.devices))
            raise ValueError(f"'{self.kind.value}' is no fault of '{self.device}'; it applies to: {known}")
        return self

    @property
    def role(self) -> str:
        """The device's name without its number."""
        return self.device.partition("_")[0]

    @property
    def end_s(self) -> float:
        """Bench time at which it is over."""
        return self.start_s + self.duration_s

    @property
    def amount(self) -> float:
        """The value, or the kind's default."""
        return FAULT_KINDS[self.kind].default if self.value is None else self.value

    def concerns(self, device: str) -> bool:
        """Whether the device of that name has this fault."""
        return self.device in (device, device.partition("_")[0], "bench")


_NUMBER: Final = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_FAULT_TEXT: Final = re.compile(
    rf"(?P<device>[a-z]+(?:_\d+)?):(?P<kind>[a-z_]+)(?:@(?P<start>{_NUMBER}))?(?:/(?P<duration>{_NUMBER}))?"
    rf"(?:=(?P<value>{_NUMBER}))?(?:#(?P<channel>\d+))?"
)


def parse_fault(text: str) -> Fault:
    """Read a fault as written on a command line: `DEVICE:KIND[@START_S][/DURATION_S][=VALUE][#CHANNEL]`.

    Example: `thermometer:drift@600/120=5#2` drifts channel 2 by 5 K/h from 600 s on for two minutes.

    Raises:
        ConfigError: the text is of another form, or the fault does not exist or not for this device.
    """
    match = _FAULT_TEXT.fullmatch(text.strip())
    if match is None:
        form = "DEVICE:KIND[@START_S][/DURATION_S][=VALUE][#CHANNEL]"
        raise ConfigError(f"fault '{text}': expected {form}")
    kind = match["kind"]
    if kind not in set(FaultKind):
        raise ConfigError(f"fault '{text}': unknown kind '{kind}'; known: {', '.join(FaultKind)}")
    try:
        return Fault(
            device=match["device"],
            kind=FaultKind(kind),
            start_s=float(match["start"] or 0.0),
            duration_s=float(match["duration"] or math.inf),
            value=None if match["value"] is None else float(match["value"]),
            channel=None if match["channel"] is None else int(match["channel"]),
        )
    except ValidationError as error:
        said = error.errors(include_url=False)[0]["msg"].removeprefix("Value error, ")
        raise ConfigError(f"fault '{text}': {said}") from None


class FaultEdge(NamedTuple):
    """The beginning or the end of a fault."""

    time_s: float
    fault: Fault
    begins: bool


@final
class FaultBook:
    """All faults of a bench, now and to come. Shared by the plant and every emulator.

    Args:
        faults: what is known from the start.
    """

    def __init__(self, faults: tuple[Fault, ...] | list[Fault] = ()) -> None:
        self._order = itertools.count()
        self._live: dict[int, Fault] = {}
        self._begun: set[int] = set()
        self._cleared: set[int] = set()
        self._edges: list[tuple[float, int, bool]] = []
        for fault in faults:
            self.inject(fault)

    @property
    def faults(self) -> tuple[Fault, ...]:
        """Every fault that is not over, in the order they were injected."""
        return tuple(fault for key, fault in self._live.items() if key not in self._cleared)

    @property
    def next_edge_s(self) -> float:
        """Bench time of the next beginning or end; infinity when nothing is to come."""
        return self._edges[0][0] if self._edges else math.inf

    def inject(self, fault: Fault) -> None:
        """Add a fault. One whose start has passed begins when the plant is next advanced."""
        key = next(self._order)
        self._live[key] = fault
        heapq.heappush(self._edges, (fault.start_s, key, True))

    def clear(self, device: str | None = None, kind: FaultKind | None = None) -> int:
        """End faults, and forget those to come. What they did to a device ends when the plant is next advanced.

        Args:
            device: only those of this device.
            kind: only those of this kind.

        Returns:
            How many faults that were.
        """
        concerned = [
            key
            for key, fault in self._live.items()
            if key not in self._cleared
            and (device is None or fault.device == device)
            and (kind is None or fault.kind is kind)
        ]
        for key in concerned:
            if key in self._begun:
                self._cleared.add(key)
                heapq.heappush(self._edges, (-math.inf, key, False))
            else:
                del self._live[key]
        return len(concerned)

    def active(self, device: str, kind: FaultKind, now_s: float) -> Fault | None:
        """The fault of that kind that the device has at `now_s`; the one injected last if there are several."""
        if not self._live:
            return None
        found = None
        # a copy: tests inject while a server's thread looks
        for key, fault in tuple(self._live.items()):
            if (
                key not in self._cleared
                and fault.kind is kind
                and fault.start_s <= now_s < fault.end_s
                and fault.concerns(device)
            ):
                found = fault
        return found

    def take_edge(self, until_s: float) -> FaultEdge | None:
        """The next beginning or end up to `until_s`, or None. Only the plant calls this."""
        while self._edges and self._edges[0][0] <= until_s:
            time_s, key, begins = heapq.heappop(self._edges)
            fault = self._live.get(key)
            if fault is None:
                continue
            if begins:
                self._begun.add(key)
                if math.isfinite(fault.end_s):
                    heapq.heappush(self._edges, (max(fault.end_s, time_s), key, False))
            else:
                del self._live[key]
                self._begun.discard(key)
                self._cleared.discard(key)
            return FaultEdge(time_s, fault, begins)
        return None
