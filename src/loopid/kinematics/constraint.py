"""Residual, Jacobian and drift of all closures, at closed and open configurations.

The Jacobian A is the exact derivative of the residual, A v = dr/dt, and the drift is
d²r/dt² at zero acceleration, so that A a + drift = d²r/dt² [Featherstone2008, ch. 8]. The rows of
the loop closures come first, then one row a coupling of joints.
"""

from __future__ import annotations

from collections.abc import Callable

from loopid.arguments import checked
from loopid.arrays import FloatArray, samples
from loopid.kinematics.blocks import in_blocks
from loopid.kinematics.loops import LoopPose, loop_pose
from loopid.kinematics.tree import tree_motion
from loopid.robot import Mechanism


@checked
def constraint_residual(mechanism: Mechanism, configurations: FloatArray) -> FloatArray:
    """Residual (N, rows) of all closures: m or rad."""
    return _in_blocks(mechanism, configurations, lambda pose: pose.residual())


@checked
def constraint_jacobian(mechanism: Mechanism, configurations: FloatArray) -> FloatArray:
    """Jacobian A (N, rows, nv): the exact derivative of the residual."""
    return _in_blocks(mechanism, configurations, lambda pose: pose.jacobian())


@checked
def constraint_drift(
    mechanism: Mechanism, configurations: FloatArray, velocities: FloatArray
) -> FloatArray:
    """Drift (N, rows), the term of the residual's second derivative without acceleration.

    Parameters
    ----------
    configurations : FloatArray
        (N, nq).
    velocities : FloatArray
        (N, nv), rad/s or m/s.
    """
    q = samples(configurations, mechanism.model.nq, "configurations")
    v = samples(velocities, mechanism.model.nv, "velocities", len(q))

    def drift(rows: slice) -> tuple[FloatArray, ...]:
        pose = loop_pose(mechanism, q[rows])
        return (pose.drift(tree_motion(pose.tree, v[rows].T)),)

    return in_blocks(len(q), drift)[0]


def _in_blocks(
    mechanism: Mechanism, configurations: FloatArray, value: Callable[[LoopPose], FloatArray]
) -> FloatArray:
    q = samples(configurations, mechanism.model.nq, "configurations")
    return in_blocks(len(q), lambda k: (value(loop_pose(mechanism, q[k])),))[0]
