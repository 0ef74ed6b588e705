"""Is a motion fit to be run: limits of all joints, distance to singularity, speeds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from loopid.arguments import checked
from loopid.errors import OptionError
from loopid.kinematics import DEFAULT_MARGIN
from loopid.robot import Mechanism
from loopid.trajectories.joint_motion import JointMotion


@dataclass(frozen=True)
class JointRange:
    """What a joint with one coordinate passes through.

    Attributes
    ----------
    joint : str
    lowest, highest : float
        Least and greatest value of the motion, in m or rad.
    lower, upper : float
        Limits in the robot file, infinite where there are none.
    """

    joint: str
    lowest: float
    highest: float
    lower: float
    upper: float

    @property
    def clearance(self) -> float:
        """Distance to the nearer limit, negative outside."""
        return min(self.lowest - self.lower, self.upper - self.highest)


@dataclass(frozen=True)
class MotionReview:
    """Findings about a motion.

    Attributes
    ----------
    ranges : tuple of JointRange
        In the order of the mechanism's joints.
    singularity : float
        Least singularity measure on the way.
    singular_time : float
        When it is least, in s.
    margin : float
        What the measure was asked to keep.
    speeds : dict
        Largest speed of each independent coordinate, in m/s or rad/s.
    """

    ranges: tuple[JointRange, ...]
    singularity: float
    singular_time: float
    margin: float
    speeds: dict[str, float]

    @property
    def problems(self) -> tuple[str, ...]:
        """What speaks against the motion, one sentence each; empty where nothing does."""
        found = [
            f"joint {r.joint} goes from {r.lowest:.4f} to {r.highest:.4f}, {-r.clearance:.4f} "
            f"outside its limits {r.lower:.4f} ... {r.upper:.4f}"
            for r in self.ranges
            if r.clearance < 0
        ]
        if self.singularity < self.margin:
            found.append(
                f"the singularity measure falls to {self.singularity:.3g} at "
                f"{self.singular_time:.2f} s (margin {self.margin:g})"
            )
        return tuple(found)


@checked
def review_motion(
    mechanism: Mechanism, motion: JointMotion, margin: float = DEFAULT_MARGIN
) -> MotionReview:
    """Check a motion against joint limits and a singularity margin.

    Raises
    ------
    OptionError
        When the margin is negative.
    """
    if not margin >= 0:
        raise OptionError(f"margin must be >= 0, not {margin}")
    ranges = []
    for name in mechanism.joints:
        joint = mechanism.joint(name)
        if joint.nq == 1:
            values = motion.configurations[:, joint.idx_q]
            ends = float(values.min()), float(values.max())
            ranges.append(JointRange(name, *ends, *mechanism.limits(name)))
    worst = int(motion.singularity.argmin())
    fastest = np.abs(motion.velocities).max(axis=0)
    return MotionReview(
        ranges=tuple(ranges),
        singularity=float(motion.singularity[worst]),
        singular_time=float(motion.time[worst]),
        margin=margin,
        speeds=dict(zip(mechanism.independent, map(float, fastest), strict=True)),
    )
