"""Is the power off? The read-back of a relay does not tell a welded contact; a DUT that goes on sending does."""

from __future__ import annotations

import contextlib
from collections.abc import Collection
from typing import Final, final

from arl_fixtures.bench.bench import still_sending
from arl_fixtures.bench.config import BenchConfig
from arl_fixtures.bench.drivers import find_driver
from arl_fixtures.devices.port import DatagramPort
from arl_fixtures.errors import DeviceError
from arl_fixtures.guard.host import Host

_AGAIN_S: Final = 1.0


@final
class SilenceCheck:
    """Listens to the DUTs once after each power off, as soon as nobody else listens at their ports.

    Args:
        config: the bench file.
        host: time and ports.
        loads: what the relays switch.
    """

    def __init__(self, config: BenchConfig, host: Host, loads: Collection[str]) -> None:
        self._config, self._host, self._loads = config, host, loads
        self._off_s = self._next_s = 0.0
        self.due = False

    def power_is_off(self) -> None:
        """The read-back says so since now."""
        self.due = True
        self._off_s = self._next_s = self._host.clock.now_s

    def forget(self) -> None:
        """The power is on again."""
        self.due = False

    @property
    def may_listen(self) -> bool:
        """Whether it is worth a try now."""
        return self.due and self._host.clock.now_s >= self._next_s

    def listen(self) -> str:
        """Which DUTs still send, in words; empty when none does, or while the test still has their ports."""
        entry = self._config.devices()["duts"]
        driver = find_driver(entry.driver, "duts")
        ports: dict[str, DatagramPort] = {}
        try:
            for name, number in driver.udp_ports(self._config.device_settings("duts")).items():
                ports[name] = self._host.datagrams(number)
            duts = driver.make(ports, self._host.clock, self._config)
            alive = still_sending(duts, self._config, self._loads, self._off_s)
        except DeviceError:
            self._next_s = self._host.clock.now_s + _AGAIN_S
            return ""
        finally:
            for port in ports.values():
                with contextlib.suppress(DeviceError):
                    port.close()
        self.due = False
        return f"{', '.join(alive)} still sends; its relay may be welded" if alive else ""
