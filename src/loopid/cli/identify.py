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
    loaded,
    motor_terms,
    progress_bar,
    require_output,
    show,
)
from loopid.errors import OptionError
from loopid.experiment import DEFAULT_FRACTION, find_force_model, split_recordings
from loopid.files import write_files
from loopid.logs import Recording, prepare_recording, read_log
from loopid.report import identification_files, identification_record, identification_tables
from loopid.trajectories import LowPass

Logs = Annotated[
    list[str],
    typer.Argument(
        metavar="LOG...",
        help="CSV, NPZ, Parquet, HDF5, a ROS bag or MCAP file, or a folder with a file a stream.",
    ),
]
Mapping = Annotated[
    str | None, typer.Option(metavar="YAML", help="Which columns are what, and their units.")
]
Model = Annotated[
    str, typer.Option(help="gravity (slow motion) or full (all ten parameters a body).")
]
Terms = Annotated[
    str, typer.Option(help="Of every motor: Fc, Fv, Fo, Ia with commas between, or none.")
]
EstimatorName = Annotated[
    str, typer.Option(help="wls, ols, huber, bisquare, iv (with --reference) or bayes.")
]
Unidentifiable = Annotated[
    str,
    typer.Option(
        help="Of combinations that LOG does not excite: an error, or the robot file as prior."
    ),
]
Deviation = Annotated[
    float | None,
    typer.Option(help="For bayes: of the robot file, relative to the parameters' sizes; 0.3."),
]
Consistent = Annotated[
    str | None,
    typer.Option(
        metavar="KIND",
        help="Also fit physically consistent parameters: entropic, euclidean or riemannian.",
    ),
]
Repair = Annotated[
    bool, typer.Option("--repair", help="Repair inconsistent bodies of the robot file for that.")
]
Reference = Annotated[
    list[str] | None,
    typer.Option(metavar="LOG", help="For iv: commanded positions, one for each LOG, in order."),
]
ReferenceMapping = Annotated[
    str | None, typer.Option(metavar="YAML", help="As --mapping, of the --reference logs.")
]
Cutoff = Annotated[
    float | None, typer.Option(help="Of the low-pass filter in Hz; a twentieth of the rate.")
]
Train = Annotated[
    float, typer.Option(help="Part of each log's time that is fitted; the rest validates.")
]
Validate = Annotated[
    list[str] | None, typer.Option(metavar="LOG", help="Validate on this log instead.")
]
FrictionLog = Annotated[
    list[str] | None, typer.Option(metavar="LOG", help="Identify the terms from this log first.")
]
Jobs = Annotated[int, typer.Option(metavar="N", help="Processes that compute the regressors.")]


def identify(
    file: RobotFile,
    logs: Logs,
    mapping: Mapping = None,
    model: Model = "gravity",
    terms: Terms = "Fc,Fv",
    estimator: EstimatorName = "wls",
    unidentifiable: Unidentifiable = "error",
    prior_deviation: Deviation = None,
    consistent: Consistent = None,
    repair: Repair = False,
    reference: Reference = None,
    reference_mapping: ReferenceMapping = None,
    cutoff: Cutoff = None,
    train: Train = DEFAULT_FRACTION,
    validate: Validate = None,
    friction_log: FrictionLog = None,
    jobs: Jobs = 1,
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
    joint_terms = motor_terms(mechanism, terms)
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
