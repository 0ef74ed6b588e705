"""Assembly: all coordinates from measured ones, on the assembly branch of the start.

Measured are joints, or the coordinates of the platform. Samples on their own are reached along
straight lines from the start, in steps whose length adapts so that Newton's method contracts at
once and the Jacobian keeps its orientation: the solution then stays on the branch of the start
[Allgower2003]. All samples advance together; every linear solve is batched. Steps and residuals are
in common units (see ``constraint``).

Along a trajectory each is reached from the last one that was, window by window: a few samples, the
nodes, are solved from the start; those between them are predicted by curves and corrected by
Newton's method, mostly in one step. A sample counts once it is *linked* to the one before: a step
along the path from there would lead to it. So, by induction, the outcome is what following the path
sample by sample gives, however the trajectory is cut. Where the chain of links ends, the path to
the next sample is followed in full.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from loopid.arguments import (
    BoolArray,
    FloatArray,
    IntArray,
    checked,
    samples,
)
from loopid.errors import (
    AssemblyError,
    MobilityError,
    OptionError,
)
from loopid.kinematics.constraint import (
    Constraint,
    scaled_residual,
)
from loopid.kinematics.poses import (
    BLOCK,
    FramePoses,
    blocks,
    difference,
    frame_motions,
    frame_poses,
    integrate,
)
from loopid.kinematics.projection import (
    Factorisation,
    Solver,
    partition,
)
from loopid.robot.closures import relative_quaternion
from loopid.robot.mechanism import Mechanism
from loopid.robot.platform import Platform
from loopid.workers import one_blas_thread

CLOSURE_TOLERANCE = 1e-10  # m; what an assembled configuration must reach
SHORTEST_PATH_STEP = 2.0**-12  # part of the way below which a sample is given up

# Steps of the unknown coordinates are in rad or characteristic lengths.
NEWTON_STEPS = 12
LONGEST_STEP = 0.4  # of the first step of a correction
# A Newton step this short, the root of the round-off, leaves an error of round-off.
SHORT = 1e-8
# A Newton step this short is good enough on the way: the next correction starts from there.
ROUGH = 1e-3
# A correction is accepted when each Newton step is at most this fraction of the last. Then, by
# Kantorovich's theorem, one may expect that the root is unique around the start, hence the one
# that continues its branch.
CONTRACTION = 0.2
# Ratio of singular values above which LU factors are good enough for a Newton step.
REGULAR = 1e-6

# Along a trajectory, in samples.
LEAST_WINDOW = 16
STRIDE = 8  # between nodes


class Linearisation(NamedTuple):
    """Residual and its derivatives, exact where it is zero: Newton needs no more."""

    residual: FloatArray  # (N, m)
    unknown: FloatArray  # (N, m, u), by the unknown coordinates in unit steps
    known: FloatArray  # (N, m, c), by the measured values


class MeasuredCoordinates(ABC):
    """A set of numbers from which the configuration follows."""

    def __init__(self, mechanism: Mechanism, unknown: IntArray, width: int) -> None:
        self.mechanism = mechanism
        self.unknown = unknown
        self.width = width

    @abstractmethod
    def read(self, q: FloatArray) -> FloatArray:
        """Their values (N, width) at configurations (N, nq)."""

    @abstractmethod
    def write(self, q: FloatArray, values: FloatArray) -> FloatArray:
        """Configurations with the measured values put in, as far as they are coordinates."""

    @abstractmethod
    def linearise(self, q: FloatArray, values: FloatArray) -> Linearisation:
        """The equations at configurations (N, nq) that should have values (N, width)."""

    @abstractmethod
    def residual(self, q: FloatArray, values: FloatArray) -> FloatArray:
        """Residual (N, m) alone."""

    def difference(self, origin: FloatArray, target: FloatArray) -> FloatArray:
        """The way (N, width) from values to values."""
        return target - origin

    def tangent(self, steps: FloatArray) -> FloatArray:
        """Tangent vectors (N, nv) of scaled steps (N, u) of the unknown coordinates."""
        tangent = np.zeros((len(steps), self.mechanism.model.nv))
        tangent[:, self.unknown] = steps * self.mechanism.coordinate_scales[self.unknown]
        return tangent

    def steps(self, origin: FloatArray, target: FloatArray) -> FloatArray:
        """Scaled steps (N, u) of the unknown coordinates between configurations (N, nq)."""
        tangent = difference(self.mechanism, origin, target)
        return tangent[:, self.unknown] / self.mechanism.coordinate_scales[self.unknown]


class JointCoordinates(MeasuredCoordinates):
    """Measured joints: the others are unknown, but for single coordinates that are independent.

    The spin of a rod in a spherical joint, or the placement of a floating base, is no number that
    could be given: it stays as it is at the start.
    """

    def __init__(self, mechanism: Mechanism, joints: Sequence[str]) -> None:
        self.known, _ = partition(mechanism, joints)
        if len(self.known) != len(joints):
            raise OptionError("only joints with one coordinate can be measured")
        held = mechanism.velocity_indices(mechanism.held)
        unknown = np.setdiff1d(np.arange(mechanism.model.nv), np.append(self.known, held))
        super().__init__(mechanism, unknown, len(joints))
        models = [mechanism.joint(name) for name in joints]
        self.first = np.array([joint.idx_q for joint in models], dtype=np.int64)
        # A continuous joint is stored as the cosine and sine of its angle.
        self.circular = np.array([joint.nq == 2 for joint in models], dtype=bool)

    def read(self, q: FloatArray) -> FloatArray:
        values = q[:, self.first]
        circle = self.first[self.circular]
        values[:, self.circular] = np.arctan2(q[:, circle + 1], q[:, circle])
        return values

    def write(self, q: FloatArray, values: FloatArray) -> FloatArray:
        q = q.copy()
        q[:, self.first] = values
        angles, circle = values[:, self.circular], self.first[self.circular]
        q[:, circle], q[:, circle + 1] = np.cos(angles), np.sin(angles)
        return q

    def difference(self, origin: FloatArray, target: FloatArray) -> FloatArray:
        way = target - origin
        turns = way[:, self.circular]
        way[:, self.circular] = np.mod(turns + np.pi, 2 * np.pi) - np.pi
        return way

    def linearise(self, q: FloatArray, values: FloatArray) -> Linearisation:
        residual, jacobian = Constraint(self.mechanism, q).scaled()
        known = jacobian[:, :, self.known] / self.mechanism.coordinate_scales[self.known]
        return Linearisation(residual, jacobian[:, :, self.unknown], known)

    def residual(self, q: FloatArray, values: FloatArray) -> FloatArray:
        return scaled_residual(self.mechanism, q)


class PlatformCoordinates(MeasuredCoordinates):
    """A measured platform pose: all joints are unknown, the pose adds six equations."""

    def __init__(self, mechanism: Mechanism) -> None:
        self.platform = declared_platform(mechanism)
        super().__init__(mechanism, np.arange(mechanism.model.nv), len(self.platform.motions))

    def read(self, q: FloatArray) -> FloatArray:
        return platform_coordinates(self.mechanism, q)

    def write(self, q: FloatArray, values: FloatArray) -> FloatArray:
        return q.copy()

    def linearise(self, q: FloatArray, values: FloatArray) -> Linearisation:
        residual, closures = Constraint(self.mechanism, q).scaled()
        frame = frame_poses(self.mechanism, q, [self.platform.frame_id])
        twist = np.repeat([1.0, self.mechanism.length], 3)[:, None]
        pose = np.concatenate([frame.linear[:, 0], frame.angular[:, 0]], axis=1)
        known = np.zeros((len(q), residual.shape[1] + 6, self.width))
        known[:, -6:] = -twist * self.platform.twist_map(values)
        return Linearisation(
            np.concatenate([residual, self._off_pose(frame, values)], 1),
            np.concatenate([closures, twist * pose * self.mechanism.coordinate_scales], 1),
            known,
        )

    def residual(self, q: FloatArray, values: FloatArray) -> FloatArray:
        frame = frame_poses(self.mechanism, q, [self.platform.frame_id], jacobians=False)
        return np.concatenate(
            [scaled_residual(self.mechanism, q), self._off_pose(frame, values)], 1
        )

    def _off_pose(self, frame: FramePoses, values: FloatArray) -> FloatArray:
        """What separates the frame from its target (N, 6), in m, along the fixed axes."""
        rotation, origin = self.platform.placements(values)
        inverses = np.swapaxes(frame.rotation[:, 0], 1, 2), np.swapaxes(rotation, 1, 2)
        turn = 2 * self.mechanism.length * relative_quaternion(*inverses)[0]
        return np.concatenate([frame.origin[:, 0] - origin, turn], 1)


@checked
def measured_coordinates(
    mechanism: Mechanism, coordinates: Sequence[str] | str | None = None
) -> MeasuredCoordinates:
    """Choose the measured coordinates: joints, ``"platform"``, or the independent joints.

    A MobilityError says that they are too few or too many to determine the motion at the reference.
    """
    measured: MeasuredCoordinates
    if coordinates == "platform":
        measured = PlatformCoordinates(mechanism)
    else:
        names = mechanism.measured if coordinates is None else coordinates
        joints = (names,) if isinstance(names, str) else tuple(names)
        measured = JointCoordinates(mechanism, joints)
    q, unknown = mechanism.reference[None], len(measured.unknown)
    found = int(Factorisation.of(measured.linearise(q, measured.read(q)).unknown).rank[0])
    if found < unknown:
        raise MobilityError(
            f"the measured coordinates determine {found} of the {unknown} other coordinates of "
            f"{mechanism.name} at its reference: give more, or others, or a reference "
            "that is not singular"
        )
    jacobian, tolerance = Constraint(mechanism, q).scaled()[1], mechanism.closure_rank_tolerance
    if int(Factorisation.of(jacobian, tolerance).rank[0]) > found:
        raise MobilityError(
            f"the {measured.width} measured coordinates of {mechanism.name} are not "
            "independent of each other: leave some out"
        )
    return measured


@checked
def platform_coordinates(mechanism: Mechanism, configurations: FloatArray) -> FloatArray:
    """Platform coordinates (N, c) that the robot file declares, at configurations (N, nq).

    Raises
    ------
    OptionError
        When the robot file declares none.

    Examples
    --------
    >>> import loopid
    >>> robot = loopid.load_mechanism("3ups_rpu")
    >>> loopid.kinematics.platform_coordinates(robot, robot.reference).shape
    (1, 4)
    """
    platform = declared_platform(mechanism)
    q = samples(configurations, mechanism.model.nq, "configurations")
    frame = frame_poses(mechanism, q, [platform.frame_id], jacobians=False)
    return platform.coordinates(frame.rotation[:, 0], frame.origin[:, 0])


def declared_platform(mechanism: Mechanism) -> Platform:
    """The platform of the robot file; an OptionError when it declares none."""
    if mechanism.platform is None:
        raise OptionError(f"{mechanism.name} declares no platform coordinates")
    return mechanism.platform


@checked
def platform_motion(
    mechanism: Mechanism,
    configurations: FloatArray,
    rates: FloatArray,
    accelerations: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Velocities and accelerations (N, nv) of all joints from those (N, c) of the platform.

    At closed configurations (N, nq).
    """
    platform = declared_platform(mechanism)
    q = samples(configurations, mechanism.model.nq, "configurations")
    xd = samples(rates, len(platform.motions), "platform rates", len(q))
    xdd = samples(accelerations, len(platform.motions), "platform accelerations", len(q))
    parts = [_platform_motion(mechanism, platform, q[k], xd[k], xdd[k]) for k in blocks(len(q))]
    v, a = zip(*parts, strict=True)
    return np.concatenate(v), np.concatenate(a)


def _platform_motion(
    mechanism: Mechanism, platform: Platform, q: FloatArray, xd: FloatArray, xdd: FloatArray
) -> tuple[FloatArray, FloatArray]:
    constraint = Constraint(mechanism, q)
    frame = frame_poses(mechanism, q, [platform.frame_id])
    x = platform.coordinates(frame.rotation[:, 0], frame.origin[:, 0])
    jacobian = [constraint.jacobian(), frame.linear[:, 0], frame.angular[:, 0]]
    scales, units = mechanism.coordinate_scales, np.repeat([1.0, mechanism.length], 3)
    rows = np.append(mechanism.row_scales, units)
    factors = Factorisation.of(rows[:, None] * np.concatenate(jacobian, axis=1) * scales)

    def solve(closures: FloatArray, twists: FloatArray) -> FloatArray:
        wanted = rows * np.concatenate([closures, twists], axis=1)
        return np.asarray(scales * factors.solve(wanted[:, :, None])[:, :, 0])

    E = platform.twist_map(x)
    v = solve(np.zeros((len(q), mechanism.rows)), np.einsum("nij,nj->ni", E, xd))
    moving = frame_motions(mechanism, q, v, frame)
    felt = np.concatenate([moving.acceleration[:, 0], moving.turning[:, 0]], axis=1)
    twist_rate = np.einsum("nij,nj->ni", E, xdd) + platform.twist_drift(x, xd)
    return v, solve(-constraint.drift(v), twist_rate - felt)


@dataclass(frozen=True, repr=False)
class Assembly:
    """Assembled configurations."""

    configurations: FloatArray  # (N, nq); rows that could not be assembled hold NaN
    residual: FloatArray  # (N,), largest closure residual in m
    assembled: BoolArray  # (N,), whether the loops close on the start's branch

    def __repr__(self) -> str:
        return f"Assembly of {len(self.assembled)} samples, {int(self.assembled.sum())} assembled"

    def first(self, count: int) -> Assembly:
        """The first so many samples."""
        return Assembly(self.configurations[:count], self.residual[:count], self.assembled[:count])

    @classmethod
    def joined(cls, parts: Sequence[Assembly]) -> Assembly:
        """Assemblies one after the other."""
        fields = [(part.configurations, part.residual, part.assembled) for part in parts]
        return cls(*(np.concatenate(rows) for rows in zip(*fields, strict=True)))


@dataclass(frozen=True)
class PathOptions:
    """How exactly paths are followed, with which part of the way at least and steps at most."""

    tolerance: float = CLOSURE_TOLERANCE
    shortest_step: float = SHORTEST_PATH_STEP
    most_steps: float = np.inf

    def __post_init__(self) -> None:
        if not 0 <= self.tolerance < np.inf:
            raise OptionError(f"tolerance must be a length from 0 on, not {self.tolerance} m")


@checked
def assemble(
    mechanism: Mechanism,
    values: FloatArray,
    coordinates: Sequence[str] | str | None = None,
    start: FloatArray | None = None,
    trajectory: bool = False,
    tolerance: float = CLOSURE_TOLERANCE,
) -> FloatArray:
    """Solve all coordinates from measured ones, on the assembly branch of the start.

    A long trajectory may be assembled in parts: with the last configuration of a part as the start
    of the next one, they are the same, to round-off, as those of the whole.

    Parameters
    ----------
    values : FloatArray
        (N, c), measured coordinates in m or rad.
    coordinates : sequence of str or "platform", optional
        Joints that were measured, or ``"platform"`` for the platform coordinates that the robot
        file declares; by default the independent joints. They must determine the motion.
    start : FloatArray, optional
        (nq,), a closed configuration on the branch; by default the reference.
    trajectory : bool
        Whether the samples follow one another: each is then reached from the one before.
    tolerance : float
        Closure residual to reach, in m.

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
    >>> robot = loopid.load_mechanism("3ups_rpu")
    >>> q = loopid.assemble(robot, [[0.0, 0.7, 0.1, 0.0]], "platform")
    >>> loopid.kinematics.platform_coordinates(robot, q).round(6).tolist()
    [[0.0, 0.7, 0.1, 0.0]]
    """
    outcome = try_assemble(mechanism, values, coordinates, start, trajectory, tolerance)
    lost = np.flatnonzero(~outcome.assembled)
    if len(lost):
        raise AssemblyError(
            f"sample {lost[0]} cannot be assembled from the start: the loops stay open by "
            f"{outcome.residual[lost[0]]:.1e} m (tolerance {tolerance:g} m), so the coordinates "
            f"are out of reach or beyond a singularity ({len(lost)} of {len(outcome.assembled)} "
            "samples)"
        )
    return outcome.configurations


@checked
def try_assemble(
    mechanism: Mechanism,
    values: FloatArray,
    coordinates: Sequence[str] | str | None = None,
    start: FloatArray | None = None,
    trajectory: bool = False,
    tolerance: float = CLOSURE_TOLERANCE,
    shortest_step: float = SHORTEST_PATH_STEP,
) -> Assembly:
    """As ``assemble``, but report the samples that fail instead of raising.

    Along a trajectory the next one is then reached from the last one that was assembled. Otherwise
    there may be a start for each sample, (N, nq). A sample is given up where less than the
    ``shortest_step``, a part of the way, can be done at a time.
    """
    measured = measured_coordinates(mechanism, coordinates)
    targets = samples(values, measured.width, "measured coordinates")
    q = mechanism.reference if start is None else start
    one_each = not trajectory and np.ndim(q) == 2 and len(q) == len(targets)
    q = samples(q, mechanism.model.nq, "start", len(targets) if one_each else 1)
    options = PathOptions(tolerance, shortest_step)
    with one_blas_thread():
        if trajectory:
            return follow_trajectory(measured, q[0], targets, options)
        starts = q if one_each else np.repeat(q, len(targets), axis=0)
        return follow_paths(measured, starts, targets, options)


def follow_paths(
    measured: MeasuredCoordinates, q: FloatArray, targets: FloatArray, options: PathOptions
) -> Assembly:
    """Move all samples (N, nq) along their straight lines to the targets (N, c)."""
    parts = [_follow(measured, q[rows], targets[rows], options) for rows in blocks(len(q))]
    return Assembly.joined(parts)


def _follow(
    measured: MeasuredCoordinates, start: FloatArray, targets: FloatArray, options: PathOptions
) -> Assembly:
    origin = measured.read(start)
    way = measured.difference(origin, targets)
    # The last point on the path, the part of the way done there, and the next part tried.
    reached, done, step = start.copy(), np.zeros(len(start)), np.ones(len(start))
    jacobian = measured.linearise(start, origin).unknown
    k, tried = np.arange(len(start)), 0
    while len(k) and tried < options.most_steps:
        ahead = np.minimum(done[k] + step[k], 1.0)
        short = np.where(ahead < 1.0, ROUGH, SHORT)
        found = correct(measured, reached[k], origin[k] + ahead[:, None] * way[k], short)
        good = found.accepted.copy()
        good[good] = same_side(jacobian[k[good]], found.jacobian[good])
        arrived = k[good]
        reached[arrived], jacobian[arrived] = found.configurations[good], found.jacobian[good]
        done[arrived] = ahead[good]
        step[k] *= np.where(good, 2.0, 0.5)
        k, tried = k[(done[k] < 1.0) & (step[k] >= options.shortest_step)], tried + 1
    q = measured.write(reached, targets)
    residual, small = closes(measured, q, targets, options)
    assembled = (done >= 1.0) & small
    return Assembly(np.where(assembled[:, None], q, np.nan), residual, assembled)


def closes(
    measured: MeasuredCoordinates, q: FloatArray, targets: FloatArray, options: PathOptions
) -> tuple[FloatArray, BoolArray]:
    """Largest residuals (N,) in m, and where they are small enough."""
    residual = np.abs(measured.residual(q, targets)).max(axis=1, initial=0.0)
    least = max(options.tolerance, 2.0 * measured.mechanism.closure_residual)
    return residual, np.asarray(residual <= least, dtype=bool)


class Correction(NamedTuple):
    """What Newton's method leads to; Jacobian and tangent are of the last step, which is short."""

    configurations: FloatArray  # (N, nq)
    accepted: BoolArray  # (N,), whether it contracted at once
    jacobian: FloatArray  # (N, m, u), by the unknown coordinates
    tangent: FloatArray  # (N, u, c), their steps per unit of the measured values


def correct(
    measured: MeasuredCoordinates,
    q: FloatArray,
    values: FloatArray,
    short: FloatArray | float = SHORT,
) -> Correction:
    """Newton's method from configurations (N, nq) to measured values (N, c), up to a short step."""
    q, accepted = measured.write(q, values), np.ones(len(q), dtype=bool)
    k, longest = np.arange(len(q)), np.full(len(q), LONGEST_STEP)
    short = np.broadcast_to(short, len(q))
    for iteration in range(NEWTON_STEPS):
        at = measured.linearise(q[k], values[k])
        pull = np.concatenate([at.residual[:, :, None], at.known], axis=2)
        solution = -Solver.of(at.unknown, REGULAR).solve(pull)
        step, slope = solution[:, :, 0], solution[:, :, 1:]
        q[k] = integrate(measured.mechanism, q[k], measured.tangent(step))
        if iteration == 0:
            jacobian, tangent = at.unknown.copy(), slope.copy()
        else:
            jacobian[k], tangent[k] = at.unknown, slope
        length = np.abs(step).max(axis=1, initial=0.0)
        done = length <= short[k]
        good = done | (length <= longest)
        accepted[k] = good
        going = good & ~done
        k, longest = k[going], CONTRACTION * length[going]
        if not len(k):
            break
    accepted[k] = False
    return Correction(q, accepted, jacobian, tangent)


def same_side(before: FloatArray, after: FloatArray) -> BoolArray:
    """Whether no singularity lies between two Jacobians of the unknown coordinates.

    det(JᵀJ') of close Jacobians is positive, and changes its sign with that of a square J'.
    """
    sign, _ = np.linalg.slogdet(before.transpose(0, 2, 1) @ after)
    return np.asarray(sign > 0, dtype=bool)


def follow_trajectory(
    measured: MeasuredCoordinates, start: FloatArray, targets: FloatArray, options: PathOptions
) -> Assembly:
    """Follow the straight line to each sample (N, c) from the last one that was reached."""
    none = Assembly(np.empty((0, len(start))), np.empty(0), np.empty(0, dtype=bool))
    parts, first, window, alone = [none], 0, BLOCK, 1
    while first < len(targets):
        part = _linked(measured, start, targets[first : first + window], options)
        count = len(part.residual)
        window = min(max(2 * count, LEAST_WINDOW), BLOCK)
        if not count:
            # From one start as many samples as fail, and the first that does not.
            ahead = targets[first : first + alone]
            part = follow_paths(measured, np.tile(start, (len(ahead), 1)), ahead, options)
            found = np.flatnonzero(part.assembled)
            alone = 1 if len(found) else min(2 * alone, BLOCK)
            part = part.first(int(found[0]) + 1 if len(found) else len(ahead))
        if part.assembled[-1]:
            start = part.configurations[-1]
        parts.append(part)
        first += len(part.residual)
    return Assembly.joined(parts)


def _linked(
    measured: MeasuredCoordinates, start: FloatArray, targets: FloatArray, options: PathOptions
) -> Assembly:
    """The leading samples that are linked to each other and to the start."""
    values = np.concatenate([measured.read(start[None]), targets])
    home = correct(measured, start[None], values[:1])
    way = measured.difference(values[:1], values)
    # As far as the start's tangent leads within the reach of Newton's method.
    steps = way @ home.tangent[0].T
    near = _leading_true(np.abs(steps).max(axis=1, initial=0.0) <= LONGEST_STEP)
    rows = np.append(np.arange(0, near - 1, STRIDE), near - 1)
    guess = integrate(
        measured.mechanism, np.tile(start, (len(rows), 1)), measured.tangent(steps[rows])
    )
    nodes = correct(measured, guess, values[rows])
    known = _leading_true(nodes.accepted)
    if known < 2:
        return Assembly(guess[:0], np.empty(0), np.empty(0, dtype=bool))
    rows, nodes = rows[:known], Correction(*(field[:known] for field in nodes))  # type: ignore[arg-type]
    values = values[: rows[-1] + 1]
    found = correct(measured, _between(measured, rows, nodes, values), values)
    q = found.configurations
    q[0] = start
    residual, small = closes(measured, q, values, options)
    good = found.accepted & small
    follows = good[:-1] & good[1:] & _continues(measured, found, values)
    count = _leading_true(follows)
    return Assembly(q[1 : count + 1], residual[1 : count + 1], follows[:count])


def _leading_true(values: BoolArray) -> int:
    return len(values) if values.all() else int(values.argmin())


def _between(
    measured: MeasuredCoordinates, rows: IntArray, nodes: Correction, values: FloatArray
) -> FloatArray:
    """Configurations predicted at all samples (N, c) up to the last node.

    Between two nodes with measured values c_A and c_B and unknown coordinates x_A and x_B, the
    straight way from c_A to c_B has a curve x(λ) above it, whose ends and end tangents T c' are
    known: a cubic Hermite curve. What the measured values are off that way, by curvature or noise,
    moves x by the tangent map T, interpolated between the nodes. The error falls with the fourth
    power of the distance.
    """
    q, T, c = nodes.configurations, nodes.tangent, values[rows]
    way, chord = measured.difference(c[:-1], c[1:]), measured.steps(q[:-1], q[1:])
    begin, end = ((tangent @ way[:, :, None])[:, :, 0] for tangent in (T[:-1], T[1:]))
    samples = np.arange(len(values))
    left = np.searchsorted(rows[1:-1], samples, side="right")
    part = ((samples - rows[left]) / np.diff(rows)[left])[:, None]
    off = measured.difference(c[left], values) - part * way[left]
    tangent = T[left] + part[:, :, None] * (T[left + 1] - T[left])
    steps = (tangent @ off[:, :, None])[:, :, 0]
    steps += part**2 * (3 - 2 * part) * chord[left]
    steps += part * (1 - part) * ((1 - part) * begin[left] - part * end[left])
    return integrate(measured.mechanism, q[left], measured.tangent(steps))


def _continues(measured: MeasuredCoordinates, found: Correction, values: FloatArray) -> BoolArray:
    """Whether Newton's method, from each sample with the values of the next, would lead there.

    Its first step is the tangent; what is left then is its second step, which must be shorter.
    No singularity may lie between them.
    """
    q, way = found.configurations, measured.difference(values[:-1], values[1:])
    tangent = (found.tangent[:-1] @ way[:, :, None])[:, :, 0]
    rest = np.abs(measured.steps(q[:-1], q[1:]) - tangent).max(axis=1, initial=0.0)
    length = np.abs(tangent).max(axis=1, initial=0.0)
    short = (length <= LONGEST_STEP) & (rest <= CONTRACTION * length + SHORT)
    return np.asarray(short & same_side(found.jacobian[:-1], found.jacobian[1:]), dtype=bool)
