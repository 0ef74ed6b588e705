"""The record of ``loopid identify``: parameters, their uncertainty, how well they predict."""

from __future__ import annotations

import math
from typing import Any

from loopid.arrays import FloatArray
from loopid.experiment import Candidate, Identification
from loopid.experiment.candidate import NO_DIFFERENCE
from loopid.identification import Quality
from loopid.logs import Recording
from loopid.report.identify_consistent import consistent_sentences
from loopid.report.identify_support import support_record, support_sentences
from loopid.saved import SavedFit


def identification_record(found: Identification) -> dict[str, Any]:
    """All findings of an identification, ready for JSON."""
    model, consistent = found.force_model, found.consistent
    return {
        "mechanism": model.mechanism.name,
        "model": model.model,
        "actuators": list(model.mechanism.independent),
        "training": [_recording(recording) for recording in found.training],
        "validation": [_recording(recording) for recording in found.validation],
        "expressions": list(model.base.expressions),
        "robot_file": [float(value) for value in model.prior],
        "fit": SavedFit.of(model, found.fit).record(),
        "support": support_record(found.support),
        "consistent": consistent and SavedFit.of(model, consistent).record(),
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
        "training": _quality(candidate.training, candidate.rms_errors[0]),
        "validation": _quality(candidate.validation, candidate.rms_errors[1]),
        "error_ratio": _number(ratio),
        "error_ratio_standard_error": _number(error),
        "beats_baseline": candidate.beats_baseline,
    }


def _quality(quality: Quality, errors: FloatArray) -> dict[str, list[float | None]]:
    return {
        "rms": [_number(value) for value in quality.residual_rms],
        "rms_standard_error": [_number(value) for value in errors],
        "r_squared": [_number(value) for value in quality.r_squared],
    }


def _number(value: float) -> float | None:
    """JSON has neither infinity nor NaN: null instead."""
    return float(value) if math.isfinite(value) else None


def findings(found: Identification) -> list[str]:
    """What a reader should know before trusting the numbers, one sentence each."""
    full, supported = found.candidates[1], found.supported
    said = [_conditions(found), *support_sentences(found.support)]
    said += [] if found.consistent is None else consistent_sentences(found.consistent)
    said += [_compared(full), _compared(supported)]
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
        "unfiltered" if c is None else f"{c:.3g} Hz"
        for c in sorted(cutoffs, key=lambda c: c or 0.0)
    )
    return (
        f"Condition number of the weighted regressor: {found.fit.condition_number:.4g}; cut-off of "
        f"the filter: {filters}."
    )


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
