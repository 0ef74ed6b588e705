"""Charts: said once, drawn as SVG on a page, which a script zooms, and by matplotlib for papers.

Marks are paths in a plain square whose sides the page stretches as wide as it is; the width of
lines stays. Long lines are thinned to the least and the largest of each step of time.
"""

from __future__ import annotations

import io
import math
import warnings
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import field
from typing import Any, Literal

import numpy as np
from lxml.builder import ElementMaker
from lxml.html import HtmlElement, html_parser

from loopid.arguments import FloatArray
from loopid.errors import MissingExtraError, one_line
from loopid.records import record
from loopid.report.look import shortened

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
LONGEST = 44  # characters of a name that is drawn
STYLE: dict[str, Any] = {
    "font.size": 7.5,
    "axes.titlesize": 7.5,
    "axes.labelsize": 7.5,
    "legend.fontsize": 7,
    "legend.frameon": False,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#dddddd",
    "grid.linewidth": 0.5,
    "figure.constrained_layout.use": True,
    "svg.hashsalt": "loopid",
    "svg.fonttype": "path",
    "text.parse_math": False,  # names may hold anything
}


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
# Of figures with names that the font lacks, which are boxes there, or that leave no room.
HARMLESS = "Glyph .* missing from font", "constrained_layout not applied"


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
        if self.kind in ("dots", "band"):
            rows = np.unique(np.linspace(0, len(self.x) - 1, MOST_DOTS).round().astype(int))
            if len(self.x) <= MOST_DOTS:
                return self
            to = None if self.to is None else self.to[rows]
            return Mark(self.name, self.x[rows], self.y[rows], self.look, self.kind, to)
        if self.kind == "span" or len(self.x) <= 2 * STEPS:
            return self
        return Mark(self.name, *_extremes(self.x, self.y), self.look, self.kind)


def _extremes(x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The least and the largest value of each step of a line, in their order; gaps stay gaps."""
    edges = np.linspace(0, len(x), STEPS + 1).astype(int)[:-1]
    ends = np.append(edges[1:], len(x))
    rows = []
    for first, last in zip(edges.tolist(), ends.tolist(), strict=True):
        part = y[first:last]
        known = ~np.isnan(part)
        if not known.any():
            rows += [first]
            continue
        pair = {int(np.nanargmin(part)), int(np.nanargmax(part))}
        rows += sorted(first + k for k in (pair if known.all() else {*pair, int(np.argmin(known))}))
    return x[rows], y[rows]


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
        x, y = [], []
        for mark in self.marks:
            along, up = [mark.x], [mark.y]
            if mark.to is not None:
                (along if mark.kind == "span" else up).append(mark.to)
            x += [_scaled(each, "x" in self.log) for each in along]
            y += [_scaled(each, "y" in self.log) for each in up]
        across, high = _ends(x), _ends(y)
        if self.labels:
            high = len(self.labels) - 0.5, -0.5
        if self.y_limits is not None:
            high = self.y_limits
        if self.equal:
            half = max(across[1] - across[0], high[1] - high[0]) / 2
            across, high = ((sum(ends) / 2 - half, sum(ends) / 2 + half) for ends in (across, high))
        return across, high


@record
class Chart:
    """Panels below or beside each other, with one legend.

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
    legend: tuple[tuple[str, str, str], ...] = field(init=False, compare=False)

    def __post_init__(self) -> None:
        marks = [mark for panel in self.panels for mark in panel.marks if mark.name]
        known = dict.fromkeys((mark.name, mark.look, mark.kind) for mark in marks)
        object.__setattr__(self, "legend", tuple(known))

    def html(self) -> HtmlElement:
        """A figure of a page."""
        keys = (
            E.span(E.i({"class": f"key {kind} {look}"}), name) for name, look, kind in self.legend
        )
        figure = E.figure(
            {"class": "zoom" if self.zoom else "", "style": f"--Columns:{self.columns}"},
            E.div({"class": "legend"}, *keys),
            E.div({"class": "panels"}, *map(_panel_html, self.panels)),
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

        rows = math.ceil(len(self.panels) / self.columns)
        heights = [_height(panel) for panel in self.panels[:: self.columns]]
        with mpl.rc_context(STYLE), warnings.catch_warnings():  # type: ignore[arg-type]
            for message in HARMLESS:
                warnings.filterwarnings("ignore", message)
            figure = Figure(figsize=(COLUMN, sum(heights) + 0.4))
            axes = figure.subplots(
                rows, self.columns, squeeze=False, gridspec_kw={"height_ratios": heights}
            )
            for ax, panel in zip(axes.flat, self.panels, strict=False):
                draw_panel(ax, panel)
            for ax in axes.flat[len(self.panels) :]:
                ax.set_axis_off()
            axes[-1, 0].set_xlabel(self.x_label)
            found = [ax.get_legend_handles_labels() for ax in axes.flat]
            handles = {n: h for each in found for h, n in zip(*each, strict=True)}
            if handles:
                columns = min(len(handles), 3)
                figure.legend(handles.values(), handles, loc="outside lower center", ncols=columns)
            return dict(_rendered(figure, self.name))


def _height(panel: Panel) -> float:
    """Inches of a panel."""
    if panel.labels:
        return 0.5 + 0.16 * len(panel.labels)
    return 0.7 if panel.small else 1.4


def require_matplotlib() -> None:
    """Refuse figures where they cannot be drawn."""
    try:
        import matplotlib.figure  # noqa: F401
    except ImportError as error:
        raise MissingExtraError.of("matplotlib", "plot") from error


def draw_panel(ax: Any, panel: Panel) -> None:
    """Draw a panel on axes of matplotlib."""
    for each in panel.marks:
        mark = each.thinned()
        colour, width, dashes = LOOKS[mark.look]
        label = mark.name or None
        if mark.kind == "line":
            ax.plot(mark.x, mark.y, dashes, color=colour, linewidth=width, label=label)
        elif mark.kind == "dots":
            ax.plot(mark.x, mark.y, ".", color=colour, markersize=3, markeredgewidth=0, label=label)
        elif mark.kind == "band":
            ax.fill_between(mark.x, mark.y, mark.to, color=colour, alpha=0.25, lw=0, label=label)
        else:
            ax.hlines(mark.y, mark.x, mark.to, color=colour, linewidth=width, label=label)
    ax.set_title(shortened(panel.title, LONGEST), loc="left")
    for axis in panel.log:
        getattr(ax, f"set_{axis}scale")("log")
    if panel.equal:
        ax.set_aspect("equal", "datalim")
    if panel.labels:
        names = [shortened(name, LONGEST // 2) for name in panel.labels]
        ax.set_yticks(range(len(names)), names, fontsize=6)
        ax.set_ylim(len(names) - 0.5, -0.5)
    elif panel.y_limits is not None:
        ax.set_ylim(*panel.y_limits)


def _rendered(figure: Any, name: str) -> Iterator[tuple[str, bytes]]:
    for kind, options in (
        ("svg", {"metadata": {"Date": None}}),
        ("png", {"dpi": RESOLUTION, "metadata": {"Software": None}}),
    ):
        stream = io.BytesIO()
        figure.savefig(stream, format=kind, **options)
        yield f"{name}.{kind}", stream.getvalue()
        figure.set_layout_engine("none")  # laid out once


# As SVG.


def _panel_html(panel: Panel) -> HtmlElement:
    across, high = panel.limits()
    x_ticks = ticks(*across, log="x" in panel.log, count=3 if panel.equal else TICKS)
    y_ticks = ticks(*sorted(high), log="y" in panel.log, count=2 if panel.small else TICKS)
    if panel.labels:
        y_ticks = [(float(k), name) for k, name in enumerate(panel.labels)]
    x_scale = across[0], WIDE / (across[1] - across[0])
    y_scale = high[1], HIGH / (high[0] - high[1])
    grid = [f"M{(x - x_scale[0]) * x_scale[1]:.0f} 0v{HIGH}" for x, _ in x_ticks]
    grid += [f"M0 {(y - y_scale[0]) * y_scale[1]:.0f}h{WIDE}" for y, _ in y_ticks]
    svg = E.svg({"viewBox": f"0 0 {WIDE} {HIGH}", "preserveAspectRatio": "none"})
    svg.append(E.path({"class": "grid", "d": "".join(grid)}))
    for mark in panel.marks:
        path = _path(mark.thinned(), panel.log, x_scale, y_scale)
        drawn = E.path({"class": f"{mark.kind} {mark.look}", "d": path})
        if mark.name:
            drawn.append(E.title(mark.name))
        svg.append(drawn)
    kinds = {"small": panel.small, "equal": panel.equal, "named": bool(panel.labels)}
    classes = " ".join(["panel", *(kind for kind, given in kinds.items() if given)])
    ends = {f"data-{n}": f"{a:.9g} {b:.9g}" for n, (a, b) in (("x", across), ("y", high))}
    x_axis, y_axis = (
        [
            E.span({"style": f"{side}:{100 * (at - ends[0]) / (ends[1] - ends[0]):.2f}%"}, text)
            for at, text in marks
        ]
        for side, marks, ends in (("left", x_ticks, across), ("bottom", y_ticks, high))
    )
    return E.div(
        {"class": classes, "style": f"--Rows:{len(panel.labels)}", **ends},
        E.h4(panel.title),
        E.output(),
        E.div({"class": "up"}, *y_axis),
        E.div({"class": "plot"}, svg),
        E.div({"class": "across"}, *x_axis),
    )


def _path(mark: Mark, log: str, x_scale: Sequence[float], y_scale: Sequence[float]) -> str:
    def placed(values: FloatArray, scale: Sequence[float], axis: str) -> FloatArray:
        far = 1e6  # of what is far outside
        return np.clip((_scaled(values, axis in log) - scale[0]) * scale[1], -far, far)

    x, y = placed(mark.x, x_scale, "x"), placed(mark.y, y_scale, "y")
    known = np.isfinite(x) & np.isfinite(y)
    if mark.kind == "span":
        assert mark.to is not None
        ends = np.nan_to_num(placed(mark.to, x_scale, "x"), nan=WIDE)
        spans = zip(np.nan_to_num(x).tolist(), y.tolist(), ends.tolist(), strict=True)
        return "".join(f"M{a:.0f} {up:.0f}H{b:.0f}" for a, up, b in spans if math.isfinite(up))
    if mark.kind == "dots":
        dots = zip(x[known].tolist(), y[known].tolist(), strict=True)
        return "".join(f"M{a:.0f} {b:.0f}h0" for a, b in dots)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], known, [False]]).astype(int)))
    if mark.kind == "band":
        assert mark.to is not None
        to = placed(mark.to, y_scale, "y")
        loops = (
            (np.r_[x[a:b], x[a:b][::-1]], np.r_[y[a:b], to[a:b][::-1]])
            for a, b in edges.reshape(-1, 2).tolist()
        )
        return "".join(f"{_steps(*loop)}z" for loop in loops)
    return "".join(_steps(x[a:b], y[a:b]) for a, b in edges.reshape(-1, 2).tolist())


def _steps(x: FloatArray, y: FloatArray) -> str:
    """A line in whole numbers, from point to point."""
    points = np.stack([x, y], axis=1).round().astype(int)
    moves = np.diff(points, axis=0)
    start = f"M{points[0, 0]} {points[0, 1]}"
    return start + ("l" + " ".join(map(str, moves.ravel().tolist())) if len(moves) else "h0")


def _scaled(values: FloatArray, log: bool) -> FloatArray:
    if not log:
        return np.asarray(values, dtype=np.float64)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.log10(np.where(values > 0, values, np.nan)), dtype=np.float64)


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
