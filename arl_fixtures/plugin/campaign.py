"""Which cycles a session runs: the cycle count is carried from journal to journal of a campaign."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from arl_fixtures.journal.record import read_journal
from arl_fixtures.journal.resume import JOURNAL_PATTERN, newest_journal
from arl_fixtures.plugin.options import Options


def session_cycles(options: Options) -> Sequence[int]:
    """Cycle counts of this session: the interrupted ones, those asked for, or the next ones of the campaign.

    Raises:
        DataError: a journal in the output folder cannot be read, or there is none to resume.
    """
    if options.resume:
        return read_journal(newest_journal(options.out)).begin.cycles
    first = options.first_cycle if options.first_cycle is not None else next_cycle(options.out)
    return range(first, first + options.cycles)


def next_cycle(out: Path) -> int:
    """The cycle count after the last one begun in a folder; 0 in an empty one.

    Raises:
        DataError: a journal there cannot be read.
    """
    done = [cycle for path in sorted(out.glob(JOURNAL_PATTERN)) for cycle in read_journal(path).begin.cycles]
    return max(done, default=-1) + 1
