"""Virtual links: ports that end in emulators and live on a virtual clock.

The same drivers exchange the same bytes as on hardware; only the waiting is replaced by jumps of the clock.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from operator import itemgetter
from typing import Protocol, final, runtime_checkable

from arl_fixtures.bench.clock import VirtualClock
from arl_fixtures.devices.port import Datagram
from arl_fixtures.emulators.device import BulkyDevice, DatagramDevice, Outgoing, StreamDevice
from arl_fixtures.errors import DeviceLostError


@runtime_checkable
class Detachable(Protocol):
    """An emulator whose line can be cut by a fault."""

    def is_connected(self, now_s: float) -> bool:
        """Whether the line carries bytes at `now_s`."""


@final
class VirtualStreamPort:
    """A serial line or TCP connection to an emulated device.

    Args:
        name: how messages call the line.
        device: the emulator at the other end.
        clock: what makes time pass while a driver waits.
    """

    def __init__(self, name: str, device: StreamDevice, clock: VirtualClock) -> None:
        self.name = name
        self._device, self._clock = device, clock
        # asked at each reading; what a protocol says of an object takes longer than the reading
        self._wire = device if isinstance(device, Detachable) else None
        self._unread = bytearray()
        self._connection = 0
        self._open = True

    def write(self, data: bytes) -> None:
        """Hand `data` to the device and note when its answers arrive."""
        self._require_line()
        connection = self._connection
        for outgoing in self._device.receive(data, self._clock.now_s):

            def arrive(answer: bytes = outgoing.data) -> None:
                if connection == self._connection:
                    self._unread += answer

            self._clock.at(outgoing.time_s, arrive)

    def read(self, timeout_s: float) -> bytes:
        """What has arrived; lets time pass until something has."""
        self._require_line()
        if not self._unread:
            self._clock.wait(self._has_unread, timeout_s)
            self._require_line()
        return self.drain()

    def drain(self) -> bytes:
        """Take what lies unread."""
        data = bytes(self._unread)
        self._unread.clear()
        return data

    def reopen(self) -> None:
        """Forget what is under way in both directions."""
        self.close()
        self._open = True
        self._require_line()

    def close(self) -> None:
        """Leave the line."""
        if self._open:
            self._device.disconnect(self._clock.now_s)
        self._open = False
        self._connection += 1
        self._unread.clear()

    def _has_unread(self) -> bool:
        return bool(self._unread)

    def _require_line(self) -> None:
        if not self._open:
            raise DeviceLostError(f"{self.name}: the line is closed")
        if self._wire is not None and not self._wire.is_connected(self._clock.now_s):
            raise DeviceLostError(f"{self.name}: the line is cut")


@final
class VirtualNetwork:
    """The UDP side of an emulated bench: several senders, several listening ports.

    Nothing is computed for times in which nobody waits: `skip` moves on past them, as a host does that
    throws away what its socket collected meanwhile. What is dear is computed only for who takes it.

    Args:
        devices: the senders.
        clock: what makes time pass.
        poll_s: a waiting host looks at its socket this long after something came: long enough to take the burst in
            which sensors send a frame in one read, short enough to be done before their next one begins.
    """

    def __init__(self, devices: Sequence[DatagramDevice], clock: VirtualClock, *, poll_s: float = 0.016) -> None:
        self._devices, self._clock, self._poll_s = tuple(devices), clock, poll_s
        # asked once: what a protocol says of an object takes long
        self._bulky = [device if isinstance(device, BulkyDevice) else None for device in self._devices]
        self._bulk_ports = {device.bulk_port for device in self._bulky if device is not None}
        self._sent_until_s = self._bulk_until_s = clock.now_s
        self._queues: dict[int, deque[Datagram]] = {}

    def listen(self, port: int) -> VirtualDatagramPort:
        """A port on which datagrams to `port` arrive."""
        self._queues.setdefault(port, deque())
        return VirtualDatagramPort(f"emulated udp port {port}", port, self)

    def take(self, port: int, timeout_s: float) -> list[Datagram]:
        """Wait for datagrams to `port` and take them."""
        clock, queue = self._clock, self._queues[port]
        deadline_s = clock.now_s + max(timeout_s, 0.0)
        while True:
            self._collect(bulk=port in self._bulk_ports)
            if queue or clock.now_s >= deadline_s:
                taken = list(queue)
                queue.clear()
                return taken
            clock.sleep(max(self.next_look_s(deadline_s) - clock.now_s, 0.0))

    def next_look_s(self, deadline_s: float) -> float:
        """When a host that waits until `deadline_s` and found nothing looks at its socket again."""
        next_s = min((device.next_time_s(self._clock.now_s) for device in self._devices), default=float("inf"))
        return min(next_s + self._poll_s, deadline_s)

    def skip(self, port: int, before_s: float) -> int:
        """Forget what was sent to `port` up to now and before `before_s`; returns how many datagrams lay there."""
        queue = self._queues[port]
        kept = [datagram for datagram in queue if datagram.time_s >= before_s]
        lost = len(queue) - len(kept)
        queue.clear()
        queue.extend(kept)
        forgotten_s = min(self._clock.now_s, before_s)
        self._sent_until_s = max(self._sent_until_s, forgotten_s)
        self._bulk_until_s = max(self._bulk_until_s, forgotten_s)
        return lost

    def _collect(self, *, bulk: bool) -> None:
        now_s, since_s, bulk_since_s = self._clock.now_s, self._sent_until_s, self._bulk_until_s
        queues, arrivals = self._queues, []
        for device, bulky in zip(self._devices, self._bulky, strict=True):
            sent: list[tuple[int, Outgoing]] = []
            if now_s > since_s:
                sent = (device.send if bulky is None else bulky.send_rest)(since_s, now_s)
            if bulk and bulky is not None and now_s > bulk_since_s:
                sent = bulky.send_bulk(bulk_since_s, now_s) + sent
            address = device.address
            arrivals += [
                (time_s, port, Datagram(data, address, time_s)) for port, (time_s, data) in sent if port in queues
            ]
        # stable: at equal times the order of the devices
        arrivals.sort(key=itemgetter(0))
        for _, port, datagram in arrivals:
            queues[port].append(datagram)
        self._sent_until_s = max(since_s, now_s)
        if bulk:
            self._bulk_until_s = max(bulk_since_s, now_s)


@final
class VirtualDatagramPort:
    """One listening port of a `VirtualNetwork`."""

    def __init__(self, name: str, port: int, network: VirtualNetwork) -> None:
        self.name = name
        self._port, self._network, self._open = port, network, True

    def receive(self, timeout_s: float) -> list[Datagram]:
        """All datagrams that have arrived; lets time pass until one has."""
        if not self._open:
            raise DeviceLostError(f"{self.name}: the socket is closed")
        return self._network.take(self._port, timeout_s)

    def discard(self, before_s: float = float("inf")) -> int:
        """Forget what lies unread, and never compute what would."""
        return self._network.skip(self._port, before_s)

    def close(self) -> None:
        """Stop listening."""
        self._open = False
