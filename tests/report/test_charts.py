"""Charts: one description, drawn on the page and alone; what is drawn is what was given."""

import re
import xml.etree.ElementTree as ET

import numpy as np
import pytest
from lxml.html import fromstring, tostring

from loopid.plots import Chart, Mark, Panel
from loopid.plots.chart import COLUMN, FINE, HIGH, STEPS, WIDE, ticks

SVG = "{http://www.w3.org/2000/svg}"
TIME = np.linspace(0.0, 10.0, 50_000)


def parsed(part):
    """A part of a page as a browser reads it."""
    return fromstring(tostring(part.html()))


def points(path):
    """Subpaths of whole numbers, from point to point, as the page's script reads them."""
    parts = [np.array(re.findall(r"-?\d+", part), int) for part in path.split("M")[1:]]
    return [part[: len(part) // 2 * 2].reshape(-1, 2).cumsum(axis=0) for part in parts]


def paths(panel):
    root = Chart("name", "caption", "x", (panel,)).html()
    found = [path for path in root.iter("path") if path.get("class") != "grid"]
    ends = [
        np.array(root.find(".//div[@data-x]").get(f"data-{axis}").split(), float) for axis in "xy"
    ]
    return found, ends


def back(drawn, ends):
    """Points of the square as numbers of the axes."""
    (left, right), (low, high) = ends
    return np.stack(
        [left + drawn[:, 0] * (right - left) / WIDE, high + drawn[:, 1] * (low - high) / HIGH], 1
    )


def test_a_line_is_drawn_where_its_numbers_are():
    x, y = np.linspace(-2, 3, 100), np.random.default_rng(0).normal(size=100)
    (path,), ends = paths(Panel("t", (Mark("a", x, y),)))
    (drawn,) = points(path.get("d"))
    found = back(drawn, ends)
    np.testing.assert_allclose(found[:, 0], x, atol=5.5 / WIDE)
    np.testing.assert_allclose(found[:, 1], y, atol=1.1 * np.ptp(y) / HIGH)


def test_a_long_line_keeps_its_extremes_and_its_gaps():
    rng = np.random.default_rng(1)
    y = np.sin(TIME) + 0.01 * rng.normal(size=len(TIME))
    spikes = rng.choice(len(TIME), 20, replace=False)
    y[spikes] += 3.0
    y[20_000:30_000] = np.nan
    mark = Mark("a", TIME, y).thinned()
    assert len(mark.x) <= 3 * STEPS
    for k in np.flatnonzero(y > 2.5):
        assert np.nanmax(mark.y[np.abs(mark.x - TIME[k]) < 10.0 / STEPS]) >= y[k]
    known = TIME[[19_999, 30_000]]
    inside = mark.x[(known[0] < mark.x) & (mark.x < known[1])]
    assert np.isnan(mark.y[np.isin(mark.x, inside)]).all()
    assert len(inside)
    given = dict(zip(TIME.tolist(), y.tolist(), strict=True))
    for at, value in zip(mark.x.tolist(), mark.y.tolist(), strict=True):
        assert value == given[at] or np.isnan(value)  # nothing is made up
    (path,), _ = paths(Panel("t", (Mark("a", TIME, y),)))
    assert len(points(path.get("d"))) == 2


@pytest.mark.parametrize("kind", ["span", "dots", "band"])
def test_what_is_not_known_is_not_drawn(kind):
    """A fit that lacks a parameter has no interval of it."""
    x, y, gap = np.arange(5.0), np.ones(5), np.array([0.5, np.nan, 2.5, 3.5, np.nan])
    (path,), _ = paths(
        Panel("t", (Mark("a", x if kind == "band" else gap, y, "fit", kind, gap + 1),))
    )
    drawn = path.get("d").count("h1") if kind == "dots" else len(points(path.get("d")))
    assert drawn == (2 if kind == "band" else 3)


def test_bands_spans_and_dots_have_their_ends():
    x, low, high = np.arange(3.0), np.array([0.0, 1.0, 2.0]), np.array([4.0, 5.0, 6.0])
    marks = Mark("b", x, low, kind="band", to=high), Mark("s", low, x, kind="span", to=high)
    (band, span), ends = paths(Panel("t", marks))
    loop = back(points(band.get("d"))[0], ends)
    assert band.get("d").endswith("z")
    np.testing.assert_allclose(loop[:, 1], [0, 1, 2, 6, 5, 4], atol=0.01)
    numbers = re.findall(r"M(-?\d+) (-?\d+)h(-?\d+)", span.get("d"))
    assert len(numbers) == 3
    (left, right), _ = ends
    for (a, _, b), first, last in zip(numbers, low, high, strict=True):
        placed = [left + n * (right - left) / WIDE for n in (int(a), int(a) + int(b))]
        np.testing.assert_allclose(placed, [first, last], atol=0.01)


def test_logarithmic_axes_leave_out_what_has_no_logarithm():
    mark = Mark("a", np.array([1.0, 10.0, 0.0, 100.0]), np.array([1.0, 1e3, 1.0, 1e6]))
    (path,), ends = paths(Panel("t", (mark,), log="xy"))
    drawn = [back(part, ends) for part in points(path.get("d"))]
    np.testing.assert_allclose(drawn[0], [[0, 0], [1, 3]], atol=0.01)
    np.testing.assert_allclose(drawn[1][0], [2, 6], atol=0.01)


def test_a_length_is_the_same_both_ways_where_it_is_asked_for():
    panel = Panel("t", (Mark("a", np.array([0.0, 1.0]), np.array([0.0, 5.0])),), equal=True)
    across, high = panel.limits()
    (plot,) = parsed(panel).find_class("plot")
    shape = float(re.match(r"aspect-ratio:([\d.]+)", plot.get("style"))[1])
    assert shape == pytest.approx(np.ptp(across) / np.ptp(high), rel=1e-2)


def test_rows_of_a_table_have_their_own_marks():
    """Each row draws what is at its place; what is upright or shaded is in all of them."""
    x, y = np.array([1.0, 2.0, 3.0]), np.arange(3.0)
    marks = (
        Mark("a", x, y, kind="disc"),
        Mark.upright("b", 2.5),
        Mark("c", x, y, kind="span", to=x + 1),
    )
    columns = {"value": ("one", "two", "three")}
    panel = Panel("t", marks, labels=("p", "q", "r"), wholes=("p", "q + s", ""), columns=columns)
    rows = parsed(panel).xpath(".//tbody/tr")
    assert [row.xpath("string(td[3])") for row in rows] == list(columns["value"])
    assert [row.xpath("string(.//summary)") for row in rows] == ["", "q", ""]
    assert "q + s" in rows[1].text_content()
    drawn = [[len(points(path.get("d"))) for path in row.iter("path")][1:] for row in rows]
    assert drawn == [[1, 1, 1]] * 3
    (left, right), _ = panel.limits()
    for row, at in zip(rows, x, strict=True):
        (disc,) = row.find_class("disc")
        place = left + points(disc.get("d"))[0][0, 0] * (right - left) / WIDE
        assert place == pytest.approx(at, abs=0.01)


def test_many_rows_and_many_motors_unfold():
    rows, place = 43, np.arange(43.0)
    panel = Panel("t", (Mark("a", place, place, kind="disc"),), labels=("name",) * rows)
    (fold,) = panel.html().xpath(".//details[not(@class)]")
    assert fold.findtext("summary") == "3 more rows"
    assert len(fold.xpath(".//tbody/tr")) == 3
    line = (Mark("a", place, place),)
    lanes = tuple(Panel(f"{k}", line) for k in range(16))
    figure = parsed(Chart("c", "", "time (s)", lanes, columns=2, lanes=2, zoom="run"))
    (fold,) = figure.iter("details")
    assert fold.findtext("summary") == "2 more"
    assert len(figure.find_class("panel")) == 16
    assert len(fold.find_class("panel")) == 4
    assert len(figure.find_class("across")) == 8  # below the last lane of each


@pytest.mark.parametrize("ends", [(0.0, 1.0), (-3.7e-5, 2e-5), (1e6, 1.02e6), (13.37, 22.4)])
def test_ticks_are_few_round_and_between_the_ends(ends):
    found = ticks(*ends)
    places = [at for at, _ in found]
    assert 2 <= len(found) <= 7
    assert ends[0] <= min(places) < max(places) <= ends[1]
    assert all(float(text) == pytest.approx(at, abs=1e-12) for at, text in found)
    assert len({text for _, text in found}) == len(found)


def test_decades_are_ticked_and_parts_of_one():
    assert [text for _, text in ticks(-3.1, 4.2, log=True)][:2] == ["0.01", "1"]
    assert [text for _, text in ticks(-0.1, 1.1, log=True)] == ["1", "2", "5", "10"]


@pytest.mark.parametrize("empty", [np.zeros(0), np.full(3, np.nan), np.full(3, 5.0)])
def test_nothing_to_draw_is_drawn_as_nothing(empty):
    chart = Chart("n", "c", "x", (Panel("t", (Mark("a", empty, empty),)),))
    assert b"nan" not in tostring(chart.html())


def test_names_stay_text():
    name = '<img src=x onerror="alert(1)"> $a$ \x1b[31m'
    panel = Panel(name, (Mark(name, TIME, TIME),), labels=(name,))
    chart = Chart("n", name, name, (panel,))
    root = parsed(chart)
    assert not list(root.iter("img"))
    assert "onerror" in root.text_content()
    alone = ET.fromstring(chart.svg())
    assert {each.tag for each in alone.iter()} == {
        f"{SVG}{tag}" for tag in ("svg", "title", "style", "g", "text", "path")
    }
    assert name.replace("\x1b", "\\x1b") in {each.text for each in alone.iter(f"{SVG}title")}


# Alone, for papers.


def test_a_chart_alone_has_its_marks_names_and_numbers():
    marks = (
        Mark("line", TIME, np.sin(TIME), "measured"),
        Mark("band", TIME, np.sin(TIME) - 1, "fit", "band", np.sin(TIME) + 1),
        Mark("motors", np.array([5.0]), np.zeros(1), "fit", "motor", texts=("7",)),
    )
    spans = (Mark("span", np.zeros(2), np.arange(2.0), "fit", "span", np.ones(2)),)
    panels = Panel("force (N)", marks), Panel("named", spans, labels=("a", "b" * 90))
    chart = Chart("forces", "caption", "time (s)", panels)
    root = ET.fromstring(chart.svg())
    assert root.get("width") == str(COLUMN)
    assert root.findtext(f"{SVG}title") == "caption"
    texts = [each.text for each in root.iter(f"{SVG}text")]
    assert {"force (N)", "named", "a", "time (s)", "line", "band", "span", "7"} <= set(texts)
    assert any(text.startswith("bb") and len(text) < 30 for text in texts)
    outer = root.find(f"{SVG}g/{SVG}svg")
    left, width = (float(outer.get(side)) for side in ("x", "width"))
    assert left + width < COLUMN
    across, _ = panels[0].limits()
    (ten,) = [each for each in root.iter(f"{SVG}text") if each.text == "10"][:1]
    place = left + width * (10 - across[0]) / np.ptp(across)
    assert float(ten.get("x")) == pytest.approx(place, abs=0.1)
    (line,) = [each for each in outer if each.get("class") == "line measured"]
    (drawn,) = points(line.get("d"))
    assert drawn[-1, 0] / FINE == pytest.approx(place - left, abs=0.1)
    assert chart.svg() == chart.svg()


def test_what_is_upright_is_drawn_on_logarithmic_axes():
    (line, _), _ = paths(Panel("t", (Mark.upright("used", 10.0), Mark("a", TIME, TIME)), log="xy"))
    assert len(points(line.get("d"))) == 1
