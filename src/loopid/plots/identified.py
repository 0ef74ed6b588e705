"""Pictures of an identification: errors, friction, parameters, and checks of log and model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from loopid.arguments import FloatArray, checked, spread_rows
from loopid.identification.cutoff import CutoffChoice
from loopid.identification.delay import Delay
from loopid.identification.friction import (
    friction_columns,
    friction_curve,
    friction_summary,
    frictional_joints,
)
from loopid.identification.hysteresis import hysteresis_loop, hysteretic_joints
from loopid.identification.identification import Identification
from loopid.identification.information import body_sizes
from loopid.identification.log_mistakes import LogFaults
from loopid.identification.prediction import INTERVAL
from loopid.identification.result import Estimate
from loopid.identification.unseen import WHERE
from loopid.identification.verdict import GOOD
from loopid.logs.recording import Recording
from loopid.numbers import number, with_error
from loopid.parameters import KINDS, Parameter
from loopid.plots.chart import Chart, Mark, Panel
from loopid.plots.pictures import numbered, of_motor
from loopid.plots.structure import force_unit
from loopid.regressors.joint_laws import grouped, joint_term
from loopid.robot.robot import Robot

MOST, ROOM = 0.95, 1.3  # quantile of the friction's band, and times that, that an axis shows
MOST_CHANGE = 200.0  # % from the robot file, at which charts are cut
CURVE_POINTS = 50  # of a friction curve on either side of standstill
DOTS = 240  # of the forces that it explains
# Of the kinds whose size the evidence decides: those that say something alone.
ALONE = "Fk0", "Ft"


@checked
def model_errors_chart(found: Identification, *, worst: str = "") -> Chart:
    """Errors on new data of each motor, by the robot file and by the fit, the largest first.

    Below stands where the fit's errors are largest: that is what a verdict counts.
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
    ratios = np.sqrt(found.recommended.motor_ratios)
    for k in np.argsort(-largest, kind="stable").tolist():
        motor, marks, labels = robot.independent[k], list[Mark](), list[str]()
        if most > 100 * GOOD:
            marks.append(Mark.upright("limit of fit", 100 * GOOD, look="limit"))
        for y, ((name, look, kind, _), (error, spread)) in enumerate(zip(fits, parts, strict=True)):
            at, reach = np.array([error[k]]), INTERVAL * spread[k]
            interval = "95 % interval" if y else ""
            marks.append(Mark(interval, at - reach, np.full(1, y), look, "span", at + reach))
            marks.append(Mark(name, at, np.full(1, y), look, kind))
            labels.append(name)
        if shares[:, k].any():
            marks.append(
                Mark(
                    "where it is worst",
                    shares[:, k].max(keepdims=True),
                    np.full(1, 2),
                    "fit",
                    "ring",
                )
            )
            labels.append(WHERE[names[int(shares[:, k].argmax())]].strip())
        rms, errors = found.recommended.validation.residual_rms, found.recommended.rms_errors[1]
        note = " ± ".join(with_error(float(rms[k]), float(errors[k])))
        note = f"{note} {force_unit(robot, motor)}, {_beside(float(ratios[k]))}"
        panels.append(
            Panel(
                "",
                tuple(marks),
                x_limits=(0.0, most),
                labels=tuple(labels),
                note=note,
                **of_motor(robot, motor, worst),
            )
        )
    caption = (
        "Root mean square of the error on data that were not fitted, in % of the motor's force, on "
        "one scale. The robot file stands with fitted joint terms."
    )
    beside = _beside_each_other(panels)
    return Chart("errors", caption, "% of the motor's force", tuple(panels), beside)


def _beside(ratio: float) -> str:
    """An error beside that of the robot file."""
    change = 100 * (ratio - 1)
    if not abs(change) >= 1:
        return "as by the file"
    if ratio >= 3:
        return f"{ratio:.2g} times the file's"
    return f"{abs(change):.0f} % {'below' if change < 0 else 'above'} the file's"


def _beside_each_other(panels: Sequence[Panel]) -> int:
    """Columns of panels of motors."""
    return min(len(panels), 2 if len(panels) in (2, 4) else 3) or 1


@checked
def friction_chart(found: Identification, *, worst: str = "") -> Chart:
    """Friction of each motor by the recommended fit, over the forces that it explains."""
    fit, data, robot = found.fit, found.data, found.force_model.robot
    velocities = np.concatenate([run.motion.velocities for run in found.training])
    rows, panels, notes = spread_rows(len(data), DOTS), list[Panel](), _friction_notes(found)
    residual = data.residual(fit.values)[rows]
    for joint in (joint for joint in frictional_joints(fit) if joint in data.actuators):
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
        most = ROOM * float(np.quantile(np.abs(curve.band), MOST)) if sure else 0.0
        unit, limits = force_unit(robot, joint), (-most, most) if most else None
        said = of_motor(robot, joint, worst) | {"note": notes.get(joint, "")}
        panels.append(Panel(f"friction ({unit})", tuple(marks), y_limits=limits, **said))
    caption = "Friction over the rate of each motor, by the recommended fit."
    return Chart(
        "friction", caption, "rate (rad/s or m/s)", tuple(panels), _beside_each_other(panels)
    )


def _friction_notes(found: Identification) -> dict[str, str]:
    """Friction of each motor in at most four numbers, as text."""
    summary = friction_summary(found.fit)
    words = ("Coulomb", "viscous", "more at standstill", "part of the load")
    return {
        joint: ", ".join(
            f"{word} {value_text(own[k], found.fit.assumed)}"
            for word, own in zip(words, summary.parts.values(), strict=True)
            if own[k] is not None
        )
        for k, joint in enumerate(summary.joints)
    }


def value_text(each: Estimate | None, assumed: Sequence[str] = ()) -> str:
    """A value with its standard error and unit; no error of what is as in the robot file."""
    if each is None:
        return "-"
    value, error = with_error(each.value, 0.0 if each.name in assumed else each.standard_error)
    return f"{value} {f'± {error} ' * (error != '-')}{each.unit}".strip()


@checked
def hysteresis_chart(found: Identification, *, worst: str = "") -> Chart:
    """Friction of motors whose friction builds up after a reversal, by the recommended fit."""
    fit, robot, panels = found.fit, found.force_model.robot, list[Panel]()
    for joint in hysteretic_joints(fit):
        loop = hysteresis_loop(fit, joint, joint_terms=found.force_model.joint_terms)
        low, high = loop.band.T
        marks = [Mark("friction", 1e3 * loop.displacement, loop.force, "fit")]
        if np.isfinite(loop.band).all():
            marks.insert(0, Mark("95 % interval", marks[0].x, low, "fit", "band", high))
        title, said = (
            f"friction ({force_unit(robot, joint)})",
            of_motor(robot, joint, worst),
        )
        panels.append(Panel(title, tuple(marks), **said))
    caption = (
        "Friction over the displacement of a slow way to and fro, by the recommended fit: what "
        "builds up after each reversal."
    )
    beside = _beside_each_other(panels)
    return Chart("hysteresis", caption, "displacement (mm or mrad)", tuple(panels), beside)


@checked
def parameters_chart(found: Identification) -> Chart:
    """Parameters of bodies, and sums of them, beside the robot file."""
    alone = found.recommended is found.baseline
    fit = found["all parameters"].fit if alone else found.fit
    model = found.force_model
    bodies, base = model.body_columns, model.base
    sizes = body_sizes(model.robot, model.model)
    sizes = np.linalg.norm(base.matrix[bodies][:, : len(sizes)] * sizes, axis=1)
    estimates = [fit.estimates[j] for j in bodies]
    prior = model.prior[bodies]
    middle = 100 * (fit.values[bodies] - prior) / sizes
    ends = 100 * (fit.intervals()[bodies] - prior[:, None]) / sizes[:, None]
    panel = Panel(
        "Bodies, all parameters fitted" if alone else "Bodies",
        _about(middle, ends, 0.0),
        labels=tuple(each.name for each in estimates),
        wholes=tuple(each.expression for each in estimates),
        groups=tuple(Parameter.parse(fit.parameters.labels[j]).link for j in bodies),
        columns={
            "value ± std": tuple(value_text(each, fit.assumed) for each in estimates),
            "robot file": tuple(
                number(x + 0.0) for x in np.where(np.abs(prior) > 1e-12, prior, 0.0)
            ),
        },
    )
    caption = (
        "Change from the robot file, in % of the body's mass times its length (of inertias: length "
        "squared), cut at 200 %. Of a sum only the whole is known; its first parameter names it."
    )
    return Chart("parameters", caption, "change (%)", (panel,))


OF_FILE = "robot file", "clearly changed", "agrees with the robot file"


def _about(
    values: FloatArray, ends: FloatArray, right: float, words: tuple[str, str, str] = OF_FILE
) -> tuple[Mark, ...]:
    """Values (n,) with intervals (n, 2), filled where these do not hold what would be right."""
    if words is OF_FILE:
        values, ends = (np.clip(each, -MOST_CHANGE, MOST_CHANGE) for each in (values, ends))
    place, known = np.arange(float(len(values))), np.isfinite(ends).all(axis=1)
    alike = (ends[:, 0] <= right) & (ends[:, 1] >= right) | ~known
    return (
        Mark.upright(words[0], right),
        Mark("95 % interval", ends[known, 0], place[known], "fit", "span", ends[known, 1]),
        Mark(words[1], values[~alike], place[~alike], "fit", "disc"),
        Mark(words[2], values[alike], place[alike], "fit", "ring"),
    )


@checked
def joints_chart(found: Identification) -> Chart:
    """Joint terms of the recommended fit by their kind, all motors of a kind on one scale."""
    fit, kinds = found.fit, dict[tuple[str, str], list[tuple[str, Estimate]]]()
    for parameter, each in zip(fit.parameters, fit.estimates, strict=True):
        kind = parameter.kind
        if kind not in KINDS and (not grouped(kind) or kind.startswith(ALONE)):
            short = f"{joint_term(kind).name}, {kind.partition('~')[0]}"
            name = numbered(found.force_model.robot, parameter.link)
            name += each.name.removeprefix(f"{parameter.link}.{kind}")
            kinds.setdefault((short, each.unit), []).append((name, each))
    panels = []
    for (short, unit), all_ in kinds.items():
        own = [each for _, each in all_]
        ends = np.array([each.interval for each in own])
        texts = tuple(value_text(each, fit.assumed).removesuffix(unit) for each in own)
        words = "", "differs from zero", "not distinct from zero"
        panels.append(
            Panel(
                f"{short[:1].upper()}{short[1:]}{f' ({unit})' * bool(unit)}",
                _about(np.array([each.value for each in own]), ends, 0.0, words),
                labels=tuple(name for name, _ in all_),
                wholes=tuple(each.expression * (each.expression != each.name) for each in own),
                columns={"value ± std": texts},
            )
        )
    caption = "Of each kind, all motors on one scale."
    return Chart("joints", caption, "", tuple(panels), min(2, len(panels)) or 1)


@checked
def masses_chart(found: Identification) -> Chart:
    """Masses of the bodies of the recommended robot beside the robot file."""
    robot, file = found.fit.standard, found.force_model.standard_prior.tolist()
    known = dict(zip(found.force_model.base.parameters.labels, file, strict=True))
    masses = [each for each in robot.values() if each.name.endswith(".m") and known.get(each.name)]
    ends = np.array([(each.value, *each.interval) for each in masses]).reshape(-1, 3)
    prior = np.array([known[each.name] for each in masses])
    changes = 100 * (ends / prior[:, None] - 1)
    panel = Panel(
        "Masses",
        _about(changes[:, 0], changes[:, 1:], 0.0),
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
    """When each motor's samples were used, a panel a recording, by what they were used for."""
    looks, panels = {"fitted": "measured", "new data, not fitted": "other"}, list[Panel]()
    for use, runs in recordings.items():
        for run in runs:
            marks, time = list[Mark](), run.motion.time
            for k in range(len(run.actuators)):
                edges = np.diff(np.concatenate([[0], run.used[:, k].astype(int), [0]]))
                first, last = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1) - 1
                place = np.full(len(first), float(k))
                marks.append(Mark(use, time[first], place, looks[use], "span", time[last]))
            labels = tuple(numbered(robot, name) for name in run.actuators)
            parts = tuple(f"{100 * part:.0f} %" for part in run.used.mean(axis=0))
            panels.append(Panel(run.name, tuple(marks), labels=labels, columns={"used": parts}))
    caption = "Gaps: the motor stands still or is saturated, or a segment begins or ends."
    return Chart("used", caption, "time (s)", tuple(panels))


@checked
def gains_chart(robot: Robot, log_faults: Sequence[LogFaults]) -> Chart:
    """Measured forces over expected ones, of each motor with a determined gain; 1 is right."""
    panels = []
    for each in (each for each in log_faults if each.gains):
        gains = np.array([gain.gain for gain in each.gains])
        ends = np.array([gain.interval for gain in each.gains])
        labels = tuple(numbered(robot, gain.joint) for gain in each.gains)
        panels.append(
            _expected(f"Force over expected force, {each.recording}", gains, ends, 1.0, labels)
        )
    caption = "What motors gave, over what bodies and other motors make expected."
    return Chart("gains", caption, "", tuple(panels), min(2, len(panels)) or 1)


@checked
def delays_chart(robot: Robot, delay: Delay) -> Chart:
    """How late the forces of each motor are."""
    labels = tuple(numbered(robot, name) for name in delay.joints)
    values, intervals = 1e3 * delay.each, 1e3 * delay.intervals
    panel = _expected("Delay of the forces (ms)", values, intervals, 0.0, labels)
    common, (low, high) = 1e3 * delay.common, (1e3 * end for end in delay.interval)
    told = f"{common:.2g} ms, 95 %: {low:.2g} to {high:.2g}" if high < np.inf else "unknown"
    caption = f"Forces after the positions. All motors together: {told}."
    return Chart("delays", caption, "", (panel,))


def _expected(
    title: str, values: FloatArray, ends: FloatArray, right: float, labels: Sequence[str]
) -> Panel:
    """Values of motors with intervals beside the one that is right."""
    marks = _about(values, ends, right, ("", "differs", "as expected"))
    texts = {"value": tuple(f"{x:.3g}" for x in values.tolist())}
    return Panel(title, marks, labels=tuple(labels), columns=texts)


@checked
def filter_chart(found: CutoffChoice) -> Chart:
    """How far predicted forces move from each cut-off that was tried to the next."""
    between, changes = np.sqrt(found.cutoffs[:-1] * found.cutoffs[1:]), 100 * found.changes
    good = found.equally_good
    marks = (
        Mark("equally good", good[:1], np.zeros(1), "other", "shade", good[-1:]),
        Mark("change", between, changes, "measured"),
        Mark("", between, changes, "measured", "disc"),
        Mark.upright("used", found.chosen, look="fit"),
    )
    said = ", ".join(f"{x:.3g}" for x in good.tolist())
    several = (
        f"{said} Hz are equally good, of these the middle one is used" if len(good) > 1 else ""
    )
    caption = (
        "How far predicted forces move between neighbouring cut-offs of the low-pass filter. A low "
        "one loses motion, a high one lets noise of the positions in. "
        f"{several or f'They move least around {found.chosen:.3g} Hz'}."
    )
    title = "Change of forces, in % of errors"
    return Chart("filter", caption, "cut-off (Hz)", (Panel(title, marks, log="xy"),))
