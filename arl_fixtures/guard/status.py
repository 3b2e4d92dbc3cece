"""What the guard of a bench does, asked from outside."""

from __future__ import annotations

from typing import Final

from arl_fixtures.guard.runtime import Places, lease_holder, read_stop
from arl_fixtures.lab.framing import Link, PeerLostError

_PATIENCE_S: Final = 5.0


def guard_status(places: Places, *, lease_s: float) -> str:
    """A few lines for a person: whether a guard is there, its state, the last stop.

    Raises:
        DataError: the report of the last stop is damaged.
    """
    lines = []
    pid = lease_holder(places.lease, lease_s=lease_s)
    if pid == 0:
        lines.append("no guard is running")
    else:
        try:
            link = Link.connect(places.socket)
            try:
                answer = link.ask({"op": "status"}, timeout_s=_PATIENCE_S).header
            finally:
                link.close()
        except PeerLostError as error:
            lines.append(f"guard (process {pid}) does not answer: {error}")
        else:
            cause = f": {answer['cause']}" if answer["cause"] else ""
            lines.append(f"guard (process {pid}) is {answer['state']}{cause}")
            if answer["request"]:
                lines.append(f"it asks the test to pause: {answer['request'][1]}")
    if pid == 0 and places.driven.exists():
        lines.append("a session was driving the bench and nobody has ended it; the next guard will")
    stop = read_stop(places)
    if stop is not None:
        lines.append(f"last stop: {stop}")
        lines.append("it must be acknowledged: arl ack" if stop.blocks else "nothing to acknowledge")
    return "\n".join(lines)
