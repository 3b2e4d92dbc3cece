"""`arl ack`: somebody has looked at the bench after a stop, and allows it to be driven again."""

from __future__ import annotations

from typing import Final

from arl_fixtures.errors import InterlockError
from arl_fixtures.guard.bookkeeping import acknowledged
from arl_fixtures.guard.runtime import Places, StopReport, read_stop, write_stop
from arl_fixtures.lab.framing import Link, PeerLostError

_PATIENCE_S: Final = 60.0


def acknowledge(places: Places, *, who: str, note: str) -> StopReport:
    """Acknowledge the last stop of a bench, through its guard where one is running.

    Args:
        places: files of the bench's guard.
        who: who has looked.
        note: what was found and done.

    Returns:
        the stop with its acknowledgement.

    Raises:
        InterlockError: there is nothing to acknowledge, or the guard is still at work.
        DataError: the report of the stop is damaged.
    """
    report = read_stop(places)
    if report is None or not report.blocks:
        raise InterlockError("nothing to acknowledge")
    try:
        link = Link.connect(places.socket)
    except PeerLostError:
        # no guard is running: the next one reads what we write
        done = acknowledged(report, who, note)
        write_stop(places, done)
        return done
    try:
        answer = link.ask({"op": "ack", "by": who, "note": note}, timeout_s=_PATIENCE_S).header
    except PeerLostError as error:
        raise InterlockError(f"the guard does not answer: {error}") from None
    finally:
        link.close()
    if "error" in answer:
        raise InterlockError(str(answer["message"]))
    return read_stop(places) or report
