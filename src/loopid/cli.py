"""The command line: ``loopid`` and ``python -m loopid``, one function a command.

A command imports what it needs when it runs: ``loopid check`` does not wait for the estimators.
"""

from __future__ import annotations

import io
import os
import re
import signal
import sys
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from functools import partial, wraps
from importlib.metadata import version
from inspect import Parameter, Signature, signature
from math import inf
from pathlib import Path
from threading import current_thread, main_thread
from time import perf_counter
from typing import TYPE_CHECKING, Any, NoReturn

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table
from typer import Argument, Option

from loopid.errors import (
    AccuracyWarning,
    FileError,
    LoopidError,
    ModelWarning,
    OptionError,
    one_line,
    warn,
)
from loopid.files import (
    require_folder,
    require_other_file,
    write_file,
    write_files,
)

if TYPE_CHECKING:
    from loopid.identification.saved import SavedFit
    from loopid.logs.recording import Recording
    from loopid.observation import Observation
    from loopid.robot.mechanism import Mechanism

app = typer.Typer(
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)

FILE = Argument(..., metavar="FILE", help="Robot YAML or URDF, or a bundled robot's name.")
LOGS = Argument(
    ...,
    metavar="LOG...",
    help="CSV, NPZ, Parquet, HDF5, a ROS bag or MCAP file, or a folder with a file a stream.",
)
MOTIONS = Argument(None, metavar="MOTIONS", help="Motion YAML; by default the robot's bundled one.")
MODEL = Option("gravity", help="gravity (slow motion) or full (all ten parameters a body).")
TERMS = (
    "Of every motor, with commas between, as Fc,Fv,Fo; file: what the robot file gives of "
    "motors and passive joints; after semicolons of some joints: "
    '"Fc,Fv; elbow: Ks; passive: Fv"; none.'
)
FRICTION = "Fc,Fv,file"  # terms of identify by default
MAPPING = Option(None, metavar="YAML", help="Which columns of LOG are what, and their units.")
CUTOFF = Option(None, help="Of the low-pass filter in Hz; by default what the spectrum asks for.")
ROWS = Option(None, metavar="M:N", help="Rows of each LOG, as its file counts them from 1.")
REPAIR = Option(False, "--repair", help="Repair inconsistent bodies of the robot file first.")
JSON = Option(False, "--json", help="Print JSON instead of tables.")
OUT = Option(None, metavar="DIR", help="Write report, figures and results to a folder.")
LEAST_TIME = 0.01  # s, of a search when the limit is used
LONGEST, AGAIN = 1e6, 0.5  # s, of a limit that is kept, and until it is enforced again
AFTERWARDS = 0.35  # of the time before the search, kept for what comes after it: as of 181 bodies
Load = Callable[[], "Mechanism"]


def loaded(
    file: str = FILE,
    lock: list[str] | None = Option(
        None, metavar="JOINT", help="Lock a joint, or a turn such as ball.wz; repeatable."
    ),
    rounding: float | None = Option(
        None, help="Of the file's numbers, in m and rad: what closes within it is closed."
    ),
    snap: bool = Option(
        False,
        "--snap",
        help="Make axes parallel or meet, and lengths equal, that nearly are or do.",
    ),
    floating_base: bool = Option(False, "--floating-base", help="The URDF's root moves freely."),
    free_mimics: bool = Option(False, "--free-mimics", help="Mimicking joints move on their own."),
    tied: bool = Option(False, "--tied", help="Links declared identical share parameters."),
) -> Any:
    """The robot (``Mechanism``) that the options of a command ask for."""
    from loopid.loading.load import load_mechanism

    with progress_bar("robot"):
        return load_mechanism(
            file,
            lock or (),
            floating_base=floating_base,
            free_mimics=free_mimics,
            tied=tied,
            rounding=rounding,
            snap=snap,
        )


def of_robot(command: Callable[..., None]) -> Callable[..., None]:
    """Give a command the options of ``loaded`` in the place of its first parameter, ``load``."""
    file, *options = signature(loaded, eval_str=True).parameters.values()
    _, *own = signature(command, eval_str=True).parameters.values()

    @wraps(command)
    def run(**given: Any) -> None:
        command(partial(loaded, **{p.name: given.pop(p.name) for p in (file, *options)}), **given)

    parameters = [p.replace(kind=Parameter.KEYWORD_ONLY) for p in (file, *own, *options)]
    run.__dict__["__signature__"] = Signature(parameters)
    run.__annotations__ = {p.name: p.annotation for p in parameters}
    return run


@app.command()
@of_robot
def check(load: Load, as_json: bool = JSON) -> None:
    """Report joints, closures, mobility and distance to singularity."""
    from loopid.report.structure import (
        check_record,
        check_tables,
    )

    record = check_record(load())
    show(record, check_tables(record), as_json)


@app.command()
@of_robot
def base(
    load: Load,
    model: str = MODEL,
    search: str = Option("exact", help="exact, subgroup, exhaustive or qr."),
    terms: str = Option("none", help=TERMS),
    criterion: str = Option("nullspace", help="nullspace (cond V22) or regressor (cond W_B)."),
    samples: int | None = Option(None, help="Random closed poses; enough by default."),
    seed: int = Option(0, help="Of the random poses."),
    time_limit: float | None = Option(
        None, metavar="S", help="Of everything, in s, with the best so far; else 10 s of search."
    ),
    as_json: bool = JSON,
) -> None:
    """Find the base parameters and the best way of writing them."""
    from loopid.base_parameters.base import (
        BaseParameters,
        find_base_parameters,
        make_strategy,
    )
    from loopid.base_parameters.choice import ExhaustiveSearch
    from loopid.base_parameters.exact import (
        TIME_LIMIT,
        ExactSearch,
    )
    from loopid.base_parameters.structure import without_effect
    from loopid.kinematics.rounding import nearly_special
    from loopid.regressors.joint_terms import (
        JointTerms,
        warn_of_omitted,
    )
    from loopid.regressors.structural import structural_observation
    from loopid.report.structure import (
        base_record,
        base_tables,
    )

    began, passed = perf_counter(), f"the time limit of {time_limit or 0:g} s has passed"
    if time_limit is not None and not 0 < time_limit < inf:
        raise OptionError(f"--time-limit must be above 0 s and finite, not {time_limit:g}")
    strategy = make_strategy(search)
    with _time_limit(time_limit, f"{passed} before base parameters were chosen: allow more"):
        mechanism = load()
        joint_terms = JointTerms.of(mechanism, terms)
        warn_of_omitted(mechanism, joint_terms)
        with progress_bar("poses") as report:
            observation = structural_observation(
                mechanism, model, samples, seed, progress=report, joint_terms=joint_terms
            )
        left, found = TIME_LIMIT, list[BaseParameters]()
        if time_limit is not None:
            left = time_limit - (1 + AFTERWARDS) * (perf_counter() - began)
        with progress_bar("combinations") as report:
            alone = observation.motors_alone
            felt = [] if alone is None or without_effect(alone) else [alone]
            for each in (observation, *felt):
                if search == ExhaustiveSearch.name:
                    strategy = ExhaustiveSearch(progress=report)
                if search == ExactSearch.name:
                    strategy = ExactSearch(max(left, LEAST_TIME))
                found.append(find_base_parameters(each, strategy, criterion))
                left -= found[-1].search.seconds
    bases = found[0], found[1] if len(found) > 1 else None
    rest = None if time_limit is None else max(began + time_limit - perf_counter(), LEAST_TIME)
    record, missing = None, "lengths in coefficients are"
    try:
        with _time_limit(rest, passed), progress_bar("names"):
            record = base_record(mechanism, model, *bases)
            missing = "what --snap would change is"
            if not mechanism.options.get("snap") and (special := nearly_special(mechanism)):
                other, moved = special
                W = structural_observation(other, model, samples, seed, joint_terms=joint_terms)
                record["base_parameters_if_snapped"] = count = _count(W)
                if count and count != len(found[0]):
                    warn(
                        f"{mechanism.path}: geometry is nearly special: {len(bases[0])} base "
                        f"parameters as it is, {count} with --snap, {moved}",
                        AccuracyWarning,
                    )
    except LoopidError as reason:
        warn(f"{mechanism.path}: {reason}, so {missing} not told", AccuracyWarning)
        record = record or base_record(mechanism, model, *bases, with_lengths=False)
    show(record, base_tables(record), as_json)


def _count(observation: Observation) -> int | None:
    """Number of base parameters; None where it is not clear."""
    from loopid.base_parameters.base import find_base_parameters

    with suppress(LoopidError), warnings.catch_warnings():
        warnings.simplefilter("ignore", AccuracyWarning)
        return len(find_base_parameters(observation, "qr"))
    return None


@app.command()
@of_robot
def motions(
    load: Load,
    program: str | None = MOTIONS,
    rate: float = Option(20.0, help="Samples per second."),
    margin: float = Option(0.02, help="Least singularity measure."),
    as_json: bool = JSON,
) -> None:
    """Check motions against strokes, joint angles and distance to singularity."""
    from loopid.motion import joint_motion
    from loopid.motion.files import read_motion_program
    from loopid.motion.joints import review_motion
    from loopid.report.structure import (
        motions_record,
        motions_tables,
    )

    mechanism = load()
    planned, reviews = read_motion_program(program or mechanism.name), {}
    with progress_bar("motions") as report:
        for name in planned.motions:
            motion = joint_motion(mechanism, planned.motion(name, rate))
            reviews[name] = review_motion(mechanism, motion, margin)
            report(len(reviews), len(planned.motions))
    seconds = {name: plan.seconds for name, plan in planned.motions.items()}
    record = motions_record(mechanism.name, reviews, seconds)
    show(record, motions_tables(record), as_json)


@app.command()
@of_robot
def simulate(
    load: Load,
    program: str | None = MOTIONS,
    motion: str | None = Option(None, metavar="NAME", help="Of the file; its first by default."),
    out: str | None = Option(None, metavar="CSV", help="The log; on the terminal without it."),
    rate: float = Option(100.0, help="Samples per second."),
    noise: float = Option(0.0, help="Standard deviation of the forces, in N or N m."),
    encoder_step: float = Option(
        0.0, help="Resolution of the positions, in m or rad; 0 for exact ones."
    ),
    terms: str = Option(
        "none", help='As for identify with values: "Fc=60,Fv=900; elbow: Ks=12"; none at first.'
    ),
    cad_error: float = Option(
        0.0, help="How far, in parts, bodies are off the robot file's: 0.2 for 20 %."
    ),
    seed: int = Option(0, help="Of the noise and of the bodies."),
) -> None:
    """Write the log that a robot would give while it follows a motion, for trying identify."""
    from loopid.identification.saved import robot_files
    from loopid.motion import joint_motion
    from loopid.motion.files import read_motion_program
    from loopid.motion.simulation import (
        Noise,
        log_text,
        scaled_bodies,
        simulate_measurement,
    )
    from loopid.regressors.joint_terms import JointTerms

    mechanism = load()
    planned = read_motion_program(program or mechanism.name)
    name = motion if motion is not None else next(iter(planned.motions))
    moved = joint_motion(mechanism, planned.motion(name, rate))
    joint_terms, values = JointTerms.with_values(mechanism, terms)
    errors = Noise(gaussian=noise, encoder_step=encoder_step)
    bodies = scaled_bodies(mechanism, cad_error, seed)
    measured = simulate_measurement(mechanism, moved, errors, seed, bodies, joint_terms, values)
    text = log_text(mechanism, measured)
    if out is None:
        typer.echo(text, nl=False)
    else:
        require_other_file(out, *robot_files(mechanism), program or "")
        write_file(out, text)
        typer.echo(out)


@app.command()
@of_robot
def excite(
    load: Load,
    out: str | None = OUT,
    model: str = MODEL,
    terms: str = Option("none", help=TERMS),
    criterion: str = Option("D", help="D, A, E or condition."),
    shape: str = Option("fourier", help="fourier, spline, or poses to stand in (gravity)."),
    size: int | None = Option(None, help="Harmonics, waypoints or poses; enough by default."),
    duration: float | None = Option(None, help="In s; 20 for a gravity model, 10 for a full one."),
    rate: float = Option(100.0, help="Samples per second of the run."),
    coordinates: str = Option("joints", help="Design in joints or platform coordinates."),
    share: float = Option(1.0, help="Part of each limit that may be used."),
    limit: list[str] | None = Option(
        None, metavar="JOINT=LOW:HIGH", help="Range of a joint; repeatable."
    ),
    max_speed: list[str] | None = Option(
        None, metavar="[JOINT=]V", help="Of one joint or every motor; repeatable."
    ),
    max_acceleration: list[str] | None = Option(None, metavar="[JOINT=]A", help="As --max-speed."),
    max_force: list[str] | None = Option(None, metavar="[JOINT=]F", help="As --max-speed."),
    workspace: list[str] | None = Option(
        None, metavar="X=LOW:HIGH", help="Range of a platform coordinate; repeatable."
    ),
    margin: float | None = Option(
        None, help="Least singularity measure; 0.02, or what is possible."
    ),
    collisions: bool = Option(True, help="Links must not touch, by the URDF's collision geometry."),
    noise: list[str] | None = Option(
        None, metavar="[JOINT=]S", help="Standard deviation of the motors' forces; 1."
    ),
    after: list[str] | None = Option(None, metavar="LOG", help="Add to what this log tells."),
    mapping: str | None = MAPPING,
    wanted: list[str] | None = Option(
        None, "--for", metavar="PARAMETER", help="Excite this one; repeatable."
    ),
    payload: str | None = Option(None, metavar="LINK", help="Only its parameters are unknown."),
    time_limit: float = Option(60.0, help="Of the design, in s."),
    starts: int = Option(4, help="Random motions to begin with."),
    iterations: int | None = Option(
        None, help="Evaluations of each start; as many as the time allows."
    ),
    seed: int = Option(0, help="Of the random motions."),
    jobs: int = Option(1, metavar="N", help="Processes, for several starts."),
    solver: str | None = Option(None, help="ipopt, where it is installed, or slsqp."),
    as_json: bool = JSON,
) -> None:
    """Design a motion that excites the parameters, within what the robot can do.

    Ctrl-C keeps the best motion so far.
    """
    from loopid.excitation.design import design_excitation
    from loopid.excitation.limits import MotionLimits
    from loopid.regressors.joint_terms import JointTerms
    from loopid.report.excitation import (
        excitation_files,
        excitation_record,
        excitation_tables,
    )

    require_output(out)
    limits = MotionLimits(
        share,
        _ranges("--limit", limit),
        _sizes("--max-speed", max_speed),
        _sizes("--max-acceleration", max_acceleration),
        _sizes("--max-force", max_force),
        _ranges("--workspace", workspace),
        margin,
        collisions,
    )
    mechanism = load()
    recordings = prepared(mechanism, after, mapping)
    deviations = _sizes("--noise", noise)
    with progress_bar(criterion) as watch:
        found = design_excitation(
            mechanism,
            model,
            JointTerms.of(mechanism, terms),
            limits,
            criterion,
            shape,
            duration,
            size,
            coordinates,
            deviations or None,
            recordings,
            wanted or (),
            payload,
            rate,
            time_limit,
            starts,
            iterations,
            seed,
            jobs,
            solver,
            watch,
        )
    if out is not None:
        write_files(out, excitation_files(found))
    show(excitation_record(found), excitation_tables(found), as_json)


def _ranges(option: str, given: Sequence[str] | None) -> dict[str, tuple[float, float]]:
    """NAME=LOW:HIGH by name."""
    found = {}
    for text in given or ():
        name, _, ends = text.rpartition("=")
        low, colon, high = ends.partition(":")
        if not name or not colon:
            raise OptionError(f"{option} must be NAME=LOW:HIGH, not {text!r}")
        found[name] = (_number(option, text, low), _number(option, text, high))
    return found


def _sizes(option: str, given: Sequence[str] | None) -> dict[str, float]:
    """[NAME=]NUMBER by name, or by "all"."""
    parts = [(text, *text.rpartition("=")) for text in given or ()]
    return {name or "all": _number(option, text, number) for text, name, _, number in parts}


def _number(option: str, text: str, number: str) -> float:
    try:
        return float(number)
    except ValueError:
        raise OptionError(f"{option} must have numbers, not {text!r}") from None


@app.command()
@of_robot
def identify(
    load: Load,
    logs: list[str] = LOGS,
    mapping: str | None = MAPPING,
    model: str = MODEL,
    terms: str = Option(FRICTION, help=f"{TERMS[:-1]}; auto: what is enough on new data."),
    compare_terms: list[str] | None = Option(
        None, metavar="CHOICE", help="Judge these terms too, as of --terms; repeatable."
    ),
    estimator: str = Option("wls", help="wls, ols, bisquare, iv (with --reference) or bayes."),
    unidentifiable: str = Option(
        "error",
        help="Of combinations that LOG does not excite: an error, or the robot file as prior.",
    ),
    prior_deviation: float | None = Option(
        None, help="For bayes: of the robot file, relative to the parameters' sizes; 0.3."
    ),
    consistent: str | None = Option(
        None,
        metavar="KIND",
        help="Also fit physically consistent parameters: entropic, euclidean or riemannian.",
    ),
    repair: bool = REPAIR,
    reference: list[str] | None = Option(
        None, metavar="LOG", help="For iv: commanded positions, one for each LOG, in order."
    ),
    reference_mapping: str | None = Option(
        None, metavar="YAML", help="As --mapping, of the --reference logs."
    ),
    cutoff: float | None = CUTOFF,
    train: float = Option(
        0.6, help="Part of each log's moving samples that is fitted; the rest validates."
    ),
    validate: list[str] | None = Option(None, metavar="LOG", help="Validate on this log instead."),
    start: float = Option(0.0, "--from", metavar="S", help="Of each LOG, in s from its start."),
    end: float = Option(inf, "--to", metavar="S", help="Of each LOG, in s from its start."),
    rows: str | None = ROWS,
    friction_log: list[str] | None = Option(
        None, metavar="LOG", help="Identify the terms from this log first."
    ),
    jobs: int = Option(1, metavar="N", help="Processes that compute the regressors."),
    out: str | None = OUT,
    as_json: bool = JSON,
) -> None:
    """Identify base parameters and friction from logs, with their uncertainty."""
    from loopid.diagnosis.study import (
        StudyOptions,
        study_logs,
    )
    from loopid.identification.options import FitOptions
    from loopid.report.identify import (
        identification_files,
        identification_record,
        identification_tables,
    )

    if not 0 < train < 1:
        raise OptionError(f"--train must be between 0 and 1, not {train}")
    if not start < end:
        raise OptionError(f"--from must be before --to, not {start:g} and {end:g} s")
    fit = FitOptions(
        estimator=estimator,
        unidentifiable=unidentifiable,
        prior_deviation=prior_deviation,
        fraction=train,
        n_jobs=jobs,
    )
    options = StudyOptions(
        model=model,
        terms=terms,
        compared=tuple(compare_terms or ()),
        consistent=consistent,
        repair=repair,
        fit=fit,
    )
    mechanism = load()
    options.require_terms(mechanism)
    require_output(out, str(mechanism.path), mapping, *logs, *(validate or ()))
    if rows is not None and reference:
        raise OptionError("--rows would move LOG against its --reference: use --from and --to")
    runs = prepared(mechanism, logs, mapping, cutoff, rows)
    judging = prepared(mechanism, validate, mapping, cutoff)
    commanded = prepared(mechanism, reference, reference_mapping, cutoff)
    friction = prepared(mechanism, friction_log, mapping, cutoff)
    with progress_bar("poses") as report:
        found = study_logs(
            mechanism,
            [run.between(start, end) for run in runs],
            validation=judging or None,
            friction=friction,
            references=[each.motion for each in commanded],
            options=options,
            progress=report,
        )
    if out is not None:
        write_files(out, identification_files(found))
    show(identification_record(found), identification_tables(found), as_json)


@app.command()
def predict(
    fit: str = Argument(..., metavar="FIT", help="Saved fit of 'loopid identify'."),
    logs: list[str] = LOGS,
    robot: str | None = Option(
        None, metavar="FILE", help="Of the fit; by default where it was then."
    ),
    mapping: str | None = MAPPING,
    cutoff: float | None = CUTOFF,
    rows: str | None = ROWS,
    out: str | None = OUT,
    as_json: bool = JSON,
) -> None:
    """Compare the forces of logs with those that a saved fit gives for their motion."""
    from loopid.diagnosis.log_mistakes import warn_of_suspicions
    from loopid.identification.prediction import predict as predicted
    from loopid.identification.saved import read_fit
    from loopid.report.forces import (
        prediction_files,
        prediction_record,
        prediction_tables,
    )

    require_output(out)
    saved = read_fit(fit)
    mechanism = _robot_of(saved, robot)
    runs = prepared(mechanism, logs, mapping, cutoff, rows)
    warn_of_suspicions(mechanism, runs, saved.force_model.joint_terms)
    found = [predicted(saved, mechanism, run) for run in runs]
    if out is not None:
        write_files(out, prediction_files(mechanism, found))
    show(prediction_record(found), prediction_tables(found), as_json)


@app.command()
@of_robot
def payload(
    load: Load,
    link: str = Argument(..., metavar="LINK", help="That the payload is fixed to."),
    unloaded: list[str] = Option(..., metavar="LOG", help="Without it; repeatable."),
    loaded_log: list[str] = Option(..., "--loaded", metavar="LOG", help="With it; repeatable."),
    known_mass: float | None = Option(
        None, metavar="KG", help="Of the payload: then find the gains of the drives."
    ),
    centre: str = Option(
        "0,0,0", metavar="X,Y,Z", help="Of the known mass, in the link's frame in m."
    ),
    mapping: str | None = MAPPING,
    model: str = MODEL,
    terms: str = Option("Fc,Fv", help=TERMS),
    estimator: str = Option("wls", help="wls, ols or bisquare."),
    cutoff: float | None = CUTOFF,
    rows: str | None = ROWS,
    as_json: bool = JSON,
) -> None:
    """Identify a payload from logs without and with it, or drive gains from a known one."""
    import numpy as np

    from loopid.diagnosis.log_mistakes import warn_of_suspicions
    from loopid.diagnosis.payload import (
        drive_gains,
        identify_payload,
    )
    from loopid.identification.force_model import find_force_model
    from loopid.regressors.joint_terms import JointTerms
    from loopid.report.forces import (
        gains_record,
        gains_tables,
        payload_record,
        payload_tables,
    )

    mechanism = load()
    force_model = find_force_model(mechanism, model, JointTerms.of(mechanism, terms))
    light, heavy = (
        prepared(mechanism, each, mapping, cutoff, rows) for each in (unloaded, loaded_log)
    )
    warn_of_suspicions(mechanism, light, force_model.joint_terms)
    if known_mass is None:
        found = identify_payload(force_model, link, light, heavy, estimator)
        show(payload_record(found), payload_tables(found), as_json)
        return
    try:
        place = np.array([float(number) for number in centre.split(",")])
    except ValueError:
        raise OptionError(f"--centre must be three numbers X,Y,Z, not {centre!r}") from None
    gains = drive_gains(force_model, link, known_mass, place, light, heavy, estimator=estimator)
    show(gains_record(gains), gains_tables(gains), as_json)


@app.command()
def export(
    file: str = FILE,
    fit: str = Argument(
        ...,
        metavar="FIT",
        help="Saved fit: parameters.yaml or standard_parameters.yaml of 'loopid identify'.",
    ),
    robot: str | None = Option(
        None, "--urdf", "--mjcf", metavar="FILE", help="The robot's own file with new inertials."
    ),
    yaml: str | None = Option(None, metavar="FILE", help="The fit as YAML, or as JSON."),
    c: str | None = Option(None, metavar="DIR", help="C source of the regressor, and its values."),
    name: str | None = Option(None, help="Of the C functions; the robot's by default."),
    repair: bool = REPAIR,
    any_mass: bool = Option(
        False, "--any-mass", help="Bodies may be over three times as heavy as in the file."
    ),
    overwrite: bool = Option(
        False, "--overwrite", help="--urdf, --mjcf: the robot's own file is replaced."
    ),
    as_json: bool = JSON,
) -> None:
    """Write a robot file, base parameters or C source with what a fit has found.

    The robot is loaded as it was for the fit, and refused where it is another one.
    """
    from loopid.diagnosis.consistent import standard_parameters_of
    from loopid.export.c_code import regressor_code
    from loopid.export.robot_file import export_robot_file
    from loopid.identification.saved import (
        read_fit,
        robot_files,
    )
    from loopid.loading.load import load_mechanism
    from loopid.parameters import KINDS
    from loopid.robot.mechanism import shortened

    if all(place is None for place in (robot, yaml, c)):
        raise OptionError("nothing to export: ask for --urdf, --mjcf, --yaml or --c")
    saved = read_fit(fit)
    mechanism = load_mechanism(file, **dict(saved.robot.options))
    # All that may be refused comes before the first file is written.
    if yaml is not None:
        saved.content(yaml)
        require_other_file(yaml, fit, *robot_files(mechanism))
    model = saved.find_force_model(mechanism)
    standard = None
    if robot is not None:
        standard = standard_parameters_of(saved, model, repair=repair, any_mass=any_mass)
    code = None if c is None else regressor_code(model, name, saved.values)
    written = []
    if robot is not None and standard is not None:
        written.append(export_robot_file(mechanism, standard, robot, overwrite, saved.standard))
        terms = [p.label for p in saved.standard if p.kind not in KINDS]
        if terms:
            warn(f"{robot} gets new inertials, not {shortened(terms)} of the fit", ModelWarning)
    if yaml is not None:
        written.append(saved.save(yaml))
    if c is not None and code is not None:
        written += code.save(c)
    if as_json:
        show({"written": [str(place) for place in written]}, (), as_json)
    else:  # on lines of their own, whatever the width of the terminal
        typer.echo("\n".join(map(str, written)))


@app.command()
def paper(
    out: str | None = OUT,
    log: list[str] | None = Option(
        None, metavar="LOG", help="Of the real robot; a simulated stand-in without one."
    ),
    seed: int = Option(0, help="Of all noise."),
) -> None:
    """Reproduce the knee-rehabilitation paper: Tables I to V, figures 2 to 6."""
    from loopid.paper.page import (
        paper_files,
        paper_tables,
    )
    from loopid.paper.reproduction import reproduce_paper

    require_output(out)
    found = reproduce_paper(log or (), seed, progress_bar)
    if out is not None:
        write_files(out, paper_files(found))
    show({}, paper_tables(found), as_json=False)
    if not found.base.agrees:
        raise LoopidError("not every row of the paper's Table II was found")


def _robot_of(saved: SavedFit, file: str | None) -> Mechanism:
    """The robot of a fit, loaded as it was then."""
    from loopid.loading.description import bundled_robots
    from loopid.loading.load import load_mechanism

    options = dict(saved.robot.options)
    if file is not None:
        return load_mechanism(file, **options)
    try:
        return load_mechanism(saved.robot.path, **options)
    except FileError:
        if saved.robot.name in bundled_robots():
            return load_mechanism(saved.robot.name, **options)
        raise FileError(
            f"the robot of the fit, {saved.robot.name}, is no longer at {saved.robot.path}: give "
            "its file with --robot"
        ) from None


def prepared(
    mechanism: Mechanism,
    paths: Sequence[str] | None,
    mapping: str | None,
    cutoff: float | None = None,
    rows: str | None = None,
) -> list[Recording]:
    """Logs, read and made ready for identification."""
    from loopid.logs.log import read_log
    from loopid.logs.recording import prepare_recording
    from loopid.motion.filtering import LowPass

    lowpass = None if cutoff is None else LowPass(cutoff)
    chosen = None if rows is None else _row_range(rows)
    found = []
    for path in paths or ():
        log = read_log(path, mechanism, mapping, chosen)
        with progress_bar(f"assembling {log.name}") as report:
            found.append(prepare_recording(mechanism, log, lowpass or "default", progress=report))
    return found


def _row_range(text: str) -> tuple[int, int | None]:
    """First and last row of M:N, M: or :N."""
    found = re.fullmatch(r"(\d{1,9})?:(\d{1,9})?", text, re.ASCII)
    if found is None:
        raise OptionError(f"--rows must be M:N, such as 1000:5000 or 1000:, not {text!r}")
    first, last = found.groups()
    return int(first or 1), int(last) if last else None


def require_output(out: str | None, *inputs: str | None) -> None:
    """Refuse, before the work is done, a report that could not be drawn, or written safely."""
    if out is not None:
        from loopid.report.identify import RESULTS
        from loopid.report.look import require_matplotlib

        require_folder(out)
        require_matplotlib()
        for name in RESULTS:
            require_other_file(Path(out, name), *(given for given in inputs if given))


def show(record: dict[str, Any], tables: Iterable[Table], as_json: bool) -> None:
    """Print tables, or the record as JSON."""
    if as_json:
        from loopid.report.look import json_text

        typer.echo(json_text(record))
        return
    console = Console()
    for table in tables:
        console.print(table)


@contextmanager
def progress_bar(what: str) -> Iterator[Callable[..., None]]:
    """A progress bar on the terminal's error stream, gone when the work is done.

    It is moved by what is done of how much, and may show the best criterion so far.
    """
    console = Console(stderr=True)
    said = TextColumn("{task.description}", markup=False)
    columns = (said, BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    console.quiet = not console.is_terminal  # a hidden bar of rich before 15 ends with a blank line
    with Progress(*columns, console=console, transient=True, disable=console.quiet) as progress:
        task = progress.add_task(one_line(what), total=None)

        def report(done: float, total: float, best: float | None = None) -> None:
            text = one_line(what) if best is None else f"{one_line(what)} {best:.4g}"
            progress.update(task, completed=done, total=total, description=text)

        yield report


def _show_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"loopid {version('loopid')}")
        raise typer.Exit


@app.callback()
def loopid(
    show_version: bool = Option(
        False, "--version", callback=_show_version, is_eager=True, help="Show the version and exit."
    ),
) -> None:
    """Identify the dynamics of robots with closed kinematic loops."""


def main() -> None:
    """Run the command line; every refusal is one line and exit code 2."""
    warnings.showwarning = _show_warning
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:  # closed: a file of ours would be opened in its place
            _discard(name)
    if isinstance(sys.stdout, io.TextIOWrapper):  # names of files need not be text
        sys.stdout.reconfigure(errors="backslashreplace")
    try:
        with _interruptible():
            try:
                app(prog_name="loopid")
            finally:
                sys.stdout.flush()
    except LoopidError as error:
        _refuse(str(error))
    except MemoryError as error:
        _refuse(f"there is not enough memory: {error}")
    except BrokenPipeError:  # as of ``loopid ... | head``
        _discard("stdout")
        sys.exit(1)
    except OSError as error:
        if error.filename is not None:
            _refuse(f"{error.filename}: {error.strerror}")
        _discard("stdout")
        _refuse(f"cannot write the result to the standard output: {error.strerror}")
    except _InterruptedError:
        _say("loopid: interrupted")
        sys.exit(130)


class _OutOfTimeError(BaseException):
    """The end of a time limit; libraries pass it on."""


class _InterruptedError(BaseException):
    """Ctrl-C; libraries pass it on."""


@contextmanager
def _handled(number: int, failure: type[BaseException], once: bool = False) -> Iterator[None]:
    """Let a signal raise a failure; the second one ends the process, where it is for once."""

    def fail(*_: object) -> None:
        if once:
            signal.signal(number, signal.SIG_DFL)
        raise failure

    before = signal.signal(number, fail)
    try:
        yield
    finally:
        signal.signal(number, before)


@contextmanager
def _time_limit(seconds: float | None, reason: str) -> Iterator[None]:
    """What is inside ends after so many seconds, with the reason as error.

    Without the signals of POSIX, and outside of the main thread, there is no limit.
    """
    known = hasattr(signal, "setitimer") and current_thread() is main_thread()
    if seconds is None or not known:
        yield
        return
    try:
        with _handled(signal.SIGALRM, _OutOfTimeError):
            # Again and again, as an exception in a callback of a library may get lost.
            signal.setitimer(signal.ITIMER_REAL, min(seconds, LONGEST), AGAIN)
            try:
                yield
            finally:
                signal.setitimer(signal.ITIMER_REAL, 0)
    except _OutOfTimeError:
        raise LoopidError(reason) from None


def _interruptible() -> AbstractContextManager[None]:
    """Context in which Ctrl-C raises, unless it is ignored or for others to handle."""
    ours = signal.getsignal(signal.SIGINT) is signal.default_int_handler
    if ours and current_thread() is main_thread():
        return _handled(signal.SIGINT, _InterruptedError, once=True)
    return nullcontext()


def _show_warning(message: Warning | str, *_: Any, **__: Any) -> None:
    """One line, without the source line that Python adds."""
    _say(f"loopid: warning: {message}")


def _refuse(reason: str) -> NoReturn:
    _say(f"loopid: error: {reason}")
    sys.exit(2)


def _say(line: str) -> None:
    """Write a line to the error stream, if it takes any: results do not depend on it."""
    try:
        sys.stderr.write(f"{one_line(line)}\n")
        sys.stderr.flush()
    except OSError:
        _discard("stderr")


def _discard(name: str) -> None:
    """Let nothing more be written to a standard stream, not even what waits to be."""
    setattr(sys, name, Path(os.devnull).open("w", encoding="utf-8"))  # noqa: SIM115
