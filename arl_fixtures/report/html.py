"""A report as one HTML page that needs nothing else: no script, no request, every foreign text escaped."""

from __future__ import annotations

import base64
from pathlib import Path
from typing import Final

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from arl_fixtures.report.blocks import Report

_HERE: Final = Path(__file__).parent
_TYPES: Final = {"svg": "image/svg+xml", "png": "image/png"}


def html_page(report: Report) -> str:
    """The page; the same report gives the same page."""
    environment = Environment(
        loader=FileSystemLoader(_HERE),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    template = environment.get_template("report.html.j2")
    sources = {name: _data_url(name, content) for name, content in report.pictures.items()}
    css = (_HERE / "report.css").read_text("utf-8")
    return template.render(report=report.plain(), sources=sources, css=css)


def _data_url(name: str, content: bytes) -> str:
    # as an image a drawing can neither run scripts nor share ids with another one
    return f"data:{_TYPES[name.rpartition('.')[2]]};base64,{base64.b64encode(content).decode()}"
