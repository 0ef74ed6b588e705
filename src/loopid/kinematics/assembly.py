"""Assembly: all coordinates from measured ones, on the assembly branch of the start.

Samples on their own are reached along straight lines from the start, in steps so short that
Newton's method contracts at once and the Jacobian keeps its orientation [Allgower2003]. Along a
trajectory each is reached from the last one that was, as many at once as one step along the tangent
leads to. All samples advance together. Steps and residuals are in common units (``constraint``).
Derivation in docs/derivations.md.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import field
from typing import Annotated, NamedTuple

import numpy as np
from pydantic import Field

from loopid.arguments import (
    NOT_EMPTY,
    BoolArray,
    FloatArray,
    IntArray,
    NotNegative,
    Positive,
    checked,
    one_as_many,
    rectangular,
    samples,
)
from loopid.errors import AccuracyWarning, AssemblyError, DataError, warn
from loopid.kinematics.constraint import constraint_residual
from loopid.kinematics.measured import MeasuredCoordinates, measured_coordinates
from loopid.kinematics.poses import blocks, difference, integrate
from loopid.kinematics.projection import OPEN, SOFT, Solver
from loopid.records import record
from loopid.robot.robot import Robot
from loopid.workers import one_blas_thread

CLOSURE_TOLERANCE = 1e-10  # of the characteristic length; what a configuration must reach
NEWTON_STEPS = 12  # of a correction at most
LONGEST_STEP = 0.4  # rad or characteristic lengths, of the first of these
# Each further step as a part of the last at most. By Kantorovich's theorem one may then expect that
# the root is unique around the start, hence the one on its branch.
CONTRACTION = 0.2
LEAST_WINDOW, WINDOW = 16, 256  # samples of a trajectory that are reached at a time
REGULAR = 1e-6  # ratio of singular values above which inverses are good enough for such a step


@record(kw_only=True, checked=True)
class AssemblyOptions:
    """How closely loops are closed, and how paths are followed to there.

    Steps of Newton's method are in rad or characteristic lengths of the unknown coordinates.

    Attributes
    ----------
    tolerance : float
        Largest closure residual that is left, of the characteristic length.
    shortest_step : float
        Part of the way to a sample that must be done at a time; below it the sample is given up.
    most_steps : float
        Of a path; by default more than the shortest step leaves room for.
    short : float
        A Newton step this short, the root of the round-off, leaves an error of round-off.
    rough : float
        The same on the way, where the next correction starts.

    Examples
    --------
    >>> import loopid
    >>> robot = loopid.load("five_bar")
    >>> closer = loopid.kinematics.AssemblyOptions(tolerance=1e-12)
    >>> loopid.kinematics.assemble(robot, [[1.2, 1.9]], options=closer).shape
    (1, 4)
    """

    tolerance: NotNegative = CLOSURE_TOLERANCE
    shortest_step: Annotated[float, Field(gt=0, le=1)] = 2.0**-12
    most_steps: Annotated[float, Field(ge=1)] = 1e6
    short: Positive = 1e-8
    rough: Positive = 1e-3


USUAL = AssemblyOptions()


@record(checked="outside")
class Assembly:
    """Assembled configurations.

    Examples
    --------
    >>> import numpy as np
    >>> from loopid.kinematics import Assembly
    >>> left = np.array([1e-12, 2e-12, 0.1])
    >>> found = Assembly(np.zeros((3, 4)), left, left < 1e-9)
    >>> found.first(2).assembled.tolist()
    [True, True]
    """

    configurations: FloatArray  # (N, nq); rows that could not be assembled hold NaN
    residual: FloatArray  # (N,), largest closure residual in m
    assembled: BoolArray  # (N,), whether the loops close on the start's branch
    tolerance: float = field(default=0.0, repr=False)  # in m, of the residual

    def first(self, count: int) -> Assembly:
        """The first ``count`` samples."""
        parts = self.configurations[:count], self.residual[:count], self.assembled[:count]
        return Assembly(*parts, self.tolerance)

    @classmethod
    def joined(cls, parts: Annotated[Sequence[Assembly], NOT_EMPTY]) -> Assembly:
        """Assemblies one after the other, at least one."""
        if len(parts) == 1:
            return parts[0]
        return cls(
            np.concatenate([part.configurations for part in parts]),
            np.concatenate([part.residual for part in parts]),
            np.concatenate([part.assembled for part in parts]),
            parts[0].tolerance,
        )


@checked
def assemble(
    robot: Robot,
    values: FloatArray,
    coordinates: Sequence[str] | str | None = None,
    *,
    start: FloatArray | None = None,
    trajectory: bool = False,
    options: AssemblyOptions = USUAL,
) -> FloatArray:
    """Solve all coordinates from measured ones, on the assembly branch of the start.

    A long trajectory may be assembled in parts. Take the last configuration of a part as the start
    of the next one. They are then the same, to round-off, as those of the whole.

    Parameters
    ----------
    robot : Robot
    values : FloatArray
        (N, c), measured coordinates in m or rad.
    coordinates : sequence of str or "platform", optional
        Joints that were measured, or ``"platform"`` for the platform coordinates that the robot
        file declares; by default the independent joints. They must determine the motion.
    start : FloatArray, optional
        (nq,), a closed configuration on the branch; by default the reference.
    trajectory : bool
        Whether the samples follow one another: each is then reached from the one before.
    options : AssemblyOptions
        Such as the closure residual to reach, ``tolerance``.

    Returns
    -------
    FloatArray
        (N, nq), closed to round-off where the geometry allows, at least to the tolerance.

    Raises
    ------
    AssemblyError
        When a sample cannot be reached from the start without meeting a singularity.
    MobilityError
        When the coordinates do not determine the motion.

    Examples
    --------
    >>> import loopid
    >>> robot = loopid.load("3ups_rpu")
    >>> q = loopid.kinematics.assemble(robot, [[0.0, 0.7, 0.1, 0.0]], "platform")
    >>> loopid.kinematics.platform_coordinates(robot, q).round(6).tolist()
    [[0.0, 0.7, 0.1, 0.0]]
    """
    outcome = try_assemble(
        robot, values, coordinates, start=start, trajectory=trajectory, options=options
    )
    return required(outcome).copy()


@checked
def try_assemble(
    robot: Robot,
    values: FloatArray,
    coordinates: Sequence[str] | str | None = None,
    *,
    start: FloatArray | None = None,
    trajectory: bool = False,
    options: AssemblyOptions = USUAL,
) -> Assembly:
    """As ``assemble``, but report the samples that fail; there may be a start for each, (N, nq)."""
    measured = measured_coordinates(robot, coordinates)
    targets = samples(values, measured.width, "measured coordinates")
    q = rectangular(robot.reference if start is None else start, "start")
    one_each = not trajectory and np.ndim(q) == 2 and len(q) == len(targets)
    q = samples(q, robot.model.nq, "start", len(targets) if one_each else 1)
    if trajectory:
        with one_blas_thread():
            return follow_trajectory(measured, q[0], targets, options)
    return follow_paths(measured, q, targets, options)


@checked
@one_as_many
def closed_configurations(robot: Robot, configurations: FloatArray) -> FloatArray:
    """Close the loops of configurations that are a little open, as those of soft constraints.

    Simulators such as MuJoCo let equalities give way, by some thousandths of the robot's length.
    The independent coordinates stay as they are. All others go to where the loops close, on the
    same assembly branch.

    Parameters
    ----------
    robot : Robot
    configurations : FloatArray
        (nq,) or (N, nq) in m and rad, open by at most ``SOFT`` of the robot's length.

    Returns
    -------
    FloatArray
        (nq,) or (N, nq), closed as ``assemble`` does.

    Raises
    ------
    DataError
        Naming the loop that is open by more.
    AssemblyError
        Where loops cannot be closed from there.

    Warns
    -----
    AccuracyWarning
        By how much loops were open, where this is more than ``OPEN`` of the robot's length, and
        how far the other coordinates went.

    Examples
    --------
    >>> import loopid
    >>> robot = loopid.load("five_bar")
    >>> q = robot.reference + [0, 1e-6, 0, 0]  # what a soft constraint leaves open
    >>> closed = loopid.kinematics.closed_configurations(robot, q)
    >>> bool(abs(loopid.kinematics.constraint_residual(robot, closed)).max() < 1e-10)
    True
    """
    measured, q = measured_coordinates(robot), samples(configurations, robot.model.nq, "q")
    before, length = np.abs(robot.row_scales * constraint_residual(robot, q)), robot.length
    if before.max(initial=0.0) > SOFT * length:
        k, row = np.unravel_index(int(before.argmax()), before.shape)
        raise DataError(
            f"{robot.row_names[row]} of sample {k} is open by {before[k, row]:.3g} m, more than a "
            f"soft constraint leaves ({SOFT:g} of the robot's length of {length:.3g} m): give the "
            "positions of the independent coordinates to loopid.kinematics.assemble",
            argument="configurations",
            given=float(before[k, row]),
            tolerance=SOFT * length,
        )
    closed = required(follow_paths(measured, q, measured.read(q)))
    if before.max(initial=0.0) > OPEN * length:
        steps = np.abs(difference(robot, q, closed) / robot.coordinate_scales)
        warn(
            f"loops of {robot.name} were open by up to {before.max():.3g} m, "
            f"{before.max() / length:.2g} of its length: to close them, joints went up to "
            f"{steps.max():.2g} rad or lengths",
            AccuracyWarning,
        )
    return closed


def required(outcome: Assembly) -> FloatArray:
    """The configurations (N, nq), where all samples are assembled."""
    if not outcome.assembled.all():
        lost = np.flatnonzero(~outcome.assembled)
        open_by, tolerance = float(outcome.residual[lost[0]]), outcome.tolerance
        raise AssemblyError(
            f"sample {lost[0]} cannot be assembled from the start: the loops stay open by "
            f"{open_by:.1e} m (tolerance {tolerance:g} m), so the coordinates are out of reach or "
            f"beyond a singularity ({len(lost)} of {len(outcome.assembled)} samples)",
            sample=int(lost[0]),
            residual=open_by,
            tolerance=tolerance,
            samples=len(lost),
        )
    return outcome.configurations


def follow_paths(
    measured: MeasuredCoordinates,
    starts: FloatArray,
    targets: FloatArray,
    options: AssemblyOptions = USUAL,
) -> Assembly:
    """Move samples along their straight lines from starts (N or 1, nq) to targets (N, c)."""
    q = np.repeat(starts, len(targets), axis=0) if len(starts) != len(targets) else starts
    # Threads of BLAS only matter, and setting them only pays, where there are many samples.
    with one_blas_thread() if len(targets) > 1 else nullcontext():
        parts = [_followed(measured, q[rows], targets[rows], options) for rows in blocks(len(q))]
    return Assembly.joined(parts)


def _followed(
    measured: MeasuredCoordinates, start: FloatArray, targets: FloatArray, options: AssemblyOptions
) -> Assembly:
    """Samples (N, c) from starts (N, nq): the whole way at once, else in steps."""
    origin = measured.read(start)
    way, jacobian = measured.difference(origin, targets), measured.linearise(start, origin).unknown
    # The last point on the path, the part of the way done there, and the next part.
    q, done, step = start.copy(), np.zeros(len(start)), np.ones(len(start))
    k, tried = np.arange(len(start)), 0
    while len(k) and tried < options.most_steps:
        ahead = np.minimum(done[k] + step[k], 1.0)
        short = np.where(ahead < 1.0, options.rough, options.short)
        values = targets[k] - (1.0 - ahead)[:, None] * way[k]
        found = correct(measured, q[k], values, short)
        good = found.accepted & same_side(jacobian[k], found.jacobian)
        there = k[good]
        q[there], jacobian[there] = found.configurations[good], found.jacobian[good]
        done[there] = ahead[good]
        step[k] *= np.where(good, 2.0, 0.5)
        k, tried = k[(done[k] < 1.0) & (step[k] >= options.shortest_step)], tried + 1
    if (done < 1.0).any():
        q = measured.write(q, targets)
    return _judged(measured, q, targets, done >= 1.0, options)


def largest_opening(robot: Robot, tolerance: float = CLOSURE_TOLERANCE) -> float:
    """What the loops of a robot may stay open by, in m."""
    return max(tolerance * robot.length, 2.0 * robot.closure_residual)


def _judged(
    measured: MeasuredCoordinates,
    q: FloatArray,
    targets: FloatArray,
    good: BoolArray,
    options: AssemblyOptions,
) -> Assembly:
    """Configurations (N, nq), of which those are assembled that are good, and closed."""
    residual = np.abs(measured.residual(q, targets)).max(axis=1, initial=0.0)
    most = largest_opening(measured.robot, options.tolerance)
    assembled = good & (residual <= most)
    q[~assembled] = np.nan
    return Assembly(q, residual, assembled, most)


class Correction(NamedTuple):
    """What Newton's method leads to; Jacobian and tangent are of the last step, which is short."""

    configurations: FloatArray  # (N, nq)
    accepted: BoolArray  # (N,), whether it contracted at once
    jacobian: FloatArray  # (N, m, u), by the unknown coordinates
    # (N, u, c), their steps per unit of the measured values; without columns where not required
    tangent: FloatArray


def correct(
    measured: MeasuredCoordinates,
    q: FloatArray,
    values: FloatArray,
    short: FloatArray | float,
    *,
    tangents: bool = False,
) -> Correction:
    """Newton's method from configurations (N, nq) to measured values (N, c), up to a short step."""
    q, count = measured.write(q, values), len(q)
    accepted, short = np.zeros(count, dtype=bool), np.full(count, short)
    jacobian = tangent = np.empty((count, 0, 0))
    longest: FloatArray | float = LONGEST_STEP
    k: IntArray | slice = slice(None)  # those that go on
    for _ in range(NEWTON_STEPS):
        at = measured.linearise(q[k], values[k])
        pull = at.residual[:, :, None]
        if tangents:
            pull = np.concatenate([pull, at.known], axis=2)
        solution = Solver.of(at.unknown, REGULAR).solve(pull)
        step, slope = -solution[:, :, 0], -solution[:, :, 1:]
        q[k] = integrate(measured.robot, q[k], measured.tangent(step))
        if len(at.unknown) == count:
            jacobian, tangent = at.unknown, slope
        else:
            jacobian[k], tangent[k] = at.unknown, slope
        length = np.abs(step).max(axis=1, initial=0.0)
        accepted[k] = done = length <= short[k]
        if done.all():
            break
        going = ~done & (length <= longest)
        if not going.all():
            k = left = np.arange(count)[k][going]
            if not len(left):
                break
        longest = CONTRACTION * length[going]
    return Correction(q, accepted, jacobian, tangent)


def same_side(before: FloatArray, after: FloatArray) -> BoolArray:
    """Whether no singularity lies between two Jacobians of the unknown coordinates.

    det(JᵀJ') of close Jacobians is positive, and changes its sign with that of a square J'.
    """
    sign, _ = np.linalg.slogdet(before.transpose(0, 2, 1) @ after)
    return np.asarray(sign > 0, dtype=bool)


def follow_trajectory(
    measured: MeasuredCoordinates,
    start: FloatArray,
    targets: FloatArray,
    options: AssemblyOptions = USUAL,
) -> Assembly:
    """Follow the straight line to each sample (N, c) from the last one that was reached."""
    if not len(targets):
        return follow_paths(measured, start[None], targets, options)
    parts, first, window, alone = list[Assembly](), 0, WINDOW, 1
    while first < len(targets):
        part = _together(measured, start, targets[first : first + window], options)
        count = len(part.residual)
        window = min(max(2 * count, LEAST_WINDOW), WINDOW)
        if not count:
            # From one start as many samples as fail, and the first that does not.
            ahead = targets[first : first + alone]
            part = follow_paths(measured, start[None], ahead, options)
            found = np.flatnonzero(part.assembled)
            alone = 1 if len(found) else min(2 * alone, WINDOW)
            part = part.first(int(found[0]) + 1 if len(found) else len(ahead))
        if part.assembled[-1]:
            start = part.configurations[-1]
        parts.append(part)
        first += len(part.residual)
    return Assembly.joined(parts)


def _together(
    measured: MeasuredCoordinates, start: FloatArray, targets: FloatArray, options: AssemblyOptions
) -> Assembly:
    """The leading samples (N, c) to which one step leads from the start (nq,).

    The tangent at the start is the first Newton step. What is left then must be shorter. No
    singularity may lie in between.
    """
    here = measured.read(start[None])
    home = correct(measured, start[None], here, options.short, tangents=True)
    steps = measured.difference(here, targets) @ home.tangent[0].T
    length = np.abs(steps).max(axis=1, initial=0.0)
    near = _leading_true(length <= LONGEST_STEP)
    targets, steps, length = targets[:near], steps[:near], length[:near]
    guess = integrate(measured.robot, np.tile(start, (near, 1)), measured.tangent(steps))
    found = correct(measured, guess, targets, options.short)
    q = found.configurations
    rest = np.abs(measured.steps(guess, q)).max(axis=1, initial=0.0)
    good = found.accepted & (rest <= CONTRACTION * length + options.short)
    good &= same_side(np.repeat(home.jacobian, near, axis=0), found.jacobian)
    outcome = _judged(measured, q, targets, good, options)
    return outcome.first(_leading_true(outcome.assembled))


def _leading_true(values: BoolArray) -> int:
    return len(values) if values.all() else int(values.argmin())
