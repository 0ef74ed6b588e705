"""``loopid identify``: parameters of any robot from logged motion and force."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import typer

from loopid.cli.console import Json, Lock, Out, RobotFile, Tied, progress_bar, require_output, show
from loopid.errors import OptionError
from loopid.experiment import (
    DEFAULT_FRACTION,
    find_force_model,
    split_recordings,
)
from loopid.experiment import (
    identify as identify_recordings,
)
from loopid.files import write_files
from loopid.loading import load_mechanism
from loopid.logs import Recording, prepare_recording, read_log
from loopid.mechanism import Mechanism
from loopid.regressors import JointTerms
from loopid.report import identification_files, identification_record, identification_tables
from loopid.trajectories import LowPass

Paths = list[str]


def identify(
    file: RobotFile,
    logs: Annotated[
        Paths, typer.Argument(metavar="LOG...", help="CSV, NPZ, or a folder with a file a stream.")
    ],
    mapping: Annotated[
        str | None, typer.Option(metavar="YAML", help="Which columns are what, and their units.")
    ] = None,
    model: Annotated[
        str, typer.Option(help="gravity (slow motion) or full (all ten parameters a body).")
    ] = "gravity",
    terms: Annotated[
        str, typer.Option(help="Of every motor: Fc, Fv, Fo, Ia with commas between, or none.")
    ] = "Fc,Fv",
    estimator: Annotated[str, typer.Option(help="wls or ols.")] = "wls",
    cutoff: Annotated[
        float | None, typer.Option(help="Of the low-pass filter in Hz; a twentieth of the rate.")
    ] = None,
    train: Annotated[
        float, typer.Option(help="Part of each log's time that is fitted; the rest validates.")
    ] = DEFAULT_FRACTION,
    validate: Annotated[
        Paths | None, typer.Option(metavar="LOG", help="Validate on this log instead.")
    ] = None,
    friction_log: Annotated[
        Paths | None, typer.Option(metavar="LOG", help="Identify the terms from this log first.")
    ] = None,
    jobs: Annotated[
        int, typer.Option(metavar="N", help="Processes that compute the regressors.")
    ] = 1,
    out: Out = None,
    lock: Lock = None,
    tied: Tied = False,
    as_json: Json = False,
) -> None:
    """Identify base parameters and friction from logs, with their uncertainty."""
    require_output(out)
    if not 0 < train < 1:
        raise OptionError(f"--train must be between 0 and 1, not {train}")
    mechanism = load_mechanism(file, lock or (), tied=tied)
    joint_terms = _joint_terms(mechanism, terms)
    lowpass = None if cutoff is None else LowPass(cutoff)

    def recordings(paths: Sequence[str] | None) -> list[Recording]:
        return [_recording(mechanism, path, mapping, lowpass) for path in paths or ()]

    training: Sequence[Recording] = recordings(logs)
    validation: Sequence[Recording] = recordings(validate)
    if not validation:
        training, validation = split_recordings(training, train)
    with progress_bar("poses") as report:
        force_model = find_force_model(mechanism, model, joint_terms, progress=report)
    friction = recordings(friction_log)
    found = identify_recordings(force_model, training, validation, estimator, friction, jobs)
    if out is not None:
        write_files(out, identification_files(found))
    show(identification_record(found), identification_tables(found), as_json)


def _joint_terms(mechanism: Mechanism, terms: str) -> JointTerms | None:
    kinds = tuple(kind.strip() for kind in terms.split(",") if kind.strip())
    return None if kinds in ((), ("none",)) else JointTerms(mechanism.actuated, kinds)


def _recording(
    mechanism: Mechanism, path: str, mapping: str | None, lowpass: LowPass | None
) -> Recording:
    log = read_log(path, mechanism, mapping)
    with progress_bar(f"assembling {log.name}") as report:
        return prepare_recording(mechanism, log, lowpass or "default", progress=report)
