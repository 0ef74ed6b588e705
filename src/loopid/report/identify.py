"""The report of ``loopid identify``: card, findings, charts, tables and files."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from rich.table import Table

from loopid.arguments import checked
from loopid.errors import DataWarning, OptionError, counted, warn
from loopid.identification.candidate import Candidate
from loopid.identification.identification import Identification
from loopid.identification.information import WeakDirection
from loopid.identification.outcome import ROUGH
from loopid.identification.plausibility import require_sane
from loopid.identification.prediction import Prediction, reach_of
from loopid.identification.result import RECOMMENDED
from loopid.identification.saved import as_file
from loopid.identification.unseen import WHERE
from loopid.identification.verdict import GOOD, NOT_FIT, Verdict
from loopid.logs.recording import Recording
from loopid.numbers import interval, number, root, with_error
from loopid.parameters import KINDS
from loopid.plots import identified as charts
from loopid.plots.pictures import alone, forces_chart
from loopid.plots.structure import robot_chart
from loopid.records import json_value
from loopid.report.look import json_fields, plain_table, table_of
from loopid.report.page import Card, Figure, Part, Report, Section, Tone

# Values that the terminal shows where there are more than twice as many, or sums among them.
SHOWN = 14
OPEN = 20  # values of a table that is not folded
USES = "forces", "single_parameters"
ROBOT = "name", "value", "standard_error", "interval", "unit", "determined"
BESIDE = "fit", "all_parameters", "robot", "identifiability", "expressions"
TONES: dict[str, Tone] = {"yes": "good", "roughly": "rough", "no": "bad"}  # of uses
WORDS = {"yes": "Fit", "roughly": "Rough", "no": "Not fit"}


@checked
def identification_report(
    found: Identification, command: str = "", *, anyway: bool = False
) -> Report:
    """What an identification found; the command designs the motion that its verdict names.

    Without a file of the recommended fit where that breaks a law, unless forced.

    Parameters
    ----------
    found : Identification
    command : str
        That designs the motion which the verdict names.
    anyway : bool
        Write a fit that breaks a law, too.

    Returns
    -------
    Report

    Examples
    --------
    >>> import loopid
    >>> robot = loopid.load("five_bar")
    >>> found = loopid.identify(robot, "urdf/logs/five_bar.csv")
    >>> loopid.report.identification_report(found).name
    'identification'
    """
    judged, robot, rows = found.verdict, found.force_model.robot, list[tuple[str, ...]]()
    for each in alone(found.fit):
        assumed = each.name in found.fit.assumed  # as in the robot file
        value, error = with_error(each.value, 0.0 if assumed else each.standard_error)
        rows.append((each.name, value, "= file" if error == "-" else f"± {error}", each.unit))
    if len(rows) > 2 * SHOWN or any(" more" in row[0] for row in rows):
        left = len(rows) - SHOWN
        rows[SHOWN:] = [(f"... and {left} more in the report", "", "", "")] if left > 0 else []
    advice = command if judged.excite else ""
    return Report(
        name="identification",
        title=f"{robot.name}, {found.force_model.model} model",
        verdict=str(judged),
        record=lambda: identification_record(found, judged),
        brief=[plain_table("", ("", ">", "", ""), rows)],
        sections=lambda: list(_sections(found, judged.motor)),
        results=lambda data: _fits(found, data, anyway),
        advice=advice,
        card=_card(found, judged, advice),
        pictures=lambda: (robot_chart(robot, worst=judged.motor),),
        under=_under(found),
        findings=found.findings,
        checks=found.checks,
        beside=BESIDE,
    )


def _under(found: Identification) -> str:
    """What was fitted, in a line."""
    said = [
        f"{run.name}, {run.motion.time[-1] - run.motion.time[0]:.3g} s, {len(run):,} samples"
        for run in found.training
    ]
    if found.cutoff is not None:
        said.append(f"filtered at {found.cutoff.chosen:.3g} Hz")
    others = "each segment judged by fits to the others"
    judged = "judged on other data" if found.validation else others
    return "; ".join([*said, judged])


def _card(found: Identification, judged: Verdict, command: str) -> Card:
    """The verdict as it is seen."""
    tone, told, sure = TONES[judged.forces], found.identifiability, judged.mistake is None
    (ratio, spread), mistakes = root(*judged.ratio), len(found.mistakes)
    change = f"{100 * (ratio - 1):+.0f} %".replace("-", "−")
    more = f"± {number(100 * spread, 1)} %" if spread > 1e-4 else ""  # no errors of round-off
    use = judged.use.removeprefix(NOT_FIT).removeprefix("Fit").removeprefix(" for rough")
    error = f"of its force: largest error on new data ({judged.motor}{WHERE[judged.where]})"
    better, of_all = "combinations known better than by the robot file", told.structural_rank
    warnings = sum(each.severity == "warning" for each in found.findings)
    suspected = f"{'mistake' if mistakes == 1 else 'mistakes'} suspected; "
    suspected += counted(warnings, "warning") if warnings else "no warning"
    gauge, percent = (judged.error, GOOD, ROUGH), f"{number(100 * judged.error, 2)} %"
    alone = "yes" if judged.single_parameters else "no"
    return Card(
        tone=tone,
        word=WORDS[judged.forces],
        use=use.strip(", ") if sure else "until a mistake is mended",
        chips=((tone, f"Forces: {judged.forces}"), (TONES[alone], f"Single parameters: {alone}")),
        figures=(
            Figure(percent, error, gauge=gauge, sure=sure),
            Figure(change, "errors against the given bodies, all motors", more, sure=sure),
            Figure(f"{told.well_determined}", better, f"of {of_all}", sure=sure),
            Figure(f"{mistakes}", suspected),
        ),
        next=f"{judged.improvement}.",
        command=command,
    )


def _sections(found: Identification, worst: str) -> Iterator[Section]:
    """Errors, forces, friction, parameters, what is unidentified, checks, and all values."""
    told = found.identifiability
    errors, robot = charts.model_errors_chart(found, worst=worst), found.force_model.robot
    motors = tuple(panel.motor for panel in errors.panels)
    yield Section("Errors on new data, by motor", (errors,), short="Errors")
    lead = "What is left should look like noise: no drift, no steps where a motor turns."
    forces = [*_forces(found, motors, worst)]
    yield Section("Forces left unexplained over time", tuple(forces), lead=lead, short="Forces")
    friction = (charts.friction_chart(found, worst=worst),)
    if drawn := tuple(each for each in friction if each.panels):
        yield Section("Friction of each motor", drawn, short="Friction")
    drawn = charts.parameters_chart(found), charts.joints_chart(found), charts.masses_chart(found)
    yield Section(
        "Parameters compared with the robot file",
        tuple(each for each in drawn if each.panels and each.panels[0].labels),
        lead=_changed(found),
        short="Parameters",
    )
    if told.weak or told.unidentifiable:
        yield Section("Not identified", (_unidentified_table(found),))
    used = {"fitted": found.training, "new data, not fitted": found.validation}
    log = [charts.used_chart(robot, used), charts.gains_chart(robot, found.log_faults)]
    log += [] if found.delay is None else [charts.delays_chart(robot, found.delay)]
    checks: list[Part] = [each for each in log if each.panels]
    dropped = [
        (run.name, d.reason, d.count, f"{d.first:.2f}", f"{d.last:.2f}")
        for run in found.training
        for d in run.dropped
    ]
    columns = "recording", "reason", ">samples", ">from (s)", ">to (s)"
    checks += [plain_table("left out", columns, dropped)] if dropped else []
    yield Section("Checks of the log", tuple(checks), folded=True, short="Log")
    model: list[Part] = [] if found.cutoff is None else [charts.filter_chart(found.cutoff)]
    model.append(_candidates_table(found))
    yield Section("Checks of the model", tuple(model), folded=True, short="Model")
    values, robot_values = _values(found)
    yield Section("All values", (values,), folded=values.row_count > OPEN)
    if robot_values.row_count:
        yield Section("Values of bodies and joints", (robot_values,), folded=True, short="Robot")


def _forces(found: Identification, motors: tuple[str, ...], worst: str) -> Iterator[Part]:
    """On each recording that judges, by fits that have not seen it."""
    robot, fit, first = found.force_model.robot, found.fit, 0
    for k, run in enumerate(found.validation or found.training):
        rows = slice(first, first + len(run))
        own, file = (each.predicted[rows] for each in (found.recommended, found.baseline))
        W, first = found.new.regressor[rows], rows.stop
        new = Prediction(run, own, reach_of(fit, run, W))
        name = "forces" if not k else f"forces_{k + 1}"
        yield forces_chart(robot, new, motors=motors, file=file, worst=worst, name=name)


def _changed(found: Identification) -> str:
    """How many parameters of bodies are clearly not those of the robot file."""
    if found.recommended is found.baseline:
        return "The bodies are those of the robot file: fitted ones are clearly worse."
    bodies, prior = found.force_model.body_columns, found.force_model.prior
    low, high = found.fit.intervals()[bodies].T - prior[bodies]
    clear = int(((low > 0) | (high < 0)).sum())
    return f"{clear} of {len(bodies)} parameters and sums clearly differ from the robot file."


def _unidentified_table(found: Identification) -> Table:
    """Combinations that the file determines better than the log."""
    told = found.identifiability
    rows = [(each.text, "0", "unknown: as in the file") for each in told.unidentifiable]
    rows += [
        (each.text, f"{100 * each.effect:.2g} %", f"{each.standard_error:.2g} times the file's")
        for each in told.weak
    ]
    columns = "combination", ">effect on forces", ">uncertainty"
    return plain_table("", columns, rows)


def _fits(found: Identification, data: dict[str, Any], anyway: bool) -> dict[str, bytes | str]:
    """The recommended fit, unless it breaks a law, and that of all parameters where it is another.

    That one may break laws: its file says which, and controllers refuse it.
    """
    try:
        require_sane(found.fit, anyway)
    except OptionError as refused:
        warn(f"parameters.yaml is not written: {refused}", DataWarning)
        return {}
    files: dict[str, bytes | str] = {RECOMMENDED: as_file(data["fit"])}
    if found.recommended is not found["all parameters"]:
        files["all_parameters.yaml"] = as_file(data["all_parameters"])
    return files


def identification_record(found: Identification, judged: Verdict | None = None) -> dict[str, Any]:
    """All findings of an identification, ready for JSON."""
    model, told = found.force_model, found.identifiability
    terms, judged = model.joint_terms, judged or found.verdict
    known: dict[str, Any] = json_value(
        {
            "mechanism": model.robot.name,
            "model": model.model,
            "actuators": model.robot.independent,
            "training": [_recording(recording) for recording in found.training],
            "validation": [_recording(recording) for recording in found.validation],
            "expressions": model.base.expressions,
            "robot_file": model.prior,
            "recommended": found.recommended.name,
            "judged": json_value(judged)
            | json_fields(judged, *USES)
            | {"ratio": root(*judged.ratio)},
            "errors": [_errors(found, k) for k in range(len(model.robot.independent))],
            **json_fields(found, "prior_deviation", "cutoff", "delay", "log_faults"),
            "joint_terms": {} if terms is None else dict(terms.of_joints),
            "identifiability": {
                **json_fields(told, "structural_rank", "rank"),
                "better_than_robot_file": told.well_determined,
                "parameters": told.parameters.names,
                "structural_effects": told.excitation.structural,
                "effects": told.excitation.effects,
                "unidentifiable": [_direction(direction) for direction in told.unidentifiable],
                "weak": [_direction(direction) for direction in told.weak],
            },
            "essential": found.essential.fit.values,
            "essential_parameters": found.reduction.result.parameters.names,
            "candidates": [_candidate(candidate) for candidate in _candidates(found)],
            "robot": [json_fields(each, *ROBOT) for each in found.fit.standard.values()],
        }
    )
    whole = found["all parameters"].fit
    return known | {"fit": found.fit.record(), "all_parameters": whole.record()}


def _errors(found: Identification, k: int) -> dict[str, Any]:
    """Errors on new data of a motor, in parts of its force, as the page shows them."""
    robot, motor = found.force_model.robot, found.force_model.robot.independent[k]
    said: dict[str, Any] = {"motor": motor, "number": k + 1, "unit": robot.units(motor)[1]}
    for name, candidate in (("fit", found.recommended), ("robot_file", found.baseline)):
        error, spread = (float(each[k]) for each in found.relative_errors(candidate))
        said[name] = {"error": error, "standard_error": spread}
    return said | {"where": {name: each[k] for name, each in found.unseen.shares.items()}}


def _candidates(found: Identification) -> tuple[Candidate, ...]:
    """The robot file, all parameters, the essential ones, and the consistent ones."""
    start, whole, *others = found.candidates.values()
    return (start, whole, found.essential, *others)


def _recording(recording: Recording) -> dict[str, Any]:
    return {
        **json_fields(recording, "name", "cutoff", "wrenches"),
        "samples": len(recording),
        "used": recording.used.sum(axis=0),
        "dropped": [str(dropped) for dropped in recording.dropped],
    }


def _direction(direction: WeakDirection) -> dict[str, Any]:
    numbers = json_fields(direction, "effect", "standard_error", "change")
    return {"combination": direction.text} | numbers


def _candidate(candidate: Candidate) -> dict[str, Any]:
    parts = (candidate.fit.quality, candidate.validation), candidate.rms_errors
    training, validation = (
        {"rms": quality.residual_rms, "rms_standard_error": errors}
        for quality, errors in zip(*parts, strict=True)
    )
    ratio, error = root(*candidate.error_ratio)
    return {
        **json_fields(candidate, "name", "fitted", "beats_baseline"),
        **{"training": training, "validation": validation},
        **{"error_over_file": ratio, "error_over_file_standard_error": error},
    }


def _values(found: Identification) -> tuple[Table, Table]:
    """All values of the recommended fit; bodies and joints of its robot, and their source."""
    fit, model, name = found.fit, found.force_model, found.recommended.name
    own = zip(model.base.parameters, model.standard_prior.tolist(), strict=True)
    file = charts.file_values(found)
    file |= {each.label: number(value) for each, value in own if each.kind in KINDS}
    columns = {
        "parameter": "name",
        ">value ± std": lambda each: charts.value_text(each, fit.assumed),
        ">robot file": lambda each: file.get(each.name, "-"),
        ">95 % interval": lambda each: interval(*each.interval),
    }
    source = {"by": lambda each: "log" if each.determined else "file"}
    return (
        table_of(f"recommended: {name}, as in parameters.yaml", columns, alone(fit)),
        table_of(f"robot: {name}", columns | source, fit.standard.values()),
    )


def _candidates_table(found: Identification) -> Table:
    """Errors on new data of the robot file, all parameters, the essential ones, and others."""
    columns = {
        **{"fit": "name", ">fitted": "fitted"},
        ">error over the file's": lambda each: " ± ".join(with_error(*root(*each.error_ratio))),
        "against the file": lambda each: _grade(each, found),
    }
    return table_of("other fits: errors on new data", columns, _candidates(found))


def _grade(each: Candidate, found: Identification) -> str:
    said = "better" if each.beats_baseline else "worse" if each.loses_to_baseline else "not clear"
    said = "" if each is found.baseline else said
    return f"{said} (recommended)".strip() if each is found.recommended else said
