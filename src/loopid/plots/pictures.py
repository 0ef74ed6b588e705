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
from loopid.identification.cutoff import CutoffChoice
from loopid.identification.friction import friction_columns, friction_curve, frictional_joints
from loopid.identification.hysteresis import hysteresis_loop, hysteretic_joints
from loopid.identification.information import Identifiability, body_sizes
from loopid.identification.pipeline import Identification
from loopid.identification.prediction import Prediction
from loopid.identification.saved import SavedFit
from loopid.plots.chart import MOST_DOTS, Chart, Mark, Panel
from loopid.robot.mechanism import Mechanism
from loopid.view.scene import link_rods, placed

FLAT = 1e-6  # part of the largest extent below which a robot is flat
VIEWS = {"front": (0, 2), "side": (1, 2), "top": (0, 1)}  # axes that go right and up
ACROSS = np.array([[0.82, -0.57, 0.0], [-0.25, -0.36, 0.9]])  # right and up, from a corner
FLOOR_OF_WEAK = 0.1  # of the least effect that is drawn, where unidentifiable ones are drawn
MOST, ROOM = 0.95, 1.3  # quantile of the friction's band, and times that, that an axis shows
HIGHEST = 1e20  # condition number that is drawn; larger ones are drawn there
CURVE_POINTS = 200  # of a friction curve on either side of standstill
MOST_ERRORS = 40  # parameters whose standard errors are drawn
RUNS = "fit", "file", "other", "weak", "measured", "faint"  # looks of fits beside each other
ZOOM = "Drag along time to zoom in, double-click to see all again."


def force_unit(mechanism: Mechanism, joint: str) -> str:
    """Unit of a motor's force: N where it slides, N m where it turns."""
    return "N" if mechanism.velocity_indices([joint])[0] in mechanism.prismatic else "N m"


@checked
def robot_chart(mechanism: Mechanism, configuration: FloatArray | None = None) -> Chart:
    """Links, joints and closures at a configuration (nq,), by default the reference."""
    q = mechanism.reference if configuration is None else configuration
    rods = link_rods(mechanism)
    places, ends, met = placed(mechanism, rods, q)
    joints, met = np.array([place.translation for place in places[1:]]), met.reshape(-1, 3)
    for ((base, _), (joint, _)), both in zip(rods, ends, strict=True):
        if base != joint:  # a slide, in its middle: at its ends are other joints
            joints[joint - 1] = both.mean(axis=0)
    motors = np.isin(mechanism.joints, mechanism.actuated)
    fixed = np.array([first == 0 for (first, _), _ in rods], dtype=bool)
    gaps = np.concatenate([ends, np.full((len(ends), 1, 3), np.nan)], axis=1)
    marks: tuple[Any, ...] = (
        ("base", gaps[fixed].reshape(-1, 3), "faint", "line"),
        ("links", gaps[~fixed].reshape(-1, 3), "measured", "line"),
        ("motors", joints[motors], "fit", "dots"),
        ("passive joints", joints[~motors], "file", "dots"),
        ("closures", met, "other", "dots"),
    )
    extent = np.ptp(np.vstack([joints, met, ends.reshape(-1, 3)]), axis=0)
    flat = extent <= FLAT * extent.max()
    views = {n: np.eye(3)[list(axes)] for n, axes in VIEWS.items() if not flat[list(axes)].any()}
    views = views or {"front": np.eye(3)[[0, 2]]}
    if not flat.any():
        views["from a corner"] = ACROSS
    panels = tuple(
        Panel(
            f"{title} (m)",
            tuple(
                Mark(name, at @ right, at @ up, look, kind)
                for name, at, look, kind in marks
                if len(at)
            ),
            equal=True,
        )
        for title, (right, up) in views.items()
    )
    cuts = "; ".join(f"{c.frame_a} and {c.frame_b}" for c in mechanism.closures) or "it has none"
    at = "at its reference" if configuration is None else "at a configuration"
    caption = f"{mechanism.name} {at}. Where loops are cut, frames meet: {cuts}."
    return Chart("robot", caption, "", panels, columns=len(panels))


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


@checked
def forces_chart(
    mechanism: Mechanism,
    found: Prediction,
    *,
    motors: Sequence[str] | None = None,
    file: FloatArray | None = None,
    name: str = "forces",
) -> Chart:
    """Measured and predicted forces of each motor over time, and below them what is left.

    Parameters
    ----------
    motors : sequence of str, optional
        Some of the motors.
    file : FloatArray, optional
        (N, dof), the forces that the robot file predicts.

    Examples
    --------
    >>> import loopid
    >>> from matplotlib.figure import Figure
    >>> robot = loopid.load_mechanism("five_bar")
    >>> log = loopid.read_log(robot.path.parent / "logs" / "five_bar.csv", robot)
    >>> recording = loopid.prepare_recording(robot, log)
    >>> found = loopid.identify(loopid.find_force_model(robot, "full"), [recording])
    >>> prediction = loopid.predict(found.fit, found.force_model, recording)
    >>> chart = loopid.plots.forces_chart(robot, prediction, motors=["left_crank_joint"])
    >>> [panel.title for panel in chart.panels]
    ['left_crank_joint: force (N m), R² 1.000', 'residual (N m)']
    >>> chart.draw(Figure().subplots(2))
    """
    run, time = found.recording, found.recording.motion.time
    some, panels = spread_rows(len(run), MOST_DOTS), list[Panel]()
    half = None if found.reach is None else found.reach[some]
    for motor in run.actuators if motors is None else motors:
        if motor not in run.actuators:
            raise OptionError.unknown("motor", motor, run.actuators)
        k = run.actuators.index(motor)
        used, force = run.used[:, k], run.force[:, k]
        fit = np.where(used, found.predicted[:, k], np.nan)  # elsewhere friction is not known
        marks, left = [Mark("measured", time, force, "measured")], list[Mark]()
        if half is not None:
            low, high = fit[some] - half[:, k], fit[some] + half[:, k]
            marks.append(Mark("95 % of new forces", time[some], low, "fit", "band", high))
        if file is None:
            standing = np.where(used, np.nan, found.residual[:, k])
            left.append(Mark("standing or saturated", time, standing, "faint"))
        else:
            by_file = np.where(used, file[:, k], np.nan)
            marks.append(Mark("robot file", time, by_file, "file"))
            left.append(Mark("measured less robot file", time, force - by_file, "faint"))
        marks.append(Mark("predicted", time, fit))
        left.append(Mark("measured less predicted", time, force - fit, "residual"))
        unit, score = force_unit(mechanism, motor), found.moving.r_squared[k]
        panels.append(Panel(f"{motor}: force ({unit}), R² {score:.3f}", tuple(marks)))
        panels.append(Panel(f"residual ({unit})", tuple(left), small=True))
    beside = "" if file is None else " Of the robot file, joint terms are fitted."
    caption = f"Forces of {run.name}; none is predicted where a motor stands.{beside} {ZOOM}"
    return Chart(name, caption, "time (s)", tuple(panels), zoom=True)


@checked
def parameters_chart(found: Identification) -> Chart:
    """Intervals of the parameters of bodies about the values of the robot file."""
    alone = found.recommended is found.baseline
    fit = found["all parameters"].fit if alone else found.fit
    model = found.force_model
    bodies, base = model.body_columns, model.base
    sizes = body_sizes(model.mechanism, model.model)
    sizes = np.linalg.norm(base.matrix[bodies][:, : len(sizes)] * sizes, axis=1)
    low, high = ((fit.intervals() - model.prior[:, None])[bodies] / sizes[:, None]).T
    known, place = np.isfinite(low) & np.isfinite(high), np.arange(float(len(bodies)))
    middle = (fit.values - model.prior)[bodies] / sizes
    marks = (
        Mark("robot file", np.zeros(2), np.array([-0.5, len(bodies) - 0.5]), "faint"),
        Mark("95 % interval", low[known], place[known], "fit", "span", high[known]),
        Mark("all parameters" if alone else "recommended", middle, place, "fit", "dots"),
    )
    labels = tuple(fit.parameters.names[j] for j in bodies)
    caption = (
        "Parameters of the bodies less those of the robot file, in sizes: a body's mass times its "
        "length, or that squared."
    )
    panel = Panel("fit less robot file (sizes)", marks, labels=labels)
    return Chart("parameters", caption, "", (panel,))


@checked
def comparison_chart(fits: Mapping[str, SavedFit]) -> Chart:
    """Values of fits with 95 % intervals, each less their mean, by the name of their run."""
    names = {e.expression: e.name for fit in fits.values() for e in fit.base_parameters}
    x, s = np.full((2, len(names), len(fits)), np.nan)
    for k, fit in enumerate(fits.values()):
        rows = [[*names].index(each.expression) for each in fit.base_parameters]
        x[rows, k] = [each.value for each in fit.base_parameters]
        s[rows, k] = [each.standard_error or 0.0 for each in fit.base_parameters]
    size = np.nanmax(s, axis=1, keepdims=True)
    size = np.where(size > 0, size, np.nanmax(np.abs(x), axis=1, keepdims=True))
    middle = (x - np.nanmean(x, axis=1, keepdims=True)) / np.where(size > 0, size, 1.0)
    reach, marks = 1.96 * s / np.where(size > 0, size, 1.0), list[Mark]()
    for k, name in enumerate(fits):
        place = np.arange(float(len(names))) + 0.6 * ((k + 0.5) / len(fits) - 0.5)
        look, at = RUNS[k % len(RUNS)], middle[:, k]
        marks += [Mark("", at - reach[:, k], place, look, "span", at + reach[:, k])]
        marks += [Mark(name, at, place, look, "dots")]
    title = "less the mean of the fits, in the largest standard error"
    panel = Panel(title, tuple(marks), labels=tuple(names.values()))
    return Chart("parameters", "Values of each fit with 95 % intervals.", "", (panel,))


@checked
def friction_chart(found: Identification) -> Chart:
    """Friction of each motor by the recommended fit, over the forces that it explains."""
    fit, data, mechanism = found.fit, found.data, found.force_model.mechanism
    velocities = np.concatenate([run.motion.velocities for run in found.training])
    rows, panels = spread_rows(len(data), MOST_DOTS), list[Panel]()
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
        title = f"{joint}: friction ({force_unit(mechanism, joint)})"
        panels.append(Panel(title, tuple(marks), (-most, most) if most else None))
    caption = "Friction over the rate of each motor (m/s or rad/s), by the recommended fit."
    return Chart("friction", caption, "rate", tuple(panels), columns=min(2, len(panels)) or 1)


@checked
def hysteresis_chart(found: Identification) -> Chart:
    """Friction of motors whose friction builds up after a reversal, by the recommended fit."""
    fit, mechanism, panels = found.fit, found.force_model.mechanism, list[Panel]()
    for joint in hysteretic_joints(fit):
        loop = hysteresis_loop(fit, joint, joint_terms=found.force_model.joint_terms)
        low, high = loop.band.T
        marks = [Mark("friction", 1e3 * loop.displacement, loop.force, "fit")]
        if np.isfinite(loop.band).all():
            marks.insert(0, Mark("95 % interval", marks[0].x, low, "fit", "band", high))
        panels.append(Panel(f"{joint}: friction ({force_unit(mechanism, joint)})", tuple(marks)))
    caption = (
        "Friction over the displacement of a slow way to and fro, by the recommended fit: what "
        "builds up after each reversal."
    )
    return Chart(
        "hysteresis",
        caption,
        "displacement (mm or mrad)",
        tuple(panels),
        columns=min(2, len(panels)) or 1,
    )


@checked
def spectrum_chart(found: Identifiability) -> Chart:
    """Effects of the combinations on forces: in random states of the robot, and in the data."""
    structural, effects = 100 * found.excitation.structural, 100 * found.excitation.effects
    place: FloatArray = np.arange(1.0, len(effects) + 1.0)
    rank, sure = found.rank, found.well_determined
    shown = np.append(structural[structural > 0], effects[:rank])
    floor = np.full(len(effects), FLOOR_OF_WEAK * shown.min(initial=1.0))
    kinds = (
        ("data", slice(0, sure), effects, "file"),
        ("weak: worse than the robot file", slice(sure, rank), effects, "weak"),
        ("unidentifiable: no effect", slice(rank, None), floor, "fit"),
    )
    dots = (Mark(n, place[part], y[part], look, "dots") for n, part, y, look in kinds)
    marks = Mark("structure", place, structural, "faint"), *(mark for mark in dots if len(mark.x))
    caption = (
        "What a change of each combination of parameters by its size does to the forces: in random "
        f"states of the robot, and in the data. {rank} of {found.structural_rank} are excited, "
        f"{sure} are known better than by the robot file."
    )
    panel = Panel("effect on the forces (%)", marks, log="y")
    return Chart("spectrum", caption, "combination of parameters", (panel,))


@checked
def filter_chart(found: CutoffChoice) -> Chart:
    """How far predicted forces move from each cut-off that was tried to the next."""
    between, changes = np.sqrt(found.cutoffs[:-1] * found.cutoffs[1:]), 100 * found.changes
    ends = np.array([changes.min(initial=np.inf), changes.max(initial=0.0)])
    marks = (
        Mark("change", between, changes, "file"),
        Mark("", between, changes, "file", "dots"),
        *([Mark("chosen", np.full(2, found.chosen), ends, "fit")] if len(changes) else []),
    )
    title = "change of forces (% of errors)"
    caption = (
        "How far predicted forces move between neighbouring cut-offs of the low-pass filter. "
        f"They move little around {found.chosen:.3g} Hz: a lower one loses motion, a higher one "
        "lets noise of the positions in."
    )
    return Chart("filter", caption, "cut-off (Hz)", (Panel(title, marks, log="xy"),))


@checked
def motion_chart(found: ExcitationDesign) -> Chart:
    """Position of each motor with its limits, and its force below."""
    motors, mechanism, panels = found.motors, found.force_model.mechanism, list[Panel]()
    limits = {check.name: (check.lower, check.upper) for check in found.checks}
    span = motors.time[[0, -1]]
    for k, name in enumerate(motors.names):
        unit = force_unit(mechanism, name)
        marks = [Mark("position", motors.time, motors.position[:, k], "fit")]
        for end in limits.get(f"position of {name}", ()):
            if np.isfinite(end):
                marks.append(Mark("limit", span, np.full(2, end), "limit"))
        force = Mark("force by the robot file", motors.time, found.forces[:, k], "file")
        panels.append(Panel(f"{name} ({'m' if unit == 'N' else 'rad'})", tuple(marks)))
        panels.append(Panel(f"force ({unit})", (force,), small=True))
    caption = f"Motors: position with its limits, and force by the robot file. {ZOOM}"
    return Chart("motion", caption, "time (s)", tuple(panels), zoom=True)


@checked
def errors_chart(found: ExcitationDesign) -> Chart:
    """Standard errors of the least known parameters, before and after."""
    worst = np.sort(np.argsort(-found.standard_errors, kind="stable")[:MOST_ERRORS])
    place = np.arange(float(len(worst)))
    before = "with the logs" if found.after_logs else "first motion"
    marks = (
        Mark(before, found.before.standard_errors[worst], place, "faint", "dots"),
        Mark("with this motion", found.standard_errors[worst], place, "fit", "dots"),
    )
    labels = tuple(found.parameters.names[j] for j in worst)
    panel = Panel("standard error (kg, kg m, kg m², ...)", marks, labels=labels, log="x")
    caption = "Predicted standard errors; one dot alone: unidentifiable without the motion."
    return Chart("errors", caption, "", (panel,))
