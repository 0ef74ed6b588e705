"""Pictures of forces and of several fits."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np

from loopid.arguments import FloatArray, checked, shaped, spread_rows
from loopid.errors import OptionError
from loopid.identification.estimates import Estimate
from loopid.identification.prediction import Prediction
from loopid.identification.result import Fit
from loopid.numbers import NORMAL_95, interval, number, with_error
from loopid.plots.chart import MOST_DOTS, Chart, Mark, Panel, forest, segments
from loopid.plots.structure import motor_numbers
from loopid.regressors.joint_laws import grouped
from loopid.robot.robot import Robot

ROOM = 1.06  # times the largest error, that an axis shows
RUNS = "fit", "file", "other", "weak", "measured", "faint"  # looks of fits beside each other
BESIDE = 3  # fits that a panel has room for
NOT_JUDGED = "not judged: stands or is saturated"
ZOOM = "Drag along time to zoom in, double-click to see all again."


def of_motor(robot: Robot, name: str, worst: str = "") -> dict[str, Any]:
    """What a panel says of a motor: name, number, and whether it is the worst."""
    return {"motor": name, "number": motor_numbers(robot)[name], "worst": name == worst}


def motors_panel(
    robot: Robot,
    title: str,
    values: Mapping[str, Sequence[float]],
    right: float,
    words: tuple[str, str, str] = ("", "differs", "as expected"),
) -> Panel:
    """Values of motors with the ends of their intervals; without ends they are undetermined."""
    found = np.array([*values.values()]).reshape(-1, 3)
    found[~np.isfinite(found).all(axis=1)] = np.nan
    columns = {
        "value": tuple(with_error(x, (high - low) / 2)[0] for x, low, high in found.tolist()),
        "95 % interval": tuple(interval(low, high) for _, low, high in found.tolist()),
    }
    labels = tuple(numbered(robot, name) for name in values)
    return forest(title, found, right, words, labels=labels, columns=columns)


def numbered(robot: Robot, name: str) -> str:
    """A joint, a motor with its number on the page."""
    number = motor_numbers(robot).get(name)
    return f"{number} {name}" if number else name


@checked
def forces_chart(
    robot: Robot,
    found: Prediction,
    *,
    motors: Sequence[str] | None = None,
    file: FloatArray | None = None,
    worst: str = "",
    name: str = "forces",
) -> Chart:
    """Measured forces of each motor over time, and below them what predictions leave of them.

    What is left by the robot file and by the fit has one scale a motor.

    Parameters
    ----------
    robot : Robot
    found : Prediction
    motors : sequence of str, optional
        Some of the motors, in the order in which they are shown.
    file : FloatArray, optional
        (N, dof), the forces that the robot file predicts.
    worst : str
        The motor that is marked.
    name : str
        Of the chart.

    Returns
    -------
    Chart

    Examples
    --------
    >>> import loopid
    >>> robot = loopid.load("five_bar")
    >>> found = loopid.identify(robot, "urdf/logs/five_bar.csv")
    >>> prediction = found.fit.predict("urdf/logs/five_bar.csv")
    >>> loopid.plots.forces_chart(robot, prediction, motors=["left_crank_joint"]).panels[0].title
    'measured force (N m)'
    """
    run, panels = found.recording, list[Panel]()
    time = run.motion.time
    predictions, some = {"fit": ("this fit", found.predicted)}, spread_rows(len(run), MOST_DOTS)
    if file is not None:
        file = shaped(file, "file", *run.force.shape)
        predictions = {"file": ("the robot file", file), **predictions}
    chosen = run.actuators if motors is None else motors
    for motor in chosen:
        OptionError.require("motor", motor, run.actuators)
        k = run.actuators.index(motor)
        used, force, unit = run.used[:, k], run.force[:, k], robot.units(motor)[1]
        first, end = segments(~used).T
        ends = time[np.minimum(end, len(time) - 1)]
        shade = Mark(NOT_JUDGED, time[first], np.zeros(len(first)), "faint", "shade", ends)
        measured = Mark("measured force", time, force, "measured")
        said = of_motor(robot, motor, worst)
        panels.append(Panel(f"measured force ({unit})", (shade, measured), small=True, **said))
        every = predictions.items()
        left = {look: np.where(used, force - each[:, k], np.nan) for look, (_, each) in every}
        most = ROOM * max(float(np.nanmax(np.abs(y), initial=0.0)) for y in left.values()) or 1.0
        for look, (by, _) in predictions.items():
            rms = float(np.sqrt(np.nanmean(left[look] ** 2))) if used.any() else np.nan
            line = Mark(f"measured less {by}", time, left[look], look)
            zero = Mark("", time[[0, -1]], np.zeros(2), "faint")
            title = f"left by {by} ({unit}), rms {number(rms, 2)}"
            marks = [shade, zero, line]
            if found.reach is not None and look == "fit":
                half = found.reach[some, k]
                marks.insert(2, Mark("95 % of new forces", time[some], -half, look, "band", half))
            panels.append(Panel(title, tuple(marks), y_limits=(-most, most), small=True))
    caption = f"Of {run.name}. Lanes of errors have one scale a motor. {ZOOM}"
    lanes = 1 + len(predictions)
    columns = 3 if len(panels) == 3 * lanes else 2
    return Chart(name, caption, "time (s)", tuple(panels), columns, lanes, run.name)


def alone(fit: Fit) -> list[Estimate]:
    """Base parameters of a fit without points of curves, which say nothing alone."""
    pairs = zip(fit.parameters, fit.estimates, strict=True)
    return [each for parameter, each in pairs if not grouped(parameter.kind)]


@checked
def comparison_chart(fits: Mapping[str, Fit], *, clear: Collection[str] = ()) -> Chart:
    """Values of fits by the name of their run with 95 % intervals, each less their mean.

    Of more than three fits three have a panel. Clear are expressions that are said to differ.

    Parameters
    ----------
    fits : mapping of str to Fit
    clear : collection of str
        Expressions that are said to differ.

    Returns
    -------
    Chart

    Examples
    --------
    >>> import loopid
    >>> robot = loopid.load("five_bar")
    >>> found = loopid.identify(robot, "urdf/logs/five_bar.csv")
    >>> fits = {"recommended": found.fit, "all": found["all parameters"].fit}
    >>> loopid.plots.comparison_chart(fits).panels[0].title
    'Parameters; * clearly different'
    """
    known = {each.expression: each for fit in fits.values() for each in alone(fit)}
    own = [{e.expression: (e.value, e.standard_error) for e in alone(f)} for f in fits.values()]
    lacking = np.nan, np.nan
    rows = np.array([[each.get(text, lacking) for each in own] for text in known])
    x, s = rows.reshape(-1, len(own), 2).transpose(2, 0, 1)
    size = np.nanmax(s, axis=1, keepdims=True)
    size = np.where(size > 0, size, np.nanmax(np.abs(x), axis=1, keepdims=True))
    size = np.where(size > 0, size, 1.0)
    middle = (x - np.nanmean(x, axis=1, keepdims=True)) / size
    reach = NORMAL_95 * s / size
    labels = tuple(f"{each.name}{' *' * (text in clear)}" for text, each in known.items())
    names, panels, title = [*fits], list[Panel](), "Parameters; * clearly different"
    for first in range(0, len(fits), BESIDE):
        marks, columns = list[Mark](), dict[str, tuple[str, ...]]()
        for k, name in enumerate(names[first : first + BESIDE], start=first):
            place = np.arange(float(len(known))) + 0.6 * ((k - first + 0.5) / BESIDE - 0.5)
            look, at = RUNS[k % len(RUNS)], middle[:, k]
            marks += [Mark("", at - reach[:, k], place, look, "span", at + reach[:, k])]
            marks += [Mark(name, at, place, look, ("disc", "box", "ring")[k % 3])]
            pairs = (with_error(*pair) for pair in zip(x[:, k], s[:, k], strict=True))
            columns[name] = tuple(" ± ".join(pair).removesuffix(" ± -") for pair in pairs)
        columns["unit"] = tuple(each.unit for each in known.values())
        panels.append(Panel(title, tuple(marks), labels=labels, columns=columns))
    caption = (
        "Values of each fit with 95 % intervals, less their mean, in the largest standard error."
    )
    return Chart("parameters", caption, "", tuple(panels))
