"""The tables of ``loopid identify``."""

from __future__ import annotations

from rich.table import Table

from loopid.experiment import Candidate, Identification
from loopid.report.identify import findings
from loopid.report.identify_consistent import consistent_table
from loopid.report.identify_support import support_table
from loopid.report.tables import plain_table


def identification_tables(found: Identification) -> list[Table]:
    """Parameters, prediction errors, what was left out, findings."""
    return [
        _parameter_table(found),
        *([support_table(found.support)] if found.support.weak else []),
        _supported_table(found),
        *([] if found.consistent is None else [consistent_table(found.consistent)]),
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
    columns = [f">{candidate.name.removesuffix(' parameters')}" for candidate in found.candidates]
    title = "prediction errors on fitted and on new data: RMS ± std (R²)"
    table = plain_table(title, "", *columns)
    table.add_row("parameters fitted", *(str(c.fitted) for c in found.candidates))
    for k, actuator in enumerate(found.force_model.mechanism.independent):
        for part, name in enumerate(("fit", "new")):
            cells = (_quality_cell(candidate, part, k) for candidate in found.candidates)
            table.add_row(f"{actuator}, {name}", *cells)
    ratios = ["1", *("{:.2f} ± {:.2f}".format(*c.error_ratio) for c in found.candidates[1:])]
    table.add_row("squared error, new", *ratios)
    return table


def _quality_cell(candidate: Candidate, part: int, k: int) -> str:
    quality = (candidate.training, candidate.validation)[part]
    rms, error = quality.residual_rms[k], candidate.rms_errors[part][k]
    if not quality.samples[k]:
        return "-"
    return f"{rms:.3g}±{error:.2g} ({quality.r_squared[k]:.2f})"


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
