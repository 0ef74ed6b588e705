"""One look for all tables, in the terminal and as Markdown, for records as JSON, and for figures.

Names come from files of any origin: nothing in them may steer a terminal, be live on a page, or be
drawn as mathematics. Figures have column width and colours that the colour-blind tell apart.
"""

from __future__ import annotations

import io
import json
import math
import re
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from rich import box
from rich.cells import cell_len
from rich.table import Table
from rich.text import Text

from loopid.arguments import FloatArray, IntArray, spread_rows
from loopid.errors import MissingExtraError, one_line
from loopid.files import require_folder, require_other_file

if TYPE_CHECKING:
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure

    from loopid.robot.mechanism import Mechanism

# What Markdown or HTML may take for markup: written as entities, which never are.
MARKUP = re.compile(r"[&<>\[\]|\\`*~$]|(?<![^\W_])_+|_+(?![^\W_])|(?<=\w):(?=//)")
# From the palette of Okabe and Ito.
BLUE, ORANGE, RED, GREY = "#0072B2", "#E69F00", "#D55E00", "#666666"
THIN = {"color": GREY, "linewidth": 0.6}  # of what was measured
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


# Tables and records.


def plain_text(text: str, style: str = "") -> Text:
    """Text that is printed as it is, what is not printable but ends of lines as escapes."""
    return Text("\n".join(map(one_line, text.split("\n"))), style)


def plain_table(title: str, columns: Sequence[str], rows: Iterable[Iterable[object]]) -> Table:
    """A table whose cells are shown as they are; columns that begin with ``>`` are aligned right.

    Columns without names have no header.
    """
    headed = any(name.strip(">") for name in columns)
    table = Table(
        title=plain_text(title, "bold") if title else None,
        title_justify="left",
        box=box.SIMPLE_HEAD if headed else box.SIMPLE,
        show_header=headed,
    )
    for name in columns:
        side: Any = "right" if name[:1] == ">" else "left"
        table.add_column(name.removeprefix(">"), justify=side, overflow="fold")
    for row in rows:
        table.add_row(*(plain_text(str(cell)) for cell in row))
    return table


def facts(title: str, entries: Mapping[str, object]) -> Table:
    """A table of names and what is said of them."""
    return plain_table(title, ("", ""), entries.items())


def markdown_page(title: str, tables: Iterable[Table], captions: Mapping[str, str]) -> str:
    """Tables, then figures by the names of their files, as Markdown under a title."""
    parts = [f"# {markdown_text(title)}", "", *map(markdown_table, tables)]
    parts += [f"![{text}]({figure}.svg)\n\n{text}\n" for figure, text in captions.items()]
    return "\n".join(parts)


def markdown_table(table: Table) -> str:
    """A table as Markdown under its title."""
    columns = [[markdown_text(str(cell)) for cell in column.cells] for column in table.columns]
    head = [markdown_text(str(column.header)) for column in table.columns]
    rules = ["---:" if column.justify == "right" else "---" for column in table.columns]
    lines = [head, rules, *map(list, zip(*columns, strict=True))]
    body = "\n".join(f"| {' | '.join(line)} |" for line in lines)
    title = f"**{markdown_text(str(table.title))}**\n\n" if table.title else ""
    caption = f"\n{markdown_text(str(table.caption))}\n" if table.caption else ""
    return f"{title}{body}\n{caption}"


def markdown_text(text: str) -> str:
    """Text that Markdown shows as it is, on one line."""
    line = one_line(text.replace("\n", " "))
    return MARKUP.sub(lambda found: "".join(f"&#{ord(c)};" for c in found[0]), line)


def json_text(record: Any) -> str:
    """A record as JSON; what is not printable, such as a terminal's control codes, as escapes."""
    text = json.dumps(record, indent=2, ensure_ascii=False)
    return re.sub(
        r"[^\n -~]", lambda c: c[0] if c[0].isprintable() else json.dumps(c[0])[1:-1], text
    )


def json_fields(thing: object, *names: str) -> dict[str, Any]:
    """Attributes by name, ready for JSON."""
    return {name: json_value(getattr(thing, name)) for name in names}


def json_value(value: Any) -> Any:
    """Lists of numbers and texts; null for infinity and NaN, which JSON lacks."""
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if isinstance(value, list | tuple):
        return [json_value(each) for each in value]
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    return value


# Figures.


# Of identifications; a fit only where there is one.
RESULTS = ("report.md", "identification.json", "parameters.yaml", "all_parameters.yaml")


def require_report(folder: str | Path | None, *inputs: str | Path | None) -> None:
    """Refuse, before the work is done, a report that could not be drawn or written safely.

    No input may be one of the files that would be written to the folder.
    """
    if folder is not None:
        require_folder(folder)
        require_matplotlib()
        for name in RESULTS:
            require_other_file(Path(folder, name), *(given for given in inputs if given))


def require_matplotlib() -> None:
    """Refuse figures where they cannot be drawn."""
    try:
        import matplotlib.figure  # noqa: F401
    except ImportError as error:
        raise MissingExtraError.of("matplotlib", "plot") from error


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


def force_panels(
    figure: Figure,
    axes: Any,
    time: FloatArray,
    lines: Iterable[tuple[FloatArray, str, dict[str, Any]]],
    panels: Mapping[str, str],
    band: tuple[FloatArray, str | None] | None = None,
) -> None:
    """Forces over time, a panel each by its title and unit, with one legend.

    Lines are forces (N, k), a label and a style; a band of half width (N, k) is about the last.
    """
    for k, (ax, (title, unit)) in enumerate(zip(axes[:, 0], panels.items(), strict=True)):
        for force, label, style in lines:
            ax.plot(time, force[:, k], label=label, **style)
        if band is not None:
            ends = force[:, k] - band[0][:, k], force[:, k] + band[0][:, k]
            look = {"color": ax.lines[-1].get_color(), "alpha": 0.3, "linewidth": 0}
            ax.fill_between(time, *ends, label=band[1], **look)
        ax.set(title=title, ylabel=f"force ({unit})")
    axes[-1, 0].set_xlabel("time (s)")
    handles, labels = axes[0, 0].get_legend_handles_labels()
    columns = 2 if len(labels) == 4 else len(labels)
    figure.legend(handles, labels, loc="outside lower center", ncols=columns)


def force_unit(mechanism: Mechanism, joint: str) -> str:
    """Unit of a motor's force: N where it slides, N m where it turns."""
    return "N" if mechanism.velocity_indices([joint])[0] in mechanism.prismatic else "N m"


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
