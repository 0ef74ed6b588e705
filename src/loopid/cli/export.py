"""``loopid export``: results for simulators, controllers and other programs."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated

import typer

from loopid.cli.console import (
    Floating,
    FreeMimics,
    Json,
    Lock,
    RobotFile,
    Tied,
    loaded,
    motor_terms,
    progress_bar,
    show,
)
from loopid.errors import OptionError
from loopid.export import (
    BaseValues,
    export_robot_file,
    force_model_of,
    read_fit,
    regressor_code,
    standard_parameters_of,
)


def export(
    file: RobotFile,
    fit: Annotated[
        str,
        typer.Argument(
            metavar="FIT",
            help="Saved fit: parameters.yaml of 'loopid identify --out', or base parameters.",
        ),
    ],
    robot: Annotated[
        str | None,
        typer.Option(
            "--urdf", "--mjcf", metavar="FILE", help="The robot's own file with new inertials."
        ),
    ] = None,
    yaml: Annotated[
        str | None, typer.Option(metavar="FILE", help="Base parameters and what they are.")
    ] = None,
    npz: Annotated[str | None, typer.Option(metavar="FILE", help="The same as arrays.")] = None,
    c: Annotated[
        str | None, typer.Option(metavar="DIR", help="C source of the regressor, and its values.")
    ] = None,
    name: Annotated[
        str | None, typer.Option(help="Of the C functions; the robot's by default.")
    ] = None,
    model: Annotated[
        str | None, typer.Option(help="gravity or full; what FIT says by default.")
    ] = None,
    terms: Annotated[
        str | None, typer.Option(help="Of every motor: Fc, Fv, Fo, Ia, or none; as in FIT.")
    ] = None,
    repair: Annotated[
        bool, typer.Option("--repair", help="Bodies that the robot file gets wrong are mended.")
    ] = False,
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="The robot's own file may be replaced.")
    ] = False,
    lock: Lock = None,
    floating_base: Floating = False,
    free_mimics: FreeMimics = False,
    tied: Tied = False,
    as_json: Json = False,
) -> None:
    """Write a robot file, base parameters or C source with what a fit has found."""
    wanted = (robot, yaml, npz, c)
    if all(place is None for place in wanted):
        raise OptionError("nothing to export: ask for --urdf, --mjcf, --yaml, --npz or --c")
    mechanism = loaded(file, lock, floating_base, free_mimics, tied)
    saved = read_fit(fit)
    if model is not None:
        saved = replace(saved, model=model)
    if terms is not None:
        saved = replace(saved, joint_terms=motor_terms(mechanism, terms))
    with progress_bar("poses") as report:
        force_model = force_model_of(saved, mechanism, progress=report)
    # All that may be refused comes before the first file is written.
    standard = None if robot is None else standard_parameters_of(saved, force_model, repair)
    code = None if c is None else regressor_code(force_model, name, saved.values)
    values = BaseValues.of(force_model, saved.values, saved.covariance)
    written = []
    if robot is not None and standard is not None:
        written.append(
            export_robot_file(mechanism, standard, robot, overwrite, force_model.base.parameters)
        )
    for place in (yaml, npz):
        if place is not None:
            written.append(values.save(place))
    if c is not None and code is not None:
        written += code.save(c)
    if as_json:
        show({"written": [str(place) for place in written]}, (), as_json)
    else:  # on lines of their own, whatever the width of the terminal
        typer.echo("\n".join(map(str, written)))
