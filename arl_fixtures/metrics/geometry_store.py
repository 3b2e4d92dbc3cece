"""Expectations of a twin on disk, so that a process that comes later need not render them again.

An expectation is named by the hash of all it depends on: DUT file, chamber, angles, and the code that made it. What
cannot be read is rendered anew, and what cannot be written is not kept: nothing but time depends on this store.
"""

from __future__ import annotations

import contextlib
import hashlib
import zipfile
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any, Final, final

import numpy as np
import numpy.typing as npt

from arl_fixtures.twin import frame
from arl_fixtures.twin.frame import Renderer

Float64Array = npt.NDArray[np.float64]

EXPECTATIONS: Final = "cache"
"""Folder in a session's output."""
MOST_OF_A_DUT: Final = 2
"""Ascending sweeps repeat exactly, others never do; each is some 15 MB at full resolution."""


@final
class GeometryStore:
    """Expectations of one DUT in a folder.

    Args:
        folder: shared by all DUTs of a bench; made when it is needed.
        renderer: the twin.
    """

    def __init__(self, folder: Path, renderer: Renderer) -> None:
        self._folder = folder
        self._twin = hashlib.sha256(
            renderer.dut.model_dump_json().encode() + renderer.scene.model_dump_json().encode() + _code().encode()
        ).hexdigest()

    def read(self, stage_angle_deg: Float64Array, part: str = "") -> dict[str, npt.NDArray[Any]] | None:
        """What was written for these angles; None where there is nothing that can be used.

        Args:
            stage_angle_deg: (n,) angles.
            part: of the expectation; the images where not given.
        """
        try:
            with self._path(stage_angle_deg, part).open("rb") as stream, np.load(stream, allow_pickle=False) as file:
                return {name: file[name] for name in file.files}
        except (OSError, ValueError, EOFError, zipfile.BadZipFile):
            return None

    def write(self, stage_angle_deg: Float64Array, arrays: Mapping[str, npt.NDArray[Any]], part: str = "") -> None:
        """Keep an expectation, whole or not at all; a part of one only where its images are kept."""
        path = self._path(stage_angle_deg, part)
        unfinished = path.with_suffix(".part")
        try:
            if part and not self._path(stage_angle_deg).is_file():
                return
            if not part and len(list(self._folder.glob(f"{self._twin[:16]}-*.images.npz"))) >= MOST_OF_A_DUT:
                return
            self._folder.mkdir(parents=True, exist_ok=True)
            with unfinished.open("wb") as file:
                np.savez(file, allow_pickle=False, **arrays)
            unfinished.replace(path)
        except OSError:
            with contextlib.suppress(OSError):
                unfinished.unlink(missing_ok=True)

    def _path(self, stage_angle_deg: Float64Array, part: str = "") -> Path:
        angles = hashlib.sha256(self._twin.encode() + stage_angle_deg.tobytes()).hexdigest()
        return self._folder / f"{self._twin[:16]}-{angles[:32]}.{part or 'images'}.npz"


@cache
def _code() -> str:
    """Hash of the modules that make an expectation."""
    here = Path(__file__).parent
    modules = [
        *sorted(Path(frame.__file__).parent.glob("*.py")),
        *sorted((here / "calibration").glob("*.py")),
        here / "geometry.py",
        here / "panels.py",
    ]
    return hashlib.sha256(b"".join(module.read_bytes() for module in modules)).hexdigest()
