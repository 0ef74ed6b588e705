"""What all joints do while some coordinates follow a motion, and whether the robot may do it."""

from __future__ import annotations

from dataclasses import fields

import numpy as np

from loopid.arguments import BoolArray, FloatArray, IntArray, NotNegative, checked, chosen, shaped
from loopid.errors import OptionError
from loopid.kinematics.assembly import assemble
from loopid.kinematics.measured import platform_motion
from loopid.kinematics.projection import ClosedMotion, closed_motion, singularity_measure
from loopid.kinematics.sampling import SINGULARITY_THRESHOLD
from loopid.motion.trajectories import Motion
from loopid.records import record
from loopid.robot.robot import Robot, lock_options


@record(checked="outside")
class JointMotion:
    """Configurations of a robot over time, and the motion of its independent coordinates.

    All arrays are read-only.

    Examples
    --------
    >>> import loopid
    >>> robot = loopid.load("3ups_rpu")
    >>> plan = loopid.motion.read_motion_program(robot.name).motion("5", rate=2)
    >>> moved = loopid.motion.joint_motion(robot, plan)
    >>> moved.configurations.shape[1], moved.velocities.shape[1]
    (13, 4)
    """

    time: FloatArray  # (N,) in s
    configurations: FloatArray  # (N, nq), closed
    velocities: FloatArray  # (N, dof) of the independent coordinates
    accelerations: FloatArray
    singularity: FloatArray  # (N,), see ``Projection.singularity``

    def __post_init__(self) -> None:
        for name in (field.name for field in fields(self)):
            values = getattr(self, name)
            width = () if name in ("time", "singularity") else np.shape(values)[1:2] or (1,)
            object.__setattr__(self, name, shaped(values, name, np.size(self.time), *width))

    def __len__(self) -> int:
        return len(self.time)

    def select(self, rows: BoolArray | IntArray | slice) -> JointMotion:
        """Some of the samples, by a mask (N,), by number or as a slice."""
        rows = chosen(rows, "rows", len(self))
        return JointMotion(*(getattr(self, field.name)[rows] for field in fields(self)))

    def closed(self, robot: Robot, rows: IntArray | slice = slice(None)) -> ClosedMotion:
        """The motion of all joints, of all samples or some."""
        rows = chosen(rows, "rows", len(self))
        state = self.configurations, self.velocities, self.accelerations
        return closed_motion(robot, *(each[rows] for each in state))


@checked
def joint_motion(robot: Robot, motion: Motion) -> JointMotion:
    """Follow a motion of the platform coordinates or of independent joints.

    Parameters
    ----------
    robot : Robot
    motion : Motion
        Named after the platform coordinates of the robot file, or after joints that determine the
        motion.

    Returns
    -------
    JointMotion

    Raises
    ------
    OptionError
        When the names are neither, or joints of a robot whose base, or a ball joint, is free.
    AssemblyError
        When the motion leaves the workspace.

    Examples
    --------
    >>> import loopid
    >>> robot = loopid.load("four_bar")
    >>> series = loopid.motion.FourierSeries(robot.actuated, 0.5, [1.0], [[0.2]], [[0.0]])
    >>> followed = loopid.motion.joint_motion(robot, series.motion(rate=20))
    >>> followed.configurations.shape == (41, robot.model.nq)
    True
    """
    independent = robot.velocity_indices(robot.independent)
    platform = robot.platform
    if platform is not None and motion.names == platform.names:
        q = assemble(robot, motion.position, "platform", trajectory=True)
        v, a = platform_motion(robot, q, motion.velocity, motion.acceleration)
    elif set(motion.names) <= set(robot.joints):
        free = [name for name in robot.free if name not in robot.joints]
        if free:
            raise OptionError(
                f"a motion of joints does not determine {', '.join(free)} of {robot.name}, "
                f"which the motors leave free: lock them ({lock_options(robot)})"
            )
        q = assemble(robot, motion.position, motion.names, trajectory=True)
        whole = closed_motion(
            robot, q, motion.velocity, motion.acceleration, independent=motion.names
        )
        v, a = whole.velocities, whole.accelerations
    else:
        of_platform = () if platform is None else platform.names
        raise OptionError(
            f"a motion of {', '.join(motion.names)} fits neither the platform coordinates "
            f"({', '.join(of_platform) or 'none'}) nor joints ({', '.join(robot.joints)})"
        )
    measure = singularity_measure(robot, q)
    return JointMotion(motion.time, q, v[:, independent], a[:, independent], measure)


@record
class JointRange:
    """What a joint with one coordinate passes through, in m or rad."""

    joint: str
    lowest: float  # of the motion
    highest: float
    lower: float  # limits in the robot file, infinite where there are none
    upper: float

    @property
    def clearance(self) -> float:
        """Distance to the nearer limit, negative outside."""
        return min(self.lowest - self.lower, self.upper - self.highest)


@record
class MotionReview:
    """Findings about a motion."""

    ranges: tuple[JointRange, ...]  # in the order of the robot's joints
    singularity: float  # least singularity measure on the way
    singular_time: float  # when it is least, in s
    singularity_threshold: float  # threshold of the measure
    speeds: dict[str, float]  # largest speed of each independent coordinate, in m/s or rad/s

    def __repr__(self) -> str:
        found = "; ".join(self.problems) or "nothing speaks against the motion"
        return f"<MotionReview of {len(self.ranges)} joints: {found:.500}>"

    @property
    def problems(self) -> tuple[str, ...]:
        """What speaks against the motion, one sentence each; empty where nothing does."""
        found = [
            f"joint {r.joint} goes from {r.lowest:.4f} to {r.highest:.4f}, {-r.clearance:.4f} "
            f"outside its limits {r.lower:.4f} ... {r.upper:.4f}"
            for r in self.ranges
            if r.clearance < 0
        ]
        if self.singularity < self.singularity_threshold:
            found.append(
                f"the singularity measure falls to {self.singularity:.3g} at "
                f"{self.singular_time:.2f} s (threshold {self.singularity_threshold:g})"
            )
        return tuple(found)


@checked
def review_motion(
    robot: Robot, motion: JointMotion, singularity_threshold: NotNegative = SINGULARITY_THRESHOLD
) -> MotionReview:
    """Check a motion against joint limits and a threshold of the singularity measure.

    Parameters
    ----------
    robot : Robot
    motion : JointMotion
    singularity_threshold : float
        Singularity measure below which a pose is a problem.

    Returns
    -------
    MotionReview
        Ranges, speeds and problems.

    Raises
    ------
    OptionError
        When the threshold is negative.

    Examples
    --------
    >>> import loopid
    >>> robot = loopid.load("four_bar")
    >>> series = loopid.motion.FourierSeries(robot.actuated, 0.5, [1.0], [[0.2]], [[0.0]])
    >>> motion = loopid.motion.joint_motion(robot, series.motion(rate=20))
    >>> loopid.motion.review_motion(robot, motion).problems
    ()
    """
    ranges = []
    for name in robot.joints:
        joint = robot.joint(name)
        if joint.nq == 1:
            values = motion.configurations[:, joint.idx_q]
            ends = float(values.min()), float(values.max())
            ranges.append(JointRange(name, *ends, *robot.limits(name)))
    worst = int(motion.singularity.argmin())
    fastest = np.abs(motion.velocities).max(axis=0)
    return MotionReview(
        ranges=tuple(ranges),
        singularity=float(motion.singularity[worst]),
        singular_time=float(motion.time[worst]),
        singularity_threshold=singularity_threshold,
        speeds=dict(zip(robot.independent, map(float, fastest), strict=True)),
    )
