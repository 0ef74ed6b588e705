"""Pictures of a robot, and of searches for its base parameters."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from loopid.arguments import FloatArray, checked, shaped
from loopid.base_parameters.account import SubgroupAccount
from loopid.base_parameters.choice import SearchResult
from loopid.errors import OptionError
from loopid.plots.chart import Chart, Mark, Panel
from loopid.robot.robot import Robot
from loopid.view.scene import link_rods, placed, slides

FLAT = 1e-6  # part of the largest extent below which a robot is flat
VIEWS = (0, 2), (0, 1), (1, 2)  # axes that go right and up
ACROSS = np.array([[0.82, -0.57, 0.0], [-0.25, -0.36, 0.9]])  # right and up, from a corner
SIGN = 0.09  # least distance of signs of motors, in extents of the robot
# Places that are tried for a sign, from one to the next by the golden angle.
SPIRAL, GOLDEN = 4000, np.pi * (3 - np.sqrt(5))
HIGHEST = 1e20  # condition number that is drawn; larger ones are drawn there


def motor_numbers(robot: Robot) -> dict[str, int]:
    """What motors are called on all charts: first those with a row of the forces, then redundant.

    Free coordinates have a row, too.
    """
    return {name: k for k, name in enumerate((*robot.independent, *robot.redundant), start=1)}


@checked
def robot_chart(robot: Robot, configuration: FloatArray | None = None, *, worst: str = "") -> Chart:
    """Links, motors by their numbers, passive joints and closures at a configuration (nq,).

    By default that is the reference. A flat robot is seen from its front, any other from a corner.
    The worst motor is marked.

    Parameters
    ----------
    robot : Robot
    configuration : FloatArray, optional
        (nq,).
    worst : str
        The motor that is marked.

    Returns
    -------
    Chart

    Examples
    --------
    >>> import loopid
    >>> len(loopid.plots.robot_chart(loopid.load("five_bar")).panels)
    1
    """
    given = robot.reference if configuration is None else configuration
    q = shaped(given, "configuration", robot.model.nq)
    rods = link_rods(robot)
    _, joints, ends, pairs = placed(robot, rods, q)
    met, sliding = pairs.reshape(-1, 3), np.zeros(len(joints), dtype=bool)
    sliding[np.array([*slides(rods)], dtype=int) - 1] = True
    extent = np.ptp(np.vstack([joints, met, ends.reshape(-1, 3)]), axis=0)
    flat = [axes for axes in VIEWS if extent.sum() - extent[[*axes]].sum() <= FLAT * extent.max()]
    right, up = np.eye(3)[[*flat[0]]] if flat else ACROSS
    fixed = np.array([first == 0 for (first, _), _ in rods], dtype=bool)
    apart = np.array([closure.kind in ("distance", "cable") for closure in robot.closures], bool)
    gaps, spans = (np.insert(each, 2, np.nan, axis=1) for each in (ends, pairs[apart]))
    number = motor_numbers(robot)
    motors = np.isin(robot.joints, robot.actuated)
    bad = np.array([name == worst for name in robot.joints])
    marks = [
        Mark("", *_seen(gaps[~fixed], right, up), "links"),
        Mark("base", *_seen(gaps[fixed], right, up), "limit"),
        Mark("rod or cable", *_seen(spans, right, up), "faint"),
        Mark("loop closed here", *_seen(met, right, up), "file", "closure"),
        Mark("passive joint", *_seen(joints[~motors], right, up), "measured", "joint"),
    ]
    kinds = (("motor", motors & ~sliding, "motor"), ("sliding motor", motors & sliding, "slide"))
    x, y = _seen(joints, right, up)
    x[motors], y[motors] = _apart(x[motors], y[motors], SIGN * extent.max())
    for name, own, kind in kinds:
        for said, look, rows in (
            (name, "measured", own & ~bad),
            ("largest error", "fit", own & bad),
        ):
            texts = tuple(str(number.get(robot.joints[k], "")) for k in np.flatnonzero(rows))
            marks.append(Mark(said, x[rows], y[rows], look, kind, texts=texts))
    motors_said = "; ".join(f"{k} {name}" for name, k in number.items())
    caption = f"{motors_said}. It is {extent.max():.3g} m large."
    panel = Panel("", tuple(mark for mark in marks if len(mark.x)), equal=True)
    return Chart("robot", caption, "", (panel,))


def _seen(points: FloatArray, right: FloatArray, up: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Points (..., 3) in a plane."""
    flat = points.reshape(-1, 3)
    return flat @ right, flat @ up


def _apart(x: FloatArray, y: FloatArray, least: float) -> FloatArray:
    """Places (2, n) next to these, each where it covers none before it."""
    turn = np.arange(SPIRAL)
    nearest = 0.1 * least * np.sqrt(turn) * np.exp(1j * GOLDEN * turn)
    put = np.zeros(0, dtype=complex)
    for place in x + 1j * y:
        free = (np.abs(place + nearest[:, None] - put) >= least).all(axis=1)
        put = np.append(put, place + nearest[free.argmax()])
    return np.stack([put.real, put.imag])


@checked
def search_chart(searches: Sequence[SearchResult]) -> Chart:
    """Condition numbers of the combinations that subgroup searches tried, a panel a search.

    Parameters
    ----------
    searches : sequence of SearchResult

    Returns
    -------
    Chart

    Raises
    ------
    OptionError
        When a search is not one by subgroups.

    Examples
    --------
    >>> import loopid
    >>> observation = loopid.regressors.structural_observation(loopid.load("four_bar"))
    >>> base = loopid.base_parameters.find_base(observation, "subgroup")
    >>> loopid.plots.search_chart([base.search]).panels[0].title
    'cond(V22), rank by a gap'
    """
    for search in searches:
        if search.subgroups is None:
            raise OptionError(f"search_chart shows subgroup searches, not {search.name} search")
    panels = tuple(_tried_panel(s.subgroups) for s in searches if s.subgroups is not None)
    caption = (
        "Condition number of each combination tried, in turn; lines part the groups. Of those that "
        f"are rank-deficient it is round-off, drawn up to {HIGHEST:.0e}."
    )
    return Chart("search", caption, "combination tried", panels, 2)


def _tried_panel(account: SubgroupAccount) -> Panel:
    conditions = np.concatenate([group.condition_numbers for group in account.groups])
    full_rank = np.concatenate([group.full_rank for group in account.groups])
    place, drawn = np.arange(1.0, len(conditions) + 1), np.minimum(conditions, HIGHEST)
    ends = np.cumsum([len(group) for group in account.groups])[:-1] + 0.5
    marks = [
        Mark.upright("", *ends.tolist()),
        Mark("rank-deficient", place[~full_rank], drawn[~full_rank], "faint", "dots"),
        Mark("limit", place[[0, -1]], np.full(2, account.condition_limit), "limit"),
        Mark("full rank", place[full_rank], drawn[full_rank], "fit", "dots"),
    ]
    if account.found_in is not None:
        before = sum(map(len, account.groups[: account.found_in]))
        at = [before + int(account.groups[account.found_in].best or 0)]
        marks.append(Mark("best", place[at], drawn[at], "file", "box"))
    return Panel(f"cond(V22), {account.rule}", tuple(marks), log="y")
