"""The paper's page: every table and figure is there, true to the numbers, nothing cut off."""

import io
import re
from dataclasses import replace

import numpy as np
import pytest
from lxml.html import fromstring
from rich.console import Console

from loopid.base_parameters import ChoiceProblem, SubgroupSearch
from loopid.paper.page import actual_chart, base_table, paper_report, simulated_chart
from loopid.plots import Chart


@pytest.fixture(scope="module")
def report(paper):
    return paper_report(paper)


def figures(report):
    parts = (part for section in report.sections() for part in section.parts)
    return {part.name: part for part in parts if isinstance(part, Chart)}


def printed(table, width):
    stream = io.StringIO()
    Console(file=stream, width=width, force_terminal=False).print(table)
    return stream.getvalue()


def test_every_table_and_figure_is_on_the_page(report):
    page = fromstring(report.page().html())
    captions = [figure.findtext("figcaption") for figure in page.iter("figure")]
    for number in range(2, 7):
        assert sum(caption.startswith(f"Figure {number}:") for caption in captions) == 1
    titles = [caption.text for caption in page.iter("caption")]
    tables = [str(table.title) for table in report.tables()]
    with_pictures = ("Table IV: ", "Rms error of the force (N)", "Table V: ")
    assert all(map(str.startswith, tables, with_pictures))
    assert titles == tables[3:]
    for number in ("I", "II", "III", "IV", "V"):
        assert any(title.startswith(f"Table {number}: ") for title in tables)


def test_the_page_begins_with_the_result(report, paper):
    page = fromstring(report.page().html())
    header = page.find("body/header").text_content()
    least = f"{paper.base.base.search.condition_number:.4f}"
    assert "15 of 15" in header
    assert header.count(least) >= 2
    worst = paper.actual.new_errors["CAD as prior"].max()
    assert f"{worst:.3g} N" in header
    # What stands open is the result: all else is folded.
    unfolded = [
        caption.text
        for caption in page.iter("caption")
        if not any(parent.tag == "details" for parent in caption.iterancestors())
    ]
    assert [title.split(":")[0] for title in unfolded] == ["the searches", "Table II", "Table III"]


def test_the_verdict_counts_the_rows_that_are_found(paper):
    rows = (*paper.base.rows[:8], None, *paper.base.rows[9:])
    for base, count in ((paper.base, 15), (replace(paper.base, rows=rows), 14)):
        verdict = paper_report(replace(paper, base=base)).verdict
        assert verdict.startswith(f"{count} of the 15 rows")


@pytest.mark.validate
def test_a_subgroup_search_that_finds_nothing_is_said_so(paper):
    """As by the pseudocode, on some processors."""
    strict = SubgroupSearch(condition_limit=1.5)
    nothing = strict.search(ChoiceProblem(paper.base.base.structure))
    searches = dict.fromkeys(paper.base.subgroups, nothing)
    report = paper_report(replace(paper, base=replace(paper.base, subgroups=searches)))
    assert "subgroup search finds nothing" in report.verdict
    story = " ".join(printed(report.brief[0], 80).split())  # lines break where times are long
    assert story.count("no valid choice") == 2
    assert report.page().html().count("none found") == 2


def test_the_story_is_one_screen(report):
    (story,) = report.brief
    steps = [str(cell) for cell in story.columns[0].cells]
    assert steps == [
        *("robot", "regressor", "projection", "symbolic model", "subgroup search"),
        *("exact search", "base parameters", "simulated values", "identified values"),
        "errors on new data",
    ]
    assert all(re.search(r"\d", str(cell)) for cell in story.columns[1].cells)
    assert len(printed(story, 80).splitlines()) <= 20


@pytest.mark.parametrize("width", [80, 120])
def test_all_tables_fit_the_terminal_and_nothing_in_them_is_cut(report, width):
    for table in [*report.brief, *report.tables()]:
        text = printed(table, width)
        assert max(map(len, text.splitlines())) <= width
        cells = " ".join(str(cell) for column in table.columns for cell in column.cells)
        assert "…" not in text
        assert all(number in text for number in re.findall(r"-?\d+\.\d+", cells)), table.title


def test_a_row_that_is_not_found_is_said_so(paper):
    rows = (*paper.base.rows[:8], None, *paper.base.rows[9:])
    text = printed(base_table(replace(paper.base, rows=rows)), 160)
    assert text.count("not found") == 1


def test_whether_the_papers_value_fits_is_said(paper):
    simulated = paper.simulated
    # A fit without errors that any value of the paper could agree with by chance.
    sure = replace(simulated.eight, covariance=1e-12 * simulated.eight.covariance)
    verdicts = []
    for expected, single in (((14.12,) + (9.0,) * 7, (0.0, 1.5)), ((9.0,) * 8, (20.0, 30.0))):
        ranges = np.array([single] * 8)
        found = replace(simulated, eight=sure, expected=np.array(expected), expected_range=ranges)
        verdicts.append(simulated_chart(found).panels[0].columns["fits"])
    assert verdicts[0][:4] == ("yes", "no", "single", "no")
    assert set(verdicts[1]) == {"no"}


def test_intervals_in_table_v_are_95_percent(paper):
    (panel,) = actual_chart(paper.actual).panels
    for column, fit in (("fifteen", "fifteen"), ("CAD as prior", "informed")):
        ends = getattr(paper.actual, fit).intervals(0.95)
        for cell, (low, high) in zip(panel.columns[f"{column} ± 95 %"], ends, strict=False):
            value, reach = map(float, cell.split(" ± "))
            assert value == pytest.approx((low + high) / 2, rel=0.01, abs=1e-9)
            assert reach == pytest.approx((high - low) / 2, rel=0.06)


def test_a_stand_in_is_said_to_be_one_and_a_log_is_named(paper, report):
    page = report.page().html()
    assert "No log of the real robot was given" in page
    assert "Table V: base parameters from a simulated stand-in" in page
    assert "measured" not in re.sub(
        r"measured here", "", fromstring(page).find("body/main").text_content()
    )
    assert figures(report)["figure_5"].panels[0].marks[0].name == "simulated less friction"

    other = paper_report(
        replace(paper, actual=replace(paper.actual, truth=None, sources=("run_7",)))
    )
    page = other.page().html()
    assert "No log of the real robot was given" not in page
    assert "Table V: base parameters from run_7" in page
    assert figures(other)["figure_5"].panels[0].marks[0].name == "measured less friction"


def test_axes_say_their_units(report):
    for chart in figures(report).values():
        for panel in chart.panels:
            assert re.search(r"\((m?N|m|kg, kg m)\)|%|cond\(V22\)|full rank", panel.title)


def test_figure_4_shows_influence_and_what_is_explained(report, paper):
    (panel,) = figures(report)["figure_4"].panels
    influence, explained, *_ = panel.marks
    np.testing.assert_allclose(influence.y, paper.simulated.influence)
    np.testing.assert_allclose(explained.y, paper.simulated.explained)


def test_figures_of_the_robot_show_limbs_1_and_4(report, paper):
    actual, charts = paper.actual, figures(report)
    for name, values in (("figure_5", actual.gravity), ("figure_6", actual.force)):
        for panel, limb in zip(charts[name].panels, (1, 4), strict=True):
            shown = np.where(actual.used, values, np.nan)[:, limb - 1]
            np.testing.assert_array_equal(panel.marks[0].y, shown)
