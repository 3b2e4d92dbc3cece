"""The diagnosis as a page: says what the diagnosis says, trusts nothing from the table, needs nothing else."""

import re
from html.parser import HTMLParser

import numpy as np
import pytest

from arl_fixtures.reconcile import search
from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.command import reconcile
from arl_fixtures.reconcile.page import page_of
from arl_fixtures.reconcile.page_rows import shown_rows
from arl_fixtures.reconcile.page_words import with_interval
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import load_table

HOSTILE = "</style><script>alert(1)</script><img src=x onerror=alert(2)>\"'&$x_{1}$ {{ 7 * 7 }}"
VOID = {"meta", "br"}
RIVALS = ("timing.range_walk", "timing.tdc_nonlinearity", "timing.clock_scale")
"""A range walk, and who is named beside it: what a page says does not depend on who else was asked."""


class Outline(HTMLParser):
    """Tags with their attributes, and the text between them; the balance of the tags is checked."""

    def __init__(self):
        super().__init__()
        self.open, self.tags, self.text = [], [], []

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text.append(data)


def outline(page):
    found = Outline()
    found.feed(page.replace("<wbr>", ""))
    found.close()
    assert found.open == []
    return found


def text_of(page):
    return re.sub(r"\s+", " ", " ".join(outline(page).text))


def page_from(path, *effects):
    known = [library()[name] for name in effects] or None
    diagnosis, _, decision = diagnose(load_table(path), sha256="0" * 64, effects=known)
    return diagnosis, decision, page_of(diagnosis, decision)


@pytest.fixture(scope="module")
def walked(tmp_path_factory, make_table, save, walk):
    """Diagnosis, decision and page of a table with a range walk."""
    return page_from(save(tmp_path_factory.mktemp("walked") / "t.parquet", make_table(2, walk, steps=6)), *RIVALS)


def lamp(seed, *, loss):
    """A light-current curve at two heat-sink temperatures: no pixel, no angle, no step."""
    rng = np.random.default_rng(seed)
    current = np.tile(np.linspace(0.0, 2.0, 300), 2)
    light = np.maximum(current - 0.5, 0.0) * 0.8
    return {
        "drive_current_a": current,
        "humidity": rng.uniform(0.2, 0.8, 600),
        "output_w": light - loss * np.maximum(current - 1.2, 0.0) + rng.normal(0, 0.002, 600),
        "sim_output_w": light,
        "sim_output_w_std": np.full(600, 0.002),
    }


def test_every_finding_stands_on_the_page_with_its_law_intervals_and_alternatives(walked):
    diagnosis, decision, page = walked
    text = text_of(page)
    assert [f.effect for f in diagnosis.findings] == ["timing.range_walk"]
    for finding in diagnosis.findings:
        assert finding.alternatives
        assert finding.effect in text
        assert finding.expression in text
        assert finding.source in text
        assert finding.next_experiment in text
        assert finding.statement in text
        for p in finding.parameters:
            value, low, high = with_interval(p)
            assert f"{p.name} {value}" in text
            assert f"{low} to {high}" in text
        for other in finding.alternatives:
            assert f"{other.effect} " in text
    assert "disagrees with the measurement" in text
    assert "fewer than 1 of 1000 tables" in text
    # that a second run over the same table gives the same page: test_reconcile_command.py
    assert page_of(diagnosis, decision) == page


def test_the_page_loads_nothing_from_elsewhere(walked):
    _, _, page = walked
    for tag, attributes in outline(page).tags:
        assert tag not in {"script", "link", "iframe", "object", "embed", "img", "a"}
        for name, value in attributes.items():
            assert not name.startswith("on")
            if name in {"href", "src", "xlink:href"}:
                assert value.startswith("data:image/png;base64,")
    assert "url(" not in page
    assert "@import" not in page


def test_names_and_serials_from_outside_are_only_ever_text(tmp_path, make_table, save, walk):
    columns = make_table(2, walk, steps=6)
    columns["dut"] = np.array([HOSTILE, "S1"])[(columns["dut"] == "S1").astype(int)]
    columns["surface"] = np.array([f"{s}{HOSTILE}" for s in columns["surface"]])
    columns[f"{HOSTILE}_c"] = columns.pop("tof_temperature_c")
    for part in ("", "sim_"):
        columns[f"{part}{HOSTILE}_m"] = columns.pop(f"{part}distance_m")
    columns[f"sim_{HOSTILE}_m_std"] = columns.pop("sim_distance_m_std")
    columns[f"sim_{HOSTILE}_orphan"] = columns["reflectance"]
    diagnosis, _, page = page_from(save(tmp_path / "t.parquet", columns), *RIVALS)
    assert f"{HOSTILE}_m" in diagnosis.channels
    assert diagnosis.verdict == "mismatch"
    found = outline(page)
    assert {tag for tag, _ in found.tags} <= {
        "html", "head", "meta", "title", "style", "body", "header", "section", "div", "span", "h1", "h2", "h3", "h4",
        "p", "pre", "code", "strong", "ul", "li", "table", "tr", "th", "td", "figure", "figcaption", "svg", "text",
        "polyline", "polygon", "rect", "circle", "image",
    }  # fmt: skip
    assert not any(name.startswith("on") for _, attributes in found.tags for name in attributes)
    assert page.count("<style>") == page.count("</style>") == 1
    assert HOSTILE in "".join(found.text)


def test_a_table_without_any_position_gives_a_page_with_fewer_pictures(tmp_path, save):
    diagnosis, _, calm = page_from(save(tmp_path / "a.parquet", lamp(8, loss=0.0)))
    assert diagnosis.verdict == "consistent"
    assert "agrees with the measurement" in text_of(calm)
    assert "<image" not in calm
    assert calm.count("<svg") == 3  # drive current, humidity, simulated output
    assert "Findings, strongest first" not in calm
    diagnosis, _, bent = page_from(save(tmp_path / "b.parquet", lamp(8, loss=0.05)))
    assert diagnosis.verdict == "mismatch"
    assert "Over drive_current_a" in text_of(bent)
    assert 'class="after"' in bent


def test_the_page_lies_beside_the_other_files_and_names_what_was_not_used(tmp_path, save):
    table = lamp(8, loss=0.0)
    table["sim_forgotten_m"] = table["humidity"]
    reconcile(save(tmp_path / "t.parquet", table), tmp_path / "out")
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == [
        "diagnosis.html", "diagnosis.json", "localisation.parquet", "model.yaml",
    ]  # fmt: skip
    text = text_of((tmp_path / "out" / "diagnosis.html").read_text(encoding="utf-8"))
    assert "sim_forgotten_m has no measured column 'forgotten_m' beside it" in text
    assert "Rows 600" in text


def test_of_a_large_table_the_pictures_show_rows_that_the_search_never_saw(
    tmp_path, make_table, save, walk, monkeypatch
):
    monkeypatch.setattr(search, "FULL_ROWS", 700)
    diagnosis, decision, page = page_from(save(tmp_path / "t.parquet", make_table(2, walk, steps=20)), *RIVALS)
    shown = shown_rows(decision)
    assert shown.fresh
    assert np.intersect1d(shown.problem.view.rows, decision.problem.view.rows).size == 0
    assert len(shown.problem.view.rows) + decision.problem.view.n == decision.problem.columns.n
    d = next(d for d in shown.problem.data if d.channel.name == "distance_m")
    assert diagnosis.findings
    before, after = (np.mean(d.whiten(d.residual(state)) ** 2) for state in (shown.before, shown.after))
    assert after < 1.2 < before
    assert "on rows that the search never looked at" in text_of(page)


def test_a_pixel_index_that_is_none_costs_no_memory(tmp_path, save):
    table = lamp(8, loss=0.0)
    rng = np.random.default_rng(1)
    table["pixel_u"], table["pixel_v"] = rng.uniform(0, 1e9, 600), rng.uniform(0, 4, 600)
    columns = load_table(save(tmp_path / "t.parquet", table))
    diagnosis, _, decision = diagnose(columns, effects=[])
    assert len(page_of(diagnosis, decision)) < 200_000
