"""A report as PDF, set by typst. Texts reach it as JSON data, never as markup, so nothing in them is interpreted."""

from __future__ import annotations

import json
import tempfile
from pathlib import Path
from typing import Final

from arl_fixtures.errors import StorageError
from arl_fixtures.report.blocks import Report

TEMPLATE: Final = Path(__file__).parent / "report.typ"


def pdf_bytes(report: Report) -> bytes:
    """The PDF; the same report gives the same bytes: embedded fonts only, and no date of making.

    Raises:
        StorageError: the typesetter refuses, or there is no room for its input.
    """
    # the typesetter is loaded where it is used: other commands start without it
    import typst

    try:
        with tempfile.TemporaryDirectory(prefix="arl-report-") as name:
            folder = Path(name)
            (folder / "report.typ").write_bytes(TEMPLATE.read_bytes())
            (folder / "report.json").write_text(json.dumps(report.plain(), ensure_ascii=False), encoding="utf-8")
            for picture, content in report.pictures.items():
                (folder / picture).write_bytes(content)
            made = typst.compile(folder / "report.typ", root=folder, ignore_system_fonts=True, timestamp=0)
    except typst.TypstError as error:
        raise StorageError(f"PDF cannot be set: {error}") from None
    except OSError as error:
        raise StorageError(f"PDF cannot be set: {error.strerror}") from None
    assert isinstance(made, bytes)  # one document, no output file
    return made
