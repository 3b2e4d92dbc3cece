"""The proof's figures: rates with their counts, beside what was to be reached, as text and Markdown."""

from collections.abc import Iterable

import numpy as np

from benchmarks.concealed.score import Score

Line = tuple[str, str, str]


def _rate(values: Iterable[bool | None]) -> str:
    marks = [bool(v) for v in values if v is not None]
    return f"{100 * np.mean(marks):.0f} % ({sum(marks)} of {len(marks)})" if marks else "–"


def _median(values: Iterable[float | None], unit: str = "") -> str:
    marks = [v for v in values if v is not None]
    return f"{np.median(marks):.2f}{unit} ({len(marks)})" if marks else "–"


def figures(scores: list[Score]) -> list[Line]:
    """(measure, reached, to reach) in the order of the promise."""
    kinds = {k: [s for s in scores if s.kind == k] for k in ("null", "single", "pair", "unknown")}
    one, two, none, other = kinds["single"], kinds["pair"], kinds["null"], kinds["unknown"]
    lines: list[Line] = [
        ("null tables that end consistent", _rate(s.named for s in none), "≥ 98 %"),
        ("null tables with a wrong name", _rate(s.wrong for s in none), "0 of 100"),
    ]
    for band, goal in (("faint", "≥ 65 %"), ("moderate", "≥ 92 %"), ("strong", "≥ 98 %")):
        here = [s for s in one if s.band == band]
        lines.append((f"named first, {band}", _rate(s.named for s in here), goal))
        lines.append((f"first class holds the truth, {band}", _rate(s.classed for s in here), ""))
    lines += [
        ("first name wrong (single effects)", _rate(s.wrong for s in one), "≤ 2 %"),
        ("something added to a single effect", _rate(s.added for s in one), ""),
        ("both of two named, nothing added", _rate(s.exact for s in two), "≥ 92 %"),
        ("both of two named", _rate(s.both for s in two), ""),
        ("outside the library, wrongly named", _rate(s.wrong for s in other), "≤ 8 %"),
        ("outside, called unknown and nothing else", _rate(s.named for s in other), ""),
        (
            "outside, channel and first driver right",
            _rate(None if s.channel is None else bool(s.channel and s.driver is not False) for s in other),
            "≥ 85 %",
        ),
        ("single effects: channel right", _rate(s.channel for s in one), ""),
        ("single effects: first driver right", _rate(s.driver for s in one), ""),
        ("region overlap, named cases (median)", _median(s.region for s in one), ""),
        ("unseen improvement reached, library (median)", _median(s.explained for s in one), "≥ 0.95"),
        ("unseen improvement reached, unknown (median)", _median(s.explained for s in other), "≥ 0.80"),
        ("parameter error (median)", _median(p[1] for s in one for p in s.parameters), ""),
        ("95 % intervals that cover", _rate(p[2] for s in one for p in s.parameters), "90–98 %"),
        ("CPU seconds per case (median)", _median((s.cpu_seconds for s in scores), " s"), ""),
        ("CPU seconds, slowest case", f"{max((s.cpu_seconds for s in scores), default=0.0):.0f} s", ""),
        ("cases without an answer", str(sum(not s.answered for s in scores)), "0"),
    ]
    return lines


def _cell(value: object) -> str:
    if value is None:
        return ""
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.2f}" if isinstance(value, float) else str(value)


def as_text(lines: list[Line]) -> str:
    """Aligned columns."""
    width = max(len(line[0]) for line in lines)
    return "\n".join(f"{a:<{width}}  {b:<18}  {c}" for a, b, c in lines)


def as_markdown(lines: list[Line], scores: list[Score], heading: str) -> str:
    """Summary table and one row per case."""
    out = [heading, "", "| measure | reached | to reach |", "| --- | --- | --- |"]
    out += [f"| {a} | {b} | {c} |" for a, b, c in lines]
    out += [
        "",
        "## Every case",
        "",
        "| case | kind | sensor | truth | strength | said | first right | wrong | region | unseen | CPU s |",
        "| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |",
    ]
    for s in scores:
        said = (
            ", ".join(s.said)
            if s.said
            else (s.failed.replace("|", "/").strip().splitlines() or ["consistent"])[-1][:100]
        )
        cells = (s.name, s.kind, s.sensor, ", ".join(s.truth), s.band, said, s.named, s.wrong, s.region, s.explained)
        out.append("| " + " | ".join(_cell(c) for c in cells) + f" | {s.cpu_seconds:.0f} |")
    return "\n".join(out) + "\n"
