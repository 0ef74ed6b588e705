"""Pictures of an identification: errors, friction, parameters, and checks of log and model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from loopid.arguments import FloatArray, checked, spread_rows
from loopid.identification.cutoff import CutoffChoice
from loopid.identification.delay import Delay
from loopid.identification.estimates import Estimate
from loopid.identification.friction_curves import (
    friction_columns,
    friction_curve,
    friction_numbers,
    frictional_joints,
)
from loopid.identification.identification import Identification
from loopid.identification.information import body_sizes
from loopid.identification.log_mistakes import LogFaults
from loopid.identification.unseen import WHERE
from loopid.identification.verdict import GOOD
from loopid.logs.recording import Recording
from loopid.numbers import NORMAL_95, SUM_ROUND_OFF, number, with_error
from loopid.parameters import KINDS, Parameter
from loopid.plots.chart import Chart, Mark, Panel, forest, segments
from loopid.plots.pictures import motors_panel, numbered, of_motor
from loopid.regressors.joint_laws import grouped, joint_term
from loopid.robot.robot import Robot

MOST, ROOM = 0.95, 1.3  # quantile of the friction's band, and times that, that an axis shows
MOST_CHANGE = 200.0  # % from the robot file, at which charts are cut
CURVE_POINTS = 50  # of a friction curve on either side of standstill
DOTS = 240  # of the forces that it explains
# Numbers that stand for it, in words.
FRICTION = {
    "Fc": "Coulomb",
    "Fv": "viscous",
    "Fk0": "more at standstill",
    "Ft": "part of the load",
}
# Of the kinds whose size the evidence decides: those that say something alone.
ALONE = "Fk0", "Ft"


@checked
def model_errors_chart(found: Identification, *, worst: str = "") -> Chart:
    """Errors on new data of each motor, by the robot file and by the fit, the largest first.

    Below stands where the fit's errors are largest: that is what a verdict counts.

    Parameters
    ----------
    found : Identification
    worst : str
        The motor that is marked.

    Returns
    -------
    Chart

    Examples
    --------
    >>> import loopid
    >>> robot = loopid.load("five_bar")
    >>> found = loopid.identify(robot, "urdf/logs/five_bar.csv")
    >>> loopid.plots.model_errors_chart(found).name
    'errors'
    """
    robot, panels = found.force_model.robot, list[Panel]()
    fits = (
        ("robot file", "file", "box", found.baseline),
        ("this fit", "fit", "disc", found.recommended),
    )
    parts = [np.multiply(100, found.relative_errors(each)) for *_, each in fits]
    names = [name for name, text in WHERE.items() if text]
    shares = 100 * np.nan_to_num([found.unseen.shares[name] for name in names])
    largest = np.maximum(shares.max(axis=0), np.nan_to_num(parts[1][0]))
    ends = [*(part.sum(axis=0) + part[1] for part in parts), largest]
    most = 1.04 * float(np.nanmax(ends, initial=1e-9))
    limit = [Mark.upright("limit of fit", 100 * GOOD, look="limit")] * (most > 100 * GOOD)
    rms, spreads = found.recommended.validation.residual_rms, found.recommended.rms_errors[1]
    ratios = np.sqrt(found.recommended.motor_ratios)
    for k in np.argsort(-largest, kind="stable").tolist():
        motor, marks, labels = robot.independent[k], [*limit], [name for name, *_ in fits]
        for y, ((name, look, kind, _), (error, spread)) in enumerate(zip(fits, parts, strict=True)):
            at, reach, row = error[[k]], NORMAL_95 * spread[k], np.full(1, float(y))
            marks.append(Mark("95 % interval" * (y > 0), at - reach, row, look, "span", at + reach))
            marks.append(Mark(name, at, row, look, kind))
        if shares[:, k].any():
            at = shares[:, k].max(keepdims=True)
            marks.append(Mark("where it is worst", at, np.full(1, 2.0), "fit", "ring"))
            labels.append(WHERE[names[int(shares[:, k].argmax())]].strip())
        change = 100 * (float(ratios[k]) - 1)
        beside = f"{abs(change):.0f} % {'below' if change < 0 else 'above'} the file's"
        if not abs(change) >= 1:
            beside = "as by the file"
        size = " ± ".join(with_error(float(rms[k]), float(spreads[k])))
        note = f"{size} {robot.units(motor)[1]}, {beside}"
        said = of_motor(robot, motor, worst) | {"labels": tuple(labels), "note": note}
        panels.append(Panel("", tuple(marks), x_limits=(-0.04 * most, most), **said))
    caption = (
        "Root mean square of the error on data that were not fitted, in % of the motor's force, on "
        "one scale. The robot file stands with fitted joint terms."
    )
    return _by_motor("errors", caption, "% of the motor's force", panels)


def _by_motor(name: str, caption: str, x_label: str, panels: Sequence[Panel]) -> Chart:
    """A panel a motor, some beside each other."""
    return Chart(name, caption, x_label, tuple(panels), 2 if len(panels) in (2, 4) else 3)


@checked
def friction_chart(found: Identification, *, worst: str = "") -> Chart:
    """Friction of each motor by the recommended fit, over the forces that it explains.

    Parameters
    ----------
    found : Identification
    worst : str
        The motor that is marked.

    Returns
    -------
    Chart

    Examples
    --------
    >>> import loopid
    >>> robot = loopid.load("five_bar")
    >>> found = loopid.identify(robot, "urdf/logs/five_bar.csv")
    >>> [panel.motor for panel in loopid.plots.friction_chart(found).panels]
    ['left_crank_joint', 'right_crank_joint']
    """
    fit, data, robot = found.fit, found.data, found.force_model.robot
    velocities = np.concatenate([run.motion.velocities for run in found.training])
    rows, panels, numbers = spread_rows(len(data), DOTS), list[Panel](), friction_numbers(fit)
    residual = data.residual(fit.values)[rows]
    for joint in (joint for joint in frictional_joints(fit) if joint in data.actuators):
        k, own = data.actuators.index(joint), friction_columns(fit, joint)
        rate, used = velocities[rows, k], data.used[rows, k]
        left = residual[:, k] + data.regressor[rows, k][:, own] @ fit.values[own]
        marks = [Mark("measured less all else", rate[used], left[used], "measured", "dots")]
        fastest = float(np.abs(rate).max(initial=0.0)) or 1.0
        rates = fastest * np.linspace(-1, 1, 2 * CURVE_POINTS)  # none is 0, where it jumps
        curve = friction_curve(fit, joint, rates)
        for half in (slice(CURVE_POINTS), slice(CURVE_POINTS, None)):
            low, high = curve.band[half].T
            if np.isfinite(low).all() and np.isfinite(high).all():
                marks.append(Mark("95 % interval", rates[half], low, "fit", "band", high))
            marks.append(Mark("friction", rates[half], curve.values[half], "fit"))
        # Next to standstill hardly anything is known: bands there would flatten the rest.
        most = ROOM * float(np.quantile(np.abs(curve.band), MOST))
        limits = (-most, most) if np.isfinite(most) and most else None
        parts = (
            f"{FRICTION[kind]} {value_text(each, fit.assumed)}"
            for kind, each in numbers[joint].items()
        )
        note = ", ".join(parts)
        said = of_motor(robot, joint, worst) | {"note": note, "y_limits": limits}
        panels.append(Panel(f"friction ({robot.units(joint)[1]})", tuple(marks), **said))
    caption = "Friction over the rate of each motor, by the recommended fit."
    units = {"m/s" if robot.slides(name) else "rad/s" for name in robot.actuated}
    rate = f"rate ({' or '.join(sorted(units, reverse=True))})"
    return _by_motor("friction", caption, rate, panels)


def value_text(each: Estimate, assumed: Sequence[str] = ()) -> str:
    """A value with its standard error and unit; no error of what keeps the robot file's value."""
    value, error = with_error(each.value, 0.0 if each.name in assumed else each.standard_error)
    return f"{value} {f'± {error} ' * (error != '-')}{each.unit}".strip()


@checked
def parameters_chart(found: Identification) -> Chart:
    """Parameters of bodies, and sums of them, beside the robot file.

    Parameters
    ----------
    found : Identification

    Returns
    -------
    Chart

    Examples
    --------
    >>> import loopid
    >>> robot = loopid.load("five_bar")
    >>> found = loopid.identify(robot, "urdf/logs/five_bar.csv")
    >>> loopid.plots.parameters_chart(found).panels[0].title
    'Bodies'
    """
    alone = found.recommended is found.baseline
    fit = found["all parameters"].fit if alone else found.fit
    model = found.force_model
    bodies, base = model.body_columns, model.base
    sizes = body_sizes(model.robot, model.model)
    sizes = np.linalg.norm(base.matrix[bodies][:, : len(sizes)] * sizes, axis=1)
    known = fit.estimates
    estimates = [known[j] for j in bodies]
    prior, file = model.prior[bodies], file_values(found)
    ends = np.column_stack([fit.values, fit.intervals()])[bodies]
    panel = _from_file(
        "Bodies, all parameters fitted" if alone else "Bodies",
        100 * (ends - prior[:, None]) / sizes[:, None],
        labels=tuple(each.name for each in estimates),
        wholes=tuple(each.expression for each in estimates),
        groups=tuple(Parameter.parse(fit.parameters.labels[j]).link for j in bodies),
        columns={
            "value ± std": tuple(value_text(each, fit.assumed) for each in estimates),
            "robot file": tuple(file[each.name] for each in estimates),
        },
    )
    caption = (
        "Change from the robot file, in % of the body's mass times its length (of inertias: length "
        "squared), cut at 200 %. Of a sum only the whole is known; its first parameter names it."
    )
    return Chart("parameters", caption, "change (%)", (panel,))


def file_values(found: Identification) -> dict[str, str]:
    """Values of bodies by the robot file, by the names of the fit's parameters."""
    model = found.force_model
    prior = np.where(np.abs(model.prior) > SUM_ROUND_OFF, model.prior, 0.0).tolist()
    return {found.fit.parameters.names[j]: number(prior[j]) for j in model.body_columns}


def _from_file(title: str, changes: FloatArray, **rows: Any) -> Panel:
    """Changes from the robot file in %, which are cut."""
    words = "robot file", "clearly changed", "agrees with the robot file"
    return forest(title, np.clip(changes, -MOST_CHANGE, MOST_CHANGE), 0.0, words, **rows)


@checked
def joints_chart(found: Identification) -> Chart:
    """Joint terms of the recommended fit by their kind, all motors of a kind on one scale.

    Parameters
    ----------
    found : Identification

    Returns
    -------
    Chart

    Examples
    --------
    >>> import loopid
    >>> robot = loopid.load("five_bar")
    >>> found = loopid.identify(robot, "urdf/logs/five_bar.csv")
    >>> len(loopid.plots.joints_chart(found).panels)
    4
    """
    fit, kinds = found.fit, dict[tuple[str, str], list[tuple[str, Estimate]]]()
    for parameter, each in zip(fit.parameters, fit.estimates, strict=True):
        kind = parameter.kind
        if kind not in KINDS and (not grouped(kind) or kind.startswith(ALONE)):
            short = f"{joint_term(kind).name}, {kind.partition('~')[0]}"
            name = numbered(found.force_model.robot, parameter.link)
            name += each.name.removeprefix(f"{parameter.link}.{kind}")
            kinds.setdefault((short, each.unit), []).append((name, each))
    panels = []
    words = "", "differs from zero", "not distinct from zero"
    for (short, unit), all_ in kinds.items():
        names, own = zip(*all_, strict=True)
        texts = tuple(value_text(each, fit.assumed).removesuffix(unit) for each in own)
        panel = forest(
            f"{short[:1].upper()}{short[1:]}{f' ({unit})' * bool(unit)}",
            np.array([(each.value, *each.interval) for each in own]),
            0.0,
            words,
            labels=names,
            wholes=tuple(each.expression * (each.expression != each.name) for each in own),
            columns={"value ± std": texts},
        )
        panels.append(panel)
    caption = "Of each kind, all motors on one scale."
    return Chart("joints", caption, "", tuple(panels), 2)


@checked
def masses_chart(found: Identification) -> Chart:
    """Masses of the bodies of the recommended robot beside the robot file.

    Parameters
    ----------
    found : Identification

    Returns
    -------
    Chart

    Examples
    --------
    >>> import loopid
    >>> robot = loopid.load("five_bar")
    >>> found = loopid.identify(robot, "urdf/logs/five_bar.csv")
    >>> loopid.plots.masses_chart(found).panels[0].labels
    ('left_crank', 'left_coupler', 'right_crank', 'right_coupler')
    """
    robot, file = found.fit.standard, found.force_model.standard_prior.tolist()
    known = dict(zip(found.force_model.base.parameters.labels, file, strict=True))
    masses = [each for each in robot.values() if each.name.endswith(".m") and known.get(each.name)]
    ends = np.array([(each.value, *each.interval) for each in masses]).reshape(-1, 3)
    prior = np.array([known[each.name] for each in masses])
    panel = _from_file(
        "Masses",
        100 * (ends / prior[:, None] - 1),
        labels=tuple(each.name.removesuffix(".m") for each in masses),
        columns={
            "mass ± std": tuple(map(value_text, masses)),
            "robot file": tuple(map(number, prior.tolist())),
            "by": tuple("log" if each.determined else "file" for each in masses),
        },
    )
    caption = (
        "Change from the robot file, cut at 200 %. Forces determine sums of masses: a mass by the "
        "file is the one nearest to it of all that give these forces."
    )
    return Chart("masses", caption, "change (%)", (panel,) if masses else ())


@checked
def used_chart(robot: Robot, recordings: Mapping[str, Sequence[Recording]]) -> Chart:
    """When each motor's samples were used, a panel a recording, by what they were used for.

    Parameters
    ----------
    robot : Robot
    recordings : mapping of str to sequence of Recording
        By their use: ``"fitted"``, or ``"new data, not fitted"``.

    Returns
    -------
    Chart

    Examples
    --------
    >>> import loopid
    >>> robot = loopid.load("five_bar")
    >>> found = loopid.identify(robot, "urdf/logs/five_bar.csv")
    >>> loopid.plots.used_chart(robot, {"fitted": found.training}).panels[0].labels
    ('1 left_crank_joint', '2 right_crank_joint')
    """
    looks, panels = {"fitted": "measured", "new data, not fitted": "other"}, list[Panel]()
    for use, runs in recordings.items():
        for run in runs:
            marks, time = list[Mark](), run.motion.time
            for k in range(len(run.actuators)):
                first, end = segments(run.used[:, k]).T
                place = np.full(len(first), float(k))
                marks.append(Mark(use, time[first], place, looks[use], "span", time[end - 1]))
            labels = tuple(numbered(robot, name) for name in run.actuators)
            parts = tuple(f"{100 * part:.0f} %" for part in run.used.mean(axis=0))
            panels.append(Panel(run.name, tuple(marks), labels=labels, columns={"used": parts}))
    caption = "Gaps: the motor stands still or is saturated, or a segment begins or ends."
    return Chart("used", caption, "time (s)", tuple(panels))


@checked
def gains_chart(robot: Robot, log_faults: Sequence[LogFaults]) -> Chart:
    """Measured forces over expected ones, of each motor with a determined gain; 1 is right.

    Parameters
    ----------
    robot : Robot
    log_faults : sequence of LogFaults
        One a log.

    Returns
    -------
    Chart

    Examples
    --------
    >>> import loopid
    >>> robot = loopid.load("five_bar")
    >>> found = loopid.identify(robot, "urdf/logs/five_bar.csv")
    >>> loopid.plots.gains_chart(robot, found.log_faults).name
    'gains'
    """
    panels = []
    for each in (each for each in log_faults if each.gains):
        known = {gain.joint: (gain.gain, *gain.interval) for gain in each.gains}
        title = f"Force over expected force, {each.recording}"
        panels.append(motors_panel(robot, title, known, 1.0))
    caption = (
        "What motors gave, over what bodies and other motors make expected. Intervals of 95 % hold "
        "bodies that may be off by half."
    )
    return Chart("gains", caption, "", tuple(panels), 2)


@checked
def delays_chart(robot: Robot, delay: Delay) -> Chart:
    """How late the forces of each motor are.

    Parameters
    ----------
    robot : Robot
    delay : Delay

    Returns
    -------
    Chart

    Examples
    --------
    >>> import loopid, numpy as np
    >>> from loopid.identification.delay import Delay
    >>> robot, each = loopid.load("five_bar"), np.array([0.004, 0.005])  # s
    >>> delay = Delay(robot.actuated, 0.0045, (0.004, 0.005), each,
    ...     each[:, None] + [-1e-3, 1e-3], 0.01, np.full(2, 0.0045), np.array([2e-4]))
    >>> loopid.plots.delays_chart(robot, delay).panels[0].title
    'Delay of the forces (ms)'
    """
    values = 1e3 * np.column_stack([delay.each, delay.intervals])
    each = dict(zip(delay.joints, values.tolist(), strict=True))
    panel = motors_panel(robot, "Delay of the forces (ms)", each, 0.0)
    common, (low, high) = 1e3 * delay.common, (1e3 * end for end in delay.interval)
    common_text = f"{common:.2g} ms, 95 %: {low:.2g} to {high:.2g}" if high < np.inf else "unknown"
    caption = f"Forces after the positions. All motors together: {common_text}."
    return Chart("delays", caption, "", (panel,))


@checked
def filter_chart(found: CutoffChoice) -> Chart:
    """How far predicted forces move from each cut-off that was tried to the next.

    Parameters
    ----------
    found : CutoffChoice

    Returns
    -------
    Chart

    Examples
    --------
    >>> import loopid
    >>> robot = loopid.load("five_bar")
    >>> run = loopid.prepare(robot, loopid.read_log("urdf/logs/five_bar.csv", robot))
    >>> model = loopid.force_model(robot, "full", "Fc,Fv")
    >>> choice = loopid.identification.choose_cutoff(model, [run])
    >>> loopid.plots.filter_chart(choice).x_label
    'cut-off (Hz)'
    """
    between, changes = np.sqrt(found.cutoffs[:-1] * found.cutoffs[1:]), 100 * found.changes
    good = found.equally_good
    marks = (
        Mark("equally good", good[:1], np.zeros(1), "other", "shade", good[-1:]),
        Mark("change", between, changes, "measured"),
        Mark("", between, changes, "measured", "disc"),
        Mark.upright("used", found.chosen, look="fit"),
    )
    which = f"They move least around {found.chosen:.3g} Hz"
    if len(good) > 1:
        said = ", ".join(f"{x:.3g}" for x in good.tolist())
        which = f"{said} Hz are equally good, of these the middle one is used"
    caption = (
        "How far predicted forces move between neighbouring cut-offs of the low-pass filter. A low "
        "one loses motion, a high one lets noise of the positions in. "
        f"{which}."
    )
    title = "Change of forces, in % of errors"
    return Chart("filter", caption, "cut-off (Hz)", (Panel(title, marks, log="xy"),))
