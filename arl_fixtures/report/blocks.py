"""What a report is made of: sections of plain blocks that HTML and PDF set in their own way.

Nothing here is markup. Texts are plain and become visible as they are; the templates escape them.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Any, Literal

Tone = Literal["", "pass", "conditional", "not_run", "invalid", "fail"]


@dataclass(frozen=True, slots=True)
class Cell:
    """A table cell; the tone colours it, and is never all that tells."""

    text: str
    tone: Tone = ""


def verdict_cell(verdict: str) -> Cell:
    """A verdict in its colour."""
    tones: dict[str, Tone] = {
        "PASS": "pass",
        "CONDITIONAL": "conditional",
        "NOT_RUN": "not_run",
        "INVALID": "invalid",
        "FAIL": "fail",
    }
    return Cell(verdict.replace("_", " "), tones.get(verdict, ""))


@dataclass(frozen=True, slots=True, kw_only=True)
class Table:
    """Rows under a header.

    Attributes:
        header: column titles.
        rows: cells, as many as columns.
        weights: relative widths of the columns on paper.
        title: above the table; empty for none.
        note: below it.
    """

    header: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    weights: tuple[float, ...] = ()
    title: str = ""
    note: str = ""
    kind: Literal["table"] = "table"


@dataclass(frozen=True, slots=True, kw_only=True)
class Facts:
    """Pairs of label and value."""

    rows: tuple[tuple[str, Cell], ...]
    title: str = ""
    kind: Literal["facts"] = "facts"


@dataclass(frozen=True, slots=True, kw_only=True)
class Text:
    """A paragraph; with a tone it stands in a box of that colour."""

    text: str
    tone: Tone = ""
    kind: Literal["text"] = "text"


@dataclass(frozen=True, slots=True, kw_only=True)
class Picture:
    """A drawing.

    Attributes:
        name: file name in `Report.pictures`, by its suffix SVG or PNG.
        caption: below it.
        alt: what it shows, for who cannot see it.
        share: share of the paper's text width.
    """

    name: str
    caption: str
    alt: str
    share: float = 1.0
    kind: Literal["picture"] = "picture"


@dataclass(frozen=True, slots=True, kw_only=True)
class Signatures:
    """Lines to sign on."""

    roles: tuple[str, ...]
    kind: Literal["signatures"] = "signatures"


Block = Table | Facts | Text | Picture | Signatures


@dataclass(frozen=True, slots=True, kw_only=True)
class Section:
    """A headed part of the report."""

    title: str
    blocks: tuple[Block, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Report:
    """A whole report.

    Attributes:
        title: of the document.
        subtitle: what it is about.
        verdict: the cycle's.
        decided_by: what decided it; empty for PASS.
        banner: what must not be overlooked, e.g. that this is a re-judgement; empty for nothing.
        sections: in order.
        pictures: file name to content.
        footer: stands on every page: what identifies the report.
    """

    title: str
    subtitle: str
    verdict: Cell
    decided_by: str
    banner: str
    sections: tuple[Section, ...]
    footer: str
    pictures: dict[str, bytes] = field(default_factory=dict)

    def plain(self) -> dict[str, Any]:
        """Everything but the pictures as dictionaries, lists and texts."""
        content = {name: getattr(self, name) for name in ("title", "subtitle", "decided_by", "banner", "footer")}
        return content | {
            "verdict": asdict(self.verdict),
            "sections": [asdict(section) for section in self.sections],
        }
