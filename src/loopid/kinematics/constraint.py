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
    prepared,
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
        self.mechanism, self.q, self.prepared = mechanism, q, prepared(mechanism)
        ids = self.prepared.closure_frames
        # Without loops there is nothing to ask for.
        self.poses = frame_poses(mechanism, q if ids else q[:0], ids, jacobians=jacobians)
        p, R = self.poses.origin, self.poses.rotation
        distance = (p[:, 1::2] - p[:, ::2])[..., None]
        self.pairs = [
            FramePair(distance[:, k], R[:, 2 * k], R[:, 2 * k + 1]) for k in range(len(ids) // 2)
        ]

    def residual(self) -> FloatArray:
        """(N, rows), m or rad."""
        residual = np.empty((len(self.q), self.prepared.rows))
        for closure, part, rows in self.prepared.equations:
            residual[:, rows] = part.residual(self.pairs[closure])
        for row, coupling in enumerate(self.mechanism.couplings, self.prepared.closure_rows):
            residual[:, row] = coupling.residual(self.q)
        return residual

    def jacobian(self) -> FloatArray:
        """A (N, rows, nv)."""
        A = np.zeros((len(self.q), self.prepared.rows, self.prepared.model.nv))
        if self.pairs:
            linear = self.poses.linear
            # What no equation asks for is not computed.
            angular = self.poses.angular if self.prepared.turns else linear
            self._rates(linear, angular, A)
        for row, coupling in enumerate(self.mechanism.couplings, self.prepared.closure_rows):
            A[:, row, list(coupling.v_indices)] = coupling.jacobian(self.q)
        return A

    def drift(self, v: FloatArray) -> FloatArray:
        """(N, rows), d²r/dt² at velocities (N, nv) and zero acceleration."""
        drift = np.zeros((len(self.q), self.prepared.rows, 1))
        if self.pairs:
            moving = frame_motions(self.mechanism, self.q, v, self.poses)
            self._rates(moving.acceleration[..., None], moving.turning[..., None], drift)
            velocities = _pair_rates(moving.velocity[..., None], moving.turn[..., None])
            for closure, part, rows in self.prepared.equations:
                drift[:, rows] += part.curvature(self.pairs[closure], velocities[closure])
        for row, coupling in enumerate(self.mechanism.couplings, self.prepared.closure_rows):
            drift[:, row, 0] = coupling.drift(self.q, v)
        return drift[:, :, 0]

    def translation_rates(self, moved: BoolArray) -> FloatArray:
        """(N, closure rows, 3 k) per unit translation along the fixed axes of k sets of frames."""
        count, width = len(self.q), 3 * moved.shape[1]
        rates = np.zeros((count, self.prepared.rows, width))
        if self.pairs:
            linear = np.einsum("fk,ab->fakb", moved, np.eye(3)).reshape(-1, 3, width)
            shape = (count, *linear.shape)
            self._rates(np.broadcast_to(linear, shape), np.zeros(shape), rates)
        return rates

    def scaled(self) -> tuple[FloatArray, FloatArray]:
        """Residual (N, rows) in m and A (N, rows, nv) in m per unit step."""
        scaled = self.mechanism.row_scales * self.residual()
        return scaled, scaled_jacobian(self.mechanism, self.jacobian())

    def _rates(self, linear: FloatArray, angular: FloatArray, out: FloatArray) -> None:
        """Put rates of the closures' residuals, from those of the frames (N, F, 3, k), in rows."""
        rates = _pair_rates(linear, angular)
        for closure, part, rows in self.prepared.equations:
            out[:, rows] = part.rate(self.pairs[closure], rates[closure])


def _pair_rates(linear: FloatArray, angular: FloatArray) -> list[PairRates]:
    """Rates of each closure from those of its two frames (N, F, 3, k)."""
    velocity = linear[:, 1::2] - linear[:, ::2]
    return [
        PairRates(velocity[:, k], angular[:, 2 * k], angular[:, 2 * k + 1])
        for k in range(velocity.shape[1])
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
    scaled = jacobian * prepared(mechanism).in_common_units
    # Equations that hold in any motion leave nothing but round-off, which has no rank.
    nothing = np.abs(scaled).max(axis=(1, 2), initial=0.0) < ROUND_OFF * mechanism.length
    if nothing.any():
        scaled[nothing] = 0.0
    return np.asarray(scaled)
