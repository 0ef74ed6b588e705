"""Residual, Jacobian and drift of all closures, at closed and open configurations.

The Jacobian A is the exact derivative of the residual, A v = dr/dt, and the drift is
d²r/dt² at zero acceleration, so that A a + drift = d²r/dt² [Featherstone2008, ch. 8]. The rows of
the loop closures come first, then one row a coupling of joints.

In common units every entry of A is a length: rows of angles, and columns of prismatic joints too,
are multiplied by the mechanism's characteristic length. Ranks, singularity measures and step
lengths then mean the same for a robot described in mm and one described in m.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from loopid.arguments import (
    BoolArray,
    FloatArray,
    checked,
    samples,
)
from loopid.kinematics.poses import (
    blocks,
    frame_motions,
    frame_poses,
)
from loopid.robot.closures import (
    FramePair,
    PairRates,
)
from loopid.robot.mechanism import Mechanism

ROUND_OFF = 1e-13  # of the characteristic length


class Constraint:
    """All closures and couplings of a mechanism at configurations (N, nq)."""

    def __init__(self, mechanism: Mechanism, q: FloatArray, jacobians: bool = True) -> None:
        self.mechanism, self.q = mechanism, q
        ids, supports = mechanism.closure_frames
        # Without loops there is nothing to ask for.
        self.poses = frame_poses(mechanism, q if ids else q[:0], ids, supports, jacobians)
        p, R = self.poses.origin, self.poses.rotation
        self.pairs = [
            FramePair((p[:, k + 1] - p[:, k])[:, :, None], R[:, k], R[:, k + 1])
            for k in range(0, len(ids), 2)
        ]

    def residual(self) -> FloatArray:
        """(N, rows), m or rad."""
        parts = [
            part.residual(pair)
            for closure, pair in zip(self.mechanism.closures, self.pairs, strict=True)
            for part in closure.equations
        ]
        parts += [coupling.residual(self.q)[:, None] for coupling in self.mechanism.couplings]
        return np.concatenate([np.empty((len(self.q), 0)), *parts], axis=1)

    def jacobian(self) -> FloatArray:
        """A (N, rows, nv)."""
        A = np.zeros((len(self.q), self.mechanism.rows, self.mechanism.model.nv))
        coupled = self.mechanism.rows - len(self.mechanism.couplings)
        if self.pairs:
            linear, closures = self.poses.linear, self.mechanism.closures
            turns = any(part.turns for closure in closures for part in closure.equations)
            angular = self.poses.angular if turns else np.broadcast_to(np.nan, linear.shape)
            A[:, :coupled] = self._rates(linear, angular)
        for row, coupling in enumerate(self.mechanism.couplings, coupled):
            A[:, row, list(coupling.v_indices)] = coupling.jacobian(self.q)
        return A

    def drift(self, v: FloatArray) -> FloatArray:
        """(N, rows), d²r/dt² at velocities (N, nv) and zero acceleration."""
        drift = np.zeros((len(self.q), self.mechanism.rows))
        coupled = self.mechanism.rows - len(self.mechanism.couplings)
        for row, coupling in enumerate(self.mechanism.couplings, coupled):
            drift[:, row] = coupling.drift(self.q, v)
        if self.pairs:
            moving = frame_motions(self.mechanism, self.q, v, self.poses)
            velocities = _pair_rates(moving.velocity[..., None], moving.turn[..., None])
            curvatures = [
                part.curvature(pair, rates)
                for closure, pair, rates in zip(
                    self.mechanism.closures, self.pairs, velocities, strict=True
                )
                for part in closure.equations
            ]
            second = self._rates(moving.acceleration[..., None], moving.turning[..., None])
            second += np.concatenate(curvatures, axis=1)
            drift[:, : second.shape[1]] = second[:, :, 0]
        return drift

    def translation_rates(self, moved: BoolArray) -> FloatArray:
        """(N, closure rows, 3 k) per unit translation along the fixed axes of k sets of frames."""
        count, width = len(self.q), 3 * moved.shape[1]
        rates = np.zeros((count, self.mechanism.rows, width))
        if self.pairs:
            linear = np.einsum("fk,ab->fakb", moved, np.eye(3)).reshape(-1, 3, width)
            shape = (count, *linear.shape)
            found = self._rates(np.broadcast_to(linear, shape), np.zeros(shape))
            rates[:, : found.shape[1]] = found
        return rates

    def scaled(self) -> tuple[FloatArray, FloatArray]:
        """Residual (N, rows) in m and A (N, rows, nv) in m per unit step."""
        scaled = self.mechanism.row_scales * self.residual()
        return scaled, scaled_jacobian(self.mechanism, self.jacobian())

    def _rates(self, linear: FloatArray, angular: FloatArray) -> FloatArray:
        """Rates (N, rows, k) of the closures' residuals from those of the frames (N, F, 3, k)."""
        parts = [
            part.rate(pair, rates)
            for closure, pair, rates in zip(
                self.mechanism.closures, self.pairs, _pair_rates(linear, angular), strict=True
            )
            for part in closure.equations
        ]
        return np.concatenate(parts, axis=1)


def _pair_rates(linear: FloatArray, angular: FloatArray) -> list[PairRates]:
    """Rates of each closure from those of its two frames (N, F, 3, k)."""
    return [
        PairRates(linear[:, k + 1] - linear[:, k], angular[:, k], angular[:, k + 1])
        for k in range(0, linear.shape[1], 2)
    ]


@checked
def constraint_residual(mechanism: Mechanism, configurations: FloatArray) -> FloatArray:
    """Residual (N, rows) of all closures: m or rad."""
    q = samples(configurations, mechanism.model.nq, "configurations")
    return _in_blocks(q, lambda k: Constraint(mechanism, q[k], jacobians=False).residual())


@checked
def constraint_jacobian(mechanism: Mechanism, configurations: FloatArray) -> FloatArray:
    """Jacobian A (N, rows, nv): the exact derivative of the residual."""
    q = samples(configurations, mechanism.model.nq, "configurations")
    return _in_blocks(q, lambda k: Constraint(mechanism, q[k]).jacobian())


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
    return _in_blocks(q, lambda k: Constraint(mechanism, q[k]).drift(v[k]))


def _in_blocks(q: FloatArray, value: Callable[[slice], FloatArray]) -> FloatArray:
    return np.concatenate([value(rows) for rows in blocks(len(q))])


def scaled_residual(mechanism: Mechanism, q: FloatArray) -> FloatArray:
    """Closure residual (N, rows) in m."""
    return mechanism.row_scales * Constraint(mechanism, q, jacobians=False).residual()


def largest_residual(mechanism: Mechanism, configurations: FloatArray) -> FloatArray:
    """Largest closure residual (N,) in m."""
    residual = scaled_residual(mechanism, configurations)
    return np.asarray(np.abs(residual).max(axis=1, initial=0.0), dtype=np.float64)


def scaled_jacobian(mechanism: Mechanism, jacobian: FloatArray) -> FloatArray:
    """Constraint Jacobians (N, rows, nv) in m per unit step, as they are where loops are closed.

    What carries both frames of a closure moves them alike. Where a loop is open, it turns the
    residual without changing its size: steps that close the loop need not know.
    """
    scales = mechanism.row_scales[:, None] * mechanism.coordinate_scales
    scaled = jacobian * (scales * mechanism.moving)
    # Equations that hold in any motion leave nothing but round-off, which has no rank.
    largest = np.abs(scaled).max(axis=(1, 2), initial=0.0)
    scaled[largest < ROUND_OFF * mechanism.length] = 0.0
    return np.asarray(scaled, dtype=np.float64)
