"""Charts: said once, drawn as SVG on a page, which a script zooms, and on axes of matplotlib.

Marks are paths in a plain square whose sides the page stretches as wide as it is; the width of
lines stays. Long lines are thinned to the least and the largest of each step of time.
"""

from __future__ import annotations

import io
import math
import warnings
from collections.abc import Iterable, Sequence
from typing import Any, Literal

import numpy as np
from lxml.builder import ElementMaker
from lxml.html import HtmlElement, html_parser

from loopid.arguments import FloatArray, spread_rows
from loopid.errors import MissingExtraError, one_line, short_name
from loopid.records import record

# By what is drawn: colour of the palette of Okabe and Ito, width of a line, and its dashes. The
# page has the same as classes of its style sheet, there for dark screens, too.
LOOKS: dict[str, tuple[str, float, str]] = {
    "measured": ("#666666", 1.4, "-"),
    "fit": ("#D55E00", 0.9, "-"),
    "file": ("#0072B2", 0.9, "--"),
    "residual": ("#0072B2", 0.6, "-"),
    "other": ("#009E73", 0.9, "-"),
    "weak": ("#E69F00", 0.9, "-"),
    "faint": ("#999999", 0.6, "-"),
    "limit": ("#0072B2", 0.6, ":"),
}
STEPS = 1200  # of a line, with its least and largest value in each: more than a screen can show
MOST_DOTS = 1500
WIDE, HIGH = 20_000, 2_000  # of the square that marks are drawn in
MARGIN = 0.04  # of an axis beyond the marks, on either side
TICKS = 5  # of an axis, about
COLUMN, RESOLUTION = 3.5, 220  # inches: a column of a two-column page; dots per inch of a PNG
LONGEST, LEGEND = 44, 80  # characters of a name that is drawn, and in a line of a legend
NAMES_STAY_TEXT: Any = {"text.parse_math": False}
STYLE = NAMES_STAY_TEXT | {
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
        ``"line"``; ``"dots"``; ``"band"`` between y and ``to``; ``"span"``, from x to ``to`` at y.
    to : FloatArray or None
        (N,).
    """

    name: str
    x: FloatArray
    y: FloatArray
    look: str = "fit"
    kind: Literal["line", "dots", "band", "span"] = "line"
    to: FloatArray | None = None

    def thinned(self) -> Mark:
        """As much of it as can be seen."""
        count = len(self.x)
        if self.kind == "span" or count <= (2 * STEPS if self.kind == "line" else MOST_DOTS):
            return self
        rows = self._extremes() if self.kind == "line" else spread_rows(count, MOST_DOTS)
        to = None if self.to is None else self.to[rows]
        return Mark(self.name, self.x[rows], self.y[rows], self.look, self.kind, to)

    def _extremes(self) -> list[int]:
        """Rows of the least and the largest value of each step of a line; gaps stay gaps."""
        rows = []
        for part in np.array_split(np.arange(len(self.x)), STEPS):
            y = self.y[part]
            gap = np.isnan(y)
            chosen = [gap.argmax()] if gap.any() else []
            chosen += [] if gap.all() else [np.nanargmin(y), np.nanargmax(y)]
            rows += sorted({int(part[k]) for k in chosen})
        return rows


@record
class Panel:
    """Marks on one pair of axes.

    Attributes
    ----------
    title : str
        With the unit of y.
    marks : tuple of Mark
    y_limits : tuple of float or None
    labels : tuple of str
        Instead of numbers at y = 0, 1, ... from above.
    log : str
        Which axes are logarithmic: a part of ``"xy"``.
    small : bool
        Whether it is half as high, as of residuals.
    equal : bool
        Whether a length is the same along x and y.
    """

    title: str
    marks: tuple[Mark, ...]
    y_limits: tuple[float, float] | None = None
    labels: tuple[str, ...] = ()
    log: str = ""
    small: bool = False
    equal: bool = False

    def limits(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Ends of both axes, logarithms where they are."""
        x, y = [mark.x for mark in self.marks], [mark.y for mark in self.marks]
        for mark in self.marks:
            if mark.to is not None:
                (x if mark.kind == "span" else y).append(mark.to)
        across, high = (
            _ends(_scaled(each, axis in self.log) for each in parts)
            for axis, parts in (("x", x), ("y", y))
        )
        if self.labels:
            high = len(self.labels) - 0.5, -0.5
        if self.y_limits is not None:
            high = self.y_limits
        if self.equal:
            half = max(across[1] - across[0], high[1] - high[0]) / 2
            across, high = ((sum(ends) / 2 - half, sum(ends) / 2 + half) for ends in (across, high))
        return across, high

    @property
    def height(self) -> float:
        """In inches, for papers."""
        if self.labels:
            return 0.5 + 0.16 * len(self.labels)
        return 0.7 if self.small else 1.8 if self.equal else 1.4

    def draw(self, ax: Any) -> None:
        """Draw on axes of matplotlib."""
        for mark in (each.thinned() for each in self.marks):
            colour, width, dashes = LOOKS[mark.look]
            look = {"color": colour, "linewidth": width, "label": mark.name or None}
            if mark.kind == "line":
                ax.plot(mark.x, mark.y, dashes, **look)
            elif mark.kind == "dots":
                ax.plot(mark.x, mark.y, ".", **look, markersize=3, markeredgewidth=0)
            elif mark.kind == "band":
                ax.fill_between(mark.x, mark.y, mark.to, **look | {"linewidth": 0}, alpha=0.25)
            else:
                ax.hlines(mark.y, mark.x, mark.to, **look)
        ax.set_title(short_name(self.title, LONGEST), loc="left")
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

    def html(self) -> HtmlElement:
        """A part of a figure on a page."""
        across, high = self.limits()
        x_ticks = ticks(*across, log="x" in self.log, count=3 if self.equal else TICKS)
        y_ticks = ticks(*sorted(high), log="y" in self.log, count=3 if self.small else TICKS)
        if self.labels:
            y_ticks = [(float(k), name) for k, name in enumerate(self.labels)]
        scales = (across[0], WIDE / (across[1] - across[0])), (high[1], HIGH / (high[0] - high[1]))
        grid = [f"M{(x - scales[0][0]) * scales[0][1]:.0f} 0v{HIGH}" for x, _ in x_ticks]
        grid += [f"M0 {(y - scales[1][0]) * scales[1][1]:.0f}h{WIDE}" for y, _ in y_ticks]
        svg = E.svg({"viewBox": f"0 0 {WIDE} {HIGH}", "preserveAspectRatio": "none"})
        svg.append(E.path({"class": "grid", "d": "".join(grid)}))
        for mark in self.marks:
            path = _path(mark.thinned(), self.log, scales)
            drawn = E.path({"class": f"{mark.kind} {mark.look}", "d": path})
            if mark.name:
                drawn.append(E.title(mark.name))
            svg.append(drawn)
        kinds = {"small": self.small, "equal": self.equal, "named": bool(self.labels)}
        ends = {f"data-{n}": f"{a:.9g} {b:.9g}" for n, (a, b) in (("x", across), ("y", high))}
        return E.div(
            {"class": " ".join(["panel", *(kind for kind, given in kinds.items() if given)])},
            {"style": f"--Rows:{len(self.labels)}", **ends},
            E.h4(self.title),
            E.output(),
            E.div({"class": "up"}, *_ticks_html("bottom", y_ticks, high)),
            E.div({"class": "plot"}, svg),
            E.div({"class": "across"}, *_ticks_html("left", x_ticks, across)),
        )


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
    zoom : bool
        Whether all panels have one x axis, along which the page zooms.
    """

    name: str
    caption: str
    x_label: str
    panels: tuple[Panel, ...]
    columns: int = 1
    zoom: bool = False

    def draw(self, axes: Any) -> None:
        """Draw on axes of matplotlib, one a panel.

        Examples
        --------
        >>> import loopid
        >>> from matplotlib.figure import Figure
        >>> chart = loopid.plots.robot_chart(loopid.load_mechanism("five_bar"))
        >>> chart.draw(Figure().subplots(len(chart.panels)))
        """
        import matplotlib as mpl

        with mpl.rc_context(NAMES_STAY_TEXT):
            for ax, panel in zip(np.ravel(axes), self.panels, strict=True):
                panel.draw(ax)
                if any(mark.name for mark in panel.marks):
                    ax.legend()
            ax.set_xlabel(self.x_label)

    def html(self) -> HtmlElement:
        """A figure of a page."""
        marks = (mark for panel in self.panels for mark in panel.marks if mark.name)
        keys = dict.fromkeys((mark.name, mark.kind, mark.look) for mark in marks)
        legend = (E.span(E.i({"class": f"key {kind} {look}"}), name) for name, kind, look in keys)
        figure = E.figure(
            {"class": "zoom" if self.zoom else "", "style": f"--Columns:{self.columns}"},
            E.div({"class": "legend"}, *legend),
            E.div({"class": "panels"}, *(panel.html() for panel in self.panels)),
        )
        if self.x_label:
            figure.append(E.div({"class": "along"}, self.x_label))
        figure.append(E.figcaption(self.caption))
        return figure

    def files(self) -> dict[str, bytes]:
        """The chart by matplotlib as ``name.svg`` and ``name.png``; the same bytes every time.

        Raises
        ------
        MissingExtraError
            When matplotlib is not installed.
        """
        require_matplotlib()
        import matplotlib as mpl
        from matplotlib.figure import Figure

        columns, files = min(self.columns, 2), {}
        heights = [panel.height for panel in self.panels[::columns]]
        with mpl.rc_context(STYLE), warnings.catch_warnings():
            warnings.filterwarnings("ignore", HARMLESS)
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
            for kind, metadata in (("svg", {"Date": None}), ("png", {"Software": None})):
                stream = io.BytesIO()
                figure.savefig(stream, format=kind, dpi=RESOLUTION, metadata=metadata)
                files[f"{self.name}.{kind}"] = stream.getvalue()
                figure.set_layout_engine("none")  # laid out once
        return files


def require_matplotlib() -> None:
    """Refuse figures where they cannot be drawn."""
    try:
        import matplotlib.figure  # noqa: F401
    except ImportError as error:
        raise MissingExtraError.of("matplotlib", "plot") from error


def _ticks_html(
    side: str, marks: Iterable[tuple[float, str]], ends: tuple[float, float]
) -> Iterable[HtmlElement]:
    for at, text in marks:
        share = 100 * (at - ends[0]) / (ends[1] - ends[0])
        yield E.span({"style": f"{side}:{share:.2f}%"}, text)


def _path(mark: Mark, log: str, scales: Sequence[tuple[float, float]]) -> str:
    """A mark in whole numbers of the square."""

    def placed(values: FloatArray, axis: int) -> FloatArray:
        low, size = scales[axis]
        return np.clip((_scaled(values, "xy"[axis] in log) - low) * size, -1e6, 1e6)

    x, y = placed(mark.x, 0), placed(mark.y, 1)
    to = placed(mark.y if mark.to is None else mark.to, 0 if mark.kind == "span" else 1)
    known = np.isfinite(x) & np.isfinite(y) & np.isfinite(to)
    if mark.kind == "span":
        spans = zip(x[known].tolist(), y[known].tolist(), to[known].tolist(), strict=True)
        return "".join(f"M{a:.0f} {up:.0f}H{b:.0f}" for a, up, b in spans)
    if mark.kind == "dots":
        dots = zip(x[known].tolist(), y[known].tolist(), strict=True)
        return "".join(f"M{a:.0f} {b:.0f}h0" for a, b in dots)
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
    room = MARGIN * (high - low) or 0.5 * abs(low) or 0.5
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
    return [(at, f"1e{at:.0f}" if log else f"{round(at, 12) + 0.0:.6g}") for at in places]
