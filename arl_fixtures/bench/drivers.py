"""Finding drivers and emulators by name: ours and third parties', all through entry points.

A driver is announced in the group `arl.drivers` as a `Driver`, an emulator in `arl.emulators` as an `Emulation`.
`docs/add_a_device.md` shows both.
"""

from __future__ import annotations

import difflib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from importlib.metadata import entry_points
from typing import Any, Final, Literal

from arl_fixtures.errors import ConfigError
from arl_fixtures.yaml_model import FileModel

Kind = Literal["chiller", "thermometer", "stage", "relays", "duts"]

DRIVER_GROUP: Final = "arl.drivers"
EMULATOR_GROUP: Final = "arl.emulators"


@dataclass(frozen=True, slots=True, kw_only=True)
class Driver:
    """How the bench makes a device of one make.

    Attributes:
        kind: which role on the bench it can play.
        settings: model of the `settings` block in the bench file.
        make: (port, clock, settings) to a device; for kind `duts` the port is a `dict` of datagram ports.
        default_baud: serial speed where the URL names none.
        udp_ports: for kind `duts`, (settings) to the UDP ports to listen on, by the names `make` knows them by.
    """

    kind: Kind
    settings: type[FileModel]
    make: Callable[[Any, Any, Any], Any]
    default_baud: int = 9600
    udp_ports: Callable[[Any], Mapping[str, int]] = lambda _settings: {}


@dataclass(frozen=True, slots=True, kw_only=True)
class Emulation:
    """How the bench makes the other side of a driver.

    Attributes:
        kind: which role it plays.
        settings: model of the `emulator` block in the bench file.
        make: (plant, emulator settings, driver settings) to a `StreamDevice`.
    """

    kind: Kind
    settings: type[FileModel]
    make: Callable[[Any, Any, Any], Any]


@cache
def _announced(group: str) -> dict[str, Any]:
    return {entry.name: entry for entry in entry_points(group=group)}


def find_driver(name: str, kind: Kind) -> Driver:
    """The driver announced under `name`.

    Raises:
        ConfigError: nobody announced it, or it is of another kind.
    """
    found = _find(DRIVER_GROUP, name, "driver")
    if not isinstance(found, Driver) or found.kind != kind:
        raise ConfigError(f"driver '{name}' is not a driver for '{kind}'")
    return found


def find_emulation(name: str, kind: Kind) -> Emulation:
    """The emulator announced under `name`.

    Raises:
        ConfigError: nobody announced it, or it is of another kind.
    """
    found = _find(EMULATOR_GROUP, name, "emulator")
    if not isinstance(found, Emulation) or found.kind != kind:
        raise ConfigError(f"emulator '{name}' is not an emulator for '{kind}'")
    return found


def _find(group: str, name: str, what: str) -> object:
    known = _announced(group)
    if name not in known:
        near = difflib.get_close_matches(name, known, n=1)
        hint = f"; did you mean '{near[0]}'?" if near else f"; known are {', '.join(sorted(known)) or 'none'}"
        raise ConfigError(f"unknown {what} '{name}'{hint}")
    try:
        return known[name].load()
    except Exception as error:  # a third party may fail in any way
        raise ConfigError(f"{what} '{name}' cannot be loaded: {type(error).__name__}: {error}") from None
