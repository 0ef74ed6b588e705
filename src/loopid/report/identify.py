"""The report of ``loopid identify``: verdict, findings, tables, charts and files."""

from __future__ import annotations

from typing import Any

import numpy as np
from rich.table import Table

from loopid.arguments import FloatArray, spread_rows
from loopid.diagnosis.log_mistakes import Suspicions
from loopid.diagnosis.selection import PredictionError
from loopid.diagnosis.study import Study
from loopid.diagnosis.term_sets import TermComparison
from loopid.identification.cutoff import CutoffChoice
from loopid.identification.information import Identifiability, WeakDirection, body_sizes
from loopid.identification.pipeline import Identification
from loopid.identification.prediction import Candidate, prediction_reach
from loopid.identification.result import FitResult
from loopid.identification.saved import SavedFit
from loopid.identification.terms import friction_columns, friction_curve, frictional_joints
from loopid.logs.recording import Recording
from loopid.regressors.joint_terms import NO_TERMS
from loopid.report.chart import MOST_DOTS, Chart, Mark, Panel
from loopid.report.look import json_fields, json_value, number, plain_table, with_error
from loopid.report.page import Part, Report, Section
from loopid.report.structure import force_unit, robot_chart

FIGURE_OF_WEAK = 0.1  # of the least effect that is drawn, where unidentifiable ones are drawn
MOST, MARGIN = 0.95, 1.3  # quantile of its band, and times that, that an axis shows
CURVE_POINTS = 200  # of a friction curve on either side of standstill


def identification_report(study: Study, command: str = "") -> Report:
    """What a study of logs found; the command designs the motion that its verdict asks for."""
    found, judged = study.identification, study.verdict
    model = found.force_model
    rows = list[tuple[str, ...]]()
    for each in found.fit.estimates:
        value, error = _value_and_error(found.fit, each.name)
        rows.append(
            (each.name, value, "as in the file" if error == "-" else f"± {error}", each.unit)
        )
    return Report(
        name="identification",
        title=f"{model.mechanism.name}, {model.model} model",
        verdict=str(judged),
        record=identification_record(study),
        brief=[plain_table("", ("", ">", "", ""), rows)],
        sections=lambda: _sections(study),
        results=lambda: _fits(found),
        advice=command if judged.excite else "",
    )


def _sections(study: Study) -> list[Section]:
    """Forces, values, friction, what the data tell, other candidates, terms, filter, robot."""
    found = study.identification
    whole, told = found["all parameters"], found.identifiability
    values: list[Part] = [parameters_chart(found), _estimates_table("", found, found.fit)]
    if found.fit.standard_parameters is not None:
        values.append(_bodies_table(found))
    said: list[Part] = [spectrum_chart(told)]
    if told.unidentifiable or told.weak:
        said.append(_weak_table(told))
    others: list[Part] = [_essential_table(study)]
    if found.recommended is not whole:
        title = f"all parameters by {whole.fit.estimator}"
        others.append(_estimates_table(title, found, whole.fit))
    friction = friction_chart(found)
    filtering: list[Part] = [] if found.cutoff is None else [filter_chart(found.cutoff)]
    filtering += [_noise_table(whole.fit), _gains_table(study), _dropped_table(found)]
    return [
        Section("Forces on new data", (forces_chart(found), *_candidates_tables(study))),
        Section(f"Recommended values: {found.recommended.name}", tuple(values)),
        *([Section("Friction", (friction,))] if friction.panels else []),
        Section("What the data tell", tuple(said)),
        Section("Robot", (robot_chart(found.force_model.mechanism),)),
        Section("In words", tuple(findings(study))),
        Section("Other candidates", tuple(others)),
        Section("Joint terms", (_terms_table(study.term_sets),)),
        Section("Filter and samples", tuple(filtering)),
    ]


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
        "fit": SavedFit.of(model, found["all parameters"].fit).record(),
        "recommended": found.recommended.name,
        "recommended_fit": SavedFit.of(model, found.fit).record(),
        "judged": json_fields(
            study.verdict,
            *("use", "motor", "error", "ratio", "significant", "parameters"),
            *("excite", "improvement"),
        ),
        "prior_deviation": json_value(found.prior_deviation),
        "cutoff": found.cutoff
        and {
            **json_fields(found.cutoff, "chosen", "judged", "bound"),
            **{
                name: json_value(getattr(found.cutoff, name))
                for name in ("cutoffs", "errors", "clear", "spreads")
            },
        },
        "joint_terms": {} if terms is None else {j: list(k) for j, k in terms.of_joints.items()},
        "term_sets": _term_sets(study.term_sets),
        "fitted_bodies_pay": study.term_sets.bodies_pay,
        "identifiability": {
            **json_fields(told, "structural_rank", "rank"),
            "better_than_robot_file": told.well_determined,
            "parameters": list(told.parameters.labels),
            "structural_effects": json_value(told.excitation.structural),
            "effects": json_value(told.excitation.effects),
            "unidentifiable": [_direction(direction) for direction in told.unidentifiable],
            "weak": [_direction(direction) for direction in told.weak],
        },
        "essential": json_value(study.essential.values),
        "essential_parameters": list(reduction.result.parameters.labels),
        "candidates": [_candidate(candidate) for candidate in _candidates(study)],
        "delay": found.delay
        and json_fields(found.delay, "joints", "common", "interval", "each", "intervals", "undone"),
        "suspicions": [_suspicions(one) for one in study.suspicions],
        "findings": findings(study),
    }


def _candidates(study: Study) -> tuple[Candidate, ...]:
    """The robot file, all parameters, the essential ones, and the consistent ones."""
    start, whole, *others = study.identification.candidates.values()
    return (start, whole, study.essential, *others)


def _suspicions(found: Suspicions) -> dict[str, Any]:
    gains = [json_fields(gain, "joint", "gain", "interval") for gain in found.gains]
    return {"recording": found.recording, "sentences": list(found.sentences), "gains": gains}


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
    return {
        "combination": direction.text,
        **json_fields(direction, "effect", "standard_error", "change"),
    }


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


def findings(study: Study) -> list[str]:
    """What a reader should know beside the numbers, one sentence each."""
    found = study.identification
    told, cutoff = found.identifiability, found.training[0].cutoff
    terms = found.force_model.joint_terms
    choice = NO_TERMS if terms is None else terms.choice(found.force_model.mechanism)
    filtered = "unfiltered" if cutoff is None else f"filtered at {cutoff:.3g} Hz"
    condition = found["all parameters"].fit.condition_number
    said = [
        _recommendation(found),
        f"The data were {filtered}; the condition number of the weighted regressor is "
        f"{condition:.4g}.",
        f"The joint terms are {choice}. {_terms_finding(study.term_sets)}",
    ]
    runs = (*found.training, *found.validation)
    frames = dict.fromkeys(frame for run in runs for frame in run.wrenches)
    if frames:
        said.append(
            f"Measured wrenches of the surroundings on {', '.join(frames)} are part of the forces."
        )
    if found.delay is not None and found.delay.clear:
        said.append(f"{found.delay.sentence.capitalize()}.")
    said += [f"In {one.recording}, {text}." for one in study.suspicions for text in one.sentences]
    if told.unidentifiable:
        said.append(
            "Unidentifiable combinations are as in the robot file, so the values of "
            f"{', '.join(told.assumed)} rest on it."
        )
    return said


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
        return f"{said} with fitted joint terms, as nothing is clearly better on new data."
    deviation = found.fit.deviation
    if deviation is None:
        return f"{said} by {found.fit.estimator}."
    off = (f"{name} {100 * own:.2g} %" for name, own in deviation.rows if own > deviation.common)
    also = ", ".join(off)
    return (
        f"{said} parameters, every body solid; the bodies of the robot file count as right to "
        f"{100 * deviation.common:.2g} %{f', but {also}' if also else ''}."
    )


def _value_and_error(fit: FitResult, name: str) -> tuple[str, str]:
    """As they are shown; no error of what is as in the robot file."""
    estimate = fit[name]
    return with_error(estimate.value, 0.0 if name in fit.assumed else estimate.standard_error)


def _estimates_table(title: str, found: Identification, fit: FitResult) -> Table:
    columns = ("parameter", ">value", ">± std", ">95 % from", ">to", ">file", "unit")
    rows = (
        (
            each.name,
            *_value_and_error(fit, each.name),
            *map(number, each.interval),
            number(known) if j in found.force_model.body_columns else "-",
            each.unit,
        )
        for j, (each, known) in enumerate(
            zip(fit.estimates, found.force_model.prior.tolist(), strict=True)
        )
    )
    return plain_table(title, columns, rows)


def _weak_table(found: Identifiability) -> Table:
    rows = [(each.text, "0", "unidentifiable") for each in found.unidentifiable]
    rows += [(w.text, f"{w.effect:.1e}", f"{w.standard_error:.2g}") for w in found.weak]
    columns = "combination", ">effect on forces", ">± std (sizes)"
    return plain_table("unidentifiable and weakly identifiable combinations", columns, rows)


def _essential_table(study: Study) -> Table:
    found, reduction = study.identification, study.reduction
    result, prior = reduction.result, found.force_model.prior
    joints, rows = set(found.force_model.joint_columns), []
    for column, estimate in zip(reduction.columns, result.estimates, strict=True):
        known = f"{prior[column]:.4g}" if prior[column] or column not in joints else "-"
        numbers = f"{estimate.value:.4g}", f"{estimate.standard_error:.2g}", known
        rows.append((found.force_model.base.expressions[column], *numbers, estimate.unit))
    columns = ("parameter", ">value", ">± std", ">robot file", "unit")
    return plain_table("essential parameters; the others as in the robot file", columns, rows)


def _bodies_table(found: Identification) -> Table:
    """Mass and centre of each body of the recommended fit, beside the mass of the robot file."""
    model, fit = found.force_model, found.fit
    assert fit.standard_parameters is not None
    names, rows = model.base.parameters, []
    for j in (j for j, name in enumerate(names) if name.kind == "m"):
        mass, *first = fit.standard_parameters[j : j + 4].tolist()
        centre = ", ".join(f"{moment / mass:.4g}" for moment in first) if mass else "-"
        rows.append((names[j].link, f"{mass:.4g}", f"{model.standard_prior[j]:.4g}", centre))
    columns = "body", ">mass (kg)", ">robot file", ">centre of mass (m)"
    return plain_table(f"bodies: {found.recommended.name}", columns, rows)


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
    ratios = (
        (each.name, each.fitted, *with_error(*each.error_ratio), _grade(each, found))
        for each in candidates
    )
    title = "squared errors on new data, over those of the robot file with fitted joint terms"
    return [
        plain_table(title, ("fit", ">fitted parameters", ">ratio", ">± std", ""), ratios),
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


def _noise_table(fit: FitResult) -> Table:
    noise, rows = fit.noise, []
    if noise is not None:
        for k, actuator in enumerate(noise.actuators):
            counts = f"{noise.samples[k]:,}", f"{noise.effective_samples[k]:,.0f}"
            rows.append((actuator, *counts, f"{noise.lag_one[k]:.3f}"))
    columns = "", ">samples", ">effective", ">lag-one correlation"
    return plain_table("residuals of the fit", columns, rows)


def _gains_table(study: Study) -> Table:
    rows = (
        (one.recording, g.joint, f"{g.gain:.3g}", "{:.3g} ... {:.3g}".format(*g.interval))
        for one in study.suspicions
        for g in one.gains
    )
    columns = "recording", "motor", ">gain", ">95 % interval"
    return plain_table(
        "measured forces over what bodies and other motors let expect", columns, rows
    )


def _dropped_table(found: Identification) -> Table:
    rows = (
        (recording.name, d.reason, d.count, f"{d.first:.2f}", f"{d.last:.2f}")
        for recording in found.training
        for d in recording.dropped
    )
    return plain_table(
        "left out", ("recording", "reason", ">samples", ">from (s)", ">to (s)"), rows
    )


# Charts.


def forces_chart(found: Identification) -> Chart:
    """Forces of each motor on the first validation recording, and what no fit explains."""
    run, mechanism = found.validation[0], found.force_model.mechanism
    time, W, panels = run.motion.time, found.new.regressor[: len(run)], list[Panel]()
    some = spread_rows(len(run), MOST_DOTS)
    reach = prediction_reach(W[some], found.fit.covariance)
    by_file, fitted = W @ found.baseline.values, W @ found.fit.values
    for k, motor in enumerate(mechanism.independent):
        used = run.used[:, k]  # lines break where the force says nothing
        measured, file, fit = (
            np.where(used, force[:, k], np.nan) for force in (run.force, by_file, fitted)
        )
        low, high = fit[some] - reach[:, k], fit[some] + reach[:, k]
        marks = (
            Mark("measured", time, measured, "measured"),
            Mark("95 % interval", time[some], low, "fit", "band", high),
            Mark("robot file, fitted joint terms", time, file, "file"),
            Mark("recommended", time, fit, "fit"),
        )
        left = (
            Mark("measured less robot file", time, measured - file, "faint"),
            Mark("measured less recommended", time, measured - fit, "residual"),
        )
        unit = force_unit(mechanism, motor)
        panels += [
            Panel(f"{motor}: force ({unit})", marks),
            Panel(f"residual ({unit})", left, small=True),
        ]
    caption = (
        f"Forces of {run.name} that were not fitted. Drag along time to zoom in, double-click to "
        "see all again."
    )
    return Chart("forces", caption, "time (s)", tuple(panels), zoom=True)


def parameters_chart(found: Identification) -> Chart:
    """Intervals of the parameters of bodies about the values of the robot file."""
    alone = found.recommended is found.baseline
    fit = found["all parameters"].fit if alone else found.fit
    model = found.force_model
    bodies, base = model.body_columns, model.base
    sizes = body_sizes(model.mechanism, model.model)
    sizes = np.linalg.norm(base.matrix[bodies][:, : len(sizes)] * sizes, axis=1)
    ends = (fit.intervals()[bodies] - model.prior[bodies, None]) / sizes[:, None]
    known = np.isfinite(ends).all(axis=1)
    place = np.arange(len(bodies), dtype=np.float64)
    low, high = ends.T
    middle = (fit.values - model.prior)[bodies] / sizes
    marks = (
        Mark("robot file", np.zeros(2), np.array([-0.5, len(bodies) - 0.5]), "faint"),
        Mark("95 % interval", low[known], place[known], "fit", "span", high[known]),
        Mark("all parameters" if alone else "recommended", middle, place, "fit", "dots"),
    )
    labels = tuple(fit.parameters.labels[j] for j in bodies)
    caption = (
        "Parameters of the bodies less those of the robot file, in sizes: a body's mass times its "
        "length, or that squared."
    )
    panel = Panel("fit less robot file (sizes)", marks, labels=labels)
    return Chart("parameters", caption, "", (panel,))


def friction_chart(found: Identification) -> Chart:
    """Friction of each motor by the recommended fit, over the forces that it explains."""
    fit, data, mechanism = found.fit, found.data, found.force_model.mechanism
    joints = [joint for joint in frictional_joints(fit) if joint in data.actuators]
    velocities = np.concatenate([run.motion.velocities for run in found.training])
    rows, panels = spread_rows(len(data), MOST_DOTS), list[Panel]()
    residual = data.residual(fit.values)[rows]
    for joint in joints:
        k, own = data.actuators.index(joint), friction_columns(fit, joint)
        rate, used = velocities[rows, k], data.used[rows, k]
        left = residual[:, k] + data.regressor[rows, k][:, own] @ fit.values[own]
        marks = [Mark("measured less all else", rate[used], left[used], "measured", "dots")]
        fastest = float(np.abs(rate).max(initial=0.0)) or 1.0
        rates = fastest * np.linspace(-1, 1, 2 * CURVE_POINTS)  # none is 0, where it jumps
        curve = friction_curve(fit, joint, rates, joint_terms=found.force_model.joint_terms)
        sure = bool(np.isfinite(curve.band).all())
        for half in (slice(CURVE_POINTS), slice(CURVE_POINTS, None)):
            low, high = curve.band[half].T
            if sure:
                marks.append(Mark("95 % interval", rates[half], low, "fit", "band", high))
            marks.append(Mark("friction", rates[half], curve.values[half], "fit"))
        # Next to standstill hardly anything is known: bands there would flatten the rest.
        most = MARGIN * float(np.quantile(np.abs(curve.band), MOST)) if sure else 0.0
        title = f"{joint}: friction ({force_unit(mechanism, joint)})"
        panels.append(Panel(title, tuple(marks), (-most, most) if most else None))
    caption = "Friction over the rate of each motor (m/s or rad/s), by the recommended fit."
    return Chart("friction", caption, "rate", tuple(panels), columns=min(2, len(panels)) or 1)


def spectrum_chart(found: Identifiability) -> Chart:
    """Effects of the combinations on forces: in random states of the robot, and in the data."""
    structural, effects = 100 * found.excitation.structural, 100 * found.excitation.effects
    place: FloatArray = np.arange(1.0, len(effects) + 1.0)
    rank, sure = found.rank, found.well_determined
    known, weak, none = slice(0, sure), slice(sure, rank), slice(rank, None)
    shown = np.append(structural[structural > 0], effects[:rank])
    floor = np.full(len(effects), FIGURE_OF_WEAK * shown.min(initial=1.0))
    kinds = (
        ("data", known, effects, "file"),
        ("weak: worse than the robot file", weak, effects, "weak"),
        ("unidentifiable: no effect", none, floor, "fit"),
    )
    marks = [
        Mark("structure", place, structural, "faint"),
        *(
            Mark(n, place[part], y[part], look, "dots")
            for n, part, y, look in kinds
            if y[part].size
        ),
    ]
    panel = Panel("effect on the forces (%)", tuple(marks), log="y")
    caption = (
        "What a change of each combination of parameters by its size does to the forces: in random "
        f"states of the robot, and in the data. {found.rank} of {found.structural_rank} are "
        f"excited, {found.well_determined} are known better than by the robot file."
    )
    return Chart("spectrum", caption, "combination of parameters", (panel,))


def filter_chart(found: CutoffChoice) -> Chart:
    """Errors and spread of predictions at the cut-offs that were tried."""
    errors, spreads = 100 * found.errors, 100 * found.spreads
    both = np.concatenate([errors, spreads])
    ends = np.array([np.nanmin(both), np.nanmax(both)])
    marks = (
        Mark("error", found.cutoffs, errors, "file"),
        Mark("deviation of the predictions", found.cutoffs, spreads, "other"),
        Mark("", found.cutoffs, errors, "file", "dots"),
        Mark("", found.cutoffs, spreads, "other", "dots"),
        Mark("chosen", np.full(2, found.chosen), ends, "fit"),
    )
    title = f"predictions below {found.judged:.3g} Hz of data that were not fitted (% of the force)"
    caption = (
        "Cut-offs of the low-pass filter that were tried: errors on data that were not fitted, and "
        f"how far predictions vary with the data; {found.chosen:.3g} Hz is best."
    )
    return Chart("filter", caption, "cut-off (Hz)", (Panel(title, marks, log="xy"),))
