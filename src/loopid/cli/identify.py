"""``loopid identify``: parameters of any robot from logged motion and force."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import typer

from loopid import experiment
from loopid.cli.console import (
    Floating,
    FreeMimics,
    Json,
    Lock,
    Out,
    RobotFile,
    Tied,
    TERMS_HELP,
    loaded,
    progress_bar,
    require_output,
    show,
)
from loopid.errors import OptionError
from loopid.experiment import DEFAULT_FRACTION, find_force_model, split_recordings
from loopid.files import write_files
from loopid.logs import Recording, prepare_recording, read_log
from loopid.regressors import JointTerms
from loopid.report import identification_files, identification_record, identification_tables
from loopid.trajectories import LowPass

LOG_HELP = "CSV, NPZ, Parquet, HDF5, a ROS bag or MCAP file, or a folder with a file a stream."


def identify(
    file: RobotFile,
    logs: Annotated[list[str], typer.Argument(metavar="LOG...", help=LOG_HELP)],
    mapping: Annotated[
        str | None, typer.Option(metavar="YAML", help="Which columns are what, and their units.")
    ] = None,
    model: Annotated[
        str, typer.Option(help="gravity (slow motion) or full (all ten parameters a body).")
    ] = "gravity",
    terms: Annotated[
        str, typer.Option(help=TERMS_HELP)
    ] = "Fc,Fv,file",
    estimator: Annotated[
        str, typer.Option(help="wls, ols, huber, bisquare, iv (with --reference) or bayes.")
    ] = "wls",
    unidentifiable: Annotated[
        str,
        typer.Option(
            help="Of combinations that LOG does not excite: an error, or the robot file as prior."
        ),
    ] = "error",
    prior_deviation: Annotated[
        float | None,
        typer.Option(help="For bayes: of the robot file, relative to the parameters' sizes; 0.3."),
    ] = None,
    consistent: Annotated[
        str | None,
        typer.Option(
            metavar="KIND",
            help="Also fit physically consistent parameters: entropic, euclidean or riemannian.",
        ),
    ] = None,
    repair: Annotated[
        bool,
        typer.Option("--repair", help="Repair inconsistent bodies of the robot file for that."),
    ] = False,
    reference: Annotated[
        list[str] | None,
        typer.Option(
            metavar="LOG", help="For iv: commanded positions, one for each LOG, in order."
        ),
    ] = None,
    reference_mapping: Annotated[
        str | None, typer.Option(metavar="YAML", help="As --mapping, of the --reference logs.")
    ] = None,
    cutoff: Annotated[
        float | None, typer.Option(help="Of the low-pass filter in Hz; a twentieth of the rate.")
    ] = None,
    train: Annotated[
        float, typer.Option(help="Part of each log's time that is fitted; the rest validates.")
    ] = DEFAULT_FRACTION,
    validate: Annotated[
        list[str] | None, typer.Option(metavar="LOG", help="Validate on this log instead.")
    ] = None,
    friction_log: Annotated[
        list[str] | None,
        typer.Option(metavar="LOG", help="Identify the terms from this log first."),
    ] = None,
    jobs: Annotated[
        int, typer.Option(metavar="N", help="Processes that compute the regressors.")
    ] = 1,
    out: Out = None,
    lock: Lock = None,
    floating_base: Floating = False,
    free_mimics: FreeMimics = False,
    tied: Tied = False,
    as_json: Json = False,
) -> None:
    """Identify base parameters and friction from logs, with their uncertainty."""
    require_output(out)
    if not 0 < train < 1:
        raise OptionError(f"--train must be between 0 and 1, not {train}")
    mechanism = loaded(file, lock, floating_base, free_mimics, tied)
    joint_terms = JointTerms.of(mechanism, terms)
    lowpass = None if cutoff is None else LowPass(cutoff)

    def recordings(paths: Sequence[str] | None, columns: str | None = mapping) -> list[Recording]:
        found = []
        for path in paths or ():
            log = read_log(path, mechanism, columns)
            with progress_bar(f"assembling {log.name}") as report:
                found.append(
                    prepare_recording(mechanism, log, lowpass or "default", progress=report)
                )
        return found

    training: Sequence[Recording] = recordings(logs)
    validation: Sequence[Recording] = recordings(validate)
    if not validation:
        training, validation = split_recordings(training, train)
    references = [each.motion for each in recordings(reference, reference_mapping)]
    with progress_bar("poses") as report:
        force_model = find_force_model(mechanism, model, joint_terms, progress=report)
    found = experiment.identify(
        force_model,
        training,
        validation,
        estimator,
        recordings(friction_log),
        jobs,
        unidentifiable,
        references,
        prior_deviation,
        consistent,
        repair,
    )
    if out is not None:
        write_files(out, identification_files(found))
    show(identification_record(found), identification_tables(found), as_json)
