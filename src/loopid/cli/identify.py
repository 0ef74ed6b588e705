"""``loopid identify``: parameters of any robot from logged motion and force."""

from __future__ import annotations

from collections.abc import Sequence

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
from loopid.cli.identify_options import (
    Consistent,
    Cutoff,
    Deviation,
    EstimatorName,
    FrictionLog,
    Jobs,
    Logs,
    Mapping,
    Model,
    OnDark,
    Reference,
    ReferenceMapping,
    Repair,
    Terms,
    Train,
    Validate,
)
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
from loopid.logs import Recording, prepare_recording, read_log
from loopid.report import identification_files, identification_record, identification_tables
from loopid.robot import Mechanism
from loopid.trajectories import LowPass


def identify(
    file: RobotFile,
    logs: Logs,
    mapping: Mapping = None,
    model: Model = "gravity",
    terms: Terms = "Fc,Fv",
    estimator: EstimatorName = "wls",
    on_dark: OnDark = "refuse",
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
        return [_recording(mechanism, path, columns, lowpass) for path in paths or ()]

    training: Sequence[Recording] = recordings(logs)
    validation: Sequence[Recording] = recordings(validate)
    if not validation:
        training, validation = split_recordings(training, train)
    references = [each.motion for each in recordings(reference, reference_mapping)]
    with progress_bar("poses") as report:
        force_model = find_force_model(mechanism, model, joint_terms, progress=report)
    friction = recordings(friction_log)
    data = training, validation, estimator, friction, jobs, on_dark, references
    found = identify_recordings(force_model, *data, prior_deviation, consistent, repair)
    if out is not None:
        write_files(out, identification_files(found))
    show(identification_record(found), identification_tables(found), as_json)


def _recording(
    mechanism: Mechanism, path: str, mapping: str | None, lowpass: LowPass | None
) -> Recording:
    log = read_log(path, mechanism, mapping)
    with progress_bar(f"assembling {log.name}") as report:
        return prepare_recording(mechanism, log, lowpass or "default", progress=report)
