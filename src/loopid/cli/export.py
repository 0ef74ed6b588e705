"""``loopid export``: results for simulators, controllers and other programs."""

from __future__ import annotations

from typing import Annotated

import typer

from loopid.cli.console import Json, RobotFile, show
from loopid.errors import OptionError
from loopid.export import export_robot_file, regressor_code
from loopid.loading import load_mechanism
from loopid.saved import read_fit


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
