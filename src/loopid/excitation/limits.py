"""What a motion must keep: joints, speeds, accelerations, forces, singularities, clearance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import pinocchio as pin

from loopid.arguments import (
    FloatArray,
    checked_fields,
)
from loopid.errors import (
    ModelWarning,
    OptionError,
    warn,
)
from loopid.kinematics.assembly import platform_coordinates
from loopid.kinematics.constraint import Constraint
from loopid.kinematics.poses import frame_poses
from loopid.kinematics.projection import (
    NEAR_SINGULARITY,
    ClosedMotion,
    partition,
    project,
)
from loopid.loading.files import find_files
from loopid.loading.urdf_tree import unread_mesh
from loopid.robot.mechanism import Mechanism
from loopid.robot.platform import ROTATIONS

# Turns, characteristic lengths or weights beyond which a limit of the robot file is none.
UNLIMITED = 1e3
# Largest speeds and accelerations of slow motions, where nothing else is said, in those of a fall
# over the robot's length: inertial forces are some percent of gravity's.
SLOW_SPEED, SLOW_ACCELERATION = 0.1, 0.03
# Singularity measures change fast between samples: they count in so many times what they must keep.
STEEP = 10.0
# Relative singular values of what motors move that count as zero.
MOVED = 1e-6
# Of the robot's length: what links must keep from each other.
CLEARANCE = 1e-3
# Pairs of links that stay this part of the robot's length apart in random poses are not looked at.
FAR = 0.1

Range = tuple[float, float]


@checked_fields
@dataclass(frozen=True)
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
    singularity : float, optional
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

    share: float = 1.0
    positions: Mapping[str, Range] = field(default_factory=dict)
    speeds: Mapping[str, float] = field(default_factory=dict)
    accelerations: Mapping[str, float] = field(default_factory=dict)
    forces: Mapping[str, float] = field(default_factory=dict)
    workspace: Mapping[str, Range] = field(default_factory=dict)
    singularity: float | None = None
    collisions: bool = True

    def __post_init__(self) -> None:
        if not 0 < self.share <= 1:
            raise OptionError(f"share must be a part above 0 and up to 1, not {self.share}")
        if self.singularity is not None and not 0 <= self.singularity <= 1:
            raise OptionError(f"singularity must be a measure in [0, 1], not {self.singularity}")
        for what, ranges in (("position", self.positions), ("workspace", self.workspace)):
            for name, (low, high) in ranges.items():
                if not low < high:
                    raise OptionError(
                        f"the {what} limits of {name} are empty: {low:g} ... {high:g}"
                    )
        for what in ("speeds", "accelerations", "forces"):
            for name, largest in getattr(self, what).items():
                if not largest > 0:
                    raise OptionError(f"{what} of {name} must be above 0, not {largest:g}")


@dataclass(frozen=True)
class Bound:
    """One quantity that must stay in a range all the time."""

    kind: str
    name: str
    unit: str
    lower: float  # both infinite where there is none
    upper: float
    size: float | None = None  # what counts as 1

    def __post_init__(self) -> None:
        if not self.lower < self.upper:
            raise OptionError(
                f"the limits of the {self.text} are empty: {self.lower:g} ... {self.upper:g}"
            )

    @property
    def text(self) -> str:
        """``speed of elbow``."""
        between = "" if self.kind == "platform coordinate" else "of "
        return f"{self.kind} {between}{self.name}" if self.name else self.kind

    @property
    def scale(self) -> float:
        """What counts as 1: the size, the width of the range, or its only end."""
        if self.size is not None:
            return self.size
        both = np.isfinite([self.lower, self.upper])
        if both.all():
            return self.upper - self.lower
        return abs(self.lower if both[0] else self.upper) or 1.0


class Bounds:
    """All that a mechanism must keep, and its values in motion.

    Parameters
    ----------
    slow : bool
        Whether speeds and accelerations are to be so small that the forces are those of gravity.
    poses : FloatArray
        (N, nq), some of all over the workspace.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        limits: MotionLimits,
        singularity: float,
        slow: bool,
        collisions: Collisions | None,
        poses: FloatArray,
    ) -> None:
        self.mechanism, self.limits = mechanism, limits
        self.all: list[Bound] = []
        names = {name: mechanism.joint(name) for name in mechanism.joints}
        for ranges in (limits.positions, limits.speeds, limits.accelerations, limits.forces):
            for name in ranges:
                if name not in names and (ranges is limits.positions or name != "all"):
                    raise OptionError.unknown("joint", name, names)
        # Names only: Pinocchio's joints cannot be sent to another process.
        self._joints = [name for name, joint in names.items() if joint.nv == 1]
        self._sliding = {n: names[n].idx_v in mechanism.prismatic for n in self._joints}
        # Files often give a mimicking joint limits that its leader does not let it keep.
        following = {name for coupling in mechanism.couplings for name in coupling.joints}
        self._following = following - {*mechanism.independent, *limits.positions}
        self._bound_motion(slow)
        self.moving = len(self.all)
        self._bound_positions()
        self._bound_workspace()
        self.loops = bool(mechanism.closures)  # couplings alone have no singularities
        if self.loops:  # motors behind the loops move none of their frames
            twists = self._twists(poses, project(mechanism, poses).G)
            values = np.linalg.svd(twists, compute_uv=False)
            self.directions = int((values > MOVED * values[:, :1]).sum(axis=1).max())
        self.collisions = collisions if collisions is not None and collisions.pairs else None
        if self.collisions is not None:
            size = FAR * mechanism.length
            self._add("distance between links", "", "m", CLEARANCE * mechanism.length, np.inf, size)
        if self.loops:
            steep = min(STEEP * singularity, 0.5) or None
            self._add("singularity measure", "", "", singularity, np.inf, steep)
            for kind in ("inverse", "constraint"):
                least = min(NEAR_SINGULARITY, singularity)
                self._add(f"{kind} singularity measure", "", "", least, np.inf)
        self.lower = np.array([bound.lower for bound in self.all])
        self.upper = np.array([bound.upper for bound in self.all])
        self.scale = np.array([bound.scale for bound in self.all])

    def _bound_motion(self, slow: bool) -> None:
        """Speeds and accelerations, those of a fall where nothing else bounds them, and forces."""
        mechanism, limits, model = self.mechanism, self.limits, self.mechanism.model
        gravity = float(np.linalg.norm(model.gravity.linear)) or 1.0
        rate = np.sqrt(gravity / mechanism.length)
        weight = gravity * sum(inertia.mass for inertia in model.inertias) or np.inf
        arm = {n: mechanism.length if slides else 1.0 for n, slides in self._sliding.items()}
        unit = {name: "m" if slides else "rad" for name, slides in self._sliding.items()}
        fall = {name: rate * arm[name] for name in self._joints}
        self._v: list[int] = []
        self._a: list[int] = []
        self._f: list[int] = []
        for name in self._joints:
            joint = mechanism.joint(name)
            driven = name in mechanism.independent
            speed = self._largest(limits.speeds, name, float(model.velocityLimit[joint.idx_v]))
            if driven and slow and not limits.speeds.keys() & {name, "all"}:
                speed = min(speed, SLOW_SPEED * fall[name])
            elif driven and speed > UNLIMITED * fall[name]:
                speed = fall[name]
            if speed < UNLIMITED * fall[name] and name not in self._following:
                self._add("speed", name, f"{unit[name]}/s", -speed, speed)
                self._v.append(joint.idx_v)
        forces = {}
        for name in (name for name in self._joints if name in mechanism.actuated):
            effort = float(model.effortLimit[mechanism.joint(name).idx_v])
            lever = 1.0 if self._sliding[name] else mechanism.length
            file = effort if effort < UNLIMITED * weight * lever else 0.0
            forces[name] = self._largest(limits.forces, name, file)
        bounded = bool(np.isfinite([*forces.values()]).all())
        for name in self._joints:
            most = self._largest(limits.accelerations, name, 0.0)
            if name in mechanism.independent and not np.isfinite(most) and (slow or not bounded):
                most = fall[name] * rate * (SLOW_ACCELERATION if slow else 1.0)
            if np.isfinite(most):
                self._add("acceleration", name, f"{unit[name]}/s²", -most, most)
                self._a.append(mechanism.joint(name).idx_v)
        for k, name in enumerate(mechanism.actuated):
            if np.isfinite(forces.get(name, np.inf)):
                unit_of_force = "N" if self._sliding[name] else "N m"
                self._add("force", name, unit_of_force, -forces[name], forces[name])
                self._f.append(k)

    def _largest(self, given: Mapping[str, float], name: str, file: float) -> float:
        """The largest value of a joint that is given, else the share of the file's, if any."""
        own = given.get(name, given.get("all") if name in self.mechanism.actuated else None)
        if own is not None:
            return float(own)
        return self.limits.share * file if file > 0 else np.inf

    def _bound_positions(self) -> None:
        self._q: list[int] = []
        for name in self._joints:
            joint, (low, high) = self.mechanism.joint(name), self.mechanism.limits(name)
            width = self.mechanism.length if self._sliding[name] else np.pi
            low, high = (
                x if abs(x) < UNLIMITED * width else np.sign(x) * np.inf for x in (low, high)
            )
            if np.isfinite([low, high]).all():
                middle, half = (low + high) / 2, self.limits.share * (high - low) / 2
                low, high = middle - half, middle + half
            low, high = self.limits.positions.get(name, (low, high))
            if name not in self._following and np.isfinite([low, high]).any() and joint.nq == 1:
                self._add("position", name, "m" if self._sliding[name] else "rad", low, high)
                self._q.append(joint.idx_q)

    def _bound_workspace(self) -> None:
        self._x: list[int] = []
        platform = self.mechanism.platform
        coordinates = () if platform is None else platform.names
        for name, (low, high) in self.limits.workspace.items():
            if platform is None or name not in coordinates:
                raise OptionError.unknown("platform coordinate", name, coordinates or ["(none)"])
            at = coordinates.index(name)
            turns = platform.motions[at] in ROTATIONS
            self._add("platform coordinate", name, "rad" if turns else "m", low, high)
            self._x.append(at)

    def _add(
        self,
        kind: str,
        name: str,
        unit: str,
        low: float,
        high: float,
        size: float | None = None,
    ) -> None:
        self.all.append(Bound(kind, name, unit, float(low), float(high), size))

    @property
    def needs_forces(self) -> bool:
        """Whether forces of motors are among the values."""
        return bool(self._f)

    @property
    def designed(self) -> int:
        """How many of the bounds a design looks at.

        The last one, against constraint singularities, follows from the singularity measure but
        for a factor: more columns only raise the least singular value.
        """
        return len(self.all) - self.loops

    def in_motion(self, motion: ClosedMotion, forces: FloatArray | None) -> FloatArray:
        """The first bounded quantities (N, moving): speeds, accelerations, forces (N, motors)."""
        parts = [motion.velocities[:, self._v], motion.accelerations[:, self._a]]
        if forces is not None:
            parts.append(forces[:, self._f])
        return np.concatenate(parts, axis=1)

    def in_poses(self, motion: ClosedMotion, count: int, all_bounds: bool) -> FloatArray:
        """The other bounded quantities, of the poses alone, at the first samples (count, ...)."""
        mechanism, q = self.mechanism, motion.configurations[:count]
        parts = [q[:, self._q]]
        if self._x:
            parts.append(platform_coordinates(mechanism, q)[:, self._x])
        if self.collisions is not None:
            parts.append(self.collisions.least(q)[:, None])
        if self.loops:
            G, columns = motion.projection.G[:count], motion.projection.dependent_columns[:count]
            inverse = _ratio(self._twists(q, G), self.directions)
            parts += [_ratio(columns, columns.shape[2]), inverse]
            if all_bounds:
                whole = Constraint(mechanism, q).scaled()[1]
                parts.append(_ratio(whole, G.shape[1] - G.shape[2]))
        return np.concatenate(parts, axis=1)

    def _twists(self, q: FloatArray, G: FloatArray) -> FloatArray:
        """Twists (N, k, dof) of the platform, or of the closed frames, that the motors make."""
        mechanism = self.mechanism
        platform, (ids, supports) = mechanism.platform, mechanism.closure_frames
        if platform is not None:
            ids, supports = (platform.frame_id,), mechanism.supports([platform.frame_id])
        frames = frame_poses(mechanism, q, ids, supports)
        twists = np.concatenate([frames.linear, mechanism.length * frames.angular], axis=2)
        units = mechanism.coordinate_scales[partition(mechanism)[0]]
        return np.asarray(twists.reshape(len(q), -1, G.shape[1]) @ G * units)

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


def _ratio(matrices: FloatArray, rank: int) -> FloatArray:
    """Singular value of number ``rank`` over the largest one, (N, 1) of matrices (N, m, n)."""
    values = np.linalg.svd(matrices, compute_uv=False)
    if rank == 0 or values.shape[1] < rank:
        return np.full((len(matrices), 1), float(rank == 0))
    largest = np.maximum(values[:, :1], np.finfo(float).tiny)
    return np.asarray(values[:, rank - 1 : rank] / largest)


class Collisions:
    """Distances between links, by coal: each piece of geometry stands for its convex hull.

    Neighbours in the tree or in a loop, and links that touch each other at the reference, are left
    out.

    Parameters
    ----------
    poses : FloatArray
        (N, nq), some of all over the workspace.
    """

    def __init__(self, mechanism: Mechanism, poses: FloatArray) -> None:
        self.mechanism = mechanism
        self.geometry = _geometry(mechanism)
        pieces = self.geometry.geometryObjects
        tied = _neighbours(mechanism)
        for i, first in enumerate(pieces):
            for j, second in enumerate(pieces[:i]):
                joints = frozenset((int(first.parentJoint), int(second.parentJoint)))
                if len(joints) == 2 and joints not in tied:
                    self.geometry.addCollisionPair(pin.CollisionPair(j, i))
        if self.pairs:
            touching = self._distances(mechanism.reference[None])[0] <= 0
            near = self._distances(poses).min(axis=0) < FAR * mechanism.length
            pairs = list(self.geometry.collisionPairs)
            self.geometry.removeAllCollisionPairs()
            for pair, wanted in zip(pairs, near & ~touching, strict=True):
                if wanted:
                    self.geometry.addCollisionPair(pair)

    @property
    def pairs(self) -> int:
        """How many pairs of links may touch."""
        return len(self.geometry.collisionPairs)

    def least(self, q: FloatArray) -> FloatArray:
        """Distance (N,) in m between the two links that are nearest; negative inside each other."""
        return np.asarray(self._distances(q).min(axis=1), dtype=np.float64)

    def _distances(self, q: FloatArray) -> FloatArray:
        model = self.mechanism.model
        data, geometry = model.createData(), self.geometry.createData()
        found = np.empty((len(q), self.pairs))
        for k, configuration in enumerate(q):
            pin.computeDistances(model, data, self.geometry, geometry, configuration)
            found[k] = [result.min_distance for result in geometry.distanceResults]
        return found


def _geometry(mechanism: Mechanism) -> pin.GeometryModel:
    """Collision geometry of the URDF, as convex hulls; none where there is none, or no mesh."""
    files = find_files(mechanism.path)
    if files.tree.suffix != ".urdf":
        return pin.GeometryModel()
    folders = [str(folder) for folder in files.tree.absolute().parents]
    try:
        if reason := unread_mesh(files.tree):  # Pinocchio waits for pipes
            raise ValueError(reason)
        geometry = pin.buildGeomFromUrdf(
            mechanism.model, str(files.tree), pin.GeometryType.COLLISION, package_dirs=folders
        )
    except (ValueError, RuntimeError) as error:
        warn(f"collisions of {mechanism.name} are not looked at: {error}", ModelWarning)
        return pin.GeometryModel()
    for piece in geometry.geometryObjects:
        if hasattr(piece.geometry, "buildConvexRepresentation"):
            piece.geometry.buildConvexRepresentation(False)
            piece.geometry = piece.geometry.convex
    return geometry


def _neighbours(mechanism: Mechanism) -> set[frozenset[int]]:
    """Pairs of joints whose links are next to each other, in the tree or through a closure."""
    model = mechanism.model
    found = {frozenset((k, int(model.parents[k]))) for k in range(1, model.njoints)}
    for closure in mechanism.closures:
        joints = [int(model.frames[frame].parentJoint) for frame in closure.frame_ids]
        found.add(frozenset(joints))
    return found
