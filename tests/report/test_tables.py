"""Tables: names lose their middle and numbers are whole, at any width; JSON holds any name."""

import io
import json
import re

import pytest
from hypothesis import given, strategies as st
from rich.console import Console

from loopid.errors import one_line, short_name
from loopid.numbers import interval, number, with_error
from loopid.report.look import json_text, plain_table


def printed(table, width, **options):
    stream = io.StringIO()
    Console(file=stream, width=width, **options).print(table)
    return stream.getvalue()


NAMES = ["leg1_stem.mx", "right_coupler_of_the_other_side_joint.Izz", "上腕" * 30, "x" * 300]


@pytest.mark.parametrize("width", [60, 80, 120])
@pytest.mark.parametrize("name", NAMES)
def test_a_name_is_shortened_in_its_middle_and_numbers_stay_whole(name, width):
    table = plain_table(
        "title", ("name", ">value", ">± std", "unit"), [(name, "-0.012345", "4.5e-06", "N m s/rad")]
    )
    lines = printed(table, width).splitlines()
    (row,) = [line for line in lines if "-0.012345" in line]
    assert "4.5e-06" in row
    assert "N m s/rad" in row
    shown = row.split()[0]
    first, cut, last = shown.partition("…")
    assert name.startswith(first)
    assert name.endswith(last)
    assert bool(cut) == (shown != name)
    assert len(first) >= 3


def test_sums_and_sentences_break_between_their_words():
    text = " + ".join(f"body{k}.mx" for k in range(12))
    shown = printed(plain_table("", ("sum",), [(text,)]), 40)
    assert [word.strip() for word in shown.split()][1:] == text.split()


@pytest.mark.parametrize(
    ("value", "error", "shown"),
    [
        (0.49751, 0.00271, ("0.4975", "0.0027")),
        (900.54, 26.6, ("901", "27")),
        (-0.0239, 0.00591, ("-0.0239", "0.0059")),
        (4.5123, 0.0, ("4.512", "-")),
        (1234.5, 120.0, ("1230", "120")),
        (1.0, float("nan"), ("1", "-")),
    ],
)
def test_values_have_the_digits_that_their_errors_leave(value, error, shown):
    assert with_error(value, error) == shown


@pytest.mark.parametrize(
    ("value", "shown"),
    [(4512.0, "4512"), (45123.0, "45123"), (0.00012, "0.00012"), (float("inf"), "-"), (None, "-")],
)
def test_numbers_are_plain(value, shown):
    assert number(value) == shown


def test_a_number_that_is_rounded_up_is_plain_too():
    assert [number(x, 2) for x in (9.96, 99.4, 99.96, 0.996)] == ["10", "99", "100", "1"]


@pytest.mark.parametrize(
    "name",
    [
        *("<script>alert(1)</script>", "![](http://a.b/c.png)", "a | b", "\\", ":bomb:", "[/red]"),
        *("[bold]", "\x1b[31m", "\x9b31m", "a\nb"),
    ],
)
def test_names_are_neither_live_nor_changed(name):
    table, shown = plain_table(name, ("row",), [(name,)]), one_line(name)
    said = printed(table, 200, force_terminal=True, color_system=None)
    said = re.sub("\x1b\\[[0-9;]*m", "", said)  # the title is bold
    if "\n" not in name:
        assert said.count(shown) == 2
    assert said.replace("\n", "").isprintable()


def test_a_name_that_fits_is_whole():
    assert short_name("elbow.Fc", 8) == "elbow.Fc"
    assert short_name("a\x1bb", 20) == "a\\x1bb"


def test_records_hold_names_but_no_control_codes():
    record = {"name": "\x1b[31m\x9b é 腕\u2028\U000e0001\ud800"}
    text = json_text(record)
    assert text.replace("\n", "").isprintable()
    assert "é 腕" in text
    assert json.loads(text) == record


ENDS = st.floats(-1e6, 1e6)


@given(ENDS, ENDS)
def test_shown_intervals_hold_the_whole_interval_and_zero_only_where_it_does(one, other):
    low, high = sorted((one, other))
    first, last = map(float, interval(low, high).split(" ... "))
    if high - low > 1e-8:
        assert first <= low
        assert high <= last
        assert last - first <= 1.11 * (high - low)
    assert (first <= 0 <= last) == (low <= 0 <= high)


def test_ends_of_intervals_have_the_digits_of_their_width():
    assert interval(2.3, 702.4) == "2 ... 710"
    assert interval(0.09698, 0.10268) == "0.0969 ... 0.1027"
