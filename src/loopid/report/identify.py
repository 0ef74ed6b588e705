"""The report of ``loopid identify``: verdict, findings, tables, charts and files."""

from __future__ import annotations

from typing import Any

from rich.table import Table

from loopid.diagnosis.selection import PredictionError
from loopid.diagnosis.study import Study
from loopid.diagnosis.term_sets import TermComparison
from loopid.findings import Finding, most_important_first
from loopid.identification.force_model import parted
from loopid.identification.friction import friction_findings, friction_summary
from loopid.identification.hysteresis import hysteresis_loop, hysteretic_joints
from loopid.identification.information import WeakDirection
from loopid.identification.pipeline import Identification
from loopid.identification.prediction import Candidate, Prediction, prediction_reach
from loopid.identification.result import Estimate, FitResult
from loopid.identification.saved import SavedFit
from loopid.logs.recording import Recording
from loopid.parameters import KINDS, Parameter
from loopid.plots.chart import Chart
from loopid.plots.pictures import (
    filter_chart,
    forces_chart,
    friction_chart,
    hysteresis_chart,
    parameters_chart,
    robot_chart,
    spectrum_chart,
)
from loopid.regressors.joint_laws import grouped
from loopid.regressors.joint_terms import NO_TERMS
from loopid.report.look import (
    interval,
    json_fields,
    json_value,
    number,
    plain_table,
    table_of,
    with_error,
)
from loopid.report.page import Part, Report, Section

# Values that the terminal shows where they do not fit in two columns.
SHOWN = 14
# Of the kinds whose size the evidence decides: those that say something alone.
ALONE = "Fk0", "Ft"


def identification_report(study: Study, command: str = "") -> Report:
    """What a study of logs found; the command designs the motion that its verdict asks for."""
    found, judged = study.identification, study.verdict
    model = found.force_model
    rows = list[tuple[str, ...]]()
    for each in _shown(found.fit):
        value, error = _value_and_error(found.fit, each)
        rows.append((each.name, value, "= file" if error == "-" else f"± {error}", each.unit))
    if len(rows) > 2 * SHOWN or any(" more" in row[0] for row in rows):
        left = len(rows) - SHOWN
        rows[SHOWN:] = [(f"... and {left} more in the report", "", "", "")] if left > 0 else []
    return Report(
        name="identification",
        title=f"{model.mechanism.name}, {model.model} model",
        verdict=str(judged),
        record=identification_record(study),
        brief=[plain_table("", ("", ">", "", ""), rows)],
        sections=lambda: _sections(study),
        results=lambda: _fits(found),
        advice=command if judged.excite else "",
        findings=findings(study),
    )


def _sections(study: Study) -> list[Section]:
    """Forces, values, friction, what the data tell, other candidates, terms, filter, robot."""
    found = study.identification
    whole, told = found["all parameters"], found.identifiability
    values: list[Part] = [parameters_chart(found), _estimates_table("", found, found.fit)]
    values += _robot_tables(found)
    said: list[Part] = [spectrum_chart(told)]
    rows = [(each.text, "0", "unidentifiable") for each in told.unidentifiable]
    rows += [(each.text, f"{each.effect:.1e}", f"{each.standard_error:.2g}") for each in told.weak]
    if rows:
        columns = "combination", ">effect on forces", ">± std (sizes)"
        said.append(
            plain_table("unidentifiable and weakly identifiable combinations", columns, rows)
        )
    others: list[Part] = [_essential_table(study)]
    if found.recommended is not whole:
        title = f"all parameters by {whole.fit.estimator}"
        others.append(_estimates_table(title, found, whole.fit))
    friction = [each for each in (friction_chart(found), hysteresis_chart(found)) if each.panels]
    filtering: list[Part] = [] if found.cutoff is None else [filter_chart(found.cutoff)]
    filtering += _filter_tables(study)
    return [
        Section("Forces on new data", (_forces_chart(found), *_candidates_tables(study))),
        Section(f"Recommended values: {found.recommended.name}", tuple(values)),
        *([Section("Friction", (*friction, _friction_table(found)))] if friction else []),
        Section("What the data tell", tuple(said)),
        Section("Robot", (robot_chart(found.force_model.mechanism),)),
        Section("Other candidates", tuple(others)),
        Section("Joint terms", (_terms_table(study.term_sets),)),
        Section("Filter and samples", tuple(filtering)),
    ]


def _forces_chart(found: Identification) -> Chart:
    """On the first recording that judges, by fits that have not seen it."""
    run = (found.validation or found.training)[0]
    fit, W = found.fit, found.new.regressor[: len(run)]
    reach = prediction_reach(W, fit.covariance, fit.unseen_rms)
    own, file = (each.predicted[: len(run)] for each in (found.recommended, found.baseline))
    prediction = Prediction(run, own, reach)
    return forces_chart(found.force_model.mechanism, prediction, file=file)


def _fits(found: Identification) -> dict[str, bytes | str]:
    """The recommended fit, and that of all parameters where it is another."""
    fits = {"parameters.yaml": found.fit}
    if found.recommended is not found["all parameters"]:
        fits["all_parameters.yaml"] = found["all parameters"].fit
    return {n: SavedFit.of(found.force_model, fit).content(n) for n, fit in fits.items()}


def identification_record(study: Study) -> dict[str, Any]:
    """All findings of a study, ready for JSON."""
    found, reduction = study.identification, study.reduction
    model, told = found.force_model, found.identifiability
    terms = model.joint_terms
    return {
        "mechanism": model.mechanism.name,
        "model": model.model,
        "actuators": list(model.mechanism.independent),
        "training": [_recording(recording) for recording in found.training],
        "validation": [_recording(recording) for recording in found.validation],
        "expressions": list(model.base.expressions),
        "robot_file": json_value(model.prior),
        "all_parameters": SavedFit.of(model, found["all parameters"].fit).record(),
        "recommended": found.recommended.name,
        "fit": SavedFit.of(model, found.fit).record(),
        "judged": json_value(study.verdict),
        "prior_deviation": json_value(found.prior_deviation),
        "cutoff": json_value(found.cutoff),
        "joint_terms": {} if terms is None else {j: list(k) for j, k in terms.of_joints.items()},
        "term_sets": _term_sets(study.term_sets),
        "fitted_bodies_pay": study.term_sets.bodies_pay,
        "identifiability": {
            **json_fields(told, "structural_rank", "rank"),
            "better_than_robot_file": told.well_determined,
            "parameters": list(told.parameters.names),
            "structural_effects": json_value(told.excitation.structural),
            "effects": json_value(told.excitation.effects),
            "unidentifiable": [_direction(direction) for direction in told.unidentifiable],
            "weak": [_direction(direction) for direction in told.weak],
        },
        "essential": json_value(study.essential.values),
        "essential_parameters": list(reduction.result.parameters.names),
        "candidates": [_candidate(candidate) for candidate in _candidates(study)],
        "delay": json_value(found.delay),
        "suspicions": json_value(found.suspicions),
    }


def _candidates(study: Study) -> tuple[Candidate, ...]:
    """The robot file, all parameters, the essential ones, and the consistent ones."""
    start, whole, *others = study.identification.candidates.values()
    return (start, whole, study.essential, *others)


def _recording(recording: Recording) -> dict[str, Any]:
    return {
        "name": recording.name,
        "samples": len(recording),
        "used": recording.used.sum(axis=0).tolist(),
        "cutoff": recording.cutoff,
        "dropped": [str(dropped) for dropped in recording.dropped],
        "wrenches": list(recording.wrenches),
    }


def _direction(direction: WeakDirection) -> dict[str, Any]:
    return {"combination": direction.text} | json_fields(
        direction, "effect", "standard_error", "change"
    )


def _candidate(candidate: Candidate) -> dict[str, Any]:
    qualities = {}
    for part, errors in zip(("training", "validation"), candidate.rms_errors, strict=True):
        quality = getattr(candidate, part)
        qualities[part] = {
            "rms": json_value(quality.residual_rms),
            "rms_standard_error": json_value(errors),
            "r_squared": json_value(quality.r_squared),
        }
    ratio, error = json_value(candidate.error_ratio)
    return {
        **json_fields(candidate, "name", "fitted"),
        **qualities,
        "error_ratio": ratio,
        "error_ratio_standard_error": error,
        "beats_baseline": candidate.beats_baseline,
    }


def _term_sets(found: TermComparison) -> list[dict[str, Any]]:
    return [
        {
            "terms": each.choice,
            "chosen": each is found.chosen,
            **{
                bodies: {
                    "fitted": each.parameters[k],
                    "error": each.errors[k].mean,
                    "standard_error": json_value(each.errors[k].standard_error),
                    "enough": each is found.enough[k],
                }
                for k, bodies in enumerate(("robot_file", "fitted_bodies"))
            },
        }
        for each in found.sets
    ]


def findings(study: Study) -> tuple[Finding, ...]:
    """What a reader should know beside the numbers, the most important first."""
    found = study.identification
    told, cutoff = found.identifiability, found.training[0].cutoff
    terms, _ = parted(found.force_model.joint_terms)
    choice = NO_TERMS if terms is None else terms.choice(found.force_model.mechanism)
    filtered = "unfiltered" if cutoff is None else f"filtered at {cutoff:.3g} Hz"
    condition = found["all parameters"].fit.condition_number
    notes = [
        (f"recommended: {found.recommended.name}", _recommendation(found)),
        (
            f"the data were {filtered}",
            f"the condition number of the weighted regressor is {condition:.4g}",
        ),
        (f"the joint terms are {choice}", _terms_finding(study.term_sets)),
    ]
    runs = (*found.training, *found.validation)
    frames = dict.fromkeys(frame for run in runs for frame in run.wrenches)
    if frames:
        where = f"on {', '.join(frames)}"
        notes.append(("measured wrenches are part of the forces", where))
    notes += [(sentence, "") for sentence in friction_findings(found.fit)]
    for joint in hysteretic_joints(found.fit):
        notes.append((hysteresis_loop(found.fit, joint).sentence, ""))
    if told.unidentifiable:
        notes.append(
            (
                "unidentifiable combinations are as in the robot file",
                f"the values of {', '.join(told.assumed)} rest on it",
            )
        )
    return most_important_first((*study.findings, *(Finding("note", *note) for note in notes)))


def _terms_finding(found: TermComparison) -> str:
    with_file, fitted = (
        f"{'these are' if each is found.chosen else f'{each.choice} are'} enough with "
        f"{bodies} (squared error {_error_text(each.errors[k])})"
        for k, (each, bodies) in enumerate(
            zip(found.enough, ("the bodies of the robot file", "fitted bodies"), strict=True)
        )
    )
    said = (
        f"On new data {fitted}, {with_file}: fitted bodies are "
        f"{'' if found.bodies_pay else 'not '}clearly better."
    )
    good = found.chosen.errors[1].as_good
    return said if good else f'{said} Try terms="{found.enough[1].choice}".'


def _error_text(error: PredictionError) -> str:
    return f"{error.mean:.3g} ± {error.standard_error:.2g}"


def _recommendation(found: Identification) -> str:
    said = f"Recommended, and written to parameters.yaml: {found.recommended.name}"
    if found.recommended is found.baseline:
        return f"{said} with fitted joint terms, as fitted bodies are clearly worse on new data."
    deviation = found.fit.deviation
    if deviation is None:
        return f"{said} by {found.fit.estimator}."
    return f"{said} parameters, every body solid; {deviation.sentence}."


def _value_and_error(fit: FitResult, estimate: Estimate) -> tuple[str, str]:
    """As they are shown; no error of what is as in the robot file."""
    error = 0.0 if estimate.name in fit.assumed else estimate.standard_error
    return with_error(estimate.value, error)


def _estimates_table(title: str, found: Identification, fit: FitResult) -> Table:
    bodies = {fit.parameters.names[j] for j in found.force_model.body_columns}
    known = dict(zip(fit.parameters.names, found.force_model.prior.tolist(), strict=True))
    columns = {
        "parameter": lambda each: each.expression or each.name,
        ">value": lambda each: _value_and_error(fit, each)[0],
        ">± std": lambda each: _value_and_error(fit, each)[1],
        ">95 % from": lambda each: number(each.interval[0]),
        ">to": lambda each: number(each.interval[1]),
        ">file": lambda each: number(known[each.name]) if each.name in bodies else "-",
        "unit": "unit",
    }
    return table_of(title, columns, _shown(fit))


def _shown(fit: FitResult) -> list[Estimate]:
    """Estimates without points of friction curves, but for what there is more at standstill."""
    shown = zip(fit.parameters, fit.estimates, strict=True)
    return [one for each, one in shown if not grouped(each.kind) or each.kind.startswith(ALONE)]


def _friction_table(found: Identification) -> Table:
    """Friction of each motor in four numbers, with standard errors."""
    fit, rows = friction_summary(found.fit), []
    for k, joint in enumerate(fit.joints):
        own = [each[k] for each in fit.parts.values()]
        cells = [
            "-" if one is None else " ± ".join(_value_and_error(found.fit, one)) for one in own
        ]
        rows.append((joint, *cells))
    columns = "joint", ">Coulomb", ">viscous", ">more at standstill", ">part of the load"
    return plain_table("friction; its curve is drawn", columns, rows)


def _essential_table(study: Study) -> Table:
    found, reduction = study.identification, study.reduction
    prior, joints = found.force_model.prior, set(found.force_model.joint_columns)
    rows = (
        (
            found.force_model.base.expressions[column],
            f"{estimate.value:.4g}",
            f"{estimate.standard_error:.2g}",
            f"{prior[column]:.4g}" if prior[column] or column not in joints else "-",
            estimate.unit,
        )
        for column, estimate in zip(reduction.columns, reduction.result.estimates, strict=True)
    )
    columns = ("parameter", ">value", ">± std", ">robot file", "unit")
    return plain_table("essential parameters; the others as in the robot file", columns, rows)


def _robot_tables(found: Identification) -> list[Table]:
    """Masses, moments, rotors and friction of the recommended robot, and who tells them."""
    file = found.force_model.standard_prior.tolist()
    known = dict(zip(found.force_model.base.parameters.labels, file, strict=True))
    columns = {
        "parameter": "name",
        ">value": lambda each: with_error(each.value, each.standard_error)[0],
        ">95 % interval": lambda each: interval(*each.interval),
        ">file": lambda each: number(known[each.name]) if _of_body(each) else "-",
        "unit": "unit",
        "by": lambda each: "log" if each.told else "file",
    }
    robot = found.fit.robot.values()
    return [table_of(f"robot: {found.recommended.name}", columns, robot)] if robot else []


def _of_body(estimate: Estimate) -> bool:
    """Whether it is a parameter of a body."""
    return Parameter.parse(estimate.name).kind in KINDS


def _candidates_tables(study: Study) -> list[Table]:
    """Prediction errors of the robot file, all parameters, the essential ones, and others."""
    found, candidates, rows = study.identification, _candidates(study), list[list[object]]()
    for k, motor in enumerate(found.force_model.mechanism.independent):
        for j, each in enumerate(candidates):
            rows.append(["" if j else motor, each.name])
            parts = zip((each.training, each.validation), each.rms_errors, strict=True)
            for quality, errors in parts:
                there = bool(quality.samples[k])
                rms = with_error(float(quality.residual_rms[k]), float(errors[k]))
                rows[-1] += [*rms, f"{quality.r_squared[k]:.3f}"] if there else ["-"] * 3
    columns = "motor", "fit", ">fitted", ">±", ">R²", ">new", ">±", ">R²"
    ratios = {
        **{"fit": "name", ">fitted parameters": "fitted"},
        ">ratio": lambda each: with_error(*each.error_ratio)[0],
        ">± std": lambda each: with_error(*each.error_ratio)[1],
        "": lambda each: _grade(each, found),
    }
    title = "squared errors on new data, over those of the robot file with fitted joint terms"
    return [
        table_of(title, ratios, candidates),
        plain_table("errors on fitted and on new data: RMS ± std, R²", columns, rows),
    ]


def _grade(each: Candidate, found: Identification) -> str:
    if each.beats_baseline:
        return "better"
    return "worse" if each.loses_to_baseline else "" if each is found.baseline else "not clear"


def _terms_table(found: TermComparison) -> Table:
    """What each set of joint terms buys, with the bodies of the robot file and fitted ones."""
    rows = []
    for each in found.sets:
        rows.append([each.choice + (" (chosen)" if each is found.chosen else "")])
        for k in (0, 1):
            best = " *" if each is found.enough[k] else "  "
            rows[-1] += [str(each.parameters[k]), _error_text(each.errors[k]) + best]
    columns = "terms", ">fitted", ">robot file's bodies", ">fitted", ">bodies fitted"
    title = "squared error on new data ± std, in error variances of the fit; * enough"
    return plain_table(title, columns, rows)


def _filter_tables(study: Study) -> list[Table]:
    """Samples and their correlation, gains of the motors, and what was left out."""
    found, rows = study.identification, list[tuple[str, ...]]()
    if noise := found["all parameters"].fit.noise:
        for k, motor in enumerate(noise.actuators):
            counts = f"{noise.samples[k]:,}", f"{noise.effective_samples[k]:,.0f}"
            rows.append((motor, *counts, f"{noise.lag_one[k]:.3f}"))
    gains = (
        (one.recording, g.joint, f"{g.gain:.3g}", "{:.3g} ... {:.3g}".format(*g.interval))
        for one in found.suspicions
        for g in one.gains
    )
    dropped = (
        (recording.name, d.reason, d.count, f"{d.first:.2f}", f"{d.last:.2f}")
        for recording in found.training
        for d in recording.dropped
    )
    of_noise = "", ">samples", ">effective", ">lag-one correlation"
    of_gains = "recording", "motor", ">gain", ">95 % interval"
    of_dropped = "recording", "reason", ">samples", ">from (s)", ">to (s)"
    expected = "measured forces over what bodies and other motors let expect"
    return [
        plain_table("residuals of the fit", of_noise, rows),
        plain_table(expected, of_gains, gains),
        plain_table("left out", of_dropped, dropped),
    ]
