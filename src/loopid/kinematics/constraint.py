"""Residual, Jacobian and drift of all closures, at closed and open configurations.

The Jacobian A is the exact derivative of the residual, A v = dr/dt. The drift is d²r/dt² at zero
acceleration, so that A a + drift = d²r/dt² [Featherstone2008, ch. 8]. The rows of the loop closures
come first, then one row a coupling of joints.

In common units every entry of A is a length. Rows of angles, and columns of prismatic joints too,
are multiplied by the robot's characteristic length. Ranks, singularity measures and step lengths
then mean the same for a robot described in mm and one described in m.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from loopid.arguments import BoolArray, FloatArray, checked, one_as_many, samples
from loopid.kinematics.poses import FramePoses, blocks, frame_motions, frame_poses, prepared
from loopid.numbers import SUM_ROUND_OFF
from loopid.robot.closures import Equations, FramePair, PairRates
from loopid.robot.robot import Robot


class Constraint:
    """All closures and couplings of a robot at configurations (N, nq)."""

    def __init__(
        self, robot: Robot, q: FloatArray, jacobians: bool = True, poses: FramePoses | None = None
    ) -> None:
        self.robot, self.q, self.prepared = robot, q, prepared(robot)
        if poses is None:
            ids, _ = robot.closure_frames
            # Without loops there is nothing to ask for.
            poses = frame_poses(robot, q if ids else q[:0], ids, jacobians=jacobians)
        self.poses = poses
        p, R = self.poses.origin, self.poses.rotation
        distance = (p[:, 1::2] - p[:, ::2])[..., None]
        count = range(distance.shape[1])
        self.pairs = [FramePair(distance[:, k], R[:, 2 * k], R[:, 2 * k + 1]) for k in count]

    def repeated(self, count: int) -> Constraint:
        """The same, each configuration ``count`` times."""
        q = np.repeat(self.q, count, axis=0)
        return Constraint(self.robot, q, poses=self.poses.repeated(count))

    def residual(self) -> FloatArray:
        """(N, rows), m or rad."""
        residual = np.empty((len(self.q), self.robot.rows, 1))
        self._fill(residual, lambda part, k: part.residual(self.pairs[k]))
        for row, (length, _) in self.robot.cable_rows.items():
            residual[:, row, 0] -= self.q[:, length]
        for row, coupling in enumerate(self.robot.couplings, self.prepared.closure_rows):
            residual[:, row, 0] = coupling.residual(self.q)
        return residual[:, :, 0]

    def jacobian(self) -> FloatArray:
        """A (N, rows, nv)."""
        A = np.zeros((len(self.q), self.robot.rows, self.robot.model.nv))
        if self.pairs:
            rates = _pair_rates(self.poses.linear, self.poses.angular)
            self._fill(A, lambda part, k: part.rate(self.pairs[k], rates[k]))
        for row, (_, length) in self.robot.cable_rows.items():
            A[:, row, length] -= 1.0
        for row, coupling in enumerate(self.robot.couplings, self.prepared.closure_rows):
            A[:, row, list(coupling.v_indices)] = coupling.jacobian(self.q)
        return A

    def drift(self, v: FloatArray) -> FloatArray:
        """(N, rows), d²r/dt² at velocities (N, nv) and zero acceleration."""
        drift = np.zeros((len(self.q), self.robot.rows, 1))
        if self.pairs:
            at = frame_motions(self.robot, self.q, v, self.poses)
            first = _pair_rates(at.velocity[..., None], at.turn[..., None])
            second = _pair_rates(at.acceleration[..., None], at.turning[..., None])

            def derivative(part: Equations, k: int) -> FloatArray:
                return part.rate(self.pairs[k], second[k]) + part.curvature(self.pairs[k], first[k])

            self._fill(drift, derivative)
        for row, coupling in enumerate(self.robot.couplings, self.prepared.closure_rows):
            drift[:, row, 0] = coupling.drift(self.q, v)
        return drift[:, :, 0]

    def translation_rates(self, moved: BoolArray) -> FloatArray:
        """(N, closure rows, 3 k) per unit translation along the fixed axes of k sets of frames."""
        count, width = len(self.q), 3 * moved.shape[1]
        found = np.zeros((count, self.robot.rows, width))
        if self.pairs:
            one = np.einsum("fk,ab->fakb", moved, np.eye(3)).reshape(-1, 3, width)
            linear = np.broadcast_to(one, (count, *one.shape))
            rates = _pair_rates(linear, np.zeros(linear.shape))
            self._fill(found, lambda part, k: part.rate(self.pairs[k], rates[k]))
        return found

    def scaled(self) -> tuple[FloatArray, FloatArray]:
        """Residual (N, rows) in m and A (N, rows, nv) in m per unit step."""
        scaled = self.robot.row_scales * self.residual()
        return scaled, scaled_jacobian(self.robot, self.jacobian())

    def _fill(self, out: FloatArray, value: Callable[[Equations, int], FloatArray]) -> None:
        """Put what each equation of the k-th closure gives in its rows of an array (N, rows, c)."""
        (count, _, width), row = out.shape, 0
        for k, closure in enumerate(self.robot.closures):
            for part in closure.equations:
                found = value(part, k).reshape(count, part.count, width)
                out[:, row : row + part.count] = found
                row += part.count


def _pair_rates(linear: FloatArray, angular: FloatArray) -> list[PairRates]:
    """Rates of each closure from those of all frames (N, F, 3, k)."""
    return [
        PairRates(linear[:, k + 1] - linear[:, k], angular[:, k], angular[:, k + 1])
        for k in range(0, linear.shape[1], 2)
    ]


@checked
@one_as_many
def constraint_residual(robot: Robot, configurations: FloatArray) -> FloatArray:
    """Residual of all closures, zero where the loops are closed.

    Parameters
    ----------
    robot : Robot
    configurations : FloatArray
        (nq,) or (N, nq).

    Returns
    -------
    FloatArray
        (rows,) or (N, rows), in m or rad.

    Examples
    --------
    >>> import loopid
    >>> robot = loopid.load("five_bar")
    >>> loopid.kinematics.constraint_residual(robot, robot.reference).shape
    (3,)
    """
    q = samples(configurations, robot.model.nq, "configurations")
    return _in_blocks(q, lambda k: Constraint(robot, q[k], jacobians=False).residual())


@checked
@one_as_many
def constraint_jacobian(robot: Robot, configurations: FloatArray) -> FloatArray:
    """Jacobian A of all closures: the exact derivative of the residual.

    Parameters
    ----------
    robot : Robot
    configurations : FloatArray
        (nq,) or (N, nq).

    Returns
    -------
    FloatArray
        (rows, nv) or (N, rows, nv), in m or rad per rad or m.

    Examples
    --------
    >>> import loopid
    >>> robot = loopid.load("five_bar")
    >>> loopid.kinematics.constraint_jacobian(robot, robot.reference).shape
    (3, 4)
    """
    q = samples(configurations, robot.model.nq, "configurations")
    return _in_blocks(q, lambda k: Constraint(robot, q[k]).jacobian())


@checked
@one_as_many
def constraint_drift(
    robot: Robot, configurations: FloatArray, velocities: FloatArray
) -> FloatArray:
    """Drift, the term of the residual's second derivative without acceleration.

    Parameters
    ----------
    robot : Robot
    configurations : FloatArray
        (nq,) or (N, nq).
    velocities : FloatArray
        (nv,) or (N, nv), rad/s or m/s.

    Returns
    -------
    FloatArray
        (rows,) or (N, rows), in m/s² or rad/s².

    Examples
    --------
    >>> import loopid, numpy as np
    >>> robot = loopid.load("five_bar")
    >>> loopid.kinematics.constraint_drift(robot, robot.reference, np.zeros(4))
    array([0., 0., 0.])
    """
    q = samples(configurations, robot.model.nq, "configurations")
    v = samples(velocities, robot.model.nv, "velocities", len(q))
    return _in_blocks(q, lambda k: Constraint(robot, q[k]).drift(v[k]))


def _in_blocks(q: FloatArray, value: Callable[[slice], FloatArray]) -> FloatArray:
    return np.concatenate([value(rows) for rows in blocks(len(q))])


def scaled_residual(robot: Robot, q: FloatArray) -> FloatArray:
    """Closure residual (N, rows) in m."""
    return robot.row_scales * Constraint(robot, q, jacobians=False).residual()


def largest_residual(robot: Robot, configurations: FloatArray) -> FloatArray:
    """Largest closure residual (N,) in m."""
    residual = scaled_residual(robot, configurations)
    return np.asarray(np.abs(residual).max(axis=1, initial=0.0), dtype=np.float64)


def scaled_jacobian(robot: Robot, jacobian: FloatArray) -> FloatArray:
    """Constraint Jacobians (N, rows, nv) in m per unit step, as they are where loops are closed.

    What carries both frames of a closure moves them alike. Where a loop is open, it turns the
    residual without changing its size. Steps that close the loop need not know.
    """
    scaled = jacobian * prepared(robot).in_common_units
    # Equations that hold in any motion leave nothing but round-off, which has no rank.
    largest = np.abs(scaled).max(axis=(1, 2), initial=0.0)
    least = SUM_ROUND_OFF * robot.length
    if largest.min(initial=np.inf) < least:
        scaled[largest < least] = 0.0
    return np.asarray(scaled)
