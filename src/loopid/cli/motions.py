"""``loopid motions``: may a robot run the motions of a file."""

from __future__ import annotations

from typing import Annotated

import typer

from loopid.cli.console import (
    Floating,
    FreeMimics,
    Json,
    Lock,
    RobotFile,
    loaded,
    progress_bar,
    show,
)
from loopid.kinematics import DEFAULT_MARGIN
from loopid.report import motions_record, motions_tables
from loopid.trajectories import joint_motion, read_motion_program, review_motion


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
    planned = read_motion_program(program or mechanism.name)
    reviews = {}
    with progress_bar("motions") as report:
        for name in planned.motions:
            motion = joint_motion(mechanism, planned.motion(name, rate))
            reviews[name] = review_motion(mechanism, motion, margin)
            report(len(reviews), len(planned.motions))
    seconds = {name: plan.seconds for name, plan in planned.motions.items()}
    record = motions_record(mechanism.name, reviews, seconds)
    show(record, motions_tables(record), as_json)
