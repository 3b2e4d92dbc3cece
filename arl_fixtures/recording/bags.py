"""Finding bags in folders."""

from __future__ import annotations

from pathlib import Path

from arl_fixtures.errors import DataError
from arl_fixtures.recording.reader import StepBag


def bags_in(folder: Path, *, references: bool = False) -> list[Path]:
    """The finished bags in a folder, or in its subfolder `bags`, in the order they were recorded.

    Args:
        folder: a bag, a folder of bags, or an output folder.
        references: also those of reference sweeps before the cycle.

    Raises:
        DataError: there is none.
    """
    if (folder / "metadata.yaml").is_file() or any(folder.glob("*.mcap")):
        return [StepBag(folder).path]
    for place in (folder, folder / "bags"):
        found = [StepBag(path.parent) for path in sorted(place.glob("*/metadata.yaml"))]
        kept = [bag for bag in found if references or bag.metadata.step >= 0]
        if kept:
            return [bag.path for bag in sorted(kept, key=lambda bag: bag.metadata.started_utc_ns)]
    raise DataError(f"{folder}: holds no finished bag" if folder.exists() else f"{folder}: there is no such folder")
