"""The command line, one file a command."""

from __future__ import annotations

import sys
import warnings

import typer
from rich.console import Console

from loopid.cli.console import escape_odd_names, show_warning
from loopid.cli.export import export
from loopid.cli.identify import identify
from loopid.cli.motions import motions
from loopid.cli.paper import paper
from loopid.cli.structure import base, check
from loopid.errors import LoopidError

app = typer.Typer(
    help="Identify the dynamics of robots with closed kinematic loops.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
for command in (check, base, motions, identify, export, paper):
    app.command()(command)


def main() -> None:
    """Run the command line; every refusal is one line and exit code 2."""
    warnings.showwarning = show_warning
    escape_odd_names()
    try:
        app()
    except LoopidError as error:
        _refuse(str(error))
    except MemoryError as error:
        _refuse(f"there is not enough memory: {error}")
    except KeyboardInterrupt:
        sys.exit(130)


def _refuse(reason: str) -> None:
    console = Console(stderr=True, soft_wrap=True, highlight=False)
    console.print(f"loopid: error: {reason}", markup=False)
    sys.exit(2)
