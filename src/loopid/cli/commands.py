"""``loopid check``, ``base``, ``motions``, ``export`` and ``paper``."""

from __future__ import annotations

from typing import Annotated

import typer

from loopid.base_parameters import (
    TIME_LIMIT,
    ExactSearch,
    ExhaustiveSearch,
    find_base_parameters,
    make_strategy,
)
from loopid.cli.console import (
    Floating,
    FreeMimics,
    Json,
    Lock,
    Out,
    RobotFile,
    Tied,
    loaded,
    progress_bar,
    require_output,
    show,
)
from loopid.errors import LoopidError, OptionError
from loopid.export import export_robot_file, regressor_code
from loopid.files import write_files
from loopid.kinematics import DEFAULT_MARGIN
from loopid.loading import load_mechanism
from loopid.paper import paper_files, paper_tables, reproduce_paper
from loopid.regressors import JointTerms, structural_observation, warn_of_omitted
from loopid.report import (
    base_record,
    base_tables,
    check_record,
    check_tables,
    motions_record,
    motions_tables,
)
from loopid.robot import named_lengths
from loopid.saved import read_fit
from loopid.trajectories import joint_motion, read_motion_program, review_motion


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
    terms: Annotated[str, typer.Option(help=TERMS_HELP)] = "none",
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
    joint_terms = JointTerms.of(mechanism, terms)
    warn_of_omitted(mechanism, joint_terms)
    with progress_bar("poses") as report:
        observation = structural_observation(
            mechanism, model, samples, seed, progress=report, joint_terms=joint_terms
        )
    with progress_bar("combinations") as report:
        if search == ExhaustiveSearch.name:
            strategy = ExhaustiveSearch(progress=report)
        found = find_base_parameters(observation, strategy, criterion)
    record = base_record(mechanism.name, model, found, named_lengths(mechanism))
    show(record, base_tables(record), as_json)


def motions(
    file: RobotFile,
    program: Annotated[
        str | None,
        typer.Argument(metavar="MOTIONS", help="Motion YAML; by default the robot's bundled one."),
    ] = None,
    rate: Annotated[float, typer.Option(help="Samples per second.")] = 20.0,
    margin: Annotated[float, typer.Option(help="Least singularity measure.")] = DEFAULT_MARGIN,
    lock: Lock = None,
    floating_base: Floating = False,
    free_mimics: FreeMimics = False,
    as_json: Json = False,
) -> None:
    """Check motions against strokes, joint angles and distance to singularity."""
    mechanism = loaded(file, lock, floating_base, free_mimics)
    planned, reviews = read_motion_program(program or mechanism.name), {}
    with progress_bar("motions") as report:
        for name in planned.motions:
            motion = joint_motion(mechanism, planned.motion(name, rate))
            reviews[name] = review_motion(mechanism, motion, margin)
            report(len(reviews), len(planned.motions))
    seconds = {name: plan.seconds for name, plan in planned.motions.items()}
    record = motions_record(mechanism.name, reviews, seconds)
    show(record, motions_tables(record), as_json)


def export(
    file: RobotFile,
    fit: Annotated[
        str,
        typer.Argument(
            metavar="FIT",
            help="Saved fit: parameters.yaml or standard_parameters.yaml of 'loopid identify'.",
        ),
    ],
    robot: Annotated[
        str | None,
        typer.Option(
            "--urdf", "--mjcf", metavar="FILE", help="The robot's own file with new inertials."
        ),
    ] = None,
    yaml: Annotated[str | None, typer.Option(metavar="FILE", help="The fit as YAML.")] = None,
    npz: Annotated[str | None, typer.Option(metavar="FILE", help="The fit as arrays.")] = None,
    c: Annotated[
        str | None, typer.Option(metavar="DIR", help="C source of the regressor, and its values.")
    ] = None,
    name: Annotated[
        str | None, typer.Option(help="Of the C functions; the robot's by default.")
    ] = None,
    repair: Annotated[
        bool,
        typer.Option("--repair", help="Repair bodies of the robot file that are not consistent."),
    ] = False,
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="The robot's own file may be replaced.")
    ] = False,
    as_json: Json = False,
) -> None:
    """Write a robot file, base parameters or C source with what a fit has found.

    The robot is loaded as it was for the fit, and refused where it is another one.
    """
    if all(place is None for place in (robot, yaml, npz, c)):
        raise OptionError("nothing to export: ask for --urdf, --mjcf, --yaml, --npz or --c")
    saved = read_fit(fit)
    mechanism = load_mechanism(file, **dict(saved.robot.options))
    model = saved.find_force_model(mechanism)
    # All that may be refused comes before the first file is written.
    standard = None if robot is None else saved.find_standard_parameters(model, repair)
    code = None if c is None else regressor_code(model, name, saved.values)
    written = []
    if robot is not None and standard is not None:
        written.append(export_robot_file(mechanism, standard, robot, overwrite, saved.standard))
    written += [saved.save(place) for place in (yaml, npz) if place is not None]
    if c is not None and code is not None:
        written += code.save(c)
    if as_json:
        show({"written": [str(place) for place in written]}, (), as_json)
    else:  # on lines of their own, whatever the width of the terminal
        typer.echo("\n".join(map(str, written)))


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
