"""What a person reads: no unit 1, no signed zero, no stray spaces; every sentence of the library says a size."""

import io
import re

import numpy as np
import pyarrow as pa
import pytest
from rich.console import Console
from rich.progress import Progress

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.finding_words import separating, tidy
from arl_fixtures.reconcile.page_words import breakable, readable
from arl_fixtures.reconcile.progress_bar import TimeLeft
from arl_fixtures.reconcile.table import columns_of
from arl_fixtures.reconcile.terms import default_values
from arl_fixtures.reconcile.view import View

DEFECT = re.compile(r"\s[.,;]|  |\d 1 of |[+-]0\.0+ |\bnan\b|\binf\b|None|(?<!and )(?<!between )(?<![\d.])0\.0+ %")


@pytest.mark.parametrize(
    ("said", "better"),
    [
        ("The light fades by 1.0 % from cycle 1 to 49 .", "The light fades by 1.0 % from cycle 1 to 49."),
        ("It changed from 1 to 4 1 of cycle.", "It changed from 1 to 4 of cycle."),
        ("up to 0.0914 1", "up to 0.0914"),
        ("between -3.6 and -0.0 %.", "between -3.6 and 0.0 %."),
        ("The distance shifts by -0.05 mm at 0.001.", "The distance shifts by -0.05 mm at 0.001."),
        ("3 of 12 pixels; 1, then 2.", "3 of 12 pixels; 1, then 2."),
    ],
)
def test_a_sentence_is_tidied(said, better):
    assert tidy(said) == better


def test_no_sentence_of_the_library_needs_an_excuse(make_table):
    table = make_table(1)
    time_s = table["time_s"]
    table |= {
        "cycle": 1.0 + np.floor(time_s / 3000.0), "rail_5v0_v": 5.0 + 0.01 * np.sin(time_s),
        "laser_current_a": 1.0 + 0.1 * np.cos(time_s), "ambient_temperature_c": 20.0 + np.sin(time_s),
        "incidence_deg": np.abs(table["azimuth_deg"] + table["stage_angle_deg"]), "mixed": table["pixel_u"] % 5 == 0,
        "valid_fraction": np.ones(len(time_s)), "sim_valid_fraction": 1.0 - 1e-3 * (table["pixel_u"] % 3),
        "intensity_counts_std": table["sim_intensity_counts_std"], "distance_m_std": table["sim_distance_m_std"],
    }  # fmt: skip
    view = View(columns_of(pa.table(table)))
    seen = 0
    for effect in library().values():
        for variant in effect.variants(view):
            free = {p.name: 0.03 if p.unit == "1" else p.typical for p in variant.parameters if p.per}
            sentence = tidy(effect.sentence(variant, {**free, **default_values(variant, amplitude=1.0)}, view))
            assert not DEFECT.search(sentence), sentence
            assert not sentence[0].islower() or sentence.split()[0] in table, sentence
            assert sentence.endswith("."), sentence
            seen += 1
    assert seen > 80


def test_a_class_asks_for_the_measurement_of_each_of_its_effects():
    text = separating("Use a filter.", {"a.b": "Heat it.", "c.d": "Use a filter."})
    assert text == "Use a filter. To check for a.b: Heat it."
    assert separating("Use a filter.", {}) == "Use a filter."


def test_large_numbers_and_long_names_can_be_read():
    assert readable(11_234_567.0, 2) == "11\u202f000\u202f000"
    assert readable(9_400.0) == "9400"
    assert breakable("a_b.<i>") == "a_<wbr>b.<wbr>&lt;i&gt;"


@pytest.mark.parametrize(
    ("share", "reported_s", "now_s", "text"),
    [
        (0.05, 10.0, 12.0, "0:12 so far"),
        (0.25, 30.0, 30.0, "1:30 left"),
        (0.25, 30.0, 50.0, "1:10 left"),
        (0.9, 90.0, 130.0, "a moment left"),
    ],
)
def test_time_left_counts_down_between_two_reports(share, reported_s, now_s, text):
    now = 0.0
    bar = Progress(TimeLeft(), console=Console(file=io.StringIO()), get_time=lambda: now)
    task = bar.add_task("", total=1.0, reported_at=0.0)
    bar.update(task, completed=share, reported_at=reported_s)
    now = now_s
    assert TimeLeft().render(bar.tasks[0]).plain == text
