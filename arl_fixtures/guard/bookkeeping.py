"""The guard's memory on disk: its log, why the bench was stopped, and that it is being driven."""

from __future__ import annotations

import json
import os
from dataclasses import replace
from datetime import UTC, datetime
from typing import Any, Final, final

from arl_fixtures.errors import StorageError
from arl_fixtures.guard.core import Event, GuardCore, Record, State
from arl_fixtures.guard.runtime import (
    UNDER_WAY,
    Places,
    StopReport,
    append_log,
    read_stop,
    write_durably,
    write_stop,
)

_STOPS: Final = {Event.TRIP.value, Event.FOUND.value}


@final
class Bookkeeping:
    """Writes down what the core says.

    Args:
        places: where.
        bench: name of the bench.
    """

    def __init__(self, places: Places, bench: str) -> None:
        self._places, self._bench = places, bench
        self.last_stop: StopReport | None = read_stop(places)
        self._open: StopReport | None = None
        self._actions: list[dict[str, Any]] = []

    @property
    def what_nobody_ended(self) -> tuple[str, bool]:
        """What a predecessor left undone, in words, empty if nothing; whether somebody must look in any case."""
        try:
            since = str(json.loads(self._places.driven.read_text(encoding="utf-8"))["since_utc"])
        except FileNotFoundError:
            return "", False
        except (OSError, ValueError, KeyError, TypeError):
            since = "an unknown time"
        stop = self.last_stop
        if stop is None or not stop.blocks:
            return f"the guard died while a test, there since {since}, drove the bench", False
        # what could not be verified asks for somebody, also when it works later
        needs_ack = stop.ack_if_verified or stop.unverified != UNDER_WAY
        return f"{stop.cause}; the guard died while it made the bench safe", needs_ack

    def write_down(self, core: GuardCore, records: list[Record]) -> None:
        """Keep records; what must outlive a power failure is on disk when this returns."""
        if not records:
            return
        append_log(
            self._places,
            [{"utc": now_utc(), "time_s": round(r.time_s, 6), "what": r.what, **r.detail} for r in records],
        )
        for record in records:
            self._see(core, record)

    def _see(self, core: GuardCore, record: Record) -> None:
        after = record.detail.get("after")
        if record.what == Event.JOIN.value:
            mark = {"since_utc": now_utc(), "bench_time_s": round(record.time_s, 6), "guard": os.getpid()}
            write_durably(self._places.driven, json.dumps(mark) + "\n")
        elif record.what in _STOPS:
            self._begin(core, record, str(record.detail["cause"]))
        elif record.what == Event.LEAVE.value:
            self._actions = []
        elif record.what == Event.RETRY.value:
            self._open = self.last_stop
        elif record.what == Event.SENDING.value:
            if self.last_stop is None or self.last_stop.cause != core.cause or self.last_stop.acknowledged:
                self._begin(core, record, core.cause)
            self._open = self.last_stop
            self._settle(core, record)
        elif record.what == "safe action":
            self._actions.append({"time_s": round(record.time_s, 6), **record.detail})
        elif record.what in {Event.SETTLED.value, Event.UNSAFE.value}:
            self._settle(core, record)
        elif record.what == Event.ACK.value and self.last_stop is not None:
            self._keep(acknowledged(self.last_stop, str(record.detail["by"]), str(record.detail["note"])))
        if after in {State.IDLE, State.SAFE} and not core.unverified:
            self.forget_session()

    def forget_session(self) -> None:
        """Nobody need end the session any more: the bench is safe, or somebody has told the guard to leave it."""
        self._places.driven.unlink(missing_ok=True)

    def _begin(self, core: GuardCore, record: Record, cause: str) -> None:
        # written before the first action: should the guard die now, the next one knows
        self._actions = []
        self._open = StopReport(
            bench=self._bench,
            cause=cause,
            utc=now_utc(),
            bench_time_s=round(record.time_s, 6),
            unverified=dict(UNDER_WAY),
            ack_if_verified=core.needs_ack,
        )
        self._keep(self._open)

    def _settle(self, core: GuardCore, record: Record) -> None:
        unverified = dict(record.detail.get("unverified", {}))
        if self._open is None:
            if not unverified:
                return
            self._begin(core, record, core.cause)
        assert self._open is not None
        actions = [*self._open.actions, *self._actions]
        self._keep(replace(self._open, actions=actions, unverified=unverified, needs_ack=core.needs_ack))
        self._open, self._actions = None, []

    def _keep(self, report: StopReport) -> None:
        self.last_stop = report
        try:
            write_stop(self._places, report)
        except StorageError as error:
            # the bench comes first; who asks the guard still gets the report
            append_log(self._places, [{"utc": now_utc(), "what": "stop not kept", "fault": str(error)}])


def acknowledged(report: StopReport, who: str, note: str) -> StopReport:
    """The report with its acknowledgement."""
    return replace(report, acknowledged={"by": who, "utc": now_utc(), "note": note})


def now_utc() -> str:
    """Wall time, ISO 8601 with seconds."""
    return datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
