"""Devices of a guarded bench that tell the guard what no line shows: what was commanded, who is awaited."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, final

from arl_fixtures.bench.bench import Duts
from arl_fixtures.devices.dut_status import DutStatus
from arl_fixtures.devices.idling import Idle, nothing
from arl_fixtures.devices.interfaces import Identity, Relays
from arl_fixtures.devices.port import Clock
from arl_fixtures.metrics.block import AngleBlock

Commanded = Callable[[Mapping[str, bool | None]], None]
"""Told load to its new state; None while it is being switched, when either state is right."""

Awaited = Callable[[Mapping[str, float]], None]
"""Told serial number to the bench time since when nothing has come of it, of those that are waited for."""


@final
class WatchedRelays:
    """Relays whose commands are announced.

    Args:
        relays: the board.
        commanded: told before and after each switching.
    """

    def __init__(self, relays: Relays, commanded: Commanded) -> None:
        self._relays, self._commanded = relays, commanded

    def identify(self) -> Identity:
        """Name, firmware, serial number."""
        return self._relays.identify()

    def loads(self) -> Sequence[str]:
        """Names of the loads in channel order."""
        return self._relays.loads()

    def set(self, load: str, on: bool) -> None:
        """Switch a load and verify it by read-back."""
        self._commanded({load: None})
        self._relays.set(load, on)
        self._commanded({load: on})

    def states(self) -> Mapping[str, bool]:
        """State of every load, read back from the board."""
        return self._relays.states()

    def all_off(self) -> None:
        """Switch every load off and verify it by read-back."""
        loads = self._relays.loads()
        self._commanded(dict.fromkeys(loads))
        self._relays.all_off()
        self._commanded(dict.fromkeys(loads, False))

    def close(self) -> None:
        """Release the line."""
        self._relays.close()

    def __getattr__(self, name: str) -> Any:  # noqa: ANN401 - whatever else the driver offers
        return getattr(self._relays, name)


@final
class WatchedDuts:
    """A receiver that announces whom it waits for.

    Args:
        duts: the receiver.
        clock: the bench clock.
        awaited: told of all when waiting begins, again and again while it lasts, and of nobody when it has ended.
    """

    def __init__(self, duts: Duts, clock: Clock, awaited: Awaited) -> None:
        self._duts, self._clock, self._awaited = duts, clock, awaited

    def collect(
        self,
        serials: Sequence[str],
        n_frames: int,
        *,
        not_before_s: float,
        timeout_s: float,
        angle_index: int = 0,
        stage_angle_deg: float = 0.0,
        idle: Idle = nothing,
    ) -> dict[str, AngleBlock]:
        """The first `n_frames` frames of each DUT whose exposure began at or after `not_before_s`."""
        start_s = self._clock.now_s

        def announce() -> None:
            last_s = {serial: status.last_packet_s for serial, status in self._duts.listen(0.0).items()}
            self._awaited({serial: max(start_s, last_s.get(serial, start_s)) for serial in serials})
            idle()

        self._awaited(dict.fromkeys(serials, start_s))
        try:
            return self._duts.collect(
                serials,
                n_frames,
                not_before_s=not_before_s,
                timeout_s=timeout_s,
                angle_index=angle_index,
                stage_angle_deg=stage_angle_deg,
                idle=announce,
            )
        finally:
            self._awaited({})

    def identify(self) -> Identity:
        """Who the DUTs say they are."""
        return self._duts.identify()

    def listen(self, duration_s: float) -> Mapping[str, DutStatus]:
        """Listen for a while."""
        return self._duts.listen(duration_s)

    def close(self) -> None:
        """Release the sockets."""
        self._duts.close()

    def __getattr__(self, name: str) -> Any:  # noqa: ANN401 - whatever else the driver offers
        return getattr(self._duts, name)
