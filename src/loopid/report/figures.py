"""One look for all figures: column width, colours that the colour-blind tell apart, SVG and PNG."""

from __future__ import annotations

import io
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, cast

from rich.cells import cell_len

from loopid.arguments import IntArray, spread_rows
from loopid.errors import MissingExtraError, one_line

if TYPE_CHECKING:
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure

# From the palette of Okabe and Ito.
BLUE, ORANGE, RED, GREY = "#0072B2", "#E69F00", "#D55E00", "#666666"
COLUMN = 3.5  # inches: the width of a column of a two-column page
RESOLUTION = 220  # dots per inch of the PNG
MOST_POINTS = 1500  # of a line: more than a column can show
STYLE: dict[str, Any] = {
    "font.size": 7.5,
    "axes.titlesize": 8,
    "axes.labelsize": 7.5,
    "legend.fontsize": 7,
    "legend.frameon": False,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#dddddd",
    "grid.linewidth": 0.5,
    "lines.linewidth": 1.0,
    "figure.constrained_layout.use": True,
    "svg.hashsalt": "loopid",
    "svg.fonttype": "path",
    "text.parse_math": False,  # names may hold anything
}
# Of figures with names that the font lacks, which are boxes there, or that leave no room.
HARMLESS = "Glyph .* missing from font", "constrained_layout not applied"
LONGEST = 50  # characters of a name that is drawn


def require_matplotlib() -> None:
    """Refuse figures where they cannot be drawn."""
    try:
        import matplotlib.figure  # noqa: F401
    except ImportError as error:
        raise MissingExtraError("matplotlib", "plot") from error


@contextmanager
def drawing(rows: int = 1, columns: int = 1, height: float = 1.6) -> Iterator[tuple[Any, Any]]:
    """A figure of column width with axes (rows, columns), in our style.

    Parameters
    ----------
    height : float
        Of each row, in inches.

    Raises
    ------
    MissingExtraError
        When matplotlib is not installed.
    """
    require_matplotlib()
    import matplotlib as mpl
    from matplotlib.figure import Figure

    with mpl.rc_context(cast(Any, STYLE)):
        figure = Figure(figsize=(COLUMN, height * rows))
        yield figure, figure.subplots(rows, columns, squeeze=False)


def rendered(figure: Figure, name: str) -> dict[str, bytes]:
    """The figure as ``name.svg`` and ``name.png``; the same bytes every time."""
    files = {}
    with warnings.catch_warnings():
        for message in HARMLESS:
            warnings.filterwarnings("ignore", message)
        for kind, options in (
            ("svg", {"metadata": {"Date": None}}),
            ("png", {"dpi": RESOLUTION, "metadata": {"Software": None}}),
        ):
            stream = io.BytesIO()
            figure.savefig(stream, format=kind, **options)
            files[f"{name}.{kind}"] = stream.getvalue()
            figure.set_layout_engine("none")  # laid out once
    return files


def drawn(name: str, longest: int = LONGEST) -> str:
    """A name as it is drawn: printable, its middle left out where it is too long."""
    line = one_line(name)
    width = cell_len(line)  # characters of some scripts are twice as wide
    half = longest * len(line) // max(2 * width, 1)
    return line if width <= longest else f"{line[:half]}…{line[-half:]}"


def thinned(count: int) -> IntArray:
    """Evenly spread samples, as many as a line can show."""
    return spread_rows(count, MOST_POINTS)


def plain_log_labels(axis: Axis, subdivisions: tuple[float, ...] = (1.0, 2.0, 5.0)) -> None:
    """Label a logarithmic axis with 1, 2, 5, 10, or others, in plain text."""
    from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

    axis.set_major_locator(LogLocator(subs=subdivisions))
    axis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axis.set_minor_formatter(NullFormatter())
