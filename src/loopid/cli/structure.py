"""``loopid check`` and ``loopid base``: what a robot's structure lets be known."""

from __future__ import annotations

from typing import Annotated

import typer

from loopid.base_parameters import ExhaustiveSearch, SearchStrategy, find_base_parameters
from loopid.base_parameters.search import make_strategy
from loopid.cli.console import Json, Lock, RobotFile, progress_bar, show
from loopid.loading import load_mechanism
from loopid.progress import Progress as Reporter
from loopid.regressors import structural_observation
from loopid.report import base_record, base_tables, check_record, check_tables


def check(file: RobotFile, lock: Lock = None, as_json: Json = False) -> None:
    """Report joints, closures, mobility and distance to singularity."""
    record = check_record(load_mechanism(file, lock=lock or ()))
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
    lock: Lock = None,
    as_json: Json = False,
) -> None:
    """Find the base parameters and the best way of writing them."""
    strategy = make_strategy(search)
    mechanism = load_mechanism(file, lock=lock or ())
    with progress_bar("poses") as report:
        observation = structural_observation(mechanism, model, samples, seed, progress=report)
    with progress_bar("combinations") as report:
        found = find_base_parameters(observation, _with_progress(strategy, report), criterion)
    record = base_record(mechanism.name, model, found)
    show(record, base_tables(record), as_json)


def _with_progress(strategy: SearchStrategy, report: Reporter) -> SearchStrategy:
    return ExhaustiveSearch(progress=report) if strategy.name == "exhaustive" else strategy
