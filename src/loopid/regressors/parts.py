"""Actuator forces apart by their cause: inertia, Coriolis and centrifugal effects, gravity."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from loopid.arguments import checked
from loopid.arrays import FloatArray, finite
from loopid.errors import DataError
from loopid.kinematics.motion import closed_motion
from loopid.regressors.tree import tree_regressor
from loopid.robot import Mechanism


@dataclass(frozen=True)
class ForceParts:
    """Parts of the actuator forces, each (N, dof) in N or N m.

    Attributes
    ----------
    inertial : FloatArray
        Linear in the accelerations of the independent coordinates.
    coriolis : FloatArray
        Quadratic in their velocities, through the tree's own terms and γ.
    gravity : FloatArray
        What holds the robot at rest.
    """

    inertial: FloatArray
    coriolis: FloatArray
    gravity: FloatArray

    @property
    def total(self) -> FloatArray:
        """Their sum, the forces of ``dynamic_regressor``."""
        return self.inertial + self.coriolis + self.gravity


@checked
def force_parts(
    mechanism: Mechanism,
    configurations: FloatArray,
    velocities: FloatArray,
    accelerations: FloatArray,
    standard_parameters: FloatArray | None = None,
) -> ForceParts:
    """Split the actuator forces of a motion.

    Parameters
    ----------
    configurations : FloatArray
        (N, nq), closed.
    velocities, accelerations : FloatArray
        (N, dof) of the independent coordinates.
    standard_parameters : FloatArray, optional
        (n,) of ``mechanism.parameters()``; by default those of the robot file.
    """
    pi = standard_values(mechanism, standard_parameters)
    motion = closed_motion(mechanism, configurations, velocities, accelerations)
    still = np.zeros_like(motion.velocities)
    gravity, accelerated, moving = (
        motion.projected(tree_regressor(mechanism, motion.configurations, v, a)) @ pi
        for v, a in (
            (still, still),
            (still, motion.accelerations - motion.gamma),
            (motion.velocities, motion.gamma),
        )
    )
    return ForceParts(accelerated - gravity, moving - gravity, gravity)


def standard_values(mechanism: Mechanism, given: FloatArray | None) -> FloatArray:
    """Standard parameters (n,), by default those of the robot file."""
    pi = finite(mechanism.standard_parameters() if given is None else given, "standard parameters")
    if pi.shape != (len(mechanism.parameters()),):
        expected = len(mechanism.parameters())
        raise DataError(f"standard parameters must have shape ({expected},), not {pi.shape}")
    return pi
