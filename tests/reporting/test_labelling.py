import re
from dataclasses import replace
from html.parser import HTMLParser

import pytest

from predplan.reporting.document import Cell, Table
from predplan.reporting.labelling import figures, measurements, tables
from predplan.reporting.labelling.section import data_text, labelling_section
from predplan.reporting.markdown import to_markdown
from predplan.reporting.page import linked, to_page
from tests.reporting.made import made_results


def cell(table: Table, row: str, column: str) -> str | Cell:
    """The cell of a row and a column by their names."""
    rows = {of[0]: of for of in table.rows}
    return rows[row][table.header.index(column)]


def test_means_ranges_and_the_thesis() -> None:
    table = tables.table_3_1(made_results())
    assert cell(table, "EM", "HMM, 150") == Cell("76.0", "75.0–77.0", "77.2")
    assert cell(table, "EM", "HMM, 1,000") == Cell("80.0", "", "83.1")
    assert cell(table, "calibrated on the labels", "HMM, 150") == Cell("85.0", "84.0–86.0", "", best=True)


def test_missing_methods_are_dashes() -> None:
    table = tables.table_3_1(made_results())
    assert cell(table, "EM", "FHMM, 150") == Cell("-", published="81.8")
    assert cell(table, "least squares, λ = 0", "FHMM, 150") == Cell("-")


def test_other_corpora_have_no_thesis_numbers() -> None:
    made = made_results("brown")
    for table in (tables.table_3_1(made), tables.table_3_2(made), tables.table_3_3(made)):
        assert not any(isinstance(each, Cell) and each.published for row in table.rows for each in row)


@pytest.mark.parametrize(("dictionary", "number"), [(False, "89.4"), (True, "90.9")])
def test_malagasy_with_and_without_dictionary(dictionary: bool, number: str) -> None:
    table = tables.table_3_4([made_results("malagasy", dictionary=dictionary)])
    found = cell(table, "anchor FHMM, λ=1", table.header[1])
    assert isinstance(found, Cell)
    assert found.published == number


def test_times_in_units_of_the_anchor_hmm() -> None:
    table = measurements.time_table(made_results())
    assert cell(table, "EM HMM", "150: to anchor HMM") == "15 ×"
    assert cell(table, "EM HMM", "thesis") == "14.9 h"


def test_tests_take_the_least_favourable_draw() -> None:
    table = measurements.comparison_table(made_results())
    small = next(row for row in table.rows if row[0] == "EM HMM")
    assert small[1:] == ("+15.0", "-1.0 to +30.0", "1 / 0 of 2", ".040", ".500")


def test_only_choices_are_listed() -> None:
    assert {row[0] for row in measurements.chosen_table(made_results()).rows} == {"EM HMM"}


@pytest.mark.parametrize(
    "draw",
    [figures.learning_curve, figures.training_times, figures.differences, figures.confusion, figures.ablations],
)
def test_figures_are_whole_and_stable(draw: object) -> None:
    assert callable(draw)
    first, second = draw(made_results()), draw(made_results())
    assert first.svg == second.svg
    assert first.svg.rstrip().endswith("</svg>")


def test_figures_of_one_draw_and_one_method() -> None:
    made = made_results(methods=("supervised", "anchor"))
    few = replace(made, curve=[row for row in made.curve if row["draw"] == 0][:1], ablations=[])
    assert "anchor HMM" in figures.differences(few).caption
    assert "</svg>" in figures.learning_curve(few).svg


def test_raw_text_and_malformed_lines_are_told() -> None:
    text = data_text(made_results())
    assert "https://example.org/made.zip" in text
    assert "malformed lines: 3 with bad UTF-8, 0 with NUL, 1 too long" in text


def test_page_needs_no_network_and_escapes_words() -> None:
    page = to_page("predplan", "All of it.", [labelling_section([made_results()])])
    assert "&lt;b&gt;*word*" in page
    assert "<s>VERB</s> NOUN" in page
    seen = _References()
    seen.feed(page)
    assert seen.loaded == []
    assert not re.search(r"@import|url\((?!#)", page)
    assert seen.inner <= seen.ids


def test_only_web_addresses_become_links() -> None:
    text = linked("npm corpus@1.9, https://example.org/a.zip; <b>")
    assert (
        text
        == 'npm corpus@1.9, <a href="https://example.org/a.zip" rel="noopener">https://example.org/a.zip</a>; &lt;b&gt;'
    )


def test_report_without_ablations() -> None:
    markdown = to_markdown(labelling_section([replace(made_results(), ablations=[])]), "labelling")
    assert "Ablations" not in markdown
    assert "What differs from the thesis" in markdown


class _References(HTMLParser):
    """What a page loads, the places in it that it links to, and its ids."""

    def __init__(self) -> None:
        super().__init__()
        self.loaded: list[str] = []
        self.inner: set[str] = set()
        self.ids: set[str] = set()

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        for name, value in attributes:
            if name == "src" or (tag == "link" and name == "href"):
                self.loaded.append(str(value))
            if tag == "a" and name == "href" and str(value).startswith("#"):
                self.inner.add(str(value)[1:])
            if name == "id":
                self.ids.add(str(value))
