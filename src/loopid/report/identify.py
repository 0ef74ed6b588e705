"""The report of ``loopid identify``: parameters, their uncertainty, how well they predict."""

from __future__ import annotations

import math
from typing import Any

from rich.table import Table

from loopid.experiment import Candidate, Identification
from loopid.experiment.candidate import NO_DIFFERENCE
from loopid.identification import Quality
from loopid.logs import Recording
from loopid.report.style import plain_table


def identification_record(found: Identification) -> dict[str, Any]:
    """All findings of an identification, ready for JSON."""
    model = found.force_model
    return {
        "mechanism": model.mechanism.name,
        "model": model.model,
        "actuators": list(model.mechanism.actuated),
        "training": [_recording(recording) for recording in found.training],
        "validation": [_recording(recording) for recording in found.validation],
        "expressions": list(model.base.expressions),
        "robot_file": [float(value) for value in model.prior],
        "fit": found.fit.record(),
        "supported": [float(value) for value in found.supported.values],
        "supported_corrections": list(found.reduction.result.parameters.labels),
        "candidates": [_candidate(candidate) for candidate in found.candidates],
        "findings": findings(found),
    }


def _recording(recording: Recording) -> dict[str, Any]:
    return {
        "name": recording.name,
        "samples": len(recording),
        "used": [int(count) for count in recording.used.sum(axis=0)],
        "cutoff": recording.cutoff,
        "dropped": [str(dropped) for dropped in recording.dropped],
    }


def _candidate(candidate: Candidate) -> dict[str, Any]:
    ratio, error = candidate.error_ratio
    return {
        "name": candidate.name,
        "fitted": candidate.fitted,
        "training": _quality(candidate.training),
        "validation": _quality(candidate.validation),
        "error_ratio": _number(ratio),
        "error_ratio_standard_error": _number(error),
        "beats_baseline": candidate.beats_baseline,
    }


def _quality(quality: Quality) -> dict[str, list[float | None]]:
    return {
        "rms": [_number(value) for value in quality.residual_rms],
        "r_squared": [_number(value) for value in quality.r_squared],
    }


def _number(value: float) -> float | None:
    """JSON has neither infinity nor NaN: null instead."""
    return float(value) if math.isfinite(value) else None


def findings(found: Identification) -> list[str]:
    """What a reader should know before trusting the numbers, one sentence each."""
    full, supported = found.candidates[1], found.supported
    said = [_conditions(found), _compared(full), _compared(supported)]
    weak = found.fit.unsupported()
    if weak or not full.beats_baseline:
        said.append(
            "Of all parameters together, the data do not tell these from zero: "
            f"{', '.join(weak) or 'none alone'}."
        )
    kept = found.reduction.result.parameters.labels
    said.append(
        f"The data support {len(kept)} of {len(found.fit.parameters)} parameters; their ± holds if "
        "the others are as in the robot file, and joint terms that are left out are zero."
    )
    return said


def _conditions(found: Identification) -> str:
    cutoffs = {recording.cutoff for recording in found.training}
    filters = ", ".join(
        "unfiltered" if c is None else f"{c:.3g} Hz" for c in sorted_cutoffs(cutoffs)
    )
    return (
        f"Condition number of the weighted regressor: {found.fit.condition_number:.4g}; cut-off of "
        f"the filter: {filters}."
    )


def sorted_cutoffs(cutoffs: set[float | None]) -> list[float | None]:
    """Cut-off frequencies, none first."""
    return sorted(cutoffs, key=lambda cutoff: cutoff or 0.0)


def _compared(candidate: Candidate) -> str:
    ratio, error = candidate.error_ratio
    verdict = "better than" if candidate.beats_baseline else "not clearly better than"
    if ratio - 1 > 2 * error + NO_DIFFERENCE:
        verdict = "worse than"
    return (
        f"With {candidate.name} the mean squared error on data that were not fitted is "
        f"{ratio:.2f} ± {error:.2f} times that of the robot file with fitted joint terms: "
        f"{verdict} it."
    )


def identification_tables(found: Identification) -> list[Table]:
    """Parameters, prediction errors, what was left out, findings."""
    return [
        _parameter_table(found),
        _supported_table(found),
        candidates_table(found),
        _noise_table(found),
        _dropped_table(found),
        _findings_table(found),
    ]


def _parameter_table(found: Identification) -> Table:
    title = f"{found.force_model.mechanism.name}: all parameters by {found.fit.estimator}"
    columns = ("leading parameter", ">value", ">± std", ">std %", ">95 % interval", "unit")
    table = plain_table(title, *columns)
    for estimate in found.fit.estimates:
        table.add_row(
            estimate.name,
            f"{estimate.value:.4g}",
            f"{estimate.standard_error:.2g}",
            f"{estimate.relative_std:.1f}",
            "{:.4g} ... {:.4g}".format(*estimate.interval),
            estimate.unit,
        )
    return table


def _supported_table(found: Identification) -> Table:
    columns = ("parameter", ">value", ">± std", ">robot file", "unit")
    table = plain_table("what the data support; the rest as in the robot file", *columns)
    result, prior = found.reduction.result, found.force_model.prior
    joints = set(found.force_model.joint_columns)
    rows = zip(found.reduction.columns, result.estimates, strict=True)
    for column, estimate in rows:
        known = "-" if column in joints else f"{prior[column]:.4g}"
        numbers = f"{estimate.value:.4g}", f"{estimate.standard_error:.2g}", known
        table.add_row(found.force_model.base.expressions[column], *numbers, estimate.unit)
    return table


def candidates_table(found: Identification) -> Table:
    """Prediction errors of the robot file, all parameters and the supported ones."""
    columns = [f">{candidate.name}" for candidate in found.candidates]
    table = plain_table("prediction errors on fitted and on new data: RMS (R²)", "", *columns)
    table.add_row("parameters fitted", *(str(c.fitted) for c in found.candidates))
    for k, actuator in enumerate(found.force_model.mechanism.actuated):
        for part, name in (("training", "fitted"), ("validation", "new")):
            qualities = [getattr(candidate, part) for candidate in found.candidates]
            table.add_row(f"{actuator}, {name}", *(_quality_cell(q, k) for q in qualities))
    ratios = ["1", *("{:.2f} ± {:.2f}".format(*c.error_ratio) for c in found.candidates[1:])]
    table.add_row("squared error, new", *ratios)
    return table


def _quality_cell(quality: Quality, k: int) -> str:
    return f"{quality.residual_rms[k]:.3g} ({quality.r_squared[k]:.3f})"


def _noise_table(found: Identification) -> Table:
    table = plain_table("errors of the fit", "", ">samples", ">effective", ">lag-one correlation")
    noise = found.fit.noise
    if noise is not None:
        for k, actuator in enumerate(noise.actuators):
            counts = f"{noise.samples[k]:,}", f"{noise.effective_samples[k]:,.0f}"
            table.add_row(actuator, *counts, f"{noise.lag_one[k]:.3f}")
    return table


def _dropped_table(found: Identification) -> Table:
    table = plain_table("left out", "recording", "reason", ">samples", ">from (s)", ">to (s)")
    for recording in found.training:
        for dropped in recording.dropped:
            span = f"{dropped.first:.2f}", f"{dropped.last:.2f}"
            table.add_row(recording.name, dropped.reason, str(dropped.count), *span)
    return table


def _findings_table(found: Identification) -> Table:
    table = plain_table("findings", "")
    for sentence in findings(found):
        table.add_row(sentence)
    return table
