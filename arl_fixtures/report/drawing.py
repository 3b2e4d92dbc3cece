"""How every drawing of a report is made: same data, same bytes; large enough to be read on a phone."""

from __future__ import annotations

import io
from collections.abc import Callable
from typing import TYPE_CHECKING, Final

from arl_fixtures.report.text import shown

if TYPE_CHECKING:
    from matplotlib.figure import Figure

WIDTH_IN: Final = 4.4
SHADES: Final = ("#1b5e9e", "#c2570c", "#2d7d46", "#7b3fa0", "#8a6d00", "#a3224a", "#00757a", "#555555")
"""Told apart in grey and by most colour-blind readers, together with the markers."""
MARKERS: Final = ("o", "s", "^", "D", "v", "P", "X", "*")
GRID: Final = "#d8d8d8"
_STYLE: Final = {
    "font.size": 8.5,
    "font.family": "DejaVu Sans",
    "axes.titlesize": 8.5,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": GRID,
    "grid.linewidth": 0.6,
    "legend.fontsize": 7.5,
    "legend.frameon": False,
    "svg.hashsalt": "arl-report",
    "svg.fonttype": "path",
    "figure.dpi": 100,
    "text.parse_math": False,
}


def drawn(draw: Callable[[Figure], None], height_in: float, suffix: str = "svg", width_in: float = WIDTH_IN) -> bytes:
    """A figure as SVG or PNG, without date or version of the tool that drew it.

    Args:
        draw: fills the figure.
        height_in: height, inches.
        suffix: ``svg`` or ``png``.
        width_in: width, inches.
    """
    # half a second of import that other commands need not wait for
    import matplotlib as mpl
    from matplotlib.figure import Figure

    with mpl.rc_context(_STYLE):  # type: ignore[arg-type]  # keys of rcParams are a Literal in the stubs
        figure = Figure(figsize=(width_in, height_in), layout="constrained")
        draw(figure)
        buffer = io.BytesIO()
        metadata = {"Date": None, "Creator": None} if suffix == "svg" else {"Software": None}
        figure.savefig(buffer, format=suffix, dpi=170, metadata=metadata)
    return buffer.getvalue()


def label(text: str) -> str:
    """A foreign text as a label of a drawing."""
    text = shown(text)
    return text if len(text) <= 40 else text[:39] + "…"
