"""Where a search begins: random motions, shrunk around poses until they keep all bounds."""

from __future__ import annotations

import numpy as np

from loopid.arguments import FloatArray
from loopid.errors import AssemblyError
from loopid.excitation.problem import Problem, evaluate
from loopid.kinematics.assembly import AssemblyOptions, try_assemble
from loopid.kinematics.measured import measured_coordinates
from loopid.kinematics.projection import singularity_measure
from loopid.records import record
from loopid.robot.mechanism import Mechanism

# How many of the best random poses are improved, how often, and how: by steps of a part of
# the workspace that gets smaller.
BEST, ROUNDS, SMALLER = 8, 14, 0.75
# Random motions for a start, and by how much they are shrunk until they keep all bounds.
DRAWS, SHRINK, SHRINKS = 3, 0.8, 40


@record
class Poses:
    """Poses in which all bounds hold, the one with most slack first.

    Attributes
    ----------
    positions : FloatArray
        (P, c), of the coordinates of the design.
    configurations : FloatArray
        (P, nq).
    reach : FloatArray
        (c,), half the range of each coordinate.
    """

    positions: FloatArray
    configurations: FloatArray
    reach: FloatArray


def slacks(problem: Problem, positions: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Slacks (N, k) of all bounds at rest in poses (N, c), and configurations (N, nq).

    Minus infinity where the loops do not close, or at a singularity.
    """
    space, found = problem.coordinates, np.full((len(positions), len(problem.bounds.all)), -np.inf)
    names = "platform" if space.on_platform else space.names
    outcome = try_assemble(
        space.mechanism, positions, names, options=AssemblyOptions(shortest_step=2.0**-6)
    )
    q = outcome.configurations[outcome.assembled]
    # Singular poses have no velocities to tell.
    regular = singularity_measure(space.mechanism, q) > 1e-6
    rows = np.flatnonzero(outcome.assembled)[regular]
    if len(rows):
        still = np.zeros((len(rows), len(space.names)))
        values = problem.bounded(space.whole(q[regular], still, still))
        found[rows] = problem.bounds.slack(values)
    return found, outcome.configurations


def find_poses(problem: Problem, configurations: FloatArray, seed: int) -> Poses:
    """Poses that keep all bounds, from random configurations (N, nq) on."""
    space, generator = problem.coordinates, np.random.default_rng([seed, 11])
    names = "platform" if space.on_platform else space.names
    measured = measured_coordinates(space.mechanism, names)
    q = np.concatenate([space.mechanism.reference[None], configurations])
    x = measured.read(q)
    reach = np.maximum(np.ptp(x, axis=0) / 2, 1e-3 * space.units)
    # Random poses miss narrow ranges, which their nearest ends may keep.
    low, high = problem.bounds.ranges(space.names, 2 * problem.inset)
    x = np.concatenate([x, np.clip(x, low, high)])
    slack, q = slacks(problem, x)
    tried, nearest = len(x), slack.max(axis=0)
    step = 0.3
    for _ in range(ROUNDS):
        best = np.argsort(-slack.min(axis=1), kind="stable")[:BEST]
        if slack[best[0]].min() > problem.inset:
            break
        moves = step * reach * generator.normal(size=(4 * len(best), len(reach)))
        x = np.concatenate([x[best], np.repeat(x[best], 4, axis=0) + moves])
        there, at = slacks(problem, x[len(best) :])
        slack, q = np.concatenate([slack[best], there]), np.concatenate([q[best], at])
        tried, step = tried + len(moves), SMALLER * step
        nearest = np.maximum(nearest, slack.max(axis=0))
    worst = slack.min(axis=1)
    order = [int(k) for k in np.argsort(-worst, kind="stable") if worst[k] > problem.inset]
    if not order:
        raise _impossible(problem, slack, nearest, tried)
    return Poses(x[order], q[order], reach)


def _impossible(
    problem: Problem, slack: FloatArray, nearest: FloatArray, tried: int
) -> AssemblyError:
    """Which bound cannot be met."""
    name, bounds = problem.force_model.mechanism.name, problem.bounds.all
    best = slack[int(slack.min(axis=1).argmax())]
    alone = np.flatnonzero(nearest <= problem.inset)  # bounds that no pose keeps
    k = int(alone[nearest[alone].argmin()]) if len(alone) else int(best.argmin())
    missing = float(-(nearest if len(alone) else best)[k]) * bounds[k].scale
    facts = {"bound": bounds[k].text, "lower": bounds[k].lower, "upper": bounds[k].upper}
    facts |= {"missing": missing, "poses": tried}
    if not np.isfinite(nearest[k]):
        message = (
            f"none of {tried} poses of {name} can be assembled: check the reference and limits"
        )
    elif len(alone):
        by = f"{missing:.4g} {bounds[k].unit}".rstrip()
        message = (
            f"{name} cannot keep the {bounds[k].text} in {bounds[k].ends}: the nearest of {tried} "
            f"poses misses it by {by}, with a margin of {problem.inset:.0%}: widen it by more"
        )
    else:
        broken = ", ".join(bounds[j].text for j in np.flatnonzero(best <= problem.inset))
        message = (
            f"{name} cannot keep all limits at once: the best of {tried} poses breaks those of the "
            f"{broken} ({bounds[k].text} in {bounds[k].ends} by {missing:.4g}): widen one"
        )
    return AssemblyError(message, **facts)


def feasible_start(
    problem: Problem, poses: Poses, seed: int, number: int
) -> tuple[FloatArray, FloatArray]:
    """Variables of a motion that keeps all bounds, and its configurations (N, nq) or (1, nq).

    A random motion is shrunk around a regular pose.
    """
    generator = np.random.default_rng([seed, 12, number])
    among, best, value = max(1, len(poses.positions) // 2), None, np.inf
    still = problem.shape.still()
    for draw in range(DRAWS):
        k = 0 if draw == number == 0 else int(generator.integers(among))
        centre = np.outer(still, poses.positions[k])
        around = problem.shape.draw(generator, len(poses.reach)) * poses.reach
        for _ in range(SHRINKS):
            around = SHRINK * around
            y = problem.of_variables(centre + around)
            found = evaluate(problem, y, poses.configurations[k, None], slopes=False)
            if found is not None and problem.keeps_bounds(found):
                if best is None or found.f < value:
                    best, value = (y, found.q), found.f
                break
    if best is None:
        centre = np.outer(still, poses.positions[0])
        return problem.of_variables(centre), poses.configurations[:1]
    return best


def random_margin(mechanism: Mechanism, configurations: FloatArray, most: float) -> float:
    """A singularity measure that most poses keep: so much, or half of their median."""
    if mechanism.rows == 0:
        return most
    return float(min(most, np.median(singularity_measure(mechanism, configurations)) / 2))
