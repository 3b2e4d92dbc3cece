"""What Allure gets of a step: parameters, steps, one bounded figure, environment and categories."""

from __future__ import annotations

import io
import json
import platform
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import allure
import numpy as np
import numpy.typing as npt

import arl_fixtures
from arl_fixtures.metrics.step import StepData
from arl_fixtures.plugin.outcome import Row, verdict_table
from arl_fixtures.plugin.setup import SessionFiles
from arl_fixtures.plugin.step_runner import StepResult

FloatArray = npt.NDArray[np.floating]

FIGURE_INCHES: Final = (9.0, 4.5)
FIGURE_DPI: Final = 80
CATEGORIES: Final = (
    {"name": "Limit exceeded", "matchedStatuses": ["failed"]},
    {"name": "INVALID: not measured or not to be trusted", "matchedStatuses": ["broken"]},
)


def describe(result: StepResult, rows: Sequence[Row], files: SessionFiles) -> None:
    """Attach a step's table and figure to the running test; nothing is drawn when nobody collects Allure results."""
    if not files.allure_folder:
        return
    step = result.step
    allure.dynamic.title(f"{step.id}: {step.set_temperature_c:g} °C")  # type: ignore[no-untyped-call]  # allure's
    allure.dynamic.parameter("set temperature", f"{step.set_temperature_c:g} °C")
    allure.dynamic.parameter("cycle", step.cycle)
    allure.dynamic.parameter("profile", files.profile.name)
    with allure.step(f"settle: {result.settle.duration_s:.0f} s, overshoot {result.settle.overshoot_k:.2f} K"):
        pass
    if result.bag is not None:
        with allure.step(f"record {result.bag.path.name}: {result.bag.size_bytes / 1e6:.1f} MB"):
            pass
    with allure.step(f"judge: {result.verdict.value} {result.reason}".rstrip()):
        allure.attach(verdict_table(rows), "values and limits", allure.attachment_type.TEXT)
    if result.steps:
        allure.attach(figure(result), "intensity and distance error", allure.attachment_type.PNG)


def figure(result: StepResult) -> bytes:
    """One PNG of bounded size: per DUT the mean intensity and the median distance error of each pixel."""
    # a second of import that only Allure users pay
    import matplotlib as mpl
    from matplotlib.figure import Figure

    with mpl.rc_context({"font.size": 7}):
        drawing = Figure(figsize=FIGURE_INCHES, dpi=FIGURE_DPI)
        # fixed places: laying out automatically draws everything three times
        drawing.subplots_adjust(left=0.035, right=0.95, bottom=0.06, top=0.94, wspace=0.25, hspace=0.25)
        axes = drawing.subplots(2, len(result.steps), squeeze=False)
        for column, (serial, data) in enumerate(result.steps.items()):
            for row, (label, image) in enumerate(_maps(data)):
                axis = axes[row][column]
                shown = axis.imshow(image, aspect="auto", interpolation="nearest")
                axis.set_title(f"{serial}: {label}")
                drawing.colorbar(shown, ax=axis, pad=0.02, fraction=0.06)
        buffer = io.BytesIO()
        drawing.savefig(buffer, format="png", metadata={"Software": None})
    return buffer.getvalue()


def write_environment(folder: Path, files: SessionFiles) -> None:
    """Write Allure's environment and categories beside its results."""
    environment = {
        "arl-fixtures": arl_fixtures.__version__,
        "Python": platform.python_version(),
        "bench": files.bench.name,
        "bench SHA-256": files.hashes["bench"],
        "profile": files.profile.name,
        "profile SHA-256": files.hashes["profile"],
        "limits SHA-256": files.hashes["limits"],
        "DUTs": ", ".join(dut.serial for dut in files.bench.dut_settings),
    }
    lines = (f"{key.replace(' ', '_')}={value}" for key, value in environment.items())
    (folder / "environment.properties").write_text("\n".join(lines) + "\n", encoding="utf-8")
    (folder / "categories.json").write_text(json.dumps(CATEGORIES, indent=1), encoding="utf-8")


def _maps(data: StepData) -> tuple[tuple[str, FloatArray], tuple[str, FloatArray]]:
    """Mean intensity, and mean distance minus the twin's, over all angles; each pixel (H, W)."""
    with warnings.catch_warnings():
        # a dead pixel has no value at any angle, which is what the map shows
        warnings.simplefilter("ignore", RuntimeWarning)
        intensity = np.nanmean(data.sweep.intensity_counts, axis=0)
        error_mm = 1e3 * np.nanmedian(data.sweep.distance_m - data.geometry.distance_m, axis=0)
    return ("mean intensity / counts", intensity), ("median distance error / mm", error_mm)
