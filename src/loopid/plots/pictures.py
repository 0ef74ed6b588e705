"""Pictures of results, as charts for pages, notebooks and papers; a function a picture."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from loopid.arguments import BoolArray, FloatArray, checked, spread_rows
from loopid.base_parameters.account import SubgroupAccount
from loopid.base_parameters.choice import SearchResult
from loopid.errors import OptionError
from loopid.excitation.design import ExcitationDesign
from loopid.identification.prediction import Prediction
from loopid.identification.result import Fit
from loopid.numbers import number
from loopid.plots.chart import MOST_DOTS, Chart, Mark, Panel
from loopid.robot.mechanism import Mechanism
from loopid.view.scene import link_rods, placed

FLAT = 1e-6  # part of the largest extent below which a robot is flat
VIEWS = (0, 2), (0, 1), (1, 2)  # axes that go right and up
ACROSS = np.array([[0.82, -0.57, 0.0], [-0.25, -0.36, 0.9]])  # right and up, from a corner
SIGN = 0.09  # least distance of signs of motors, in extents of the robot
ROOM = 1.06  # times the largest error, that an axis shows
HIGHEST = 1e20  # condition number that is drawn; larger ones are drawn there
MOST_ERRORS = 40  # parameters whose standard errors are drawn
RUNS = "fit", "file", "other", "weak", "measured", "faint"  # looks of fits beside each other
ZOOM = "Drag along time to zoom in, double-click to see all again."


def force_unit(mechanism: Mechanism, joint: str) -> str:
    """Unit of a motor's force: N where it slides, N m where it turns."""
    return "N" if mechanism.velocity_indices([joint])[0] in mechanism.prismatic else "N m"


@checked
def robot_chart(
    mechanism: Mechanism, configuration: FloatArray | None = None, *, worst: str = ""
) -> Chart:
    """Links, motors by their numbers, passive joints and closures at a configuration (nq,).

    By default that is the reference. A flat robot is seen from its front, any other from a corner.
    The worst motor is marked.
    """
    q = mechanism.reference if configuration is None else configuration
    rods = link_rods(mechanism)
    places, ends, met = placed(mechanism, rods, q)
    joints, met = np.array([place.translation for place in places[1:]]), met.reshape(-1, 3)
    slides = np.zeros(len(joints), dtype=bool)
    for ((base, _), (joint, _)), both in zip(rods, ends, strict=True):
        if base != joint:  # a slide, in its middle: at its ends are other joints
            joints[joint - 1], slides[joint - 1] = both.mean(axis=0), True
    extent = np.ptp(np.vstack([joints, met, ends.reshape(-1, 3)]), axis=0)
    flat = [axes for axes in VIEWS if extent.sum() - extent[[*axes]].sum() <= FLAT * extent.max()]
    right, up = np.eye(3)[[*flat[0]]] if flat else ACROSS
    fixed = np.array([first == 0 for (first, _), _ in rods], dtype=bool)
    gaps = np.concatenate([ends, np.full((len(ends), 1, 3), np.nan)], axis=1)
    number = {name: str(k) for k, name in enumerate(mechanism.independent, start=1)}
    motors = np.isin(mechanism.joints, mechanism.actuated)
    bad = np.array([name == worst for name in mechanism.joints])
    marks = [
        Mark("", *_seen(gaps[~fixed], right, up), "links"),
        Mark("base", *_seen(gaps[fixed], right, up), "limit"),
        Mark("loop closed here", *_seen(met, right, up), "file", "closure"),
        Mark("passive joint", *_seen(joints[~motors], right, up), "measured", "joint"),
    ]
    kinds = (("motor", motors & ~slides, "motor"), ("sliding motor", motors & slides, "slide"))
    x, y = _apart(*_seen(joints, right, up), motors, SIGN * extent.max())
    for name, own, kind in kinds:
        for said, look, rows in (
            (name, "measured", own & ~bad),
            ("largest error", "fit", own & bad),
        ):
            texts = tuple(number.get(mechanism.joints[k], "") for k in np.flatnonzero(rows))
            marks.append(Mark(said, x[rows], y[rows], look, kind, texts=texts))
    motors_said = "; ".join(f"{k} {name}" for name, k in number.items())
    at = "at its reference" if configuration is None else "at a configuration"
    caption = f"{motors_said}. It is {extent.max():.3g} m large {at}."
    panel = Panel("", tuple(mark for mark in marks if len(mark.x)), equal=True)
    return Chart("robot", caption, "", (panel,))


def _seen(points: FloatArray, right: FloatArray, up: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Points (..., 3) in a plane."""
    flat = points.reshape(-1, 3)
    return flat @ right, flat @ up


def _apart(
    x: FloatArray, y: FloatArray, some: BoolArray, least: float
) -> tuple[FloatArray, FloatArray]:
    """Places of which some are moved up and to the right until none covers another."""
    x, y, put = x.copy(), y.copy(), list[int]()
    for k in np.flatnonzero(some):
        while any(np.hypot(x[k] - x[j], y[k] - y[j]) < least for j in put):
            x[k], y[k] = x[k] + 0.5 * least, y[k] + 0.6 * least
        put.append(int(k))
    return x, y


@checked
def search_chart(searches: Sequence[SearchResult]) -> Chart:
    """Condition numbers of the combinations that subgroup searches tried, a column a search.

    Above stand all of them, below those of full rank.

    Raises
    ------
    OptionError
        When a search is not one by subgroups.

    Examples
    --------
    >>> import loopid
    >>> observation = loopid.structural_observation(loopid.load_mechanism("four_bar"))
    >>> base = loopid.find_base_parameters(observation, "subgroup")
    >>> loopid.plots.search_chart([base.search]).panels[0].title
    'cond(V22), rank by a gap'
    """
    for search in searches:
        if search.subgroups is None:
            raise OptionError(f"search_chart shows subgroup searches, not {search.name} search")
    accounts = [search.subgroups for search in searches if search.subgroups is not None]
    caption = (
        "Condition number of each combination tried, in turn; lines part the groups. Of those that "
        f"are rank-deficient it is round-off, drawn up to {HIGHEST:.0e}."
    )
    panels = (*map(_tried_panel, accounts), *map(_full_rank_panel, accounts))
    return Chart("search", caption, "combination tried", panels, columns=len(accounts) or 1)


def _tried_panel(account: SubgroupAccount) -> Panel:
    place, conditions, full_rank = _tried(account)
    marks = (
        _group_ends(account, 1.0, conditions.max()),
        Mark("rank-deficient", place[~full_rank], conditions[~full_rank], "faint", "dots"),
        Mark("limit", place[[0, -1]], np.full(2, account.condition_limit), "limit"),
        *_full_rank_marks(account),
    )
    return Panel(f"cond(V22), {account.rule}", marks, log="y")


def _full_rank_panel(account: SubgroupAccount) -> Panel:
    place, conditions, full_rank = _tried(account)
    shown = conditions[full_rank]
    lines = _group_ends(account, shown.min(initial=np.inf), shown.max(initial=1.0))
    ends = Mark("", place[[0, -1]], np.full(2, np.nan))  # as long as the panel above
    return Panel(f"of full rank, {account.rule}", (ends, lines, *_full_rank_marks(account)))


def _full_rank_marks(account: SubgroupAccount) -> list[Mark]:
    place, conditions, full_rank = _tried(account)
    marks = [Mark("full rank", place[full_rank], conditions[full_rank], "fit", "dots")]
    if account.found_in is not None:
        before = sum(map(len, account.groups[: account.found_in]))
        at = [before + int(account.groups[account.found_in].best or 0)]
        marks.append(Mark("best", place[at], conditions[at], "file", "dots"))
    return marks


def _tried(account: SubgroupAccount) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Places, condition numbers and whether of full rank, of all combinations in turn."""
    conditions = np.concatenate([group.condition_numbers for group in account.groups])
    full_rank = np.concatenate([group.full_rank for group in account.groups])
    return np.arange(1.0, len(conditions) + 1), np.minimum(conditions, HIGHEST), full_rank


def _group_ends(account: SubgroupAccount, low: float, high: float) -> Mark:
    ends = np.cumsum([len(group) for group in account.groups])[:-1]
    return Mark("", np.repeat(ends + 0.5, 3), np.tile([low, high, np.nan], len(ends)), "faint")


def of_motor(mechanism: Mechanism, name: str, worst: str = "") -> dict[str, Any]:
    """What a panel says of a motor: name, number, and whether it is the worst."""
    number = mechanism.independent.index(name) + 1
    return {"motor": name, "number": number, "worst": name == worst}


@checked
def forces_chart(
    mechanism: Mechanism,
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
    motors : sequence of str, optional
        Some of the motors, in the order in which they are shown.
    file : FloatArray, optional
        (N, dof), the forces that the robot file predicts.
    worst : str
        The motor that is marked.

    Examples
    --------
    >>> import loopid
    >>> from matplotlib.figure import Figure
    >>> robot = loopid.load_mechanism("five_bar")
    >>> log = loopid.read_log(robot.path.parent / "logs" / "five_bar.csv", robot)
    >>> recording = loopid.prepare_recording(robot, log)
    >>> found = loopid.identify(loopid.find_force_model(robot, "full"), [recording])
    >>> prediction = found.fit.predict(recording)
    >>> chart = loopid.plots.forces_chart(robot, prediction, motors=["left_crank_joint"])
    >>> [panel.title for panel in chart.panels]
    ['measured force (N m)', 'left by this fit (N m), rms 0.0098']
    >>> chart.draw(Figure().subplots(2))
    """
    run, panels = found.recording, list[Panel]()
    time = run.motion.time
    predictions = {"fit": ("this fit", found.predicted)}
    if file is not None:
        predictions = {"file": ("the robot file", file), **predictions}
    for motor in run.actuators if motors is None else motors:
        if motor not in run.actuators:
            raise OptionError.unknown("motor", motor, run.actuators)
        k = run.actuators.index(motor)
        used, force, unit = run.used[:, k], run.force[:, k], force_unit(mechanism, motor)
        shade = Mark("not judged: stands or is saturated", *_spans(time, ~used))
        measured = Mark("measured force", time, force, "measured")
        said = of_motor(mechanism, motor, worst)
        panels.append(Panel(f"measured force ({unit})", (shade, measured), small=True, **said))
        left = {
            look: np.where(used, force - each[:, k], np.nan)
            for look, (_, each) in predictions.items()
        }
        most = ROOM * max(float(np.nanmax(np.abs(y), initial=0.0)) for y in left.values()) or 1.0
        for look, (by, _) in predictions.items():
            rms = float(np.sqrt(np.nanmean(left[look] ** 2))) if used.any() else np.nan
            line = Mark(f"measured less {by}", time, left[look], look)
            zero = Mark("", time[[0, -1]], np.zeros(2), "faint")
            title = f"left by {by} ({unit}), rms {number(rms, 2)}"
            marks = (shade, zero, *_band(found, k, look), line)
            panels.append(Panel(title, marks, y_limits=(-most, most), small=True))
    caption = f"Of {run.name}. Lanes of errors have one scale a motor. {ZOOM}"
    many, lanes = len(panels) > 1 + len(predictions), 1 + len(predictions)
    return Chart(name, caption, "time (s)", tuple(panels), 2 if many else 1, lanes, run.name)


def _band(found: Prediction, motor: int, look: str) -> list[Mark]:
    """Where 95 % of new forces are left by the fit; none by other predictions."""
    if found.reach is None or look != "fit":
        return []
    some = spread_rows(len(found.recording), MOST_DOTS)
    time, half = found.recording.motion.time[some], found.reach[some, motor]
    return [Mark("95 % of new forces", time, -half, "faint", "band", half)]


def _spans(time: FloatArray, chosen: BoolArray) -> Any:
    """Where some samples are, as a shade."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], chosen, [False]]).astype(int)))
    first, last = edges.reshape(-1, 2).T
    ends = time[np.minimum(last, len(time) - 1)]
    return time[first], np.zeros(len(first)), "faint", "shade", ends


@checked
def comparison_chart(fits: Mapping[str, Fit]) -> Chart:
    """Values of fits with 95 % intervals, each less their mean, by the name of their run."""
    names = {e.expression: e.name for fit in fits.values() for e in fit.parameters}
    x, s = np.full((2, len(names), len(fits)), np.nan)
    for k, fit in enumerate(fits.values()):
        rows = [[*names].index(each.expression) for each in fit.parameters]
        x[rows, k], s[rows, k] = fit.values, fit.standard_errors
    size = np.nanmax(s, axis=1, keepdims=True)
    size = np.where(size > 0, size, np.nanmax(np.abs(x), axis=1, keepdims=True))
    middle = (x - np.nanmean(x, axis=1, keepdims=True)) / np.where(size > 0, size, 1.0)
    reach, marks = 1.96 * s / np.where(size > 0, size, 1.0), list[Mark]()
    for k, name in enumerate(fits):
        place = np.arange(float(len(names))) + 0.6 * ((k + 0.5) / len(fits) - 0.5)
        look, at = RUNS[k % len(RUNS)], middle[:, k]
        marks += [Mark("", at - reach[:, k], place, look, "span", at + reach[:, k])]
        marks += [Mark(name, at, place, look, ("disc", "box", "ring")[k % 3])]
    title = "Less the mean, in the largest standard error"
    panel = Panel(title, tuple(marks), labels=tuple(names.values()))
    return Chart("parameters", "Values of each fit with 95 % intervals.", "", (panel,))


@checked
def motion_chart(found: ExcitationDesign) -> Chart:
    """Position of each motor with its limits, and its force below."""
    motors, mechanism, panels = found.motors, found.force_model.mechanism, list[Panel]()
    limits = {check.name: (check.lower, check.upper) for check in found.checks}
    span = motors.time[[0, -1]]
    for k, name in enumerate(motors.names):
        unit = force_unit(mechanism, name)
        marks = [Mark("position", motors.time, motors.position[:, k], "measured")]
        for end in limits.get(f"position of {name}", ()):
            if np.isfinite(end):
                marks.append(Mark("limit", span, np.full(2, end), "limit"))
        force = Mark("force by the robot file", motors.time, found.forces[:, k], "file")
        title, said = f"position ({'m' if unit == 'N' else 'rad'})", of_motor(mechanism, name)
        panels.append(Panel(title, tuple(marks), **said))
        panels.append(Panel(f"force ({unit})", (force,), small=True))
    caption = f"Position with its limits, and force by the robot file. {ZOOM}"
    return Chart(
        "motion", caption, "time (s)", tuple(panels), min(2, len(motors.names)), 2, "motion"
    )


@checked
def errors_chart(found: ExcitationDesign) -> Chart:
    """Standard errors of the least known parameters, before and after."""
    worst = np.sort(np.argsort(-found.standard_errors, kind="stable")[:MOST_ERRORS])
    place = np.arange(float(len(worst)))
    before = "with the logs" if found.after_logs else "first motion"
    marks = (
        Mark(before, found.before.standard_errors[worst], place, "file", "box"),
        Mark("with this motion", found.standard_errors[worst], place, "fit", "disc"),
    )
    labels = tuple(found.parameters.names[j] for j in worst)
    panel = Panel("Standard error (kg, kg m, kg m², ...)", marks, labels=labels, log="x")
    caption = "Predicted standard errors; one dot alone: unidentifiable without the motion."
    return Chart("errors", caption, "", (panel,))
