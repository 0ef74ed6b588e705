"""What a motion must keep: joints, speeds, accelerations, forces, singularities, clearance."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated

import numpy as np
from pydantic import Field

from loopid.arguments import FloatArray, Positive
from loopid.errors import OptionError
from loopid.excitation.collisions import Collisions
from loopid.kinematics.constraint import Constraint
from loopid.kinematics.measured import platform_coordinates
from loopid.kinematics.poses import frame_poses
from loopid.kinematics.projection import (
    NEAR_SINGULARITY,
    ClosedMotion,
    partition,
    project,
    ratio_to_largest,
)
from loopid.records import record
from loopid.robot.platform import ROTATIONS
from loopid.robot.robot import Robot

# Turns, characteristic lengths or weights beyond which a limit of the robot file is none.
UNLIMITED = 1e3
# Largest speeds and accelerations of slow motions, where nothing else is said, in those of a fall
# over the robot's length: inertial forces are some percent of gravity's.
SLOW_SPEED, SLOW_ACCELERATION = 0.1, 0.03
# Singularity measures change fast between samples: they count in multiples of what they must keep.
STEEP = 10.0
# Of the robot's length, that links must keep from each other.
CLEARANCE = 1e-3
# Relative singular values of what motors move that count as zero.
MOVED = 1e-6

Range = tuple[float, float]


@record(kw_only=True, checked=True)
class MotionLimits:
    """What a motion must keep, beside the limits of the robot file.

    Attributes
    ----------
    share : float
        Part of each limit of the robot file that may be used: of ranges about their middle.
    positions : mapping
        Ranges (low, high) of joints in m or rad, in place of those of the robot file.
    speeds, accelerations, forces : mapping
        Largest ones of joints, per s and s², in N or N m, in place of the robot file's; under the
        name ``"all"`` of every actuated joint.
    workspace : mapping
        Ranges (low, high) of platform coordinates.
    singularity_threshold : float, optional
        Least singularity measure (``Projection.singularity``); by default 0.02, or half of the
        median at random poses where that is less.
    collisions : bool
        Whether links must not touch each other, by the collision geometry of a URDF.

    Raises
    ------
    OptionError
        When a range is empty, or a number not positive.

    Examples
    --------
    >>> import loopid
    >>> loopid.MotionLimits(share=0.9, speeds={"all": 0.3}).speeds
    {'all': 0.3}
    """

    share: Annotated[float, Field(gt=0, le=1)] = 1.0
    positions: Mapping[str, Range] = field(default_factory=dict)
    speeds: Mapping[str, Positive] = field(default_factory=dict)
    accelerations: Mapping[str, Positive] = field(default_factory=dict)
    forces: Mapping[str, Positive] = field(default_factory=dict)
    workspace: Mapping[str, Range] = field(default_factory=dict)
    singularity_threshold: Annotated[float, Field(ge=0, le=1)] | None = None
    collisions: bool = True

    def __post_init__(self) -> None:
        for name in ("positions", "workspace"):
            for ends in getattr(self, name).values():
                if not ends[0] < ends[1]:
                    raise OptionError(
                        f"{name} must go from low to high, not {ends}", argument=name, given=ends
                    )


@record
class Bound:
    """One quantity that must stay in a range all the time."""

    kind: str
    name: str
    unit: str
    lower: float  # infinite where there is no end
    upper: float
    size: float | None = None  # what counts as 1

    def __post_init__(self) -> None:
        if not self.lower < self.upper:
            raise OptionError(
                f"the limits of the {self.text} are empty: {self.lower:g} ... {self.upper:g}",
                bound=self.text,
                given=(self.lower, self.upper),
            )

    @property
    def text(self) -> str:
        """``speed of elbow``."""
        between = "" if self.kind == "platform coordinate" else "of "
        return f"{self.kind} {between}{self.name}" if self.name else self.kind

    @property
    def ends(self) -> str:
        """``-1 ... 1 m``."""
        return f"{self.lower:.4g} ... {self.upper:.4g} {self.unit}".rstrip()

    @property
    def scale(self) -> float:
        """What counts as 1: the size, the width of the range, or its only end."""
        if self.size is not None:
            return self.size
        both = np.isfinite([self.lower, self.upper])
        if both.all():
            return self.upper - self.lower
        return abs(self.lower if both[0] else self.upper) or 1.0


@dataclass(frozen=True)
class Quantities:
    """Bounds of one kind, and how their values (N, k) are read of a motion and its forces."""

    bounds: list[Bound]
    values: Callable[[ClosedMotion, FloatArray], FloatArray]


class Bounds:
    """All that a robot must keep, and its values in motion, with poses (N, nq) of the workspace.

    In ``slow`` motion the forces are those of gravity.
    """

    def __init__(self, robot: Robot, limits: MotionLimits, poses: FloatArray, slow: bool) -> None:
        joints = _Joints(robot, limits, slow)
        speeds, (forces, all_forces) = joints.speeds(), joints.forces()
        self._moving = [speeds, joints.accelerations(forces_bounded=all_forces), forces]
        self._posed = [joints.positions(), _workspace(robot, limits)]
        self._checked: list[Quantities] = []
        self.pairs: tuple[tuple[str, str], ...] = ()
        if limits.collisions and (collisions := Collisions(robot, poses)).pairs:
            self.pairs = collisions.pairs
            least, far = CLEARANCE * robot.length, collisions.far
            bound = Bound("distance between links", "", "m", least, np.inf, far)
            self._posed.append(
                Quantities(
                    [bound], lambda motion, _: collisions.least(motion.configurations)[:, None]
                )
            )
        if robot.closures:  # couplings alone have no singularities
            least = 0.0 if limits.singularity_threshold is None else limits.singularity_threshold
            self._posed.append(_singularity(robot, least, poses))
            self._checked.append(_constraint_singularity(robot, least))
        self.needs_forces = bool(forces.bounds)
        self.designed = sum(len(group.bounds) for group in [*self._moving, *self._posed])
        groups = [*self._moving, *self._posed, *self._checked]
        self.all = [bound for group in groups for bound in group.bounds]
        self.lower = np.array([bound.lower for bound in self.all])
        self.upper = np.array([bound.upper for bound in self.all])
        self.scale = np.array([bound.scale for bound in self.all])

    def in_motion(self, motion: ClosedMotion, forces: FloatArray) -> FloatArray:
        """The first bounded quantities (N, moving): speeds, accelerations, forces (N, motors)."""
        return _values(self._moving, motion, forces)

    def in_poses(self, motion: ClosedMotion, all_bounds: bool = True) -> FloatArray:
        """The other bounded quantities (N, k), which depend on the poses alone."""
        checked = self._checked if all_bounds else []
        return _values([*self._posed, *checked], motion, np.zeros((len(motion.configurations), 0)))

    def ranges(self, names: Sequence[str], inset: float) -> tuple[FloatArray, FloatArray]:
        """Ends (c,) of joints or platform coordinates, this part of their width further in."""
        low, high = np.full(len(names), -np.inf), np.full(len(names), np.inf)
        for bound in self.all:
            if bound.kind in ("position", "platform coordinate") and bound.name in names:
                k = list(names).index(bound.name)
                low[k] = bound.lower + inset * bound.scale
                high[k] = bound.upper - inset * bound.scale
        return low, high

    def slack(self, values: FloatArray) -> FloatArray:
        """What is left to the nearer end (..., k), in scales; negative outside."""
        return np.asarray(np.minimum(values - self.lower, self.upper - values) / self.scale)


def _values(groups: Sequence[Quantities], motion: ClosedMotion, forces: FloatArray) -> FloatArray:
    found = [group.values(motion, forces) for group in groups if group.bounds]
    return np.concatenate([np.zeros((len(motion.configurations), 0)), *found], axis=1)


class _Joints:
    """Bounds of joints, by what is given, else by the robot file, else by a fall."""

    def __init__(self, robot: Robot, limits: MotionLimits, slow: bool) -> None:
        self.robot, self.limits, self.slow = robot, limits, slow
        joints = {name: robot.joint(name) for name in robot.joints}
        for ranges in (limits.positions, limits.speeds, limits.accelerations, limits.forces):
            for name in ranges:
                if name not in joints and (ranges is limits.positions or name != "all"):
                    raise OptionError.unknown("joint", name, joints)
        self.joints = {name: joint for name, joint in joints.items() if joint.nv == 1}
        self.following = robot.following - {*limits.positions}
        gravity = float(np.linalg.norm(robot.model.gravity.linear)) or 1.0
        self.rate = np.sqrt(gravity / robot.length)
        self.weight = gravity * sum(each.mass for each in robot.model.inertias) or np.inf

    def fall(self, name: str) -> float:
        """Speed of a fall over the robot's length."""
        return float(self.rate * (self.robot.length if self.robot.slides(name) else 1.0))

    def largest(self, given: Mapping[str, float], name: str, file: float) -> float:
        """The largest value of a joint that is given, else the share of the file's, if any."""
        own = given.get(name, given.get("all") if name in self.robot.actuated else None)
        if own is not None:
            return float(own)
        return self.limits.share * file if file > 0 else np.inf

    def speeds(self) -> Quantities:
        """Of all joints, by the file; of the independent ones also where the file bounds none."""
        limits, given = self.robot.model.velocityLimit, self.limits.speeds
        bounds, columns = list[Bound](), list[int]()
        for name, joint in self.joints.items():
            speed, fall = self.largest(given, name, float(limits[joint.idx_v])), self.fall(name)
            driven = name in self.robot.independent
            if driven and self.slow and not given.keys() & {name, "all"}:
                speed = min(speed, SLOW_SPEED * fall)
            elif driven and speed > UNLIMITED * fall:
                speed = fall
            if speed < UNLIMITED * fall and name not in self.following:
                unit, _ = self.robot.units(name)
                bounds.append(Bound("speed", name, f"{unit}/s", -speed, speed))
                columns.append(joint.idx_v)
        return Quantities(bounds, lambda motion, _: motion.velocities[:, columns])

    def forces(self) -> tuple[Quantities, bool]:
        """Of the motors, and whether all of them are bounded."""
        robot, bounds, columns = self.robot, list[Bound](), list[int]()
        bounded = True
        for k, name in enumerate(robot.actuated):
            if name not in self.joints:
                continue
            effort = float(robot.model.effortLimit[self.joints[name].idx_v])
            lever = 1.0 if robot.slides(name) else robot.length
            file = effort if effort < UNLIMITED * self.weight * lever else 0.0
            most = self.largest(self.limits.forces, name, file)
            bounded = bounded and bool(np.isfinite(most))
            if np.isfinite(most):
                bounds.append(Bound("force", name, robot.units(name)[1], -most, most))
                columns.append(k)
        return Quantities(bounds, lambda _, forces: forces[:, columns]), bounded

    def accelerations(self, forces_bounded: bool) -> Quantities:
        """As given; those of a fall where no force bounds them, a part of these in slow motion."""
        bounds, columns = list[Bound](), list[int]()
        for name, joint in self.joints.items():
            most = self.largest(self.limits.accelerations, name, 0.0)
            driven = name in self.robot.independent
            if driven and not np.isfinite(most) and (self.slow or not forces_bounded):
                most = self.fall(name) * self.rate * (SLOW_ACCELERATION if self.slow else 1.0)
            if np.isfinite(most):
                unit, _ = self.robot.units(name)
                bounds.append(Bound("acceleration", name, f"{unit}/s²", -most, most))
                columns.append(joint.idx_v)
        return Quantities(bounds, lambda motion, _: motion.accelerations[:, columns])

    def positions(self) -> Quantities:
        """As given, else the share of the file's ranges."""
        bounds, columns = list[Bound](), list[int]()
        for name, joint in self.joints.items():
            most = UNLIMITED * (self.robot.length if self.robot.slides(name) else np.pi)
            ends = self.robot.limits(name)
            low, high = (x if abs(x) < most else np.sign(x) * np.inf for x in ends)
            if np.isfinite([low, high]).all():
                middle, half = (low + high) / 2, self.limits.share * (high - low) / 2
                low, high = middle - half, middle + half
            low, high = self.limits.positions.get(name, (low, high))
            bounded = np.isfinite([low, high]).any() and joint.nq == 1
            if bounded and name not in self.following:
                unit, _ = self.robot.units(name)
                bounds.append(Bound("position", name, unit, float(low), float(high)))
                columns.append(joint.idx_q)
        return Quantities(bounds, lambda motion, _: motion.configurations[:, columns])


def _workspace(robot: Robot, limits: MotionLimits) -> Quantities:
    """Ranges of platform coordinates."""
    platform, bounds, columns = robot.platform, list[Bound](), list[int]()
    coordinates = () if platform is None else platform.names
    for name, (low, high) in limits.workspace.items():
        if platform is None or name not in coordinates:
            raise OptionError.unknown("platform coordinate", name, coordinates or ["(none)"])
        at = coordinates.index(name)
        unit = "rad" if platform.motions[at] in ROTATIONS else "m"
        bounds.append(Bound("platform coordinate", name, unit, low, high))
        columns.append(at)
    return Quantities(
        bounds, lambda motion, _: platform_coordinates(robot, motion.configurations)[:, columns]
    )


def _singularity(robot: Robot, least: float, poses: FloatArray) -> Quantities:
    """The singularity measure, and that of what the motors move."""
    sizes = np.linalg.svd(_twists(robot, poses, project(robot, poses).G), compute_uv=False)
    # Motors behind the loops move none of their frames.
    directions = int((sizes > MOVED * sizes[:, :1]).sum(axis=1).max())

    def values(motion: ClosedMotion, _: FloatArray) -> FloatArray:
        columns = motion.projection.dependent_columns
        twists = _twists(robot, motion.configurations, motion.projection.G)
        return np.hstack([_ratio(columns, columns.shape[2]), _ratio(twists, directions)])

    steep, small = min(STEEP * least, 0.5) or None, min(NEAR_SINGULARITY, least)
    bounds = [
        Bound("singularity measure", "", "", least, np.inf, steep),
        Bound("inverse singularity measure", "", "", small, np.inf),
    ]
    return Quantities(bounds, values)


def _constraint_singularity(robot: Robot, least: float) -> Quantities:
    """The rank of the whole closure Jacobian."""

    def values(motion: ClosedMotion, _: FloatArray) -> FloatArray:
        G = motion.projection.G
        whole = Constraint(robot, motion.configurations).scaled()[1]
        return _ratio(whole, G.shape[1] - G.shape[2])

    small = min(NEAR_SINGULARITY, least)
    return Quantities([Bound("constraint singularity measure", "", "", small, np.inf)], values)


def _twists(robot: Robot, q: FloatArray, G: FloatArray) -> FloatArray:
    """Twists (N, k, dof) of the platform, or of the closed frames, that the motors make."""
    platform, (ids, _) = robot.platform, robot.closure_frames
    if platform is not None:
        ids = (platform.frame_id,)
    frames = frame_poses(robot, q, ids)
    twists = np.concatenate([frames.linear, robot.length * frames.angular], axis=2)
    units = robot.coordinate_scales[partition(robot)[0]]
    return np.asarray(twists.reshape(len(q), -1, G.shape[1]) @ G * units)


def _ratio(matrices: FloatArray, rank: int) -> FloatArray:
    """Singular value of number ``rank`` over the largest one, (N, 1) of matrices (N, m, n)."""
    values = np.asarray(np.linalg.svd(matrices, compute_uv=False), dtype=np.float64)
    return ratio_to_largest(values, rank)[:, None]
