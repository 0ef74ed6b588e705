"""Pages and tables: every figure is there, every finding is said, nothing is cut off."""

import io
import json
import re
from dataclasses import replace

import numpy as np
import pytest
from rich.console import Console

from loopid.report import (
    identification_files,
    identification_record,
    identification_tables,
    motions_record,
    motions_tables,
    paper_files,
    paper_tables,
)
from loopid.report.identify import findings
from loopid.report.paper_base_tables import base_table

LINK = re.compile(r"!\[[^]]*\]\(([^)]+)\)")


@pytest.fixture(scope="module")
def files(identification):
    return identification_files(identification)


@pytest.fixture(scope="module")
def paper_page_files(paper):
    return paper_files(paper)


def printed(table, width):
    stream = io.StringIO()
    Console(file=stream, width=width, force_terminal=False).print(table)
    return stream.getvalue()


def judged(identification, **changes):
    """The identification with other verdicts on its candidates."""
    candidates = [
        replace(candidate, **changes.get(name, {}))
        for name, candidate in zip(
            ("baseline", "full", "supported"), identification.candidates, strict=True
        )
    ]
    return replace(identification, candidates=tuple(candidates))


def test_every_figure_is_on_the_page_and_every_link_leads_to_a_file(files):
    linked = set(LINK.findall(files["report.md"]))
    assert linked <= set(files)
    assert {name for name in files if name.endswith(".svg")} == linked
    assert {name.replace(".svg", ".png") for name in linked} <= set(files)


def test_every_figure_of_the_paper_is_on_its_page(paper_page_files):
    linked = set(LINK.findall(paper_page_files["paper.md"]))
    assert linked == {f"figure_{number}.svg" for number in range(2, 7)}
    pictures = {f"figure_{number}.{kind}" for number in range(2, 7) for kind in ("svg", "png")}
    assert set(paper_page_files) == {"paper.md", *pictures}


def test_the_record_is_beside_the_page(files, identification):
    record = json.loads(files["identification.json"])
    assert record == identification_record(identification)


def test_the_page_holds_all_tables(files, identification):
    for table in identification_tables(identification):
        assert table.title in files["report.md"]
    for label in identification.fit.parameters.labels:
        assert label in files["report.md"]


def test_the_papers_page_holds_tables_i_to_v_and_the_coverage(paper_page_files, paper):
    page = paper_page_files["paper.md"]
    for number in ("I", "II", "III", "IV", "V"):
        assert f"**Table {number}: " in page
    for table in paper_tables(paper):
        assert table.title in page
    assert f"{paper.coverage.shares.mean():.1%}" in page


@pytest.mark.parametrize("width", [80, 120])
def test_all_tables_fit_the_terminal_and_nothing_in_them_is_cut(identification, paper, width):
    reviews = motions_record("3ups_rpu", paper.experiment.reviews, paper.seconds)
    tables = [*identification_tables(identification), *paper_tables(paper)]
    cut = set()
    for table in [*tables, *motions_tables(reviews)]:
        text = printed(table, width)
        assert max(map(len, text.splitlines())) <= width
        numbers = {
            number
            for column in table.columns
            for cell in column.cells
            for number in re.findall(r"-?\d+\.\d+", str(cell))
        }
        if "…" in text or not all(number in text for number in numbers):
            cut.add(table.title)
    assert cut == set()


def test_values_in_the_tables_are_those_of_the_fit(identification):
    table = identification_tables(identification)[0]
    cells = [list(column.cells) for column in table.columns]
    fit = identification.fit
    assert cells[0] == list(fit.parameters.labels)
    np.testing.assert_allclose([float(x) for x in cells[1]], fit.values, rtol=1e-3, atol=1e-12)
    np.testing.assert_allclose([float(x) for x in cells[2]], fit.standard_errors, rtol=0.06)


def test_tables_of_the_supported_parameters_name_their_sums_and_file_values(identification):
    table = identification_tables(identification)[1]
    names, values, _, known, _ = (list(column.cells) for column in table.columns)
    columns = identification.reduction.columns
    model = identification.force_model
    assert names == [model.base.expressions[j] for j in columns]
    assert [cell == "-" for cell in known] == [j in model.joint_columns for j in columns]
    result = identification.reduction.result
    np.testing.assert_allclose([float(x) for x in values], result.values, rtol=1e-3)


def test_what_was_left_out_is_listed(identification):
    table = identification_tables(identification)[4]
    reasons = list(table.columns[1].cells)
    assert reasons == [part.reason for part in identification.training[0].dropped]
    assert "leg4_stroke stands still" in reasons


def blaming(identification):
    """The sentence that names weak parameters, if any."""
    found = [text for text in findings(identification) if "the data do not" in text]
    assert len(found) <= 1
    return "".join(found)


def test_parameters_that_the_data_do_not_support_are_named(identification):
    worse = judged(identification, full={"error_ratio": (1.5, 0.1)})
    assert not worse.candidates[1].beats_baseline
    weak = identification.fit.insignificant()
    assert 0 < len(weak) < len(identification.fit.values)
    assert blaming(worse).endswith(f": {', '.join(weak)}.")


def test_nobody_is_blamed_where_all_parameters_are_sure(identification):
    fit = identification.fit
    sure = replace(identification, fit=replace(fit, covariance=1e-12 * fit.covariance))
    assert sure.fit.insignificant() == ()
    assert "none alone" in blaming(judged(sure, full={"error_ratio": (1.5, 0.1)}))
    assert blaming(judged(sure, full={"error_ratio": (0.5, 0.1)})) == ""


@pytest.mark.parametrize(
    ("ratio", "verdict"),
    [
        ((0.5, 0.1), ": better than it."),
        ((0.9, 0.1), ": not clearly better than it."),
        ((1.1, 0.1), ": not clearly better than it."),
        ((1.3, 0.2), ": not clearly better than it."),
        ((1.21, 0.1), ": worse than it."),
    ],
)
def test_verdicts_take_two_standard_errors(identification, ratio, verdict):
    found = judged(identification, full={"error_ratio": ratio})
    (sentence,) = [text for text in findings(found) if "all parameters the mean" in text]
    assert sentence.endswith(verdict)
    assert "{:.2f} ± {:.2f}".format(*ratio) in sentence


def test_findings_are_sentences_and_count_the_supported_ones(identification):
    said = findings(identification)
    assert all(text[0].isupper() and text.endswith(".") and "\n" not in text for text in said)
    kept = len(identification.reduction.result.parameters)
    assert any(text.startswith(f"The data support {kept} of 23 parameters") for text in said)
    assert any("cut-off of the filter: 2.5 Hz" in text for text in said)
    plain = tuple(replace(part, cutoff=None) for part in identification.training)
    said = findings(replace(identification, training=plain))
    assert any("unfiltered" in text for text in said)


def test_a_stand_in_is_said_to_be_one_and_a_log_is_named(paper):
    page = paper_files(paper)["paper.md"]
    assert "No log of the real robot was given" in page
    assert "Table V: base parameters from a simulated stand-in" in page
    actual = replace(paper.actual, truth=None, sources=("run_7",))
    page = paper_files(replace(paper, actual=actual))["paper.md"]
    assert "No log of the real robot was given" not in page
    assert "Table V: base parameters from run_7" in page


def test_a_row_that_is_not_found_is_said_so(paper):
    rows = (*paper.base.rows[:8], None, *paper.base.rows[9:])
    text = printed(base_table(replace(paper.base, rows=rows)), 160)
    assert text.count("not found") == 1


def test_a_motion_that_breaks_a_limit_is_said_so(paper):
    review = replace(paper.experiment.reviews["1"], margin=0.9)
    record = motions_record("robot", {"1": review}, {"1": 12.0})
    (table,) = motions_tables(record)
    assert "singularity measure falls" in next(iter(table.columns[-1].cells))


def test_candidates_are_shown_with_what_they_take_from_the_data(identification):
    table = identification_tables(identification)[2]
    fitted = [next(iter(column.cells)) for column in table.columns[1:]]
    assert fitted == [str(candidate.fitted) for candidate in identification.candidates]
