"""Figures of an identification: predicted forces, spectrum, parameters, how many are essential."""

from __future__ import annotations

import numpy as np

from loopid.arrays import BoolArray, FloatArray
from loopid.experiment import Identifiability, Identification, prediction_reach
from loopid.report.figures import (
    BLUE,
    GREY,
    ORANGE,
    RED,
    drawing,
    drawn,
    plain_log_labels,
    rendered,
    thinned,
)

# Of the least effect that is drawn, where unidentifiable combinations are drawn.
BELOW = 0.1
LEAST_DENSITY = 1e-9  # of the largest, of a spectrum that is drawn
LONGEST_LABEL = 28  # characters of a parameter's name beside its interval


def identification_figures(found: Identification) -> dict[str, bytes]:
    """All figures as SVG and PNG, by file name."""
    spectrum = draw_spectrum(found.identifiability)
    rest = draw_forces(found) | spectrum | draw_parameters(found) | draw_reduction(found)
    return rest | draw_filter(found)


def draw_filter(found: Identification) -> dict[str, bytes]:
    """Spectrum of the first log, and how estimates move at lower cut-offs, where known."""
    recording, sweep = found.training[0], found.sweep
    if recording.spectrum is None or sweep is None:
        return {}
    told = recording.spectrum
    with drawing(2, height=1.6) as (figure, axes):
        ax, below = axes[:, 0]
        ax.plot(told.frequency, told.density, color=BLUE)
        ax.plot(told.frequency, told.noise, "--", color=GREY)
        ax.axvline(recording.cutoff, color=RED)
        largest = told.density.max()
        ax.set(xscale="log", yscale="log", xlabel="frequency (Hz)", ylabel="density (1/Hz)")
        ax.set(ylim=(LEAST_DENSITY * largest, 3 * largest), title="accelerations of the motors")
        for axis in (ax.xaxis, ax.yaxis):
            plain_log_labels(axis, (1.0,))
        names = "in the log", "noise of the positions", "cut-off"
        figure.legend(ax.lines, names, loc="outside lower center", ncols=3)
        change = sweep.shifts / sweep.deviations
        parts, change = np.append(1.0, sweep.parts), np.vstack([0 * change[:1], change])
        for name, moves in zip(found.fit.parameters.labels, change.T, strict=True):
            clear = name in sweep.moved
            below.plot(parts, moves, color=RED if clear else GREY, linewidth=1.2 if clear else 0.5)
        below.set(xlabel="cut-off, in parts of the one chosen", ylabel="change / noise")
        below.set_title("estimates at lower cut-offs")
        return rendered(figure, "filter")


def draw_forces(found: Identification) -> dict[str, bytes]:
    """Forces of each actuator on the first validation recording, measured and predicted."""
    recording, joints = found.validation[0], found.force_model.mechanism.independent
    rows = thinned(len(recording))
    time, gaps = recording.motion.time[rows], ~recording.used[rows]
    W = found.samples[1].regressor[rows]
    baseline, essential = W @ found.baseline.values, W @ found.essential.values
    reach = prediction_reach(W, found.essential.covariance)
    with drawing(len(joints), height=1.3) as (figure, axes):
        for k, (ax, joint) in enumerate(zip(axes[:, 0], joints, strict=True)):
            ax.plot(time, _broken(recording.force[rows], gaps, k), color=GREY, linewidth=0.6)
            ax.plot(time, _broken(baseline, gaps, k), "--", color=BLUE)
            line = _broken(essential, gaps, k)
            ends = line - reach[:, k], line + reach[:, k]
            ax.plot(time, line, color=RED)
            ax.fill_between(time, *ends, color=RED, alpha=0.3, linewidth=0)
            ax.set(title=drawn(joint), ylabel=f"force ({force_unit(found, joint)})")
        axes[-1, 0].set_xlabel("time (s)")
        labels = ("measured", "robot file, joint terms", "essential", "its 95 % interval")
        handles = [*axes[0, 0].lines, *axes[0, 0].collections]
        figure.legend(handles, labels, loc="outside lower center", ncols=2)
        return rendered(figure, "forces")


def force_unit(found: Identification, joint: str) -> str:
    """Unit of an actuator's force: N where it slides, N m where it turns."""
    mechanism = found.force_model.mechanism
    return "N" if mechanism.velocity_indices([joint])[0] in mechanism.prismatic else "N m"


def _broken(values: FloatArray, gaps: BoolArray, k: int) -> FloatArray:
    """One column, with breaks where the force says nothing."""
    return np.where(gaps[:, k], np.nan, values[:, k])


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
    labels, error = found.fit.parameters.labels, found.fit.standard_errors
    bodies = found.force_model.body_columns
    place = np.arange(len(bodies))[::-1]
    offset = (found.fit.values - found.force_model.prior)[bodies] / error[bodies]
    reach = np.ptp(found.fit.intervals(), axis=1) / 2
    with drawing(height=0.7 + 0.16 * len(bodies)) as (figure, axes):
        ax = axes[0, 0]
        bars = (reach / error)[bodies]
        ax.errorbar(offset, place, xerr=bars, fmt="o", color=BLUE, markersize=3, linewidth=1)
        ax.axvline(0.0, color=GREY, linewidth=0.8)
        names = [
            f"{drawn(labels[j], LONGEST_LABEL)}  ±{reach[j]:.2g} {found.fit.parameters[j].unit}"
            for j in bodies
        ]
        ax.set_yticks(place, names)
        figure.suptitle("base parameters against the robot file", fontsize=8)
        figure.supxlabel("fit less robot file, in standard errors (bars: 95 %)", fontsize=7.5)
        return rendered(figure, "parameters")


def draw_reduction(found: Identification) -> dict[str, bytes]:
    """Validation error by the number of fitted parameters, and the number that was chosen."""
    steps = found.reduction.steps
    count = np.array([len(step.labels) for step in steps])
    error = np.array([step.validation_error for step in steps])
    spread = np.array([step.standard_error for step in steps])
    with drawing(height=2.0) as (figure, axes):
        ax = axes[0, 0]
        ax.errorbar(count, error, yerr=spread, fmt="o-", color=BLUE, markersize=3, label="± 1 std")
        chosen = len(found.reduction.chosen.labels)
        ax.axvline(chosen, color=ORANGE, linestyle="--", label="essential")
        ax.set(xlabel="parameters taken from the data", ylabel="validation error (weighted)")
        ax.set(title="how many parameters are essential", yscale="log")
        plain_log_labels(ax.yaxis)
        ax.legend()
        return rendered(figure, "reduction")
