"""Charts: said once, drawn as SVG on a page, which a script zooms, and by matplotlib for papers.

Marks are paths in a plain square whose sides the page stretches as wide as it is; the width of
lines stays. Long lines are thinned to the least and the largest of each step of time.
"""

from __future__ import annotations

import io
import math
import warnings
from collections.abc import Callable, Iterable, Sequence
from dataclasses import field
from typing import Any

import numpy as np
from lxml.builder import ElementMaker
from lxml.html import HtmlElement, html_parser

from loopid.arguments import FloatArray, IntArray, spread_rows
from loopid.errors import MissingExtraError, one_line, short_name
from loopid.records import record

# By what is drawn: colour, width of a line, and its dashes. The page has the same as classes of its
# style sheet, there for dark screens, too.
LOOKS: dict[str, tuple[str, float, str]] = {
    "measured": ("#3b424c", 1.2, "-"),
    "fit": ("#bf4700", 0.9, "-"),
    "file": ("#0068a8", 0.9, "-"),
    "other": ("#0b7046", 0.9, "-"),
    "weak": ("#875900", 0.9, "-"),
    "faint": ("#78818d", 0.6, "-"),
    "limit": ("#565e6a", 0.6, ":"),
    "links": ("#c0c8d2", 4.0, "-"),
}
Ends = tuple[float, float]
SIGNS = {"motor": "o", "slide": "s", "joint": "o", "closure": "D"}
UPRIGHT = "upright", "shade"  # kinds that reach over all of y
POINTS = {"dots": ".", "disc": "o", "ring": "o", "box": "s"}
# Of a line, with its least and largest value in each: half a column of a page shows no more.
STEPS = 250
MOST_DOTS = 1500
MOST_GROUPS, MOST_ROWS = 6, 40  # motors, and rows of a table, that are seen at first
WIDE, HIGH = 10_000, 1_000  # of the square that marks are drawn in
ROW = 100  # height of a row of a table with pictures
MARGIN = 0.04  # of an axis beyond the marks, on either side
ROOM = 0.08  # about a robot, in parts of it, for the signs at its ends
NEAR = 5.0  # % of an axis next to its ends, where numbers stand inwards
ALIKE = 1e-5  # relative difference of values that have one place on an axis
TICKS = 5  # of an axis, about
PLAIN = 3  # powers of 10 that are written out
COLUMN = 3.5  # inches: a column of a two-column page
LONGEST, LEGEND = 44, 80  # characters of a name that is drawn, and in a line of a legend
STYLE: Any = {
    "text.parse_math": False,  # names stay text
    **dict.fromkeys(("font.size", "axes.titlesize", "axes.labelsize"), 7.5),
    **{"legend.fontsize": 7, "legend.frameon": False},
    **{"axes.spines.top": False, "axes.spines.right": False},
    **{"axes.grid": True, "grid.color": "#dddddd", "grid.linewidth": 0.5},
    **{"figure.constrained_layout.use": True, "svg.hashsalt": "loopid", "svg.fonttype": "path"},
}
# Of figures with names that the font lacks, which are boxes there, or that leave no room.
HARMLESS = "Glyph .* missing from font|constrained_layout not applied"


def _add_text(element: HtmlElement, text: str) -> None:
    """Text of any origin, what is not printable but ends of lines as escapes."""
    plain = "\n".join(map(one_line, text.split("\n")))
    if len(element):
        element[-1].tail = (element[-1].tail or "") + plain
    else:
        element.text = (element.text or "") + plain


# Elements of a page, which escape what they hold.
_TEXTS: Any = {str: _add_text}
E = ElementMaker(typemap=_TEXTS, makeelement=html_parser.makeelement)


@record
class Mark:
    """Something drawn in a panel.

    Attributes
    ----------
    name : str
        In the legend; several marks of one name have one entry, and none without a name.
    x, y : FloatArray
        (N,); a line breaks where one is NaN.
    look : str
        A key of ``LOOKS``.
    kind : str
        ``"line"``; ``"dots"``, many, or one by one ``"disc"``, ``"ring"``, ``"box"``; ``"band"``
        between y and ``to``; ``"span"`` from x to ``to`` at y; ``"upright"`` at x over all y;
        ``"shade"`` between x and ``to``; a key of ``SIGNS``.
    to : FloatArray or None
        (N,).
    texts : tuple of str
        (N,), in signs.
    """

    name: str
    x: FloatArray
    y: FloatArray
    look: str = "fit"
    kind: str = "line"
    to: FloatArray | None = None
    texts: tuple[str, ...] = ()

    @classmethod
    def upright(cls, name: str, *x: float, look: str = "faint") -> Mark:
        """Lines across the whole panel at x."""
        return cls(name, np.array(x), np.zeros(len(x)), look, "upright")

    def thinned(self) -> Mark:
        """As much of it as can be seen."""
        count = len(self.x)
        most = {"line": 2 * STEPS, "band": STEPS // 4, "dots": MOST_DOTS}.get(self.kind, count)
        if count <= most:
            return self
        rows = self._extremes() if self.kind == "line" else spread_rows(count, most)
        to = None if self.to is None else self.to[rows]
        return Mark(self.name, self.x[rows], self.y[rows], self.look, self.kind, to)

    def _extremes(self) -> IntArray:
        """Rows of the least and the largest value of each step of a line; gaps stay gaps."""
        count, each = len(self.y), -(-len(self.y) // STEPS)
        y = np.pad(self.y, (0, -count % each), "edge").reshape(-1, each)
        gap, first = np.isnan(y), each * np.arange(len(y))
        some, all_ = gap.any(axis=1), gap.all(axis=1)
        least, most = (np.where(gap, end, y) for end in (np.inf, -np.inf))
        chosen = (first + gap.argmax(axis=1))[some], first + least.argmin(axis=1)
        rows = np.concatenate([chosen[0], chosen[1][~all_], (first + most.argmax(axis=1))[~all_]])
        return np.asarray(np.unique(np.minimum(rows, count - 1)), dtype=np.int64)


@record
class Panel:
    """Marks on one pair of axes.

    Attributes
    ----------
    title : str
        With the unit of y.
    marks : tuple of Mark
    x_limits, y_limits : tuple of float or None
        By default where the marks are.
    labels : tuple of str
        Instead of numbers at y = 0, 1, ... from above: the rows of a table with a picture.
    columns : dict of tuple of str
        More columns of that table, by their heads.
    groups : tuple of str
        Of each row, said where it changes.
    wholes : tuple of str
        What the labels are short for, where they are.
    log : str
        Which axes are logarithmic: a part of ``"xy"``.
    small : bool
        Whether it is half as high.
    equal : bool
        Whether a length is the same along x and y; then the page shows no axes.
    motor : str
        Whose it is; the first of its lanes says it.
    number : int
        Of the motor on the page.
    worst : bool
        Whether it is the motor with the largest error.
    note : str
        Numbers, below the motor's name.
    """

    title: str
    marks: tuple[Mark, ...]
    x_limits: tuple[float, float] | None = None
    y_limits: tuple[float, float] | None = None
    labels: tuple[str, ...] = ()
    columns: dict[str, tuple[str, ...]] = field(default_factory=dict)
    groups: tuple[str, ...] = ()
    wholes: tuple[str, ...] = ()
    log: str = ""
    small: bool = False
    equal: bool = False
    motor: str = ""
    number: int = 0
    worst: bool = False
    note: str = ""

    def limits(self) -> tuple[Ends, Ends]:
        """Ends of both axes, logarithms where they are."""
        x, y = list[FloatArray](), list[FloatArray]()
        for mark in self.marks:
            x.append(mark.x)
            y += [] if mark.kind in UPRIGHT else [mark.y]
            if mark.to is not None:
                (y if mark.kind == "band" else x).append(mark.to)
        across, high = (
            _ends(_scaled(each, axis in self.log) for each in parts)
            for axis, parts in (("x", x), ("y", y))
        )
        if self.labels:
            high = len(self.labels) - 0.5, -0.5
        across, high = self.x_limits or across, self.y_limits or high
        if self.equal:
            room = ROOM * max(across[1] - across[0], high[1] - high[0])
            across, high = ((low - room, top + room) for low, top in (across, high))
        return across, high

    @property
    def height(self) -> float:
        """In inches, for papers."""
        if self.labels:
            return 0.5 + 0.16 * len(self.labels)
        return 0.7 if self.small else 2.4 if self.equal else 1.4

    def draw(self, ax: Any) -> None:
        """Draw on axes of matplotlib."""
        for mark in (each.thinned() for each in self.marks):
            _draw(mark, ax)
        title = f"{self.motor}: {self.title}" if self.motor else self.title
        ax.set_title(short_name(title, LONGEST), loc="left")
        for axis in self.log:
            from matplotlib.ticker import LogFormatter  # the usual one writes formulas

            getattr(ax, f"set_{axis}scale")("log")
            for which in ("major", "minor"):
                getattr(getattr(ax, f"{axis}axis"), f"set_{which}_formatter")(LogFormatter())
        if self.equal:
            ax.set_aspect("equal", "datalim")
        if self.labels:
            names = [short_name(name, LONGEST // 2) for name in self.labels]
            ax.set_yticks(range(len(names)), names, fontsize=6)
        if self.labels or self.y_limits is not None:
            ax.set_ylim(*self.limits()[1])
        if self.x_limits is not None:
            ax.set_xlim(*(10**end if "x" in self.log else end for end in self.x_limits))

    def html(self, *, headed: bool = True, ticked: bool = True) -> HtmlElement:
        """A part of a figure on a page, with a heading and numbers along x or without."""
        across, high = self.limits()
        panel = E.div(
            {
                f"data-{n}": f"{a:.9g} {b:.9g}"
                for n, (a, b) in zip("xy", (across, high), strict=True)
            }
        )
        panel.set("class", f"panel{' small' * self.small}{' equal' * self.equal}")
        if self.motor:
            badge = E.i({"class": f"badge{' worst' * self.worst}"}, str(self.number))
            panel.append(E.h3(*([badge] if self.number else []), self.motor))
        if self.note:
            panel.append(E.p({"class": "note"}, self.note))
        small = self.motor or not headed
        if self.title and not (self.labels and self.motor):
            panel.append(E.p({"class": "say"}, self.title) if small else E.h3(self.title))
        if self.labels:
            panel.extend(in_parts(len(self.labels), lambda rows: self._table(rows, across)))
            return panel
        panel.append(E.output())
        x_ticks = ticks(*across, log="x" in self.log, count=TICKS if ticked else 2 * TICKS)
        y_ticks = ticks(*sorted(high), log="y" in self.log, count=3 if self.small else TICKS)
        if self.equal:
            x_ticks = y_ticks = []
        svg = self._svg(across, high, self.marks, HIGH, [at for at, _ in x_ticks])
        grid = [f"M0 {_place(y, high[::-1], HIGH):.0f}h{WIDE}" for y, _ in y_ticks]
        svg.insert(0, E.path({"class": "grid", "d": "".join(grid)}))
        plot = E.div({"class": "plot"}, svg, *self._signs(across, high))
        if self.equal:
            plot.set("style", f"aspect-ratio:{np.ptp(across) / np.ptp(high):.3f}")
        panel.append(E.div({"class": "up"}, *_ticks_html("bottom", y_ticks, high)))
        panel.append(plot)
        if ticked and not self.equal:
            panel.append(E.div({"class": "across"}, *_ticks_html("left", x_ticks, across)))
        return panel

    def _svg(
        self, across: Ends, high: Ends, marks: Iterable[Mark], height: float, grid: list[float]
    ) -> HtmlElement:
        """Marks in a square that is so high."""
        svg = E.svg({"viewBox": f"0 0 {WIDE} {height:g}", "preserveAspectRatio": "none"})
        lines = "".join(f"M{_place(x, across, WIDE):.0f} 0v{height:g}" for x in grid)
        svg.append(E.path({"class": "grid", "d": lines}))
        for mark in (each.thinned() for each in marks if each.kind not in SIGNS):
            path = _path(mark, self.log, across, high, height)
            drawn = E.path({"class": f"{mark.kind} {mark.look}", "d": path})
            if mark.name and mark.kind == "line":
                drawn.append(E.title(mark.name))
            svg.append(drawn)
            if mark.kind in ("ring", "box"):
                svg.append(E.path({"class": f"{mark.kind} hole", "d": path}))
        return svg

    def _signs(self, across: Ends, high: Ends) -> Iterable[HtmlElement]:
        for mark in self.marks:
            texts = mark.texts or ("",) * len(mark.x)
            for x, y, text in zip(mark.x, mark.y, texts, strict=True) if mark.kind in SIGNS else ():
                left, top = _place(x, across, 100), _place(y, high[::-1], 100)
                place = {"style": f"left:{left:.2f}%;top:{top:.2f}%"}
                yield E.i({"class": f"sign {mark.kind} {mark.look}"}, place, text)

    def _table(self, rows: Iterable[int], across: Ends) -> HtmlElement:
        places = ticks(*across, log="x" in self.log, count=TICKS if self.columns else 3)
        scale = E.div({"class": "across"}, *_ticks_html("left", places, across))
        heads = (E.th({"class": "number", "scope": "col"}, head) for head in self.columns)
        named = E.th({"scope": "col"}, "")
        body, group = E.tbody(), ""
        for k in rows:
            if self.groups and self.groups[k] != group:
                group = self.groups[k]
                above = {"colspan": str(2 + len(self.columns)), "scope": "rowgroup"}
                body.append(E.tr({"class": "group"}, E.th(above, group)))
            within = [_within(mark, k) for mark in self.marks]
            svg = self._svg(across, (k + 0.5, k - 0.5), within, ROW, [at for at, _ in places])
            name = E.td(
                {"class": "name"},
                _short_or_whole(self.labels[k], self.wholes[k] if self.wholes else ""),
            )
            texts = (E.td({"class": "number"}, column[k]) for column in self.columns.values())
            body.append(E.tr(name, E.td({"class": "picture"}, svg), *texts))
        head = E.thead(E.tr(named, E.th({"class": "scale"}, scale), *heads))
        wide = " wide" if self.columns else ""
        return E.table({"class": f"forest{wide}"}, head, body)


@record
class Chart:
    """Panels below or beside each other.

    Attributes
    ----------
    name : str
        Of its files.
    caption : str
    x_label : str
        Of the last panel.
    panels : tuple of Panel
    columns : int
        Of panels beside each other.
    lanes : int
        So many panels stay below each other, and have one x axis.
    zoom : str
        Charts with the same text have one axis of time, along which the page zooms.
    """

    name: str
    caption: str
    x_label: str
    panels: tuple[Panel, ...]
    columns: int = 1
    lanes: int = 1
    zoom: str = ""

    def html(self) -> HtmlElement:
        """A figure of a page."""
        marks = (mark for panel in self.panels for mark in panel.marks if mark.name)
        keys = dict.fromkeys((mark.name, mark.kind, mark.look) for mark in marks)
        legend = (E.span(E.i({"class": f"key {kind} {look}"}), name) for name, kind, look in keys)
        lanes = [self.panels[k : k + self.lanes] for k in range(0, len(self.panels), self.lanes)]
        first, others = lanes[:MOST_GROUPS], lanes[MOST_GROUPS:]
        figure = E.figure(
            {"style": f"--Columns:{self.columns}"}, E.div({"class": "legend"}, *legend)
        )
        if self.zoom:
            figure.set("data-zoom", self.zoom)
        figure.append(self._grid(first))
        if others:
            figure.append(unfolding(f"{len(others)} more", self._grid(others)))
        figure.append(E.figcaption(self.caption))
        return figure

    def _grid(self, lanes: Sequence[Sequence[Panel]]) -> HtmlElement:
        grid = E.div({"class": "panels"})
        for group in lanes:
            ends = group[0], group[-1]
            drawn = (p.html(headed=p is ends[0], ticked=p is ends[1]) for p in group)
            grid.append(E.div({"class": "lanes"}, *drawn))
            if self.x_label:
                grid[-1].append(E.div({"class": "along"}, self.x_label))
        return grid

    def figure(self) -> Any:
        """The chart as a figure of matplotlib, as wide as a column of a paper.

        Raises
        ------
        MissingExtraError
            When matplotlib is not installed.

        Examples
        --------
        >>> import loopid
        >>> chart = loopid.plots.robot_chart(loopid.load("five_bar"))
        >>> chart.figure().savefig("robot.pdf")  # doctest: +SKIP
        """
        require_matplotlib()
        import matplotlib as mpl
        from matplotlib.figure import Figure

        columns = min(self.columns, 2) if self.lanes == 1 else 1
        heights = [panel.height for panel in self.panels[::columns]]
        with mpl.rc_context(STYLE):
            figure = Figure(figsize=(COLUMN, sum(heights) + 0.4))
            axes = figure.subplots(len(heights), columns, squeeze=False, height_ratios=heights)
            for ax, panel in zip(axes.flat, self.panels, strict=False):
                panel.draw(ax)
            for ax in axes.flat[len(self.panels) :]:
                ax.set_axis_off()
            axes[-1, 0].set_xlabel(self.x_label)
            found = [ax.get_legend_handles_labels() for ax in axes.flat]
            if handles := {n: h for each in found for h, n in zip(*each, strict=True)}:
                beside = min(len(handles), LEGEND // (10 + max(map(len, handles))) or 1)
                figure.legend(handles.values(), handles, loc="outside lower center", ncols=beside)
        return figure

    def _repr_html_(self) -> str:
        return self.files()[f"{self.name}.svg"].decode()

    def files(self) -> dict[str, bytes]:
        """The figure as ``name.svg`` and ``name.pdf``; the same bytes every time."""
        figure, files = self.figure(), dict[str, bytes]()
        import matplotlib as mpl

        with mpl.rc_context(STYLE), warnings.catch_warnings():
            warnings.filterwarnings("ignore", HARMLESS)
            for kind, dated in (("svg", "Date"), ("pdf", "CreationDate")):
                stream = io.BytesIO()
                figure.savefig(stream, format=kind, metadata={dated: None})
                files[f"{self.name}.{kind}"] = stream.getvalue()
                figure.set_layout_engine("none")  # laid out once
        return files


def require_matplotlib() -> None:
    """Refuse figures where they cannot be drawn."""
    try:
        import matplotlib.figure  # noqa: F401
    except ImportError as error:
        raise MissingExtraError.of("matplotlib", "plot") from error


def _draw(mark: Mark, ax: Any) -> None:
    """Draw a mark on axes of matplotlib."""
    colour, width, dashes = LOOKS[mark.look]
    look: Any = {"color": colour, "linewidth": width, "label": mark.name or None}
    if mark.kind == "line":
        ax.plot(mark.x, mark.y, dashes, **look)
    elif mark.kind in POINTS or mark.kind in SIGNS:
        face = "white" if mark.kind in ("ring", "box", "joint", "closure") else colour
        shape = {"markersize": 3, "markerfacecolor": face}
        ax.plot(mark.x, mark.y, {**POINTS, **SIGNS}[mark.kind], **look | shape)
        for x, y, text in zip(mark.x, mark.y, mark.texts, strict=False):
            ax.annotate(text, (x, y), (3, 3), textcoords="offset points", fontsize=6)
    elif mark.kind == "band":
        ax.fill_between(mark.x, mark.y, mark.to, **look | {"linewidth": 0}, alpha=0.25)
    elif mark.kind == "span":
        ax.hlines(mark.y, mark.x, mark.to, **look)
    else:
        ends = mark.x if mark.to is None else mark.to
        for k, (x, to) in enumerate(zip(mark.x, ends, strict=True)):
            own = look if k == 0 else look | {"label": None}
            if mark.kind == "upright":
                ax.axvline(x, linestyle=dashes, **own)
            else:
                ax.axvspan(x, to, **own | {"linewidth": 0}, alpha=0.2)


def _within(mark: Mark, row: int) -> Mark:
    """What of a mark is in a row of a table."""
    if mark.kind in UPRIGHT:
        return mark
    own = np.abs(mark.y - row) < 0.5
    to = None if mark.to is None else mark.to[own]
    return Mark(mark.name, mark.x[own], mark.y[own], mark.look, mark.kind, to)


def _short_or_whole(short: str, whole: str) -> HtmlElement | str:
    """A name that unfolds to what it is short for, if it is."""
    if whole in ("", short):
        return short
    return E.details({"class": "sum"}, E.summary(short), E.span(whole))


def in_parts(count: int, table: Callable[[range], HtmlElement]) -> list[HtmlElement]:
    """So many rows of a table; those beyond ``MOST_ROWS`` unfold."""
    found, left = [table(range(min(count, MOST_ROWS)))], count - MOST_ROWS
    if left > 0:
        title = f"{left} more {'row' if left == 1 else 'rows'}"
        found.append(unfolding(title, table(range(MOST_ROWS, count))))
    return found


def unfolding(title: str, *content: HtmlElement) -> HtmlElement:
    """A title that unfolds to what is below it."""
    return E.details(E.summary(title), *content)


def _ticks_html(side: str, marks: Iterable[tuple[float, str]], ends: Ends) -> Iterable[HtmlElement]:
    for at, text in marks:
        share = 100 * (at - ends[0]) / (ends[1] - ends[0])
        beyond = {"class": "start" if share < NEAR else "end"} if side == "left" else {}
        near = side == "left" and not NEAR <= share <= 100 - NEAR
        yield E.span({"style": f"{side}:{share:.2f}%", **(beyond if near else {})}, text)


def _place(at: Any, ends: Ends, size: float) -> Any:
    """Where values are between two ends, from 0 to a size."""
    return size * (at - ends[0]) / (ends[1] - ends[0])


def _path(mark: Mark, log: str, across: Ends, high: Ends, height: float) -> str:
    """A mark in whole numbers of the square."""

    def placed(values: FloatArray, axis: str) -> FloatArray:
        ends, size = (across, WIDE) if axis == "x" else (high[::-1], height)
        at = np.clip(_place(_scaled(values, axis in log), ends, size), -1e6, 1e6)
        return np.asarray(at, dtype=np.float64)

    x, y = placed(mark.x, "x"), placed(mark.y, "y")
    y = np.zeros(len(x)) if mark.kind in UPRIGHT else y
    sideways = mark.kind in ("span", "shade")
    to = placed(mark.y if mark.to is None else mark.to, "x" if sideways else "y")
    known = np.isfinite(x) & np.isfinite(y) & np.isfinite(to)
    rows = list(zip(*(each[known].tolist() for each in (x, y, to)), strict=True))
    if mark.kind == "span":
        return "".join(f"M{a:.0f} {up:.0f}h{round(b) - round(a)}" for a, up, b in rows)
    if mark.kind == "shade":
        wide = [(round(a), round(b) - round(a)) for a, _, b in rows]
        return "".join(f"M{a} 0h{size}v{height:g}h{-size}z" for a, size in wide)
    if mark.kind == "upright":
        return "".join(f"M{a:.0f} 0v{height:g}" for a, _, _ in rows)
    if mark.kind in POINTS:
        return _moves([(round(a), round(b)) for a, b, _ in sorted(rows)])
    edges = np.flatnonzero(np.diff(np.concatenate([[False], known, [False]]).astype(int)))
    parts = [slice(a, b) for a, b in edges.reshape(-1, 2).tolist()]
    if mark.kind == "line":
        return "".join(_steps(x[part], y[part]) for part in parts)
    return "".join(
        _steps(np.r_[x[part], x[part][::-1]], np.r_[y[part], to[part][::-1]]) + "z"
        for part in parts
    )


def _steps(x: FloatArray, y: FloatArray) -> str:
    """A line in whole numbers, from point to point."""
    points = np.stack([x, y], axis=1).round().astype(int)
    moves = np.diff(points, axis=0)
    start = f"M{points[0, 0]} {points[0, 1]}"
    return start + ("l" + " ".join(map(str, moves.ravel().tolist())) if len(moves) else "h0")


def _moves(points: Sequence[tuple[int, int]]) -> str:
    """Dots in whole numbers, from one to the next."""
    said, at = list[str](), (0, 0)
    for x, y in points:
        said.append(f"m{x - at[0]} {y - at[1]}h1" if said else f"M{x} {y}h1")
        at = x + 1, y
    return "".join(said)


def _scaled(values: FloatArray, log: bool) -> FloatArray:
    """The values, or their logarithms where they have one."""
    known = np.where(values > 0, values, np.nan) if log else values
    return np.asarray(np.log10(known) if log else known, dtype=np.float64)


def _ends(parts: Iterable[FloatArray]) -> tuple[float, float]:
    """Least and largest, with a margin."""
    all_ = np.concatenate([np.zeros(0), *(part[np.isfinite(part)] for part in parts)])
    if not len(all_):
        return 0.0, 1.0
    low, high = float(all_.min()), float(all_.max())
    spread = high - low if high - low > ALIKE * max(abs(low), abs(high)) else 0.0
    room = MARGIN * spread or 0.5 * abs(low) or 0.5
    return low - room, high + room


def ticks(
    low: float, high: float, *, log: bool = False, count: int = TICKS
) -> list[tuple[float, str]]:
    """Round numbers between two ends, with their texts; of logarithms powers of 10, or 1, 2, 5."""
    if log and high - low < 2:
        decades = range(math.floor(low), math.ceil(high) + 1)
        found = [math.log10(k) + decade for decade in decades for k in (1, 2, 5)]
        return [(at, f"{10**at:.3g}") for at in found if low <= at <= high]
    step = 10.0 ** math.floor(math.log10((high - low) / count))
    step *= next(k for k in (1, 2, 5, 10) if (high - low) / (k * step) <= count + 1)
    step = max(round(step), 1) if log else step
    places = [k * step for k in range(math.ceil(low / step), math.floor(high / step) + 1)]
    return [(at, _power(at) if log else f"{round(at, 12) + 0.0:.6g}") for at in places]


def _power(at: float) -> str:
    return f"{10**at:g}" if abs(at) <= PLAIN else f"1e{at:.0f}"
