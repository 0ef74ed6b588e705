"""The command line: ``loopid`` and ``python -m loopid``.

A command parses, calls a public function and shows what it gives. It imports what it needs when it
runs: ``loopid check`` does not wait for the estimators.
"""

from __future__ import annotations

import io
import sys

import typer

from loopid.cli.logs import compare, export, identify, paper, payload, predict
from loopid.cli.robots import base, check, excite, motions, simulate, view
from loopid.cli.shell import Command

app = typer.Typer(no_args_is_help=True, pretty_exceptions_enable=False, rich_markup_mode=None)
for command in (
    check,
    base,
    view,
    motions,
    simulate,
    excite,
    identify,
    predict,
    payload,
    compare,
    export,
    paper,
):
    app.command(cls=Command)(command)


def _show_version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        typer.echo(f"loopid {version('loopid')}")
        raise typer.Exit


@app.callback()
def loopid(
    show_version: bool = typer.Option(
        False, "--version", callback=_show_version, is_eager=True, help="Show the version and exit."
    ),
) -> None:
    """Identify the dynamics of robots with closed kinematic loops."""


def main() -> None:
    """Run the command line."""
    if isinstance(sys.stdout, io.TextIOWrapper):  # names of files need not be text
        sys.stdout.reconfigure(errors="backslashreplace")
    app(prog_name="loopid")
