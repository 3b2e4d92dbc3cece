"""HTML and PDF: same input, same bytes; what devices say is shown and never obeyed."""

from __future__ import annotations

import re
import shutil
import zlib
from html.parser import HTMLParser

import pytest
from report_samples import HOSTILE, drifting, journal, limit, one_step, report_of, step_id, step_of, value

from arl_fixtures.report.html import html_page
from arl_fixtures.report.lifetime import load_lifetime
from arl_fixtures.report.pdf import pdf_bytes
from arl_fixtures.report.text import range_text, shown
from arl_fixtures.report.write import write_report


class Page(HTMLParser):
    """Tags, attributes and visible text of a page."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.text = ""
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))

    def handle_data(self, data):
        self.text += data


@pytest.fixture(scope="module")
def hostile(tmp_path_factory):
    return one_step(tmp_path_factory.mktemp("hostile"), 9.0, "FAIL", dut=HOSTILE, reason=HOSTILE, campaign=HOSTILE)


def test_the_same_journal_gives_the_same_bytes_wherever_it_lies(tmp_path):
    path = drifting(tmp_path / "here", [0.0, 0.2, 0.3])
    there = tmp_path / "there"
    there.mkdir()
    shutil.copy(path, there)
    first = write_report(report_of(path), tmp_path / "one", "report")
    second = write_report(report_of(there / path.name), tmp_path / "two", "report")
    for one, two in zip(first, second, strict=True):
        assert one.read_bytes() == two.read_bytes()


def test_the_pdf_bears_no_date_of_its_making(tmp_path):
    made = pdf_bytes(report_of(one_step(tmp_path, 0.0, "PASS")))
    assert made.startswith(b"%PDF-")
    dates = re.findall(rb"\(D:(\d{8})", made) + re.findall(rb"CreateDate>(\d{4})", made)
    assert all(each.startswith(b"1970") for each in dates)


def test_the_page_needs_nothing_from_elsewhere(tmp_path):
    page = Page(html_page(report_of(drifting(tmp_path, [0.0, 0.2]))))
    assert not [tag for tag, _ in page.tags if tag in {"script", "link", "iframe", "object"}]
    urls = [
        value or "" for _, attributes in page.tags for name, value in attributes.items() if name in {"src", "href"}
    ]
    assert urls
    assert all(url.startswith(("data:image/", "#")) for url in urls)
    images = [attributes for tag, attributes in page.tags if tag == "img"]
    assert all(image["alt"] for image in images)


def test_hostile_texts_are_shown_and_make_no_markup(hostile):
    page = Page(html_page(report_of(hostile)))
    assert "script" not in {tag for tag, _ in page.tags}
    assert shown(HOSTILE) in page.text
    # neither the template language nor attributes take anything of it
    assert "49" not in page.text.split(shown(HOSTILE))[0][-40:]
    allowed = {"id", "class", "href", "lang", "charset", "name", "content", "http-equiv", "scope", "data-label"}
    allowed |= {"src", "alt", "role", "aria-label"}
    assert {name for _, attributes in page.tags for name in attributes} <= allowed


def test_hostile_texts_do_not_move_the_typesetter(hostile, tmp_path):
    report = report_of(hostile)
    made = pdf_bytes(report)
    harmless = one_step(tmp_path, 9.0, "FAIL", dut="SN-1", reason="harmless", campaign="c")
    assert page_count(made) - page_count(pdf_bytes(report_of(harmless))) in {0, 1}
    assert shown(HOSTILE) in report.plain()["subtitle"]


def page_count(pdf: bytes) -> int:
    bodies = [pdf]
    for stream in re.findall(rb"stream\r?\n(.*?)\r?\nendstream", pdf, re.DOTALL):
        try:
            bodies.append(zlib.decompress(stream))
        except zlib.error:
            continue
    return max(int(count) for body in bodies for count in re.findall(rb"/Count (\d+)", body))


@pytest.mark.parametrize(("number", "verdict"), [(9.0, "FAIL"), (None, "INVALID"), (None, "NOT_RUN")])
def test_what_is_not_pass_is_told_in_words_not_by_colour_alone(tmp_path, number, verdict):
    page = Page(html_page(report_of(one_step(tmp_path, number, verdict, reason="too few frames"))))
    assert verdict.replace("_", " ") in page.text
    assert "too few frames" in page.text


def test_short_cells_stay_on_a_line_and_long_ones_do_not(tmp_path):
    long = "stripe_80 is hidden or gone: at 1.61 m, off by +0.50 m"
    page = Page(html_page(report_of(one_step(tmp_path, None, "INVALID", dut="ARL-EMU-0001", reason=long))))
    tables = [attributes for tag, attributes in page.tags if tag == "div" and attributes.get("class") == "wide"]
    assert len(tables) == sum(tag == "table" for tag, _ in page.tags)
    markup = html_page(report_of(tmp_path / "session-0001.jsonl"))
    assert '<td data-label="DUT" class="whole">ARL-EMU-0001</td>' in markup
    assert f'<td data-label="Why">{long}</td>' in markup


def test_the_scope_of_a_metric_may_begin_a_line_and_is_the_same_text(tmp_path):
    name = step_id(0, 0, 25.0)
    values = value(name, "SN-1", 0.1, metric="distance_scatter_change", scope="<b>")
    markup = html_page(report_of(journal(tmp_path, step_of(0, 0, 25.0, values), [name])))
    assert "distance_scatter_change<wbr>[&lt;b&gt;]" in markup
    assert "distance_scatter_change[<b>]" in Page(markup).text


@pytest.mark.parametrize("cycles", [1, 5])
@pytest.mark.parametrize("verdict", ["INVALID", "NOT_RUN"])
def test_a_value_that_is_missing_has_no_unit_and_its_limit_has(tmp_path, cycles, verdict):
    held = limit(-5.0, 5.0, unit="mm")
    lines, plan = [], []
    for cycle in range(cycles):
        name = step_id(cycle, 0, 25.0)
        last = cycle == cycles - 1
        number, said_verdict, reason = (None, verdict, "stripe_80 is hidden or gone") if last else (0.1, "PASS", "")
        values = value(name, "SN-1", number, said_verdict, metric="distance_scatter", reason=reason, held=held)
        if not last:
            values[0] = values[0].model_copy(update={"unit": "mm"})
        lines += step_of(cycle, 0, 25.0, values, said_verdict)
        plan.append(name)
    path = journal(tmp_path, lines, plan, cycles=range(cycles))
    text = Page(html_page(report_of(path))).text
    assert "stripe_80 is hidden or gone" in text
    assert verdict.replace("_", " ") in text


def test_missing_maps_are_named_and_the_rest_is_there(tmp_path):
    page = Page(html_page(report_of(one_step(tmp_path, 0.0, "PASS"))))
    assert "Missing of c0000-00-up+25C: the bench file is not at hand" in page.text
    assert "Signatures" in page.text


def test_lifetime_is_shown_as_ranges(tmp_path):
    from test_lifetime import FILE

    page = Page(html_page(report_of(drifting(tmp_path, [0.0, 0.1]), load_lifetime(FILE))))
    assert re.search(r"\d\xa0…\xa0[\d.e+]+\xa0swings", page.text)
    assert re.search(r"\d\xa0…\xa0[\d.e+]+\xa0h", page.text)


@pytest.mark.parametrize(
    ("low", "high", "unit", "expected"),
    [
        (-9.38e-06, 0.00355, "%", "-0.00001 … 0.00355 %"),
        (-0.351, 0.686, "%", "-0.351 … 0.686 %"),
        (-1e-6, 0.00355, "%", "0.00000 … 0.00355 %"),
        (2.0, 2.0, "1", "2"),
        (0.0, 12.0, "1", "0 … 12"),
        (89.998, 90.004, "A", "90.0 A"),
        (-0.00588, 0.00482, "deg", "-0.00588 … 0.00482°"),
        (4.07, 98.8, "degC", "4.1 … 98.8 °C"),
        (0.0, 3e-15, "1", "0 … 3e-15"),
    ],
)
def test_ends_of_a_range_have_the_same_decimals(low, high, unit, expected):
    assert range_text(low, high, unit) == expected


@pytest.mark.parametrize(
    ("low", "high", "half_width", "expected"),
    [
        (-0.0895, -0.0816, 2.04, "-0.1 %"),
        (-1e-5, 0.00792, 0.0141, "0.000 … 0.008 %"),
        (-0.577, -0.087, 0.48, "-0.58 … -0.09 %"),
        (33.81, 44.176, 0.021, "33.810 … 44.176 %"),
        (120.0, 1480.0, 310.0, "120 … 1480 %"),
    ],
)
def test_ends_of_a_range_are_no_finer_than_their_uncertainty(low, high, half_width, expected):
    assert range_text(low, high, "%", half_width) == expected
