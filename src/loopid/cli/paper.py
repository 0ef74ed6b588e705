"""``loopid paper``: the paper's tables and figures, beside what it prints."""

from __future__ import annotations

from typing import Annotated

import typer

from loopid.cli.console import Out, progress_bar, require_output, show
from loopid.errors import LoopidError
from loopid.files import write_files
from loopid.paper import reproduce_paper
from loopid.report import paper_files, paper_tables


def paper(
    out: Out = None,
    log: Annotated[
        list[str] | None,
        typer.Option(metavar="LOG", help="Of the real robot; a simulated stand-in without one."),
    ] = None,
    seed: Annotated[int, typer.Option(help="Of all noise.")] = 0,
) -> None:
    """Reproduce the knee-rehabilitation paper: Tables I to V, figures 2 to 6."""
    require_output(out)
    found = reproduce_paper(log or (), seed, progress_bar)
    if out is not None:
        write_files(out, paper_files(found))
    show({}, paper_tables(found), as_json=False)
    if not found.base.agrees:
        raise LoopidError("not every row of the paper's Table II was found")
