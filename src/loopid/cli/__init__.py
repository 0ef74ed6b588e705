"""The command line: ``loopid`` and ``python -m loopid``.

A command parses, calls a public function and shows what it gives. It imports what it needs when it
runs: ``loopid check`` does not wait for the estimators.
"""

from __future__ import annotations

import io
import os
import sys

import typer

from loopid.cli.logs import compare, export, identify, paper, payload, predict
from loopid.cli.robots import base, check, excite, init, motions, schema, simulate, view
from loopid.cli.shell import Command, say

app = typer.Typer(no_args_is_help=True, pretty_exceptions_enable=False, rich_markup_mode=None)
# Each with an example, in the order of the work.
for command, example in {
    init: "loopid init leg.urdf run.csv",
    schema: "loopid schema robot > robot.schema.json",
    check: "loopid check leg.yaml --lock ankle=0.1",
    base: "loopid base leg.yaml --model full --terms Fc,Fv --out base",
    view: "loopid view leg.yaml run.csv found/parameters.yaml",
    motions: "loopid motions 3ups_rpu",
    simulate: "loopid simulate leg.yaml motion/motion.yaml --noise 0.05 --out run.csv",
    excite: "loopid excite leg.yaml --model full --max-speed 2 --out motion",
    identify: "loopid identify leg.yaml run.csv --mapping run.yaml --out found",
    predict: "loopid predict found/parameters.yaml other.csv",
    payload: "loopid payload leg.yaml shank --unloaded run.csv --loaded loaded.csv",
    compare: "loopid compare found again",
    export: "loopid export leg.yaml found/parameters.yaml --urdf new.urdf --c controller",
    paper: "loopid paper --out out",
}.items():
    app.command(cls=Command, epilog=f"Example: {example}")(command)


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
    try:
        app(prog_name="loopid")
    except OSError as error:  # of commands and of help; typer ends ``loopid ... | head`` itself
        if error.filename is None:  # what waits to be written is lost
            os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        say(f"error: {error.filename or 'standard output'}: {error.strerror}")
        sys.exit(2)
