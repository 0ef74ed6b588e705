"""Charts: said once, drawn as SVG on a page, which a script zooms, and alone for papers.

Marks are paths in a plain square whose sides the page makes as wide as it is. The width of lines
stays. Long lines are thinned to the least and the largest of each step of time.
"""

from __future__ import annotations

import math
from base64 import b64encode
from collections.abc import Callable, Iterable, Sequence
from dataclasses import field
from typing import Any

import numpy as np
from lxml.builder import ElementMaker
from lxml.etree import _Element as Element, tostring

from loopid.arguments import BoolArray, FloatArray, IntArray, spread_rows
from loopid.errors import counted, one_line, short_name
from loopid.records import record

# Colours by what is drawn. The style sheet of the page has the same, and those for dark screens.
LOOKS = {
    **{"measured": "#3b424c", "fit": "#bf4700", "file": "#0068a8", "other": "#0b7046"},
    **{"weak": "#875900", "faint": "#78818d", "limit": "#565e6a", "links": "#c0c8d2"},
}
Ends = tuple[float, float]
Ticks = list[tuple[float, str]]  # places on an axis, with their texts
SIGNS = "motor", "slide", "joint", "closure"
UPRIGHT = "upright", "shade"  # kinds that reach over all of y
POINTS = "dots", "disc", "ring", "box"
HOLLOW = "ring", "box", "joint", "closure"
# Of a line, with its least and largest value in each: half a column of a page shows no more.
STEPS = 250
MOST_DOTS = 1500
MOST_GROUPS, MOST_ROWS = 6, 40  # motors, and rows of a table, that are seen at first
WIDE, HIGH = 10_000, 1_000  # of the square that marks are drawn in
TALLEST = 12  # height of a robot's picture on a page, in rem
ROW = 100  # height of a row of a table with pictures
MARGIN = 0.04  # of an axis beyond the marks, on either side
ROOM = 0.08  # about a robot, in parts of it, for the signs at its ends
NEAR = 5.0  # % of an axis next to its ends, where numbers stand inwards
ALIKE = 1e-5  # relative difference of values that have one place on an axis
TICKS = 5  # of an axis, about
PLAIN = 3  # powers of 10 that are written out
# For papers, in px (96 an inch): a column of a two-column page, and what stands about the marks.
COLUMN, LINE, NUMBERS, NAMES = 336, 14, 34, 116
FINE = 10  # steps a px
LETTER, LONGEST, SHORT = 6, 56, 18  # width of a letter; characters of a title and a name
KEYS = {
    **dict.fromkeys(("line", "span"), "M-90 0h180"),
    "upright": "M0 -50v100",
    **dict.fromkeys(("shade", "band"), "M-90 -40h180v80h-180z"),
}
STYLE = """
text { font: 10px sans-serif; fill: #16191d; }
.end { text-anchor: end; } .middle { text-anchor: middle; }
path { fill: none; stroke: currentColor; stroke-width: 11; stroke-linejoin: round; }
.grid { color: #dadfe6; stroke-width: 5; } .limit { stroke-dasharray: 15 25; }
.band, .shade { fill: currentColor; stroke: none; opacity: .25; }
.dots, .disc, .ring, .joint, .motor, .links { stroke-linecap: round; }
.box, .slide, .closure { stroke-linecap: square; }
.dots { stroke-width: 20; opacity: .5; } .disc, .ring, .box { stroke-width: 55; }
.links { stroke-width: 50; } .motor, .slide { stroke-width: 110; }
.joint, .closure { stroke-width: 70; }
path.hole { color: #fff; stroke-width: 30; } .sign { fill: #fff; }
"""


def _add_text(element: Element, text: str) -> None:
    """Text of any origin, what is not printable but ends of lines as escapes."""
    plain = text if text.isprintable() else "\n".join(map(one_line, text.split("\n")))
    if len(element):
        element[-1].tail = (element[-1].tail or "") + plain
    else:
        element.text = (element.text or "") + plain


# Elements of a page, which escape what they hold.
_TEXTS: Any = {str: _add_text}
E = ElementMaker(typemap=_TEXTS)


@record(checked="outside")
class Mark:
    """Something drawn in a panel; marks of one name have one entry in the legend.

    A kind is ``"line"``, which breaks where a value is NaN; ``"dots"``, many, or one by one
    ``"disc"``, ``"ring"``, ``"box"``; ``"band"`` between y and ``to``; ``"span"`` from x to ``to``
    at y; ``"upright"`` at x over all y; ``"shade"`` between x and ``to``; a key of ``SIGNS``.

    Examples
    --------
    >>> from loopid.plots import Chart, Mark, Panel
    >>> force = Mark("measured", [0.0, 1.0], [2.0, 3.0])
    >>> Chart("force", "Force over time", "s", (Panel("elbow", (force,)),)).name
    'force'
    """

    name: str  # none without an entry
    x: FloatArray  # (N,), as y and ``to`` are
    y: FloatArray
    look: str = "fit"  # a key of ``LOOKS``
    kind: str = "line"
    to: FloatArray | None = None
    texts: tuple[str, ...] = ()  # (N,), in signs

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


@record(checked="outside")
class Panel:
    """Marks on one pair of axes, or a table with a picture in each row.

    Examples
    --------
    >>> from loopid.plots import Mark, Panel
    >>> Panel("elbow", (Mark("measured", [0.0, 1.0], [2.0, 3.0]),)).title
    'elbow'
    """

    title: str  # with the unit of y
    marks: tuple[Mark, ...]
    x_limits: tuple[float, float] | None = None  # by default where the marks are
    y_limits: tuple[float, float] | None = None
    # Rows of a table, in place of numbers at y = 0, 1, ... from above; more columns by their heads.
    labels: tuple[str, ...] = ()
    columns: dict[str, tuple[str, ...]] = field(default_factory=dict)
    groups: tuple[str, ...] = ()  # of each row, said where it changes
    wholes: tuple[str, ...] = ()  # what labels are short for, where they are
    log: str = ""  # which axes are logarithmic: a part of "xy"
    small: bool = False  # half as high
    equal: bool = False  # a length is the same both ways; then the page shows no axes
    motor: str = ""  # whose it is; the first of its lanes says it
    number: int = 0  # of the motor on the page
    worst: bool = False  # the motor with the largest error
    note: str = ""  # numbers, below the panel

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
    def height(self) -> int:
        """For papers, in px."""
        if self.labels:
            return LINE * (2 + len(self.labels))
        return 80 if self.small else 230 if self.equal else 140

    def drawing(self, wide: float) -> Iterable[Element]:
        """The panel for papers, this many px wide."""
        across, high = self.limits()
        title = ": ".join(filter(None, (self.motor, self.title)))
        yield _text(0, LINE - 3, short_name(title, int(LONGEST * wide / COLUMN)))
        left = NAMES if self.labels else 0 if self.equal else NUMBERS
        width, height = wide - left - 8, self.height - 2.0 * LINE
        if self.equal:
            shape = float(np.ptp(across) / np.ptp(high))
            width, height = min(width, height * shape), min(height, width / shape)
        x_ticks, y_ticks = self._ticks(across, high, TICKS if wide == COLUMN else TICKS // 2)
        size = round(FINE * width), round(FINE * height)
        svg = self._svg(across, high, self.marks, (x_ticks, y_ticks), size, alone=True)
        place = {"x": left, "y": LINE, "width": width, "height": height}
        svg.attrib.update({name: f"{value:g}" for name, value in place.items()})
        yield svg
        for at, text in x_ticks:
            yield _text(left + _place(at, across, width), self.height - 3, text, "middle")
        for at, text in y_ticks:
            down = LINE + 3 + _place(at, high[::-1], height)
            yield _text(left - 4, down, short_name(text, SHORT), "end")
        for _, x, y, text in self._signs():
            down = LINE + 3 + _place(y, high[::-1], height)
            yield _text(_place(x, across, width), down, text, "sign middle")

    def _ticks(self, across: Ends, high: Ends, count: int = TICKS) -> tuple[Ticks, Ticks]:
        """About this many numbers along x, and along y or names of rows, with their places."""
        if self.equal:
            return [], []
        x_ticks = ticks(*across, log="x" in self.log, count=count)
        if self.labels:
            return x_ticks, [*enumerate(self.labels)]
        return x_ticks, ticks(*high, log="y" in self.log, count=3 if self.small else TICKS)

    def html(self, *, headed: bool = True, ticked: bool = True) -> Element:
        """A part of a figure on a page, with a heading and numbers along x or without."""
        across, high = self.limits()
        panel = E.div()
        for axis, (low, top) in (("x", across), ("y", high)):
            panel.set(f"data-{axis}", f"{low:.9g} {top:.9g}")
        panel.set("class", f"panel{' small' * self.small}{' equal' * self.equal}")
        if self.motor:
            badge = E.i({"class": f"badge{' worst' * self.worst}"}, str(self.number))
            panel.append(E.h3(*([badge] if self.number else []), self.motor))
        small = self.motor or not headed
        if self.title and not (self.labels and self.motor):
            panel.append(E.p({"class": "say"}, self.title) if small else E.h3(self.title))
        if self.labels:
            panel.extend(in_parts(len(self.labels), lambda rows: self._table(rows, across)))
            return panel
        panel.append(E.output())
        x_ticks, y_ticks = self._ticks(across, high)
        svg = self._svg(across, high, self.marks, (x_ticks, y_ticks), (WIDE, HIGH))
        plot = E.div({"class": "plot"}, svg)
        for mark, x, y, text in self._signs():
            left, top = _place(x, across, 100), _place(y, high[::-1], 100)
            place = {"style": f"left:{left:.2f}%;top:{top:.2f}%"}
            plot.append(E.i({"class": f"sign {mark.kind} {mark.look}"}, place, text))
        if self.equal:
            shape = float(np.ptp(across) / np.ptp(high))
            plot.set("style", f"aspect-ratio:{shape:.3f};width:{TALLEST * shape:.3g}rem")
        panel.append(E.div({"class": "up"}, *_ticks_html("bottom", y_ticks, high)))
        panel.append(plot)
        if ticked and not self.equal:
            panel.append(E.div({"class": "across"}, *_ticks_html("left", x_ticks, across)))
        return panel

    def _svg(
        self,
        across: Ends,
        high: Ends,
        marks: Iterable[Mark],
        grid: tuple[Ticks, Ticks],
        size: tuple[int, int],
        *,
        alone: bool = False,
    ) -> Element:
        """Marks in a square of that size; signs are drawn, too, where no page lays them over it."""
        wide, tall = size
        svg = E.svg({"viewBox": f"0 0 {wide} {tall}", "preserveAspectRatio": "none"})
        lines = [f"M{_place(x, across, wide):.0f} 0v{tall}" for x, _ in grid[0]]
        lines += [f"M0 {_place(y, high[::-1], tall):.0f}h{wide}" for y, _ in grid[1]]
        svg.append(E.path({"class": "grid", "d": "".join(lines)}))
        for mark in (each.thinned() for each in marks if alone or each.kind not in SIGNS):
            path = _path(mark, self.log, across, high, size)
            drawn = E.path({"class": f"{mark.kind} {mark.look}", "d": path})
            if mark.name and mark.kind == "line":
                drawn.append(E.title(mark.name))
            svg.append(drawn)
            if mark.kind in HOLLOW:
                svg.append(E.path({"class": f"{mark.kind} hole", "d": path}))
        return svg

    def _signs(self) -> Iterable[tuple[Mark, float, float, str]]:
        """Signs one by one, with their places and texts."""
        for mark in (each for each in self.marks if each.kind in SIGNS):
            for x, y, text in zip(mark.x, mark.y, mark.texts or ("",) * len(mark.x), strict=True):
                yield mark, float(x), float(y), text

    def _table(self, rows: Iterable[int], across: Ends) -> Element:
        places = ticks(*across, log="x" in self.log, count=TICKS if self.columns else 3)
        scale = E.div({"class": "across"}, *_ticks_html("left", places, across))
        heads = (E.th({"class": "number", "scope": "col"}, head) for head in self.columns)
        body, group = E.tbody(), ""
        for k in rows:
            if self.groups and self.groups[k] != group:
                group = self.groups[k]
                above = {"colspan": str(2 + len(self.columns)), "scope": "rowgroup"}
                body.append(E.tr({"class": "group"}, E.th(above, group)))
            within = [_within(mark, k) for mark in self.marks]
            svg = self._svg(across, (k + 0.5, k - 0.5), within, (places, []), (WIDE, ROW))
            whole = self.wholes[k] if self.wholes else ""
            name = E.td({"class": "name"}, short_or_whole(self.labels[k], whole))
            texts = (
                E.td({"class": "number", "data-head": column}, cells[k])
                for column, cells in self.columns.items()
            )
            body.append(E.tr(name, E.td({"class": "picture"}, svg), *texts))
        head = E.thead(E.tr(E.th({"scope": "col"}, ""), E.th({"class": "scale"}, scale), *heads))
        return E.table({"class": f"forest{' wide' * bool(self.columns)}"}, head, body)


@record(checked="outside")
class Chart:
    """Panels below or beside each other.

    Examples
    --------
    >>> import loopid
    >>> chart = loopid.plots.robot_chart(loopid.load("five_bar"))
    >>> chart.name, chart.svg()[:4]
    ('robot', '<svg')
    """

    name: str  # of its files
    caption: str
    x_label: str  # below the last panel
    panels: tuple[Panel, ...]
    columns: int = 1  # of panels beside each other, at most
    lanes: int = 1  # this many panels stay below each other, and have one x axis
    zoom: str = ""  # charts with the same text are zoomed together along time

    def html(self) -> Element:
        """A figure of a page."""
        keys = self._keys()
        legend = (E.span(E.i({"class": f"key {kind} {look}"}), name) for name, kind, look in keys)
        lanes = [self.panels[k : k + self.lanes] for k in range(0, len(self.panels), self.lanes)]
        first, others = lanes[:MOST_GROUPS], lanes[MOST_GROUPS:]
        style = f"--Columns:{min(self.columns, len(lanes))}"
        figure = E.figure({"style": style}, E.div({"class": "legend"}, *legend))
        if self.zoom:
            figure.set("data-zoom", self.zoom)
        figure.append(self._grid(first))
        if others:
            figure.append(unfolding(f"{len(others)} more", self._grid(others)))
        figure.append(E.figcaption(self.caption))
        known = dict[str, str]()  # a long log has many shades, which are alike in all lanes
        for k, path in enumerate(list[Any](figure.iter("path"))):
            if "shade" in path.get("class"):
                path.set("id", "-".join(f"{self.name} {k}".split()))
                same = known.setdefault(path.get("d"), path.get("id"))
                if same != path.get("id"):
                    path.getparent().replace(path, E.use({"href": f"#{same}"}))
        return figure

    def _grid(self, lanes: Sequence[Sequence[Panel]]) -> Element:
        grid = E.div({"class": "panels"})
        for group in lanes:
            drawn = (p.html(headed=p is group[0], ticked=p is group[-1]) for p in group)
            grid.append(E.div({"class": "lanes"}, *drawn))
            if self.x_label:
                grid[-1].append(E.div({"class": "along"}, self.x_label))
            grid[-1].extend(E.p({"class": "note"}, panel.note) for panel in group if panel.note)
        return grid

    def _keys(self) -> list[tuple[str, str, str]]:
        """Names of marks for a legend, with kind and look."""
        marks = (mark for panel in self.panels for mark in panel.marks if mark.name)
        return [*dict.fromkeys((mark.name, mark.kind, mark.look) for mark in marks)]

    def _repr_html_(self) -> str:  # an image of its own, which no style of a notebook enters
        data = b64encode(self.svg().encode()).decode()
        return str(tostring(E.img(src=f"data:image/svg+xml;base64,{data}"), encoding="unicode"))

    def svg(self) -> str:
        """The chart alone as SVG, as wide as a column of a paper."""
        named = any(panel.labels for panel in self.panels)
        columns = 1 if named or self.lanes > 1 else min(self.columns, len(self.panels) or 1, 2)
        wide, down, drawn = COLUMN / columns, 0, list[Element]()
        for k in range(0, len(self.panels), columns):
            row = self.panels[k : k + columns]
            for j, panel in enumerate(row):
                move = {"transform": f"translate({j * wide:g} {down})"}
                drawn.append(E.g(move, *panel.drawing(wide)))
            down += max(panel.height for panel in row)
        if self.x_label:
            drawn.append(_text(COLUMN / 2, down + LINE - 3, self.x_label, "middle"))
            down += LINE
        keys = self._keys()
        longest = max((len(name) for name, *_ in keys), default=0)
        columns = max(min(len(keys), COLUMN // (LETTER * (longest + 5))), 1)
        for k, (name, kind, look) in enumerate(keys):
            x, y = COLUMN * (k % columns) / columns, down + LINE * (k // columns + 0.5)
            scaled = {"transform": f"translate({x + LINE:g} {y:g}) scale({1 / FINE})"}
            path = KEYS.get(kind, "M0 0h1")
            drawn.append(E.g(scaled, E.path({"class": f"{kind} {look}", "d": path})))
            if kind in HOLLOW:
                drawn[-1].append(E.path({"class": f"{kind} hole", "d": path}))
            drawn.append(_text(x + 2 * LINE, y + 3, name))
        size = {"width": f"{COLUMN}", "height": f"{down + LINE * -(-len(keys) // columns) + 3}"}
        size["viewBox"] = "0 0 {width} {height}".format(**size)
        colours = "".join(f".{look} {{ color: {colour}; }}\n" for look, colour in LOOKS.items())
        size["xmlns"] = "http://www.w3.org/2000/svg"
        figure = E.svg(size, E.title(self.caption), E.style(colours + STYLE), *drawn)
        return str(tostring(figure, encoding="unicode"))


def forest(
    title: str,
    values: FloatArray,
    right: float,
    words: tuple[str, str, str] = ("", "differs", "as expected"),
    **rows: Any,
) -> Panel:
    """Values with the ends of their intervals (n, 3), filled where these do not hold one value.

    ``words`` name that one, what differs from it, and what agrees; ``rows`` are labels and columns.
    """
    middle, low, high = values.T
    place, known = np.arange(float(len(values))), np.isfinite(values).all(axis=1)
    alike = (low <= right) & (high >= right) | ~known
    marks = (
        Mark.upright(words[0], right),
        Mark("95 % interval", low[known], place[known], "fit", "span", high[known]),
        Mark(words[1], middle[~alike], place[~alike], "fit", "disc"),
        Mark(words[2], middle[alike], place[alike], "fit", "ring"),
    )
    return Panel(title, marks, **rows)


def _text(x: float, y: float, text: str, look: str = "") -> Element:
    return E.text({"x": f"{x:.1f}", "y": f"{y:.1f}", "class": look}, text)


def _within(mark: Mark, row: int) -> Mark:
    """What of a mark is in a row of a table."""
    if mark.kind in UPRIGHT:
        return mark
    own = np.abs(mark.y - row) < 0.5
    to = None if mark.to is None else mark.to[own]
    return Mark(mark.name, mark.x[own], mark.y[own], mark.look, mark.kind, to)


def short_or_whole(short: str, whole: str) -> Element | str:
    """A name that unfolds to what it is short for, if it is."""
    if whole in ("", short):
        return short
    return E.details({"class": "sum"}, E.summary(short), E.span(whole))


def in_parts(count: int, table: Callable[[range], Element]) -> list[Element]:
    """Rows of a table; those beyond ``MOST_ROWS`` unfold."""
    found, left = [table(range(min(count, MOST_ROWS)))], count - MOST_ROWS
    if left > 0:
        found.append(unfolding(counted(left, "more row"), table(range(MOST_ROWS, count))))
    return found


def unfolding(title: str, *content: Element) -> Element:
    """A title that unfolds to what is below it."""
    return E.details(E.summary(title), *content)


def _ticks_html(side: str, marks: Iterable[tuple[float, str]], ends: Ends) -> Iterable[Element]:
    for at, text in marks:
        share = 100 * (at - ends[0]) / (ends[1] - ends[0])
        beyond = {"class": "start" if share < NEAR else "end"} if side == "left" else {}
        near = side == "left" and not NEAR <= share <= 100 - NEAR
        yield E.span({"style": f"{side}:{share:.2f}%", **(beyond if near else {})}, text)


def _place(at: Any, ends: Ends, size: float) -> Any:
    """Where values are between two ends, from 0 to a size."""
    return size * (at - ends[0]) / (ends[1] - ends[0])


def _path(mark: Mark, log: str, across: Ends, high: Ends, size: tuple[int, int]) -> str:
    """A mark in whole numbers of the square."""

    def placed(values: FloatArray, axis: str) -> FloatArray:
        ends, room = (across, size[0]) if axis == "x" else (high[::-1], size[1])
        at = np.clip(_place(_scaled(values, axis in log), ends, room), -1e6, 1e6)
        return np.asarray(at, dtype=np.float64)

    x, y = placed(mark.x, "x"), placed(mark.y, "y")
    y = np.zeros(len(x)) if mark.kind in UPRIGHT else y
    sideways = mark.kind in ("span", "shade")
    to = y if mark.to is None else placed(mark.to, "x" if sideways else "y")
    known = np.isfinite(x) & np.isfinite(y) & np.isfinite(to)
    rows = list(zip(*(each[known].tolist() for each in (x, y, to)), strict=True))
    if mark.kind == "span":
        return "".join(f"M{a:.0f} {up:.0f}h{round(b) - round(a)}" for a, up, b in rows)
    if mark.kind == "shade":
        spans = [(round(a), round(b) - round(a)) for a, _, b in rows]
        return "".join(f"M{a} 0h{wide}v{size[1]}h{-wide}z" for a, wide in spans)
    if mark.kind == "upright":
        return "".join(f"M{a:.0f} 0v{size[1]}" for a, _, _ in rows)
    if mark.kind in POINTS or mark.kind in SIGNS:
        return _moves([(round(a), round(b)) for a, b, _ in sorted(rows)])
    parts = [slice(first, end) for first, end in segments(known).tolist()]
    if mark.kind == "line":
        return "".join(_steps(x[part], y[part]) for part in parts)
    return "".join(
        _steps(np.r_[x[part], x[part][::-1]], np.r_[y[part], to[part][::-1]]) + "z"
        for part in parts
    )


def segments(chosen: BoolArray) -> IntArray:
    """Rows (n, 2) of the first sample of each segment, and of the first one behind it."""
    edges = np.diff(np.concatenate([[False], chosen, [False]]).astype(int))
    return np.flatnonzero(edges).reshape(-1, 2)


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


def ticks(low: float, high: float, *, log: bool = False, count: int = TICKS) -> Ticks:
    """Round numbers between two ends, with their texts; of logarithms powers of 10, or 1, 2, 5."""
    if log and high - low < 2:
        decades = range(math.floor(low), math.ceil(high) + 1)
        found = [math.log10(k) + decade for decade in decades for k in (1, 2, 5)]
        return [(at, f"{10**at:.3g}") for at in found if low <= at <= high]
    step = 10.0 ** math.floor(math.log10((high - low) / count))
    step *= next(k for k in (1, 2, 5, 10) if (high - low) / (k * step) <= count + 1)
    step = max(round(step), 1) if log else step
    places = [k * step for k in range(math.ceil(low / step), math.floor(high / step) + 1)]
    if len(places) < 2 and count < TICKS:
        return ticks(low, high, log=log, count=count + 1)
    if not log:
        return [(at, f"{round(at, 12) + 0.0:.6g}") for at in places]
    return [(at, f"{10**at:g}" if abs(at) <= PLAIN else f"1e{at:.0f}") for at in places]
