"""The paper's page: every table and figure is there, true to the numbers, nothing cut off."""

import io
import re
import struct
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from rich.console import Console

from loopid.paper import page as figures, paper_files, paper_tables
from loopid.paper.page import actual_table, base_table, simulated_table
from loopid.report.look import COLUMN, RESOLUTION, rendered, thinned

LINK = re.compile(r"!\[[^]]*\]\(([^)]+)\)")


def draw(paper, render=rendered):
    """All files of the page, and the figures before they are rendered."""
    kept = {}

    def keep(figure, name):
        kept[name] = figure
        return render(figure, name)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(figures, "rendered", keep)
        return paper_files(paper), kept


@pytest.fixture(scope="module")
def drawn(paper):
    return draw(paper)


def force_label(figure):
    """What the first line of a figure of forces is called."""
    return figure.legends[0].get_texts()[0].get_text()


def printed(table, width):
    stream = io.StringIO()
    Console(file=stream, width=width, force_terminal=False).print(table)
    return stream.getvalue()


def test_every_figure_is_on_the_page(drawn):
    files, _ = drawn
    pictures = {f"figure_{number}.{kind}" for number in range(2, 7) for kind in ("svg", "png")}
    assert set(files) == {"paper.md", *pictures}
    linked = set(LINK.findall(files["paper.md"]))
    assert linked == {name for name in pictures if name.endswith("svg")}


def test_the_page_holds_tables_i_to_v(drawn, paper):
    page = drawn[0]["paper.md"]
    for number in ("I", "II", "III", "IV", "V"):
        assert f"**Table {number}: " in page
    for table in paper_tables(paper):
        assert str(table.title) in page


@pytest.mark.parametrize("width", [80, 120])
def test_all_tables_fit_the_terminal_and_nothing_in_them_is_cut(paper, width):
    for table in paper_tables(paper):
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
        verdicts.append(list(map(str, simulated_table(found).columns[-1].cells)))
    assert verdicts[0][:4] == ["yes", "no", "single", "no"]
    assert set(verdicts[1]) == {"no"}


def test_intervals_in_table_v_are_95_percent(paper):
    table = actual_table(paper.actual)
    for column, fit in ((4, "fifteen"), (5, "informed")):
        ends = getattr(paper.actual, fit).intervals(0.95)
        for cell, (low, high) in zip(table.columns[column].cells, ends, strict=False):
            value, reach = map(float, str(cell).split(" ± "))
            assert value == pytest.approx((low + high) / 2, rel=0.01, abs=1e-9)
            assert reach == pytest.approx((high - low) / 2, rel=0.06)


def test_a_stand_in_is_said_to_be_one_and_a_log_is_named(paper, drawn):
    page = drawn[0]["paper.md"]
    assert "No log of the real robot was given" in page
    assert "Table V: base parameters from a simulated stand-in" in page
    assert "measured" not in re.sub(r"measured here", "", page)
    assert force_label(drawn[1]["figure_5"]) == "simulated less friction"

    actual = replace(paper.actual, truth=None, sources=("run_7",))
    empty = {"svg": "", "png": b""}
    files, kept = draw(
        replace(paper, actual=actual),
        lambda _, name: {f"{name}.{kind}": content for kind, content in empty.items()},
    )
    page = files["paper.md"]
    assert "No log of the real robot was given" not in page
    assert "Table V: base parameters from run_7" in page
    assert "limbs 1 and 4: measured less friction" in page
    assert force_label(kept["figure_5"]) == "measured less friction"


def test_figures_have_the_width_of_a_column_and_the_same_bytes_again(paper, drawn):
    files, _ = drawn
    for number in range(2, 7):
        width, height = struct.unpack(">II", files[f"figure_{number}.png"][16:24])
        assert width == pytest.approx(COLUMN * RESOLUTION, abs=1)
        assert 1.0 < height / RESOLUTION < 9.5
    for again in (figures.draw_influence(paper.simulated), figures.draw_gravity(paper.actual)):
        assert all(files[name] == content for name, content in again.items())


def test_nothing_is_drawn_outside_the_figures_and_axes_say_their_units(drawn):
    for figure in drawn[1].values():
        box = figure.get_tightbbox(FigureCanvasAgg(figure).get_renderer())
        width, height = figure.get_size_inches()
        assert -0.01 <= box.x0 < box.x1 <= width + 0.01
        assert -0.01 <= box.y0 < box.y1 <= height + 0.01
        for ax in figure.axes:
            assert ax.get_title()
            assert re.search(r"\(m?N\)|%", ax.get_ylabel())


def test_titles_beside_each_other_do_not_overlap(drawn):
    figure = drawn[1]["figure_2"]
    renderer = FigureCanvasAgg(figure).get_renderer()
    boxes = [ax.title.get_window_extent(renderer) for ax in figure.axes]
    assert all(not a.overlaps(b) for k, a in enumerate(boxes) for b in boxes[:k])


def test_figure_4_shows_influence_and_what_is_explained(drawn, paper):
    (ax,) = drawn[1]["figure_4"].axes
    heights = [bar.get_height() for bar in ax.patches]
    np.testing.assert_allclose(heights, paper.simulated.influence)
    (explained,) = [line for line in ax.lines if len(line.get_ydata()) == 15]
    np.testing.assert_allclose(explained.get_ydata(), paper.simulated.explained)


def test_figures_of_the_robot_show_limbs_1_and_4(drawn, paper):
    actual, rows = paper.actual, thinned(len(paper.actual.time))
    for name, values in (("figure_5", actual.gravity), ("figure_6", actual.force)):
        for ax, limb in zip(drawn[1][name].axes, (1, 4), strict=True):
            shown = np.where(actual.used, values, np.nan)[rows, limb - 1]
            np.testing.assert_array_equal(ax.lines[0].get_ydata(), shown)
