"""The report of ``loopid identify``: record for machines, findings, tables, page and files."""

from __future__ import annotations

from shlex import quote
from typing import TYPE_CHECKING, Any

from rich.table import Table

from loopid.regressors import NO_TERMS
from loopid.report.tables import (
    json_text,
    json_value,
    markdown_table,
    markdown_text,
    plain_table,
)

if TYPE_CHECKING:
    from loopid.consistency import ConsistentFit
    from loopid.experiment import (
        BandSweep,
        Candidate,
        Identifiability,
        Identification,
        Suspicions,
        TermComparison,
        WeakDirection,
    )
    from loopid.identification import FitResult, PredictionError
    from loopid.logs import Recording

CAPTIONS = {
    "filter": "Accelerations in the log with the cut-off; changes of estimates at lower ones, in "
    "deviations that noise of the forces explains (red: clearly more).",
    "forces": "Forces on data that were not fitted.",
    "spectrum": "Structurally identifiable combinations, and their effect in the data.",
    "parameters": "Base parameters against the robot file.",
    "reduction": "Validation error by the number of parameters taken from the data.",
}


# Beside the figures; a fit only where there is one.
RESULTS = (
    *("report.md", "identification.json", "parameters.yaml", "all_parameters.yaml"),
    "standard_parameters.yaml",
)


def identification_record(found: Identification) -> dict[str, Any]:
    """All findings of an identification, ready for JSON."""
    from loopid.saved import SavedFit  # here, as the other reports do without it

    model, told, consistent = found.force_model, found.identifiability, found.consistent
    terms = model.joint_terms
    return {
        "mechanism": model.mechanism.name,
        "model": model.model,
        "actuators": list(model.mechanism.independent),
        "training": [_recording(recording) for recording in found.training],
        "validation": [_recording(recording) for recording in found.validation],
        "expressions": list(model.base.expressions),
        "robot_file": json_value(model.prior),
        "fit": SavedFit.of(model, found.fit).record(),
        "recommended": found.recommended.name,
        "recommended_fit": SavedFit.of(model, found.recommended_fit).record(),
        "prior_deviation": json_value(found.prior_deviation),
        "joint_terms": {} if terms is None else {j: list(k) for j, k in terms.of_joints.items()},
        "term_sets": found.term_sets and _term_sets(found.term_sets),
        "fitted_bodies_pay": found.term_sets and found.term_sets.bodies_pay,
        "identifiability": {
            **_fields(told, "structural_rank", "rank", "command"),
            "better_than_robot_file": told.well_determined,
            "parameters": list(told.parameters.labels),
            "structural_effects": json_value(told.excitation.structural),
            "effects": json_value(told.excitation.effects),
            "unidentifiable": [_direction(direction) for direction in told.unidentifiable],
            "weak": [_direction(direction) for direction in told.weak],
        },
        "consistent": consistent and SavedFit.of(model, consistent).record(),
        "essential": json_value(found.essential.values),
        "essential_parameters": list(found.reduction.result.parameters.labels),
        "candidates": [_candidate(candidate) for candidate in found.candidates],
        "suspicions": [_suspicions(one) for one in found.suspicions],
        "findings": findings(found),
    }


def _fields(thing: object, *names: str) -> dict[str, Any]:
    return {name: json_value(getattr(thing, name)) for name in names}


def _suspicions(found: Suspicions) -> dict[str, Any]:
    gains = [_fields(gain, "joint", "gain", "interval") for gain in found.gains]
    return {"recording": found.recording, "sentences": list(found.sentences), "gains": gains}


def _recording(recording: Recording) -> dict[str, Any]:
    return {
        "name": recording.name,
        "samples": len(recording),
        "used": recording.used.sum(axis=0).tolist(),
        "cutoff": recording.cutoff,
        "dropped": [str(dropped) for dropped in recording.dropped],
    }


def _direction(direction: WeakDirection) -> dict[str, Any]:
    return {
        "combination": direction.text,
        **_fields(direction, "effect", "standard_error", "change"),
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
        **_fields(candidate, "name", "fitted"),
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


def findings(found: Identification) -> list[str]:
    """What a reader should know before trusting the numbers, one sentence each."""
    cutoffs = sorted({recording.cutoff for recording in found.training}, key=lambda c: c or 0.0)
    filters = ", ".join("unfiltered" if c is None else f"{c:.3g} Hz" for c in cutoffs)
    told, essential = found.identifiability, found.reduction.result.parameters.labels
    said = [
        f"Condition number of the weighted regressor: {found.fit.condition_number:.4g}; cut-off of "
        f"the filter: {filters}.",
        f"{told.structural_rank} combinations of parameters are structurally identifiable; the "
        f"data excite {told.rank} of them, and tell {told.well_determined} better than the robot "
        "file.",
    ]
    terms = found.force_model.joint_terms
    choice = NO_TERMS if terms is None else terms.choice(found.force_model.mechanism)
    said.append(f"Joint terms: {choice}.")
    said += [f"In {one.recording}, {text}." for one in found.suspicions for text in one.sentences]
    if found.term_sets is not None:
        said.append(_terms_finding(found.term_sets))
    if found.sweep is not None:
        said.append(_sweep_finding(found.sweep))
    if told.unidentifiable:
        said.append(
            "Unidentifiable combinations are as in the robot file, so the values of "
            f"{', '.join(told.assumed)} rest on it."
        )
    if told.unidentifiable or told.weak:
        said.append(
            "What is unidentifiable or weakly identifiable is excited by the motion that "
            f"{told.command} designs."
        )
    if found.consistent is not None:
        said += _consistent_findings(found.consistent)
    said += [_verdict(candidate) for candidate in found.candidates[1:]]
    said.append(_recommendation(found))
    insignificant = found.fit.insignificant()
    if insignificant or not found.candidates[1].beats_baseline:
        said.append(
            "Of all parameters together, these are not significant (the 95 % interval includes "
            f"zero): {', '.join(insignificant) or 'none alone'}."
        )
    said.append(
        f"{len(essential)} of {len(found.fit.parameters)} parameters are essential for "
        "predictions; their ± holds if the others are as in the robot file, and joint terms that "
        "it gives no value of are zero."
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
    best = found.enough[1]
    return said if best is found.chosen else f"{said} Try --terms {quote(best.choice)}."


def _error_text(error: PredictionError) -> str:
    return f"{error.mean:.3g} ± {error.standard_error:.2g}"


def _sweep_finding(sweep: BandSweep) -> str:
    narrower = f"At {', '.join(f'{part:g}' for part in sweep.parts)} of the cut-off"
    if not sweep.moved:
        return f"{narrower} estimates change by no more than noise of the forces explains."
    return (
        f"{narrower} estimates of {', '.join(sweep.moved)} change by more than their standard "
        "errors and than noise of the forces explains: noise of the positions biases them."
    )


def _recommendation(found: Identification) -> str:
    said = f"Recommended, and written to parameters.yaml: {found.recommended.name}"
    if found.recommended is found.candidates[0]:
        return (
            f"{said} with fitted joint terms, as all parameters are clearly worse on new data even "
            "with the robot file as prior."
        )
    if found.prior_deviation is None:
        return f"{said} by {found.fit.estimator}."
    return (
        f"{said}; its parameters count as known to {100 * found.prior_deviation:.2g} % of their "
        "sizes, as the data say."
    )


def _verdict(candidate: Candidate) -> str:
    verdict = "not clearly better than"
    if candidate.beats_baseline or candidate.loses_to_baseline:
        verdict = "better than" if candidate.beats_baseline else "worse than"
    ratio, error = candidate.error_ratio
    return (
        f"With {candidate.name} the mean squared error on data that were not fitted is "
        f"{ratio:.2f} ± {error:.2f} times that of the robot file with fitted joint terms: "
        f"{verdict} it."
    )


def _consistent_findings(found: ConsistentFit) -> list[str]:
    have = "Physically consistent bodies" if found.feasible else "No physically consistent bodies"
    said = [
        f"{have} have exactly the base parameters of the fit; the consistent parameters nearest to "
        "the robot file that fit the data raise the weighted residual by "
        f"{100 * (found.fit_cost.total - 1):.2g} %."
    ]
    if found.boundary:
        names = ", ".join(found.boundary)
        said.append(f"The data pull {names} to the boundary of physical consistency.")
    if found.repaired:
        names = ", ".join(found.repaired)
        said.append(f"Physically inconsistent in the robot file, and repaired: {names}.")
    return said


def identification_tables(found: Identification) -> list[Table]:
    """Parameters, prediction errors, what was left out, findings."""
    said = plain_table("findings", "")
    for sentence in findings(found):
        said.add_row(sentence)
    told = found.identifiability
    return [
        _parameter_table(found),
        *([_weak_table(told)] if told.unidentifiable or told.weak else []),
        _essential_table(found),
        *([] if found.consistent is None else [_consistent_table(found.consistent)]),
        _candidates_table(found),
        *([] if found.term_sets is None else [_terms_table(found.term_sets)]),
        _noise_table(found),
        _gains_table(found),
        _dropped_table(found),
        *([] if found.recommended_fit is found.fit else [_recommended_table(found)]),
        said,
    ]


def _parameter_table(found: Identification) -> Table:
    name = found.force_model.mechanism.name
    return _estimates_table(f"{name}: all parameters by {found.fit.estimator}", found.fit)


def _recommended_table(found: Identification) -> Table:
    title = f"recommended: {found.recommended.name}"
    return _estimates_table(title, found.recommended_fit)


def _estimates_table(title: str, fit: FitResult) -> Table:
    columns = ("leading parameter", ">value", ">± std", ">std %", ">95 % interval", "unit")
    table = plain_table(title, *columns)
    for estimate in fit.estimates:
        table.add_row(
            estimate.name,
            f"{estimate.value:.4g}",
            f"{estimate.standard_error:.2g}",
            f"{estimate.relative_std:.1f}",
            "{:.4g} ... {:.4g}".format(*estimate.interval),
            estimate.unit,
        )
    return table


def _weak_table(found: Identifiability) -> Table:
    columns = "combination", ">effect on forces", ">± std (sizes)"
    table = plain_table("unidentifiable and weakly identifiable combinations", *columns)
    for direction in found.unidentifiable:
        table.add_row(direction.text, "0", "unidentifiable")
    for direction in found.weak:
        table.add_row(direction.text, f"{direction.effect:.1e}", f"{direction.standard_error:.2g}")
    return table


def _essential_table(found: Identification) -> Table:
    columns = ("parameter", ">value", ">± std", ">robot file", "unit")
    table = plain_table("essential parameters; the others as in the robot file", *columns)
    result, prior = found.reduction.result, found.force_model.prior
    joints = set(found.force_model.joint_columns)
    for column, estimate in zip(found.reduction.columns, result.estimates, strict=True):
        known = f"{prior[column]:.4g}" if prior[column] or column not in joints else "-"
        numbers = f"{estimate.value:.4g}", f"{estimate.standard_error:.2g}", known
        table.add_row(found.force_model.base.expressions[column], *numbers, estimate.unit)
    return table


def _consistent_table(found: ConsistentFit) -> Table:
    columns = "body", ">mass (kg)", ">centre of mass (m)", ">margin"
    table = plain_table(f"physically consistent parameters ({found.regularisation})", *columns)
    for row in found.rows:
        centre = ", ".join(f"{row[axis]:.4g}" for axis in "xyz")
        table.add_row(row["body"], f"{row['mass']:.4g}", centre, f"{row['margin']:.2g}")
    return table


def _candidates_table(found: Identification) -> Table:
    """Prediction errors of the robot file, all parameters and the essential ones."""
    columns = [f">{candidate.name.removesuffix(' parameters')}" for candidate in found.candidates]
    title = "prediction errors on fitted and on new data: RMS ± std (R²)"
    table = plain_table(title, "", *columns)
    table.add_row("parameters fitted", *(str(c.fitted) for c in found.candidates))
    for k, actuator in enumerate(found.force_model.mechanism.independent):
        for part, name in enumerate(("fit", "new")):
            cells = []
            for candidate in found.candidates:
                quality = (candidate.training, candidate.validation)[part]
                rms, error = quality.residual_rms[k], candidate.rms_errors[part][k]
                cell = f"{rms:.3g}±{error:.2g} ({quality.r_squared[k]:.2f})"
                cells.append(cell if quality.samples[k] else "-")
            table.add_row(f"{actuator}, {name}", *cells)
    ratios = ["1", *("{:.2f} ± {:.2f}".format(*c.error_ratio) for c in found.candidates[1:])]
    table.add_row("squared error, new", *ratios)
    return table


def _terms_table(found: TermComparison) -> Table:
    """What each set of joint terms buys, with the bodies of the robot file and fitted ones."""
    columns = "terms", ">fitted", ">bodies of the robot file", ">fitted", ">bodies fitted"
    title = "joint terms: squared error on new data ± std, in error variances of the fit"
    table = plain_table(title, *columns)
    for each in found.sets:
        cells = [each.choice + (" (chosen)" if each is found.chosen else "")]
        for k in (0, 1):
            best = " enough" if each is found.enough[k] else ""
            cells += [str(each.parameters[k]), _error_text(each.errors[k]) + best]
        table.add_row(*cells)
    return table


def _noise_table(found: Identification) -> Table:
    columns = "", ">samples", ">effective", ">lag-one correlation"
    table = plain_table("residuals of the fit", *columns)
    noise = found.fit.noise
    if noise is not None:
        for k, actuator in enumerate(noise.actuators):
            counts = f"{noise.samples[k]:,}", f"{noise.effective_samples[k]:,.0f}"
            table.add_row(actuator, *counts, f"{noise.lag_one[k]:.3f}")
    return table


def _gains_table(found: Identification) -> Table:
    columns = "recording", "motor", ">gain", ">95 % interval"
    table = plain_table("measured forces over what bodies and other motors let expect", *columns)
    for one in found.suspicions:
        for gain in one.gains:
            interval = "{:.3g} ... {:.3g}".format(*gain.interval)
            table.add_row(one.recording, gain.joint, f"{gain.gain:.3g}", interval)
    return table


def _dropped_table(found: Identification) -> Table:
    table = plain_table("left out", "recording", "reason", ">samples", ">from (s)", ">to (s)")
    for recording in found.training:
        for dropped in recording.dropped:
            span = f"{dropped.first:.2f}", f"{dropped.last:.2f}"
            table.add_row(recording.name, dropped.reason, str(dropped.count), *span)
    return table


def identification_files(found: Identification) -> dict[str, bytes | str]:
    """Page, figures, record and results, by file name."""
    from loopid.report.identify_figures import identification_figures
    from loopid.saved import SavedFit

    record = identification_record(found)
    parts = [f"# Identification of {markdown_text(found.force_model.mechanism.name)}", ""]
    parts += [markdown_table(table) for table in identification_tables(found)]
    figures = identification_figures(found)
    parts += [
        f"![{text}]({figure}.svg)\n\n{text}\n"
        for figure, text in CAPTIONS.items()
        if f"{figure}.svg" in figures
    ]
    page, data, *names = RESULTS
    chosen = found.recommended_fit
    other = None if chosen is found.fit else found.fit
    fits = dict(zip(names, (chosen, other, found.consistent), strict=True))
    return {
        page: "\n".join(parts),
        data: json_text(record) + "\n",
        **{
            name: SavedFit.of(found.force_model, fit).content(name)
            for name, fit in fits.items()
            if fit is not None
        },
        **figures,
    }
