"""What the commands share: options, tables or JSON, progress bars."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from loopid.errors import one_line
from loopid.files import require_folder
from loopid.loading import load_mechanism
from loopid.progress import Progress as Reporter
from loopid.report import json_text, require_matplotlib
from loopid.robot import Mechanism

RobotFile = Annotated[
    str, typer.Argument(metavar="FILE", help="Robot YAML or URDF, or a bundled robot's name.")
]
Lock = Annotated[
    list[str] | None,
    typer.Option(metavar="JOINT", help="Lock a joint, or a turn such as ball.wz; repeatable."),
]
Floating = Annotated[bool, typer.Option("--floating-base", help="The URDF's root moves freely.")]
FreeMimics = Annotated[
    bool, typer.Option("--free-mimics", help="Mimicking joints move on their own.")
]
Tied = Annotated[bool, typer.Option("--tied", help="Links declared identical share parameters.")]
Json = Annotated[bool, typer.Option("--json", help="Print JSON instead of tables.")]
Out = Annotated[
    str | None, typer.Option(metavar="DIR", help="Write report, figures and results to a folder.")
]


def loaded(
    file: str, lock: list[str] | None, floating_base: bool, free_mimics: bool, tied: bool = False
) -> Mechanism:
    """The robot that the options of a command ask for."""
    return load_mechanism(
        file, lock or (), floating_base=floating_base, free_mimics=free_mimics, tied=tied
    )


def require_output(out: str | None) -> None:
    """Refuse, before the work is done, a report that could not be drawn or written."""
    if out is not None:
        require_folder(out)
        require_matplotlib()


def show(record: dict[str, Any], tables: Iterable[Table], as_json: bool) -> None:
    """Print tables, or the record as JSON."""
    if as_json:
        typer.echo(json_text(record))
        return
    console = Console()
    for table in tables:
        console.print(table)


@contextmanager
def progress_bar(what: str) -> Iterator[Reporter]:
    """A progress bar on the terminal's error stream, gone when the work is done."""
    console = Console(stderr=True)
    if not console.is_terminal:
        yield lambda done, total: None
        return
    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=console, transient=True) as progress:
        task = progress.add_task(one_line(what), total=None)
        yield lambda done, total: progress.update(task, completed=done, total=total)
