"""What a value owes to the bench's instruments: one whose calibration ran out vouches for nothing any more.

A value is INVALID where an instrument that it depends on had expired when the step was recorded, unless the bench
file says for that instrument why it may be used all the same (`accept_expired`).
"""

from __future__ import annotations

from collections.abc import Mapping
from datetime import UTC, date, datetime
from typing import Final

THERMOMETER: Final = "thermometer"
STAGE: Final = "stage"
EVERY_VALUE: Final = (THERMOMETER, STAGE)
"""Without a thermometer nobody knows at which temperature a value was taken, without a stage nobody knows what each
pixel looked at. Chiller and relays set what these two measure: no value rests on their calibration."""

CALIBRATION_DUE: Final = "calibration_due"
ACCEPT_EXPIRED: Final = "accept_expired"


def expired_instruments(said: Mapping[str, str], utc_ns: int) -> dict[str, str]:
    """Roles whose calibration had run out, and how that reads as the reason of an INVALID value.

    Args:
        said: the entries ``ROLE.calibration_due`` (ISO date, the last day that counts) and ``ROLE.accept_expired``
            (why it may be used all the same), as a journal's environment holds them; others are ignored.
        utc_ns: when it was used.
    """
    today = datetime.fromtimestamp(utc_ns / 1e9, UTC).date()
    found = {}
    for key, due in said.items():
        role, _, what = key.rpartition(".")
        if what != CALIBRATION_DUE or said.get(f"{role}.{ACCEPT_EXPIRED}"):
            continue
        try:
            days = (today - date.fromisoformat(due)).days
        except ValueError:
            continue
        if days > 0:
            found[role] = f"calibration of the {role} expired on {due}, {days} days before"
    return found
