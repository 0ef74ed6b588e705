"""The report of ``loopid identify``: record, findings, tables, page, figures and files."""

from __future__ import annotations

from typing import Any

import numpy as np
from rich.table import Table

from loopid.diagnosis.log_mistakes import Suspicions
from loopid.diagnosis.selection import PredictionError
from loopid.diagnosis.study import Study
from loopid.diagnosis.term_sets import TermComparison
from loopid.identification.cutoff import CutoffChoice
from loopid.identification.information import Identifiability, WeakDirection
from loopid.identification.pipeline import Identification
from loopid.identification.prediction import Candidate, prediction_reach
from loopid.identification.result import FitResult
from loopid.identification.saved import SavedFit
from loopid.identification.terms import friction_columns, friction_curve, frictional_joints
from loopid.logs.recording import Recording
from loopid.regressors.joint_terms import NO_TERMS
from loopid.report.look import (
    BLUE,
    GREY,
    ORANGE,
    RED,
    RESULTS,
    THIN,
    drawing,
    drawn,
    force_panels,
    force_unit,
    json_fields,
    json_text,
    json_value,
    markdown_page,
    plain_log_labels,
    plain_table,
    rendered,
    thinned,
)

CAPTIONS = {
    "filter": "Cut-offs that were tried: errors on data that were not fitted, and how far "
    "predictions vary with the data.",
    "forces": "Forces on data that were not fitted.",
    "spectrum": "Structurally identifiable combinations, and their effect in the data.",
    "parameters": "Base parameters against the robot file.",
    "friction": "Friction of the motors over their rates with its 95 % band, and what is left of "
    "the fitted forces without all other parts of the model.",
}
# Of the least effect that is drawn, where unidentifiable combinations are drawn.
BELOW = 0.1
MOST, MARGIN = 0.95, 1.3  # quantile of its band, and times that, that an axis shows
CURVE_POINTS = 200  # of a friction curve on either side of standstill
LONGEST_LABEL = 28  # characters of a parameter's name beside its interval


def identification_record(study: Study, command: str | None = None) -> dict[str, Any]:
    """All findings of a study, ready for JSON.

    ``command`` is one that designs the motion to add, where who asks has commands.
    """
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
        "verdict": found.verdict,
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
            "command": command,
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
        "findings": findings(study, command),
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


def findings(study: Study, command: str | None = None) -> list[str]:
    """What a reader should know before trusting the numbers, one sentence each."""
    found = study.identification
    cutoffs = sorted({recording.cutoff for recording in found.training}, key=lambda c: c or 0.0)
    filters = ", ".join("unfiltered" if c is None else f"{c:.3g} Hz" for c in cutoffs)
    told, essential = found.identifiability, study.reduction.result.parameters.labels
    whole = found["all parameters"]
    said = [
        f"Condition number of the weighted regressor: {whole.fit.condition_number:.4g}; cut-off of "
        f"the filter: {filters}.",
        f"{told.structural_rank} combinations of parameters are structurally identifiable; the "
        f"data excite {told.rank} of them, and tell {told.well_determined} better than the robot "
        "file.",
    ]
    terms = found.force_model.joint_terms
    choice = NO_TERMS if terms is None else terms.choice(found.force_model.mechanism)
    said.append(f"Joint terms: {choice}.")
    runs = (*found.training, *found.validation)
    frames = dict.fromkeys(frame for run in runs for frame in run.wrenches)
    if frames:
        said.append(
            f"Measured wrenches of the surroundings on {', '.join(frames)} are part of the forces."
        )
    if found.delay is not None and found.delay.clear:
        said.append(f"{found.delay.sentence.capitalize()}.")
    said += [f"In {one.recording}, {text}." for one in study.suspicions for text in one.sentences]
    said.append(_terms_finding(study.term_sets))
    if found.cutoff is not None:
        said.append(_cutoff_finding(found.cutoff))
    if told.unidentifiable:
        said.append(
            "Unidentifiable combinations are as in the robot file, so the values of "
            f"{', '.join(told.assumed)} rest on it."
        )
    if told.unidentifiable or told.weak:
        designer = command or f"design_excitation with parameters={list(told.leads)}"
        said.append(
            "What is unidentifiable or weakly identifiable is excited by the motion that "
            f"{designer} designs."
        )
    said += [candidate.verdict for candidate in _candidates(study)[1:]]
    said.append(_recommendation(found))
    insignificant = whole.fit.insignificant()
    if insignificant or not whole.beats_baseline:
        said.append(
            "Of all parameters together, these are not significant (the 95 % interval includes "
            f"zero): {', '.join(insignificant) or 'none alone'}."
        )
    said.append(
        f"{len(essential)} of {len(whole.values)} parameters are essential for "
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
    good = found.chosen.errors[1].as_good
    return said if good else f'{said} Try terms="{found.enough[1].choice}".'


def _error_text(error: PredictionError) -> str:
    return f"{error.mean:.3g} ± {error.standard_error:.2g}"


def _cutoff_finding(choice: CutoffChoice) -> str:
    return (
        f"The cut-off of the filter is {choice.chosen:.3g} Hz, of {len(choice.cutoffs)} tried from "
        f"{choice.cutoffs[0]:.3g} to {choice.cutoffs[-1]:.3g} Hz: there fits of parts of the data "
        "predict the others well, and vary least."
    )


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


def identification_tables(study: Study, command: str | None = None) -> list[Table]:
    """Parameters, prediction errors, what was left out, findings."""
    found = study.identification
    told, name, whole = (
        found.identifiability,
        found.force_model.mechanism.name,
        found["all parameters"],
    )
    tables = [_estimates_table(f"{name}: all parameters by {whole.fit.estimator}", whole.fit)]
    if told.unidentifiable or told.weak:
        tables.append(_weak_table(told))
    tables.append(_essential_table(study))
    tables += [_candidates_table(study), _terms_table(study.term_sets)]
    tables += [_noise_table(whole.fit), _gains_table(study), _dropped_table(found)]
    if found.recommended is not whole:
        title = f"recommended: {found.recommended.name}"
        tables.append(_estimates_table(title, found.fit))
    if found.fit.standard_parameters is not None:
        tables.append(_bodies_table(found))
    return [*tables, plain_table("findings", ("",), ([text] for text in findings(study, command)))]


def _estimates_table(title: str, fit: FitResult) -> Table:
    rows = (
        (
            estimate.name,
            f"{estimate.value:.4g}",
            f"{estimate.standard_error:.2g}",
            f"{estimate.relative_std:.1f}",
            "{:.4g} ... {:.4g}".format(*estimate.interval),
            estimate.unit,
        )
        for estimate in fit.estimates
    )
    columns = ("leading parameter", ">value", ">± std", ">std %", ">95 % interval", "unit")
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


def _candidates_table(study: Study) -> Table:
    """Prediction errors of the robot file, all parameters and the essential ones."""
    found, candidates, rows = study.identification, _candidates(study), list[list[object]]()
    rows.append(["parameters fitted", *(c.fitted for c in candidates)])
    for k, actuator in enumerate(found.force_model.mechanism.independent):
        for part, name in enumerate(("fit", "new")):
            rows.append([f"{actuator}, {name}"])
            for candidate in candidates:
                quality = (candidate.training, candidate.validation)[part]
                rms, error = quality.residual_rms[k], candidate.rms_errors[part][k]
                cell = f"{rms:.3g}±{error:.2g} ({quality.r_squared[k]:.2f})"
                rows[-1].append(cell if quality.samples[k] else "-")
    ratios = ("{:.2f} ± {:.2f}".format(*c.error_ratio) for c in candidates[1:])
    rows.append(["squared error, new", "1", *ratios])
    columns = "", *(f">{candidate.name.removesuffix(' parameters')}" for candidate in candidates)
    title = "prediction errors on fitted and on new data: RMS ± std (R²)"
    return plain_table(title, columns, rows)


def _terms_table(found: TermComparison) -> Table:
    """What each set of joint terms buys, with the bodies of the robot file and fitted ones."""
    rows = []
    for each in found.sets:
        rows.append([each.choice + (" (chosen)" if each is found.chosen else "")])
        for k in (0, 1):
            best = " enough" if each is found.enough[k] else ""
            rows[-1] += [str(each.parameters[k]), _error_text(each.errors[k]) + best]
    columns = "terms", ">fitted", ">bodies of the robot file", ">fitted", ">bodies fitted"
    title = "joint terms: squared error on new data ± std, in error variances of the fit"
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


def identification_files(study: Study, command: str | None = None) -> dict[str, bytes | str]:
    """Page, figures, record and results, by file name."""
    figures, found = identification_figures(study), study.identification
    captions = {name: text for name, text in CAPTIONS.items() if f"{name}.svg" in figures}
    title = f"Identification of {found.force_model.mechanism.name}"
    page, data, *names = RESULTS
    whole = found["all parameters"]
    other = None if found.recommended is whole else whole.fit
    fits = dict(zip(names, (found.fit, other), strict=True))
    return {
        page: markdown_page(title, identification_tables(study, command), captions),
        data: json_text(identification_record(study, command)) + "\n",
        **{
            name: SavedFit.of(found.force_model, fit).content(name)
            for name, fit in fits.items()
            if fit is not None
        },
        **figures,
    }


def identification_figures(study: Study) -> dict[str, bytes]:
    """All figures as SVG and PNG, by file name."""
    found = study.identification
    spectrum = draw_spectrum(found.identifiability)
    friction = draw_friction(found)
    return draw_forces(study) | spectrum | draw_parameters(found) | friction | draw_filter(study)


def draw_filter(study: Study) -> dict[str, bytes]:
    """Errors and spread of predictions at the cut-offs that were tried, where there were any."""
    choice = study.identification.cutoff
    if choice is None:
        return {}
    with drawing(height=1.8) as (figure, axes):
        ax = axes[0, 0]
        ax.plot(choice.cutoffs, 100 * choice.errors, "o-", color=BLUE, markersize=2.5)
        ax.plot(choice.cutoffs, 100 * choice.spreads, "s--", color=GREY, markersize=2.5)
        ax.axvline(choice.chosen, color=RED, linewidth=0.8)
        ax.set(xscale="log", yscale="log", xlabel="cut-off (Hz)", ylabel="part of the force (%)")
        ax.set_title(f"predictions below {choice.judged:.3g} Hz of data that were not fitted")
        for axis in (ax.xaxis, ax.yaxis):
            plain_log_labels(axis, (1.0, 2.0, 5.0))
        names = "error", "deviation of the predictions", "chosen"
        figure.legend(ax.lines, names, loc="outside lower center", ncols=3)
        return rendered(figure, "filter")


def draw_forces(study: Study) -> dict[str, bytes]:
    """Forces of each actuator on the first validation recording, measured and predicted."""
    found = study.identification
    recording, mechanism = found.validation[0], found.force_model.mechanism
    rows = thinned(len(recording))
    gaps, W = ~recording.used[rows], found.new.regressor[rows]
    measured, by_file, fitted = (
        np.where(gaps, np.nan, force)  # lines break where the force says nothing
        for force in (recording.force[rows], W @ found.baseline.values, W @ found.fit.values)
    )
    lines = (
        (measured, "measured", THIN),
        (by_file, "robot file, joint terms", {"color": BLUE, "linestyle": "--"}),
        (fitted, "recommended", {"color": RED}),
    )
    panels = {drawn(joint): force_unit(mechanism, joint) for joint in mechanism.independent}
    band = prediction_reach(W, found.fit.covariance), "its 95 % interval"
    with drawing(len(panels), height=1.3) as (figure, axes):
        force_panels(figure, axes, recording.motion.time[rows], lines, panels, band)
        return rendered(figure, "forces")


def draw_friction(found: Identification) -> dict[str, bytes]:
    """Friction of each motor by the recommended fit, over the forces that it explains."""
    fit, data, mechanism = found.fit, found.data, found.force_model.mechanism
    joints = [joint for joint in frictional_joints(fit) if joint in data.actuators]
    if not joints:
        return {}
    velocities = np.concatenate([run.motion.velocities for run in found.training])
    rows = thinned(len(data))
    with drawing(len(joints), height=1.3) as (figure, axes):
        for ax, joint in zip(axes[:, 0], joints, strict=True):
            k = data.actuators.index(joint)
            rate, used = velocities[rows, k], data.used[rows, k]
            own = friction_columns(fit, joint)
            left = data.residual(fit.values)[rows, k]
            left = left + data.regressor[rows, k][:, own] @ fit.values[own]
            dots = {"color": GREY, "alpha": 0.5, "markersize": 3, "markeredgewidth": 0}
            ax.plot(rate[used], left[used], ".", label="data less all else", **dots)
            fastest = float(np.abs(rate).max(initial=0.0)) or 1.0
            rates = fastest * np.linspace(-1, 1, 2 * CURVE_POINTS)  # none is 0, where it jumps
            curve = friction_curve(fit, joint, rates, joint_terms=found.force_model.joint_terms)
            sure = bool(np.isfinite(curve.band).all())
            for half in (slice(CURVE_POINTS), slice(CURVE_POINTS, None)):
                ax.plot(rates[half], curve.values[half], color=RED, label="friction")
                band = (curve.band if sure else np.full(curve.band.shape, np.nan))[half].T
                look = {"color": RED, "alpha": 0.3, "linewidth": 0}
                ax.fill_between(rates[half], *band, label="its 95 % band", **look)
            unit = force_unit(mechanism, joint)
            # Next to standstill hardly anything is known: bands there would flatten the rest.
            most = MARGIN * float(np.quantile(np.abs(curve.band), MOST)) if sure else None
            ax.set(title=drawn(joint), ylabel=f"friction ({unit})")
            if most:
                ax.set_ylim(-most, most)
        slides = mechanism.velocity_indices(joints[-1:])[0] in mechanism.prismatic
        axes[-1, 0].set_xlabel(f"rate ({'m/s' if slides else 'rad/s'})")
        handles, labels = axes[0, 0].get_legend_handles_labels()
        once = dict(zip(labels, handles, strict=True))
        figure.legend(once.values(), once, loc="outside lower center", ncols=3)
        return rendered(figure, "friction")


def draw_spectrum(found: Identifiability) -> dict[str, bytes]:
    """Effects of the combinations on forces: in random states of the robot, and in the data."""
    structural, effects = 100 * found.excitation.structural, 100 * found.excitation.effects
    place, rank, sure = 1 + np.arange(len(effects)), found.rank, found.well_determined
    known, weak, none = slice(0, sure), slice(sure, rank), slice(rank, None)
    shown = np.append(structural[structural > 0], effects[:rank])
    floor = np.full(len(effects), BELOW * shown.min(initial=1.0))
    with drawing(height=2.3) as (figure, axes):
        ax = axes[0, 0]
        ax.plot(place, structural, "o-", color=GREY, markersize=2.5, linewidth=0.6)
        ax.plot(place[known], effects[known], "o", color=BLUE, markersize=3.5)
        ax.plot(place[weak], effects[weak], "s", color=ORANGE, markersize=3.5)
        ax.plot(place[none], floor[none], "v", color=RED, markersize=4)
        labels = "structure", "data", "weak: worse than the robot file", "unidentifiable: no effect"
        there = [True, sure > 0, rank > sure, rank < len(effects)]
        handles = [line for line, drawn in zip(ax.lines, there, strict=True) if drawn]
        names = [name for name, drawn in zip(labels, there, strict=True) if drawn]
        ax.set(yscale="log", xlabel="combination of parameters", ylabel="effect on forces (%)")
        ax.set_title("singular spectrum: one size of each combination")
        plain_log_labels(ax.yaxis, (1.0,))
        figure.legend(handles, names, loc="outside lower center", ncols=2)
        return rendered(figure, "spectrum")


def draw_parameters(found: Identification) -> dict[str, bytes]:
    """Intervals of all parameters about the robot file's values, in standard errors."""
    whole = found.recommended is found.baseline
    fit = found["all parameters"].fit if whole else found.fit
    labels, error = fit.parameters.labels, fit.standard_errors
    bodies = found.force_model.body_columns
    place = np.arange(len(bodies))[::-1]
    offset = (fit.values - found.force_model.prior)[bodies] / error[bodies]
    reach = np.ptp(fit.intervals(), axis=1) / 2
    with drawing(height=0.7 + 0.16 * len(bodies)) as (figure, axes):
        ax = axes[0, 0]
        bars = (reach / error)[bodies]
        ax.errorbar(offset, place, xerr=bars, fmt="o", color=BLUE, markersize=3, linewidth=1)
        ax.axvline(0.0, color=GREY, linewidth=0.8)
        names = [
            f"{drawn(labels[j], LONGEST_LABEL)}  ±{reach[j]:.2g} {fit.parameters[j].unit}"
            for j in bodies
        ]
        ax.set_yticks(place, names)
        figure.suptitle("base parameters against the robot file", fontsize=8)
        figure.supxlabel("fit less robot file, in standard errors (bars: 95 %)", fontsize=7.5)
        return rendered(figure, "parameters")
