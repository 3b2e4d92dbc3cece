"""One error tree. Verdicts are never errors; an error means that the tool could not do what was asked.

Every message is one line that says what, where and what was expected. `arl` and the pytest plugin print
it as it stands and exit with a non-zero status; a traceback in front of a user is a defect.
"""

from __future__ import annotations

from pathlib import Path


class ArlError(Exception):
    """Base of everything this package raises on purpose."""


class UnitError(ArlError):
    """A unit is unknown or of a foreign dimension."""


class ConfigError(ArlError):
    """A bench, DUT, profile or limits file is wrong.

    Args:
        message: what is wrong and what was expected.
        path: the file.
        line: 1-based line, 0 if the whole file is meant.
        column: 1-based column, 0 if the whole line is meant.
    """

    def __init__(self, message: str, *, path: Path | str = "", line: int = 0, column: int = 0) -> None:
        self.path, self.line, self.column = str(path), line, column
        place = ":".join([str(path)] * bool(str(path)) + [str(n) for n in (line, column) if n])
        super().__init__(f"{place}: {message}" if place else message)


class DataError(ArlError):
    """A table, bag or journal cannot be used as it is."""


class StorageError(ArlError):
    """Output cannot be written: disk full, no permission, or something is in the way. Nothing was overwritten."""


class DeviceError(ArlError):
    """A device did not do what the bench needs. The message names the device and its address."""


class LocalProtocolError(DeviceError):
    """We asked for something the protocol cannot express (our fault)."""


class RemoteProtocolError(DeviceError):
    """The device answered with something the protocol does not allow (its fault)."""


class DeviceTimeoutError(DeviceError):
    """The device did not answer in time on the bench clock."""


class DeviceLostError(DeviceError):
    """The line to the device is gone: port closed, connection refused, unplugged."""


class InterlockError(ArlError):
    """The bench was brought into its safe state, or may not leave it before an acknowledgement."""


class HoldError(ArlError):
    """The bench must pause: what is under way is not to be judged, and goes on when the condition is over.

    Args:
        message: why.
        soak_back: whether the bench must go back to its safe temperature meanwhile.
    """

    def __init__(self, message: str, *, soak_back: bool = False) -> None:
        self.soak_back = soak_back
        super().__init__(message)
