"""The command line: ``loopid`` and ``python -m loopid``."""

from __future__ import annotations

import io
import sys
import warnings
from importlib.metadata import version
from typing import Annotated, Any

import typer
from rich.console import Console

from loopid.cli.commands import base, check, export, motions, paper
from loopid.cli.identify import identify
from loopid.cli.runs import predict, simulate
from loopid.errors import LoopidError, one_line

app = typer.Typer(
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
for command in (check, base, motions, simulate, identify, predict, export, paper):
    app.command()(command)


def _show_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"loopid {version('loopid')}")
        raise typer.Exit


@app.callback()
def loopid(
    show_version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_show_version, is_eager=True, help="Show the version and exit."
        ),
    ] = False,
) -> None:
    """Identify the dynamics of robots with closed kinematic loops."""


def main() -> None:
    """Run the command line; every refusal is one line and exit code 2."""
    warnings.showwarning = _show_warning
    if isinstance(sys.stdout, io.TextIOWrapper):  # names of files need not be text
        sys.stdout.reconfigure(errors="backslashreplace")
    try:
        app(prog_name="loopid")
    except LoopidError as error:
        _refuse(str(error))
    except MemoryError as error:
        _refuse(f"there is not enough memory: {error}")
    except KeyboardInterrupt:
        sys.exit(130)


def _show_warning(message: Warning | str, *_: Any, **__: Any) -> None:
    """One line, without the source line that Python adds."""
    sys.stderr.write(f"loopid: warning: {one_line(str(message))}\n")


def _refuse(reason: str) -> None:
    console = Console(stderr=True, soft_wrap=True, highlight=False)
    console.print(f"loopid: error: {reason}", markup=False)
    sys.exit(2)
