"""Reduce a recording that may end before its time: what came is kept, and what is missing is said."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from arl_fixtures.errors import DataError
from arl_fixtures.metrics.block import AngleBlock
from arl_fixtures.metrics.statistics import SweepStatistics


@dataclass(frozen=True, slots=True, kw_only=True)
class Collected:
    """Reduced sweeps of a step.

    Attributes:
        statistics: by serial number; one that recorded nothing is there and empty.
        faults: as `StepData` wants them; empty for a whole recording.
    """

    statistics: dict[str, SweepStatistics]
    faults: dict[str, str]


def collect(blocks: Iterable[AngleBlock], duts: Iterable[str]) -> Collected:
    """Reduce the blocks of all DUTs, in one pass.

    A recording that turns out to be cut or damaged keeps its blocks up to there, and a block that does not fit the
    others of its DUT is left out; the metrics that need more become INVALID with the reason, the others are measured.

    Args:
        blocks: from the sweep or from a bag; of DUTs in `duts` only.
        duts: serial numbers that should be there.

    Raises:
        DataError: a block is of a DUT that should not be there.
    """
    statistics = {serial: SweepStatistics(serial) for serial in duts}
    iterator, faults = iter(blocks), list[str]()
    while True:
        try:
            block = next(iterator)
        except StopIteration:
            break
        except DataError as error:
            faults.append(str(error))
            break
        if block.dut not in statistics:
            raise DataError(f"the recording holds DUT {block.dut}, which this bench does not have")
        try:
            statistics[block.dut].add(block)
        except DataError as error:
            faults.append(str(error))
    return Collected(statistics=statistics, faults={"frames": "; ".join(dict.fromkeys(faults))} if faults else {})
