"""The command line: ``loopid check``, ``loopid base``, ``loopid paper``."""

from __future__ import annotations

import json
import os
import sys
import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Annotated, Any, TextIO

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from loopid.base_parameters import ExhaustiveSearch, SearchStrategy, find_base_parameters
from loopid.base_parameters.search import make_strategy
from loopid.errors import LoopidError
from loopid.loading import load_mechanism
from loopid.progress import Progress as Reporter
from loopid.regressors import structural_observation
from loopid.report import (
    base_record,
    base_tables,
    check_record,
    check_tables,
    compare_with_paper,
    paper_tables,
)

app = typer.Typer(
    help="Identify the dynamics of robots with closed kinematic loops.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)

RobotFile = Annotated[
    str, typer.Argument(metavar="FILE", help="Robot YAML or URDF, or a bundled robot's name.")
]
Lock = Annotated[
    list[str] | None, typer.Option(metavar="JOINT", help="Lock a joint; may be repeated.")
]
Json = Annotated[bool, typer.Option("--json", help="Print JSON instead of tables.")]


@app.command()
def check(file: RobotFile, lock: Lock = None, as_json: Json = False) -> None:
    """Report joints, closures, mobility and distance to singularity."""
    record = check_record(load_mechanism(file, lock=lock or ()))
    _show(record, check_tables(record), as_json)


@app.command()
def base(
    file: RobotFile,
    model: Annotated[str, typer.Option(help="gravity or full.")] = "gravity",
    search: Annotated[str, typer.Option(help="exact, subgroup, exhaustive or qr.")] = "exact",
    criterion: Annotated[
        str, typer.Option(help="nullspace (cond V22) or regressor (cond W_B).")
    ] = "nullspace",
    samples: Annotated[
        int | None, typer.Option(help="Random closed poses; enough by default.")
    ] = None,
    seed: Annotated[int, typer.Option(help="Of the random poses.")] = 0,
    lock: Lock = None,
    as_json: Json = False,
) -> None:
    """Find the base parameters and the best way of writing them."""
    strategy = make_strategy(search)
    mechanism = load_mechanism(file, lock=lock or ())
    with _progress("poses") as report:
        observation = structural_observation(mechanism, model, samples, seed, progress=report)
    with _progress("combinations") as report:
        found = find_base_parameters(observation, _with_progress(strategy, report), criterion)
    record = base_record(mechanism.name, model, found)
    _show(record, base_tables(record), as_json)


@app.command()
def paper() -> None:
    """Reproduce the knee-rehabilitation paper's base parameters, row by row."""
    comparison = compare_with_paper()
    _show({}, paper_tables(comparison), as_json=False)
    if not comparison.agrees:
        raise LoopidError("not every row of the paper's Table II was found")


def main() -> None:
    """Run the command line; every refusal is one line and exit code 2."""
    warnings.showwarning = _show_warning
    try:
        app()
    except LoopidError as error:
        Console(stderr=True, soft_wrap=True, highlight=False).print(
            f"loopid: error: {error}", markup=False
        )
        sys.exit(2)
    except KeyboardInterrupt:
        sys.exit(130)
    except BrokenPipeError:
        # The reader has seen enough; nothing may be flushed to it at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(141)


def _show(record: dict[str, Any], tables: Iterable[Table], as_json: bool) -> None:
    if as_json:
        typer.echo(json.dumps(record, indent=2, ensure_ascii=False))
        return
    console = Console()
    for table in tables:
        console.print(table)


def _show_warning(
    message: Warning | str,
    category: type[Warning],
    filename: str,
    lineno: int,
    file: TextIO | None = None,
    line: str | None = None,
) -> None:
    """One line, without the source line that Python adds."""
    sys.stderr.write(f"loopid: warning: {message}\n")


@contextmanager
def _progress(what: str) -> Iterator[Reporter]:
    """A progress bar on the terminal's error stream, gone when the work is done."""
    columns = (TextColumn(what), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    console = Console(stderr=True)
    hidden = not console.is_terminal
    with Progress(*columns, console=console, transient=True, disable=hidden) as progress:
        task = progress.add_task(what, total=None)
        yield lambda done, total: progress.update(task, completed=done, total=total)


def _with_progress(strategy: SearchStrategy, report: Reporter) -> SearchStrategy:
    return ExhaustiveSearch(progress=report) if strategy.name == "exhaustive" else strategy
