"""``loopid check`` and ``loopid base``: what a robot's structure lets be known."""

from __future__ import annotations

from typing import Annotated

import typer

from loopid.base_parameters import (
    ExactSearch,
    ExhaustiveSearch,
    SearchStrategy,
    find_base_parameters,
)
from loopid.base_parameters.search import make_strategy
from loopid.base_parameters.search.exact import TIME_LIMIT
from loopid.cli.console import (
    Floating,
    FreeMimics,
    Json,
    Lock,
    RobotFile,
    Tied,
    loaded,
    progress_bar,
    show,
)
from loopid.progress import Progress as Reporter
from loopid.regressors import structural_observation
from loopid.report import base_record, base_tables, check_record, check_tables
from loopid.robot import named_lengths


def check(
    file: RobotFile,
    lock: Lock = None,
    floating_base: Floating = False,
    free_mimics: FreeMimics = False,
    as_json: Json = False,
) -> None:
    """Report joints, closures, mobility and distance to singularity."""
    mechanism = loaded(file, lock, floating_base, free_mimics)
    record = check_record(mechanism)
    show(record, check_tables(record), as_json)


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
    time_limit: Annotated[
        float, typer.Option(help="Of the exact search, in s; then its best so far.")
    ] = TIME_LIMIT,
    lock: Lock = None,
    floating_base: Floating = False,
    free_mimics: FreeMimics = False,
    tied: Tied = False,
    as_json: Json = False,
) -> None:
    """Find the base parameters and the best way of writing them."""
    strategy = ExactSearch(time_limit) if search == ExactSearch.name else make_strategy(search)
    mechanism = loaded(file, lock, floating_base, free_mimics, tied)
    with progress_bar("poses") as report:
        observation = structural_observation(mechanism, model, samples, seed, progress=report)
    with progress_bar("combinations") as report:
        found = find_base_parameters(observation, _with_progress(strategy, report), criterion)
    record = base_record(mechanism.name, model, found, named_lengths(mechanism))
    show(record, base_tables(record), as_json)


def _with_progress(strategy: SearchStrategy, report: Reporter) -> SearchStrategy:
    return ExhaustiveSearch(progress=report) if strategy.name == "exhaustive" else strategy
