"""Results on axes of matplotlib, for notebooks and papers; each function returns its axes."""

from __future__ import annotations

from typing import Any

import numpy as np

from loopid.arguments import FloatArray, checked
from loopid.errors import OptionError
from loopid.identification.prediction import Prediction
from loopid.identification.result import FitResult
from loopid.identification.terms import FrictionCurve
from loopid.view.scene import Pose

__all__ = ["plot_forces", "plot_friction", "plot_parameters", "plot_residual", "plot_robot"]
BLUE, ORANGE, GREEN, GREY = "#0072B2", "#E69F00", "#009E73", "#666666"


@checked
def plot_forces(found: Prediction, motor: str, ax: Any) -> Any:
    """Measured and predicted forces of a motor over time.

    Examples
    --------
    >>> import loopid
    >>> from matplotlib.figure import Figure
    >>> robot = loopid.load_mechanism("five_bar")
    >>> recording = loopid.prepare_recording(
    ...     robot, loopid.read_log(robot.path.parent / "logs" / "five_bar.csv", robot))
    >>> found = loopid.identify(loopid.find_force_model(robot, "full"), [recording])
    >>> prediction = loopid.predict(found.fit, found.force_model, recording)
    >>> axes = Figure().subplots(2)
    >>> len(loopid.plots.plot_forces(prediction, "left_crank_joint", axes[0]).lines)
    2
    >>> len(loopid.plots.plot_residual(prediction, "left_crank_joint", axes[1]).lines)
    1
    """
    k, time = _column(found, motor), found.recording.motion.time
    # What is predicted hides nothing of what was measured.
    ax.plot(time, found.recording.force[:, k], color=GREY, linewidth=0.6, label="measured")
    ax.plot(time, found.predicted[:, k], color=BLUE, linewidth=1.0, label="predicted")
    ax.set(xlabel="time (s)", ylabel="force (N or N m)")
    ax.set_title(motor, parse_math=False)
    ax.legend()
    return ax


def _column(found: Prediction, motor: str) -> int:
    if motor not in found.recording.actuators:
        raise OptionError.unknown("motor", motor, found.recording.actuators)
    return found.recording.actuators.index(motor)


@checked
def plot_residual(found: Prediction, motor: str, ax: Any) -> Any:
    """Measured less predicted forces of a motor over time."""
    k = _column(found, motor)
    ax.plot(found.recording.motion.time, found.residual[:, k], color=ORANGE, linewidth=0.6)
    ax.set(xlabel="time (s)", ylabel="residual (N or N m)")
    return ax


@checked
def plot_friction(curve: FrictionCurve, ax: Any) -> Any:
    """Friction of a joint over its rate, with its 95 % band."""
    (line,) = ax.plot(curve.rates, curve.values, label=curve.joint)
    ax.fill_between(curve.rates, *curve.band.T, color=line.get_color(), alpha=0.3, linewidth=0)
    ax.set(xlabel="rate (m/s or rad/s)", ylabel="friction (N or N m)")
    return ax


@checked
def plot_parameters(fit: FitResult, ax: Any, file: FloatArray | None = None) -> Any:
    """Values with 95 % intervals, each in units of its own size; beside those (n,) of the file."""
    values, intervals = fit.values, fit.intervals()
    intervals = np.where(np.isfinite(intervals), intervals, values[:, None])  # none is told
    size = np.maximum(np.abs(values), np.abs(intervals).max(axis=1) / 3)
    size[size == 0] = 1.0
    rows = np.arange(len(values))
    reach = np.abs(intervals - values[:, None]).T / size
    ax.errorbar(values / size, rows, xerr=reach, fmt="o", color=BLUE, label="fit, 95 %")
    if file is not None:
        ax.plot(file / size, rows, "|", color=ORANGE, markersize=10, label="robot file")
    ax.axvline(0.0, color=GREY, linewidth=0.6)
    ax.set_yticks(rows, fit.parameters.labels, parse_math=False)  # names may hold anything
    ax.set_xlabel("each in units of its own size")
    ax.invert_yaxis()
    ax.legend()
    return ax


@checked
def plot_robot(pose: Pose, ax: Any) -> Any:
    """A robot at a pose, on axes in three dimensions: rods, and balls where loops are closed."""
    for rod in pose.rods:
        ax.plot(*rod.T, color=GREY, linewidth=3)
    ax.scatter(*pose.closures.mean(axis=1).T, color=GREEN, s=40)
    ax.set(aspect="equal", title=f"open by {pose.residual:.0e} m")
    return ax
