"""``loopid simulate`` and ``loopid predict``: a log from a robot file, forces from a fit."""

from __future__ import annotations

from typing import Annotated

import numpy as np
import typer

from loopid.cli.console import Json, Out, RobotFile, loaded, progress_bar, require_output, show
from loopid.cli.identify import LOG_HELP
from loopid.errors import MissingFileError, OptionError
from loopid.files import write_file, write_files
from loopid.loading import bundled_robots, load_mechanism
from loopid.logs import prepare_recording, read_log
from loopid.prediction import predict as predicted
from loopid.regressors import JointTerms
from loopid.report import prediction_files, prediction_record, prediction_tables
from loopid.robot import Mechanism
from loopid.saved import SavedFit, read_fit
from loopid.simulation import Noise, log_text, scaled_bodies, simulate_measurement
from loopid.trajectories import LowPass, joint_motion, read_motion_program


def simulate(
    file: RobotFile,
    program: Annotated[
        str | None,
        typer.Argument(metavar="MOTIONS", help="Motion YAML; by default the robot's bundled one."),
    ] = None,
    motion: Annotated[
        str | None, typer.Option(metavar="NAME", help="Of the file; its first by default.")
    ] = None,
    out: Annotated[
        str | None, typer.Option(metavar="CSV", help="The log; on the terminal without it.")
    ] = None,
    rate: Annotated[float, typer.Option(help="Samples per second.")] = 100.0,
    noise: Annotated[
        float, typer.Option(help="Standard deviation of the forces, in N or N m.")
    ] = 0.0,
    encoder_step: Annotated[
        float, typer.Option(help="Resolution of the positions, in m or rad; 0 for exact ones.")
    ] = 0.0,
    terms: Annotated[
        str, typer.Option(help="Of every motor with their values, as Fc=60,Fv=900; none at first.")
    ] = "none",
    cad_error: Annotated[
        float,
        typer.Option(help="How far, in parts, bodies are off the robot file's: 0.2 for 20 %."),
    ] = 0.0,
    seed: Annotated[int, typer.Option(help="Of the noise and of the bodies.")] = 0,
) -> None:
    """Write the log that a robot would give while it follows a motion, for trying identify."""
    mechanism = loaded(file, None, False, False)
    planned = read_motion_program(program or mechanism.name)
    name = motion if motion is not None else next(iter(planned.motions))
    moved = joint_motion(mechanism, planned.motion(name, rate))
    kinds = _term_values(terms)
    joint_terms = JointTerms(mechanism.actuated, tuple(kinds)) if kinds else None
    values = np.tile(list(kinds.values()), len(mechanism.actuated)) if kinds else None
    errors = Noise(gaussian=noise, encoder_step=encoder_step)
    bodies = scaled_bodies(mechanism, cad_error, seed)
    measured = simulate_measurement(mechanism, moved, errors, seed, bodies, joint_terms, values)
    text = log_text(mechanism, measured)
    if out is None:
        typer.echo(text, nl=False)
    else:
        write_file(out, text)
        typer.echo(out)


def _term_values(terms: str) -> dict[str, float]:
    """Values of joint terms by their kinds, from ``Fc=60,Fv=900``."""
    values: dict[str, float] = {}
    for part in terms.split(",") if terms not in ("", "none") else ():
        kind, _, number = (piece.strip() for piece in part.partition("="))
        try:
            values[kind] = float(number)
        except ValueError:
            raise OptionError(
                f"--terms must be kinds with values, such as Fc=60,Fv=900, not {terms!r}"
            ) from None
    return values


def predict(
    fit: Annotated[str, typer.Argument(metavar="FIT", help="Saved fit of 'loopid identify'.")],
    logs: Annotated[list[str], typer.Argument(metavar="LOG...", help=LOG_HELP)],
    robot: Annotated[
        str | None,
        typer.Option(metavar="FILE", help="Of the fit; by default where it was then."),
    ] = None,
    mapping: Annotated[
        str | None, typer.Option(metavar="YAML", help="Which columns are what, and their units.")
    ] = None,
    cutoff: Annotated[
        float | None, typer.Option(help="Of the low-pass filter in Hz; as for identify.")
    ] = None,
    out: Out = None,
    as_json: Json = False,
) -> None:
    """Compare the forces of logs with those that a saved fit gives for their motion."""
    require_output(out)
    saved = read_fit(fit)
    mechanism = _robot_of(saved, robot)
    found = []
    for path in logs:
        log = read_log(path, mechanism, mapping)
        with progress_bar(f"assembling {log.name}") as report:
            lowpass = "default" if cutoff is None else LowPass(cutoff)
            recording = prepare_recording(mechanism, log, lowpass, progress=report)
        found.append(predicted(saved, mechanism, recording))
    if out is not None:
        write_files(out, prediction_files(mechanism, found))
    show(prediction_record(found), prediction_tables(found), as_json)


def _robot_of(saved: SavedFit, file: str | None) -> Mechanism:
    """The robot of a fit, loaded as it was then."""
    options = dict(saved.robot.options)
    if file is not None:
        return load_mechanism(file, **options)
    try:
        return load_mechanism(saved.robot.path, **options)
    except MissingFileError:
        if saved.robot.name in bundled_robots():
            return load_mechanism(saved.robot.name, **options)
        raise MissingFileError(
            f"the robot of the fit, {saved.robot.name}, is no longer at {saved.robot.path}: give "
            "its file with --robot"
        ) from None
