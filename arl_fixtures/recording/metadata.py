"""What a step's bag says of itself: in `custom_data` of metadata.yaml and in an MCAP metadata record `arl`.

The record stands at the start of the file, so that a bag cut short still knows where it belongs.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Final

from arl_fixtures.errors import DataError

SCHEMA: Final = "arl-step-bag/1"
RECOVERED_FROM: Final = "extra.recovered_from"
"""Key that a recovered bag bears: it looks whole to every tool, but the step in it was not finished."""
DERIVED_FROM: Final = "extra.derived_from"
"""Key of a bag computed from another one."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StepMetadata:
    """Identity of one temperature step's recording.

    Attributes:
        campaign: name of the campaign.
        cycle: cycle count within the campaign, from 0.
        step: index of the step within the cycle, from 0.
        step_id: name of the step, as in the test's id (`c0003-07-up+25C`).
        attempt: 1 for the first try at this step.
        set_temperature_c: set temperature, degrees Celsius.
        ramp: +1 heating, -1 cooling, 0 neither.
        started_utc_ns: bench UTC at the start of the recording, nanoseconds.
        duts: serial numbers, in the order of the bench file.
        software_version: version of this package.
        bench_sha256: hash of the bench file.
        profile_sha256: hash of the profile.
        limits_sha256: hash of the limits.
        extra: anything more, text to text (names of the files, seed, settle summary ...).
    """

    campaign: str
    cycle: int
    step: int
    step_id: str
    attempt: int
    set_temperature_c: float
    ramp: int
    started_utc_ns: int
    duts: tuple[str, ...]
    software_version: str
    bench_sha256: str
    profile_sha256: str
    limits_sha256: str
    extra: Mapping[str, str] = field(default_factory=dict)

    @property
    def recovered(self) -> bool:
        """Whether this is what was left of a bag that was cut."""
        return RECOVERED_FROM.removeprefix("extra.") in self.extra

    def to_custom_data(self) -> dict[str, str]:
        """Flat text to text, as rosbag2 and MCAP want it; `extra` keys bear the prefix `extra.`."""
        data = {"schema": SCHEMA}
        for item in fields(self):
            value = getattr(self, item.name)
            if item.name == "duts":
                data["duts"] = json.dumps(list(self.duts))
            elif item.name != "extra":
                data[item.name] = repr(value) if isinstance(value, float) else str(value)
        return data | {f"extra.{key}": str(value) for key, value in self.extra.items()}

    @classmethod
    def from_custom_data(cls, data: Mapping[str, str], where: str) -> StepMetadata:
        """Inverse of `to_custom_data`.

        Args:
            data: the mapping read.
            where: file name for the error message.

        Raises:
            DataError: a key is missing or not of its type.
        """
        try:
            if data["schema"] != SCHEMA:
                raise DataError(f"{where}: metadata is of schema {data['schema']!r}; this version reads {SCHEMA!r}")
            duts = json.loads(data["duts"])
            set_temperature_c = float(data["set_temperature_c"])
            if not isinstance(duts, list) or not math.isfinite(set_temperature_c):
                raise ValueError("duts or set_temperature_c")
            return cls(
                campaign=data["campaign"],
                cycle=int(data["cycle"]),
                step=int(data["step"]),
                step_id=data["step_id"],
                attempt=int(data["attempt"]),
                set_temperature_c=set_temperature_c,
                ramp=int(data["ramp"]),
                started_utc_ns=int(data["started_utc_ns"]),
                duts=tuple(str(serial) for serial in duts),
                software_version=data["software_version"],
                bench_sha256=data["bench_sha256"],
                profile_sha256=data["profile_sha256"],
                limits_sha256=data["limits_sha256"],
                extra={key[6:]: value for key, value in data.items() if key.startswith("extra.")},
            )
        except KeyError as error:
            raise DataError(f"{where}: metadata key {error} is missing; not a step recording of this tool?") from None
        except ValueError as error:
            raise DataError(f"{where}: metadata cannot be read: {error}") from None
