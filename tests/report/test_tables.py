"""Markdown tables hold the cells of the terminal's, whatever these are."""

import io
import json
import re
from dataclasses import replace
from html import unescape

import pytest
from rich.console import Console
from rich.table import Table

from loopid.errors import one_line
from loopid.report.identify import identification_tables
from loopid.report.look import json_text, markdown_table, plain_table


def parsed(text):
    """Title, header, alignments and rows of a Markdown table."""
    lines = text.strip().splitlines()
    title = unescape(lines[0].strip("*")) if lines[0].startswith("**") else None
    rows = [
        [unescape(cell) for cell in line.split("|")[1:-1]] for line in lines if line.startswith("|")
    ]
    head, rules, *body = [[cell.strip() for cell in row] for row in rows]
    return title, head, rules, body


def assert_same_cells(table: Table):
    title, head, rules, body = parsed(markdown_table(table))
    assert title == str(table.title)
    assert head == [column.header for column in table.columns]
    right = [column.justify == "right" for column in table.columns]
    assert [rule.endswith(":") for rule in rules] == right
    cells = list(zip(*(column.cells for column in table.columns), strict=True))
    assert body == [[str(cell) for cell in row] for row in cells]
    assert len(body) == table.row_count


def test_tables_of_an_identification_have_the_same_cells(study):
    for table in identification_tables(study):
        assert_same_cells(table)


def test_lines_and_rules_inside_a_cell_do_not_break_the_table():
    table = plain_table("a | b", ("name", ">value"), [("p | q", "1\n2"), ("", 3)])
    title, head, rules, body = parsed(markdown_table(table))
    assert title == "a | b"
    assert head == ["name", "value"]
    assert rules == ["---", "---:"]
    assert body == [["p | q", "1 2"], ["", "3"]]


def test_what_looks_like_markup_is_shown_as_it_is():
    table = plain_table("", ("row",), [("[red]link[/red]",)])
    assert parsed(markdown_table(table))[3] == [["[red]link[/red]"]]


def test_a_table_without_a_title_begins_with_its_header():
    assert markdown_table(plain_table("", ("row",), ())).startswith("| row |")


def test_what_is_said_below_a_table_is_on_the_page_too():
    table = plain_table("title", ("row",), [(1,)])
    table.caption = "95 % of 20 draws"
    assert "95 % of 20 draws" in markdown_table(table)


@pytest.mark.parametrize("name", ["run[old]", "leg[1]"])
def test_names_with_brackets_are_no_markup(name, study):
    found = study.identification
    recordings = tuple(replace(part, name=name) for part in found.training)
    renamed = replace(study, identification=replace(found, training=recordings))
    tables = identification_tables(renamed)
    assert any(name in unescape(markdown_table(table)) for table in tables)


LIVE = re.compile(r"[<>\[\]`$\\]|(?<!\*)\*(?!\*)|\b_|_\b|__|://")


@pytest.mark.parametrize(
    "name",
    [
        *("<script>alert(1)</script>", "<img src=x onerror=alert(1)>", "![](http://a.b/c.png)"),
        *("[a](javascript:b)", "`a`", "<http://a.b>", "&lt;b&gt;", "a | b", "\\", "**a**", "~a~"),
        *("__a__", "$a$", "http://a.b", ":bomb:", "[/red]", "[bold]", "\x1b[31m", "\x9b31m"),
    ],
)
def test_names_are_neither_live_nor_changed(name):
    table = plain_table(name, ("row",), [(name,)])
    text, shown = markdown_table(table), one_line(name)
    assert not LIVE.search(text)
    assert parsed(text)[0] == shown
    assert parsed(text)[3] == [[shown]]
    stream = io.StringIO()
    Console(file=stream, width=200, force_terminal=True, color_system=None).print(table)
    said = re.sub("\x1b\\[[01]m", "", stream.getvalue())  # the title is bold
    assert said.count(shown) == 2
    assert said.replace("\n", "").isprintable()


def test_records_hold_names_but_no_control_codes():
    record = {"name": "\x1b[31m\x9b é 腕\u2028\U000e0001\ud800"}
    text = json_text(record)
    assert text.replace("\n", "").isprintable()
    assert "é 腕" in text
    assert json.loads(text) == record
