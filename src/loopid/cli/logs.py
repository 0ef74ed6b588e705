"""Commands on logs, and on what was found from them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer
from typer import Argument, Option

from loopid.cli import completion
from loopid.cli.advice import command_with
from loopid.cli.robots import (
    FILE,
    LOGGED_MODEL,
    MAPPINGS,
    TERMS,
    mapping_of_each,
    numbers,
    of_robot,
    recordings,
)
from loopid.cli.shell import Answer, with_options
from loopid.errors import LoopidError, OptionError
from loopid.files import require_folder, require_other_file, write_file
from loopid.progress import progress_bar

if TYPE_CHECKING:
    from loopid.identification.identification import Identification
    from loopid.identification.log_mistakes import LogFaults
    from loopid.identification.result import Fit
    from loopid.logs.recording import Recording
    from loopid.report.page import Report
    from loopid.robot.robot import Robot

LOGS = Argument(
    ...,
    metavar="LOG...",
    help="CSV, NPZ, Parquet, HDF5, a ROS bag or MCAP file, or a folder with a file a stream.",
)
CUTOFF = Option(
    None, help="Cut-off of the low-pass filter in Hz; by default where estimates change least."
)
AUTOMATIC_TERMS = Option(
    "auto",
    help=f"{TERMS[:-1]}; auto: the usual ones, and what LOG needs.",
    autocompletion=completion.terms,
)
SAVED = "Fit that 'loopid identify' saved, or its folder."
FIT = Argument(..., metavar="FIT", help=SAVED)
ESTIMATORS = completion.words_of("identification.estimator:ESTIMATORS")
ROWS = Option(None, metavar="M:N", help="Rows of each LOG to use, counted from 1.")


@of_robot
def identify(
    robot: Robot,
    answer: Answer,
    logs: list[str] = LOGS,
    mapping: list[str] | None = MAPPINGS,
    model: str = LOGGED_MODEL,
    terms: str = AUTOMATIC_TERMS,
    estimator: str = Option(
        "wls", help="wls, ols, bisquare or iv (with --reference).", autocompletion=ESTIMATORS
    ),
    unidentifiable: str = Option(
        "prior", help="Unexcited parameters: keep the robot file's values (prior), or an error."
    ),
    reference: list[str] | None = Option(
        None,
        metavar="LOG",
        help="For iv: commanded positions, one for each LOG, in order; forces are not needed.",
    ),
    cutoff: float | None = CUTOFF,
    fraction: float | None = Option(
        None, "--train", help="Part of each log that is fitted; the rest validates."
    ),
    validate: list[str] | None = Option(None, metavar="LOG", help="Validate on this log instead."),
    start: float = Option(
        0.0, "--from", metavar="S", help="Use each LOG from here on, in s from its start."
    ),
    end: float = Option(inf, "--to", metavar="S", help="Use each LOG up to here."),
    rows: str | None = ROWS,
    friction_log: list[str] | None = Option(
        None, metavar="LOG", help="Identify the terms from this log first."
    ),
    undo_delay: bool = Option(
        True, "--undo-delay/--keep-delay", help="Whether a clear delay of the forces is undone."
    ),
    anyway: bool = Option(False, "--anyway", help="Save a fit that is absurd, too."),
    n_jobs: int = Option(1, "--jobs", metavar="N", help="Processes that compute the regressors."),
) -> None:
    """Identify parameters and friction from logs."""
    from loopid.identification.options import FitOptions
    from loopid.identification.pipeline import identify as identified
    from loopid.logs.reading import locked_as_logged
    from loopid.report.identify import identification_report

    options = FitOptions(
        model=model,
        terms=terms,
        estimator=estimator,
        unidentifiable=unidentifiable,
        fraction=fraction,
        undo_delay=undo_delay,
        n_jobs=n_jobs,
    )
    options.require_terms(robot)
    answer.require(robot.path, *(mapping or ()), *logs, *(validate or ()))
    of_logs, *others = mapping_of_each(
        mapping, logs=logs, validate=validate, reference=reference, friction_log=friction_log
    )
    if rows is not None and reference:
        raise OptionError("--rows would move LOG against its --reference: use --from and --to")
    loaded, robot = robot, locked_as_logged(robot, logs[0], mapping=of_logs[0])
    runs = recordings(robot, logs, of_logs, cutoff, rows)
    judging = recordings(robot, validate, others[0], cutoff)
    commanded = recordings(robot, reference, others[1], cutoff, forces=False)
    friction = recordings(robot, friction_log, others[2], cutoff)
    found = identified(
        robot,
        [run.between(start, end) for run in runs],
        validation=judging or None,
        friction=friction,
        references=[run.motion for run in commanded],
        options=options,
    )
    command = excite_command(found, loaded, logs, of_logs if len({*of_logs}) > 1 else of_logs[:1])
    answer.show(identification_report(found, command, anyway=anyway))


MOST_WANTED = 5  # parameters that a command names; of more, the motion is for all


def excite_command(
    found: Identification, robot: Robot, logs: Sequence[str], mappings: Sequence[str | None] = ()
) -> str:
    """``loopid excite`` for a robot as it was loaded, and what the logs determine badly.

    What the logs lack is locked by ``--after``.
    """
    model = found.force_model.plain  # what the evidence weighs is no aim of a motion
    terms, excite = model.joint_terms, found.verdict.excite
    wanted = excite if len(excite) <= MOST_WANTED else ()
    options: dict[str, Any] = {"model": model.model, "terms": terms and terms.choice(model.robot)}
    options |= {"mapping": list(mappings), "after": list(logs), "for": wanted}
    return command_with("excite", robot, "--out", "motion", **options)


@with_options(answer=Answer)
def predict(
    answer: Answer,
    fit: str = FIT,
    logs: list[str] = LOGS,
    robot: str | None = Option(
        None, metavar="FILE", help="The fit's robot; by default where it was then."
    ),
    mapping: list[str] | None = MAPPINGS,
    cutoff: float | None = Option(
        None,
        help="Cut-off of the low-pass filter in Hz; by default that of the fit, or what the log's "
        "rate allows.",
    ),
    rows: str | None = ROWS,
) -> None:
    """Predict the forces of logs with a saved fit."""
    from loopid.identification.log_mistakes import log_faults_by_log
    from loopid.identification.result import fit_file, load_fit
    from loopid.report.forces import prediction_report

    answer.require(fit_file(fit), *(mapping or ()), *logs)
    (mappings,) = mapping_of_each(mapping, logs=logs)
    saved = load_fit(fit, robot=robot)
    runs = recordings(saved.robot, logs, mappings, cutoff, rows)
    suspected = log_faults_by_log(saved.robot, runs, saved.require_model().joint_terms)
    found = saved.predict(runs)
    command = command_with("export", saved.robot, fit, "--c", "controller", loaded=False)
    answer.show(_vetoed(prediction_report(saved.robot, found), suspected), command)


@of_robot
def payload(
    robot: Robot,
    answer: Answer,
    link: str = Argument(
        ...,
        metavar="LINK",
        help="Link that the payload is fixed to.",
        autocompletion=completion.links,
    ),
    unloaded: list[str] = Option(..., metavar="LOG", help="Log without it; repeatable."),
    loaded_log: list[str] = Option(..., "--loaded", metavar="LOG", help="Log with it; repeatable."),
    known_mass: float | None = Option(
        None, metavar="KG", help="Mass of a known payload: find the drives' gains."
    ),
    centre: str | None = Option(
        None,
        metavar="X,Y,Z",
        help="Of the known mass, in the link's frame in m, where it is known.",
    ),
    write_mapping: str | None = Option(
        None, metavar="YAML", help="With --known-mass: a mapping that has the gains."
    ),
    mapping: list[str] | None = MAPPINGS,
    model: str = LOGGED_MODEL,
    terms: str = AUTOMATIC_TERMS,
    estimator: str = Option("wls", help="wls, ols or bisquare.", autocompletion=ESTIMATORS),
    cutoff: float | None = CUTOFF,
    rows: str | None = ROWS,
) -> None:
    """Identify a payload, or the drives' gains by a known one."""
    from loopid.diagnosis.gains import KnownLoad, drive_gains
    from loopid.diagnosis.payload import identify_payload
    from loopid.identification.force_models import force_model
    from loopid.identification.log_mistakes import log_faults_by_log
    from loopid.identification.model_choice import chosen_model
    from loopid.logs.reading import locked_as_logged
    from loopid.report.forces import gains_report, payload_report

    inputs = [*filter(None, (robot.path, *(mapping or ()), *unloaded, *loaded_log))]
    of_unloaded, of_loaded = mapping_of_each(mapping, unloaded=unloaded, loaded=loaded_log)
    _require_gains(answer, inputs, known_mass, centre, write_mapping)
    robot = locked_as_logged(robot, unloaded[0], mapping=of_unloaded[0])
    runs: dict[str, Sequence[Recording]] = {
        "unloaded": recordings(robot, unloaded, of_unloaded, cutoff, rows),
        "loaded": recordings(robot, loaded_log, of_loaded, cutoff, rows),
    }
    fitted = force_model(
        robot, chosen_model(robot, model, [*runs["unloaded"], *runs["loaded"]]), terms
    )
    if known_mass is None:
        report = payload_report(
            robot, identify_payload(fitted, link=link, **runs, estimator=estimator)
        )
    else:
        load = KnownLoad(known_mass, None if centre is None else numbers(centre, "--centre", 3))
        gains = drive_gains(fitted, link=link, load=load, **runs, estimator=estimator)
        if write_mapping is not None:
            write_file(write_mapping, gains.mapping(of_unloaded[0]).content)
        report = gains_report(robot, gains)
    answer.show(_vetoed(report, log_faults_by_log(robot, runs["unloaded"], fitted.joint_terms)))


def _require_gains(
    answer: Answer,
    inputs: Sequence[Path | str],
    known_mass: float | None,
    centre: str | None,
    mapping: str | None,
) -> None:
    """Refuse options of gains without a mass, and results in the place of an input."""
    answer.require(*inputs)
    if known_mass is None and (centre or mapping):
        given = "--centre" if centre else "--write-mapping"
        raise OptionError(f"{given} is for gains: say the mass of the payload, --known-mass KG")
    if mapping is not None:
        require_other_file(mapping, *inputs)


def _vetoed(report: Report, suspected: Sequence[LogFaults]) -> Report:
    """The report with what is suspected of the logs, and the first mistake as its verdict."""
    found = tuple(each for one in suspected for each in one.findings)
    mistake = next((each for each in found if each.severity == "mistake"), None)
    return replace(
        report,
        findings=(*found, *report.findings),
        verdict=report.verdict if mistake is None else mistake.veto,
    )


def export(
    file: str = FILE,
    fit: str = FIT,
    robot: str | None = Option(
        None,
        "--urdf",
        "--mjcf",
        metavar="FILE",
        help="The robot's own file with inertials and joint terms.",
    ),
    yaml: str | None = Option(None, metavar="FILE", help="The fit as YAML, or as JSON."),
    c: str | None = Option(
        None, metavar="DIR", help="C source for the controller, with the values."
    ),
    name: str | None = Option(None, help="Prefix of the C functions; the robot's name by default."),
    overwrite: bool = Option(
        False, "--overwrite", help="--urdf, --mjcf: the robot's own file is replaced."
    ),
    anyway: bool = Option(False, "--anyway", help="Write a fit that is not fit for use, too."),
    as_json: bool = Option(False, "--json", help="Print JSON instead of text."),
) -> None:
    """Write a fit as a robot file, YAML or C source.

    The robot is loaded as it was for the fit, and refused where it is another one.
    """
    from loopid.identification.result import fit_file, load_fit
    from loopid.loading.files import own_files
    from loopid.report.look import json_text

    if robot is yaml is c is None:
        raise OptionError("nothing to export: give --urdf, --mjcf or --yaml FILE, or --c DIR")
    saved = load_fit(fit, robot=file)
    if yaml is not None:
        require_other_file(yaml, fit_file(fit), *own_files(saved.robot))
    written = _exported(saved, robot, yaml, c, name=name, overwrite=overwrite, anyway=anyway)
    places = [str(place) for place in written]
    if as_json:
        typer.echo(json_text({"schema": "loopid export 1", "written": places}))
    else:  # on lines of their own, whatever the width of the terminal
        typer.echo("\n".join(places))


def _exported(
    fit: Fit,
    robot: str | None,
    yaml: str | None,
    c: str | None,
    *,
    name: str | None,
    overwrite: bool,
    anyway: bool,
) -> list[Path]:
    """Write a fit; all that may be refused is found out before the first file is written."""
    from loopid.export.c_code import c_source
    from loopid.identification.plausibility import require_fit_for_use

    require_fit_for_use(fit, anyway)
    if yaml is not None:
        fit.content(yaml, anyway=anyway)
    code = None if c is None else c_source(fit.require_model(), name=name, values=fit.values)
    folders = [Path(each).parent for each in (robot, yaml) if each is not None]
    for folder in [*folders, *([] if c is None else [Path(c)])]:
        require_folder(folder)
    written = list[Path]()
    if robot is not None:
        loaded = fit.to_robot_file(robot, overwrite=overwrite, anyway=anyway)
        written += dict.fromkeys([Path(robot), loaded])
    if yaml is not None:
        written.append(fit.save(yaml, anyway=anyway))
    if code is not None and c is not None:
        written += code.save(c)
    return written


@with_options(answer=Answer)
def compare(
    answer: Answer,
    runs: list[str] = Argument(..., metavar="FIT...", help=f"{SAVED[:-1]}; two or more."),
) -> None:
    """Show which parameters of saved fits differ."""
    from loopid.identification.result import fit_file
    from loopid.identification.saved import FitFile
    from loopid.report.compare import comparison_report

    answer.require(*runs)
    files = [fit_file(run) for run in runs]
    twice = next((run for k, run in enumerate(runs) if files[k] in files[:k]), None)
    if twice is not None:
        raise OptionError(f"{twice} is given twice: compare different fits", given=twice)
    named = ((each.parent if each.name == "parameters.yaml" else each) for each in files)
    names = [each.name or each.resolve().name for each in named]  # "." has none
    fits = map(FitFile.read, files)
    known = dict(zip(names if len({*names}) == len(names) else runs, fits, strict=True))
    answer.show(comparison_report(known))


@with_options(answer=Answer)
def paper(
    answer: Answer,
    log: list[str] | None = Option(
        None, metavar="LOG", help="A log of the real robot; without, one is simulated."
    ),
    seed: int = Option(0, help="Seed of all noise."),
) -> None:
    """Reproduce the paper's tables and figures."""
    from loopid.paper.page import paper_report
    from loopid.paper.reproduction import reproduce_paper

    answer.require(*(log or ()))
    found = reproduce_paper(log or (), seed, progress_bar)
    answer.show(paper_report(found))
    if not found.base.agrees:
        raise LoopidError("not every row of the paper's Table II was found")
