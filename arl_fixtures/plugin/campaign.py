"""A campaign: which cycles a session runs, and when it stops by itself.

The cycle count is carried from journal to journal in the output folder. A campaign file says how many cycles and
what ends them early; it is judged after each cycle, from the journals alone.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from statistics import fmean
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import AfterValidator, Field, model_validator

from arl_fixtures.errors import DataError, UnitError
from arl_fixtures.journal.record import SessionRecord, read_journal
from arl_fixtures.journal.resume import JOURNAL_PATTERN, newest_journal
from arl_fixtures.plugin.options import Options
from arl_fixtures.quantity import check_unit, convert
from arl_fixtures.yaml_model import FileModel, load_model


def _known_unit(text: str) -> str:
    try:
        return check_unit(text)
    except UnitError as error:
        raise ValueError(str(error)) from None


UnitText = Annotated[str, AfterValidator(_known_unit)]


class Watched(FileModel):
    """The metric that a condition looks at: its mean over all steps of a cycle, for each DUT and scope."""

    metric: str = Field(min_length=1)
    unit: UnitText
    scope: str | None = None
    reason: str = Field(min_length=1)


class WearOut(Watched):
    """Ends the campaign when a DUT's value leaves the bounds."""

    lower: float | None = Field(default=None, allow_inf_nan=False)
    upper: float | None = Field(default=None, allow_inf_nan=False)

    @model_validator(mode="after")
    def _bounds(self) -> Self:
        if self.lower is None and self.upper is None:
            raise ValueError("give lower or upper")
        if self.lower is not None and self.upper is not None and self.lower > self.upper:
            raise ValueError(f"lower {self.lower:g} is above upper {self.upper:g}")
        return self


class Drift(Watched):
    """Ends the campaign when a DUT's value changes faster than `per_cycle` over the last `over_cycles`."""

    per_cycle: float = Field(gt=0, allow_inf_nan=False)
    over_cycles: int = Field(default=5, ge=3)


class StopRules(FileModel):
    """What ends a campaign early."""

    verdict: Literal["FAIL", "INVALID", "never"] = "never"
    wear_out: tuple[WearOut, ...] = ()
    drift: tuple[Drift, ...] = ()


class CampaignFile(FileModel):
    """A campaign file."""

    cycles: int = Field(ge=1)
    stop: StopRules = StopRules()


Series = dict[tuple[str, str], dict[int, float]]
"""(DUT, scope) to cycle count to value."""


def session_cycles(options: Options) -> Sequence[int]:
    """Cycle counts of this session: the interrupted ones, those asked for, or the next ones of the campaign.

    Raises:
        DataError: a journal in the output folder cannot be read, there is none to resume, or all cycles are done.
        ConfigError: the campaign file is wrong.
    """
    if options.resume:
        return read_journal(newest_journal(options.out)).begin.cycles
    first = options.first_cycle if options.first_cycle is not None else next_cycle(options.out)
    if options.campaign is None:
        return range(first, first + options.cycles)
    campaign = load_model(options.campaign, CampaignFile)
    if first >= campaign.cycles:
        raise DataError(f"{options.campaign}: all {campaign.cycles} cycles of the campaign are done")
    return range(first, campaign.cycles)


def next_cycle(out: Path) -> int:
    """The cycle count after the last one begun in a folder; 0 in an empty one.

    Raises:
        DataError: a journal there cannot be read.
    """
    done = [attempt.begin.cycle for record in _sessions(out) for attempt in record.attempts]
    return max(done, default=-1) + 1


def why_stop(rules: StopRules, out: Path, cycle: int, *, alive: Callable[[], None] = lambda: None) -> str:
    """Why the campaign ends after this cycle, in words; empty while it goes on.

    Args:
        rules: the campaign file's.
        out: folder of the journals.
        cycle: the cycle that has just ended.
        alive: called after each journal that was read: there may be hundreds.
    """
    if rules == StopRules():
        return ""
    records = _sessions(out, alive)
    if rules.verdict != "never":
        bad = {"FAIL"} if rules.verdict == "FAIL" else {"FAIL", "INVALID"}
        for record in records:
            for step in record.steps.values():
                if step.begin.cycle == cycle and step.begin.step_index >= 0 and step.verdict in bad:
                    return f"step {step.step_id} is {step.verdict}"
    for wear in rules.wear_out:
        for (dut, scope), values in _series(records, wear).items():
            value = values.get(cycle)
            low, high = wear.lower, wear.upper
            if value is not None and ((low is not None and value < low) or (high is not None and value > high)):
                return f"{dut} {_name(wear.metric, scope)} is {value:.4g}{_unit(wear)}: {wear.reason}"
    for drift in rules.drift:
        for (dut, scope), values in _series(records, drift).items():
            last = sorted(values)[-drift.over_cycles :]
            if len(last) < drift.over_cycles or last[-1] != cycle:
                continue
            slope = float(np.polyfit(last, [values[count] for count in last], 1)[0])
            if abs(slope) > drift.per_cycle:
                place = _name(drift.metric, scope)
                return f"{dut} {place} drifts by {slope:.3g}{_unit(drift)} per cycle: {drift.reason}"
    return ""


def _sessions(out: Path, alive: Callable[[], None] = lambda: None) -> list[SessionRecord]:
    """Sessions of a folder, oldest first; re-judgements are none."""
    records = []
    for path in sorted(out.glob(JOURNAL_PATTERN)):
        records.append(read_journal(path))
        alive()
    return [record for record in records if not record.begin.rejudged_from]


def _series(records: Iterable[SessionRecord], watched: Watched) -> Series:
    """Mean of the metric over the finished steps of each cycle, in the condition's unit."""
    values: dict[tuple[str, str], dict[int, list[float]]] = {}
    for record in records:
        for attempt in record.attempts:
            if not attempt.finished or attempt.begin.step_index < 0:
                continue
            for each in attempt.measurements:
                fits = each.metric == watched.metric and watched.scope in {None, each.scope}
                if fits and each.value is not None and np.isfinite(each.value):
                    value = convert(each.value, each.unit, watched.unit)
                    by_cycle = values.setdefault((each.dut, each.scope), {})
                    by_cycle.setdefault(attempt.begin.cycle, []).append(value)
    return {key: {cycle: fmean(found) for cycle, found in series.items()} for key, series in values.items()}


def _name(metric: str, scope: str) -> str:
    return f"{metric}[{scope}]" if scope else metric


def _unit(watched: Watched) -> str:
    return "" if watched.unit in {"", "1"} else f" {watched.unit}"
