"""Seeded random closed configurations, inside the limits and away from singularities."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Annotated

import numpy as np
from pydantic import Field

from loopid.arguments import (
    MOST_SAMPLES,
    Count,
    FloatArray,
    Positive,
    checked,
    frozen,
    random_generator,
)
from loopid.errors import AssemblyError
from loopid.kinematics.assembly import AssemblyOptions, follow_paths, largest_opening
from loopid.kinematics.closing import displaced, nearby_configurations
from loopid.kinematics.measured import MeasuredCoordinates, measured_coordinates
from loopid.kinematics.projection import NEAR_SINGULARITY, partition, singularity_measure
from loopid.records import derived, record
from loopid.robot.robot import Robot

SINGULARITY_THRESHOLD = 0.02
LEAST_THRESHOLD = 1e-4  # down to which it falls where few draws keep it
BATCH = 64  # draws between which spread and threshold adapt
# Where less than a part of a batch closes, the next is drawn from nearer by a factor, down to the
# least spread.
FEW, NARROWER, LEAST_SPREAD = 0.5, 0.5, 0.05
MANY_LOOPS = 8  # from which on draws begin nearer: one of them fails in nearly every draw
# Another draw is cheaper than more steps: of a path, and to a draw near by.
SHORTEST_STEP, MOST_STEPS, LEAST_STEPS = 2.0**-6, 32, 8
MOST_KEPT = 512  # samples that are kept with a robot: most work draws the same ones again
UNLIMITED = 1e3  # turns, or characteristic lengths, beyond which a limit is none
PART_LENGTH = 0.3  # characteristic lengths that a floating base moves


@record(kw_only=True, checked=True)
class SamplingOptions:
    """How random configurations are sampled.

    Attributes
    ----------
    singularity_threshold : float, optional
        Least singularity measure of a pose, see ``Projection.singularity``; by default that of the
        robot's file, else the usual one, or less where the geometry hardly allows it.
    spread : float
        Part of the limits around the reference that samples come from.
    attempts : int
        Draws for each configuration found, after which they are given up.

    Examples
    --------
    >>> import loopid
    >>> near = loopid.kinematics.SamplingOptions(spread=0.1)
    >>> loopid.random_configurations(loopid.load("five_bar"), 3, seed=0, options=near).shape
    (3, 4)
    """

    singularity_threshold: Annotated[float, Field(ge=0, le=1)] | None = None
    spread: Positive = 1.0
    attempts: Annotated[int, Field(ge=1)] = 200


@checked
def random_configurations(
    robot: Robot, count: Count, *, seed: int = 0, options: SamplingOptions | None = None
) -> FloatArray:
    """Draw closed configurations on the reference's branch.

    Independent joints are uniform within their limits (one turn, or one characteristic length,
    around the reference where there are none). Draws that cannot be assembled, break a limit of a
    passive joint or come too near a singularity are left out. Where most draws fail, the next ones
    keep nearer to the reference. Spins of rods and floating bases are anywhere.

    Parameters
    ----------
    robot : Robot
    count : int
    seed : int
        Same seed, same configurations; a larger count only adds more.
    options : SamplingOptions, optional

    Returns
    -------
    FloatArray
        (count, nq).

    Raises
    ------
    AssemblyError
        When hardly any draw passes.

    Examples
    --------
    >>> import loopid
    >>> robot = loopid.load("five_bar")
    >>> loopid.random_configurations(robot, 10, seed=1).shape
    (10, 4)
    """
    return np.concatenate(list(configuration_batches(robot, count, seed, options=options)))


def configuration_batches(
    robot: Robot, count: int, seed: int = 0, *, options: SamplingOptions | None = None
) -> Iterator[FloatArray]:
    """Yield the rows of ``random_configurations`` a few at a time."""
    options = SamplingOptions() if options is None else options
    if options.singularity_threshold is None:
        options = replace(options, singularity_threshold=robot.singularity_threshold)
    kept = _kept(robot, seed, options)
    enough = sum(map(len, kept)) >= count
    batches, found = list[FloatArray](), 0
    for batch in kept if enough else _drawn(robot, seed, options):
        if count <= MOST_KEPT:
            batches.append(frozen(batch))
        yield batch[: count - found]
        found += len(batch)
        if found >= count:
            break
    if batches and not enough:
        kept[:] = batches


@derived
def _kept(robot: Robot, seed: int, options: SamplingOptions) -> list[FloatArray]:
    """Batches that were drawn before, to be filled."""
    return []


def _drawn(robot: Robot, seed: int, options: SamplingOptions) -> Iterator[FloatArray]:
    """Yield closed configurations without end."""
    generator, robot = random_generator(seed), _with_regular_reference(robot)
    measured = measured_coordinates(robot, None)
    home, lower, upper = _ranges(measured)
    places = robot.draw_places(robot.velocity_indices(robot.measured))
    steps = max(MOST_STEPS * options.spread, LEAST_STEPS)
    paths = AssemblyOptions(shortest_step=SHORTEST_STEP, most_steps=steps)
    spread = min(options.spread, MANY_LOOPS / max(len(robot.loops), 1))
    least = options.singularity_threshold
    if least is None:
        least = least_measure(robot)
    drawn, found, broken = 0, 0, np.zeros(robot.model.nq)
    while True:
        if drawn > options.attempts * (found + BATCH):
            raise _too_few(robot, found, drawn, least, broken)
        part = generator.uniform(size=(BATCH, len(home)))[:, places]
        values = home + spread * (lower + part * (upper - lower) - home)
        outcome = follow_paths(measured, robot.reference[None], values, paths)
        q = outcome.configurations[outcome.assembled]
        outside = robot.outside(q)
        q, broken = q[~outside.any(axis=1)], broken + outside.sum(axis=0)
        q = _completed(robot, q, generator)
        regular = q[singularity_measure(robot, q) >= least]
        if len(q) < FEW * BATCH:  # draw nearer
            spread = max(NARROWER * spread, LEAST_SPREAD)
        if len(regular) < FEW * len(q) and options.singularity_threshold is None:  # accept less
            least = max(0.5 * least, LEAST_THRESHOLD)
        found, drawn = found + len(regular), drawn + BATCH
        if len(regular):
            yield regular


def _ranges(measured: MeasuredCoordinates) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Reference values of the measured joints, and the limits between which they are drawn."""
    robot = measured.robot
    home = measured.read(robot.reference[None])[0]
    chosen = robot.velocity_indices(robot.measured)
    width = robot.coordinate_ranges[chosen]
    limits = np.array([robot.limits(name) for name in robot.measured]).reshape(-1, 2)
    limited = np.abs(limits) < UNLIMITED * width[:, None]
    lower = np.where(limited[:, 0], limits[:, 0], home - width)
    upper = np.where(limited[:, 1], limits[:, 1], home + width)
    return home, lower, upper


@derived
def least_measure(robot: Robot) -> float:
    """Singularity measure below which poses of a robot count as near a singularity.

    That of its file, else the usual one, or half of the reference's where this hardly keeps it.
    """
    if robot.singularity_threshold is not None:
        return robot.singularity_threshold
    reference = _with_regular_reference(robot).reference
    own = float(singularity_measure(robot, reference[None])[0])
    return max(LEAST_THRESHOLD, min(SINGULARITY_THRESHOLD, 0.5 * own))


def _with_regular_reference(robot: Robot) -> Robot:
    """The robot with another reference, close by, where its own one is singular."""
    if singularity_measure(robot, robot.reference[None])[0] >= NEAR_SINGULARITY:
        return robot
    around = nearby_configurations(robot, robot.reference)
    best = int(singularity_measure(robot, around).argmax())
    return replace(robot, reference=around[best])


def _too_few(
    robot: Robot, found: int, drawn: int, singularity_threshold: float, broken: FloatArray
) -> AssemblyError:
    worst = next((n for n in robot.joints if robot.joint(n).idx_q == int(broken.argmax())), "")
    limits = f" ({worst} broke them {int(broken.max())} times)" if broken.any() else ""
    return AssemblyError(
        f"only {found} of {drawn} random draws of {robot.name} close with a singularity "
        f"measure of at least {singularity_threshold:g}: lower the threshold or check the "
        f"limits{limits}",
        found=found,
        drawn=drawn,
        singularity_threshold=singularity_threshold,
    )


def _completed(robot: Robot, q: FloatArray, generator: np.random.Generator) -> FloatArray:
    """Closed configurations inside the limits, with the parts that are held at random."""
    if not robot.unmeasured:
        return q
    chosen, _ = partition(robot)
    parts = np.isin(robot.independent, robot.unmeasured)
    units = np.where(np.isin(chosen, robot.prismatic), PART_LENGTH * robot.length, np.pi)
    steps = generator.uniform(-1.0, 1.0, size=(len(q), len(chosen)))
    steps = steps[:, robot.draw_places(chosen)] * units * parts
    q, residual = displaced(robot, q, steps)
    closed = residual <= largest_opening(robot)
    return q[closed & ~robot.outside(q).any(axis=1)]


@checked
def random_motions(
    robot: Robot,
    count: Annotated[int, Field(ge=0, le=MOST_SAMPLES)],
    *,
    seed: int | np.random.Generator = 0,
) -> tuple[FloatArray, FloatArray]:
    """Draw independent velocities and accelerations (count, dof) each.

    They are uniform and as large as a fall over the characteristic length would make them. So
    inertial and gravity forces have one order of magnitude.

    Parameters
    ----------
    robot : Robot
    count : int
    seed : int or numpy.random.Generator

    Returns
    -------
    velocities, accelerations : FloatArray
        Of ``robot.independent``, in rad or m and s.

    Examples
    --------
    >>> import loopid
    >>> v, a = loopid.kinematics.random_motions(loopid.load("five_bar"), 10)
    >>> v.shape
    (10, 2)
    """
    generator = seed if isinstance(seed, np.random.Generator) else random_generator(seed)
    independent, _ = partition(robot)
    unit = robot.coordinate_scales[independent]
    gravity = float(np.linalg.norm(robot.model.gravity.linear)) or 1.0
    rate = np.sqrt(gravity / robot.length)
    drawn = generator.uniform(-1.0, 1.0, size=(2, count, len(unit)))
    velocity, acceleration = drawn.take(robot.draw_places(independent), axis=2)
    return velocity * unit * rate, acceleration * unit * rate**2
