"""What relative metrics refer to: a small file with the maps and numbers of one recorded step of one DUT."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from arl_fixtures.errors import DataError
from arl_fixtures.files import write_whole

SCHEMA: Final = "arl-reference/1"
_PREFIX: Final = "data."


class NotMeasurableError(Exception):
    """Raised inside a metric: why this value cannot be had from this step. Never leaves `measure`."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Reference:
    """A DUT as it once was.

    Attributes:
        serial: the DUT it was recorded from.
        identity: where it comes from, for the report, e.g. ``cycle 0, step 7, 25 degC``.
        set_temperature_c: set temperature of that step.
        recorded_utc_ns: bench UTC of that step.
        valid_until_utc_ns: when it expires; 0 for never.
        doubt: why nothing may refer to it, e.g. an instrument that had expired then; empty for none.
        arrays: what the metrics remember, by name; each metric knows its own (`Metric.remember`).
    """

    serial: str
    identity: str
    set_temperature_c: float
    recorded_utc_ns: int = 0
    valid_until_utc_ns: int = 0
    doubt: str = ""
    arrays: Mapping[str, npt.NDArray[Any]] = field(default_factory=dict)

    def check(self, serial: str, now_utc_ns: int) -> None:
        """Refuse use for another DUT, after expiry, or of a reference that was doubtful from the beginning.

        Raises:
            NotMeasurableError: says which.
        """
        if serial != self.serial:
            raise NotMeasurableError(f"the reference was recorded from DUT {self.serial}, not {serial}")
        if self.valid_until_utc_ns and now_utc_ns > self.valid_until_utc_ns:
            days = (now_utc_ns - self.valid_until_utc_ns) / 86_400e9
            raise NotMeasurableError(f"the reference ({self.identity}) expired {days:.1f} days before")
        if self.doubt:
            raise NotMeasurableError(f"the reference ({self.identity}): {self.doubt}")

    def array(self, name: str) -> npt.NDArray[Any]:
        """One array.

        Raises:
            NotMeasurableError: the reference step could not measure it.
        """
        if name not in self.arrays:
            raise NotMeasurableError(f"the reference ({self.identity}) holds no '{name}'")
        return self.arrays[name]

    def save(self, path: Path) -> None:
        """Write as npz, whole or not at all.

        Raises:
            StorageError: it cannot be written.
        """
        content: dict[str, npt.NDArray[Any]] = {
            "schema": np.array(SCHEMA),
            "serial": np.array(self.serial),
            "identity": np.array(self.identity),
            "set_temperature_c": np.array(self.set_temperature_c),
            "recorded_utc_ns": np.array(self.recorded_utc_ns),
            "valid_until_utc_ns": np.array(self.valid_until_utc_ns),
            "doubt": np.array(self.doubt),
        }
        content |= {f"{_PREFIX}{name}": np.asarray(array) for name, array in self.arrays.items()}
        packed = io.BytesIO()
        np.savez_compressed(packed, allow_pickle=False, **content)
        write_whole(path, packed.getvalue())

    @classmethod
    def load(cls, path: Path) -> Reference:
        """Read what `save` wrote.

        Raises:
            DataError: it is not a reference of this schema.
        """
        try:
            with path.open("rb") as stream, np.load(stream, allow_pickle=False) as file:
                content = {name: file[name] for name in file.files}
            if str(content["schema"]) != SCHEMA:
                raise DataError(f"{path}: schema '{content['schema']}'; expected '{SCHEMA}'")
            return cls(
                serial=str(content["serial"]),
                identity=str(content["identity"]),
                set_temperature_c=float(content["set_temperature_c"]),
                recorded_utc_ns=int(content["recorded_utc_ns"]),
                valid_until_utc_ns=int(content["valid_until_utc_ns"]),
                doubt=str(content.get("doubt", "")),
                arrays={
                    name.removeprefix(_PREFIX): array for name, array in content.items() if name.startswith(_PREFIX)
                },
            )
        except OSError as error:
            raise DataError(f"{path}: reference cannot be read: {error.strerror or error}") from None
        except (KeyError, ValueError, TypeError, EOFError, zipfile.BadZipFile) as error:
            raise DataError(f"{path}: not a reference file: {error}") from None
