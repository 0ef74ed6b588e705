"""Motion along all directions that the loops allow, with no coordinate before the others.

The null space of the closure Jacobian in common units has an orthonormal basis N: v = N c. Where
motors lose control of a robot, G grows without bound and N does not [Featherstone2008, ch. 8]. As
G = N R with a regular R, all that N'Y leaves open G'Y leaves open too.
"""

from __future__ import annotations

import numpy as np

from loopid.arguments import FloatArray
from loopid.kinematics.constraint import Constraint, scaled_jacobian, scaled_residual
from loopid.kinematics.poses import integrate
from loopid.kinematics.projection import ClosedMotion, Projection, partition
from loopid.records import record
from loopid.robot.robot import Robot

CORRECTIONS = 3  # Newton steps, each leaves the square of what there was


@record
class LoopDirections:
    """Directions that the loops allow at k poses, in common units."""

    # N (k, nv, dof), orthonormal. Where motors leave coordinates free, the first directions are
    # those in which these rest
    basis: FloatArray
    inverse: FloatArray  # A⁺ (k, nv, rows)
    # (k,), least over largest singular value of A: 0 where the loops allow more for an instant
    regularity: FloatArray

    @classmethod
    def of(cls, robot: Robot, A: FloatArray) -> LoopDirections:
        """Directions of closure Jacobians (k, rows, nv) in common units."""
        rank = robot.model.nv - len(robot.independent)
        left, values, right = np.linalg.svd(A)
        right = right.swapaxes(1, 2)
        values = values[:, :rank]
        least = np.finfo(float).tiny  # a pose that is singular to the last bit
        inverse = right[:, :, :rank] / np.maximum(values, least)[:, None]
        inverse = inverse @ left[:, :, :rank].swapaxes(1, 2)
        regularity = np.ones(len(A))
        if rank:
            regularity = values[:, -1] / np.maximum(values[:, 0], least)
        basis = right[:, :, rank:]
        if robot.free:
            free = basis[:, robot.velocity_indices(robot.free)]
            basis = basis @ np.linalg.svd(free)[2].swapaxes(1, 2)[:, :, ::-1]
        return cls(basis, inverse, regularity)


def loop_motion(
    robot: Robot, q: FloatArray, drawn: FloatArray, rate: float
) -> tuple[ClosedMotion, LoopDirections]:
    """Motion through poses (k, nq), as near to drawn rates as the loops allow.

    Drawn are (2, k, nv) velocities over ``rate`` in 1/s, and accelerations over its square, in unit
    steps. A robot moves slower where the loops would accelerate it by more than its square. The
    projection of the motion has N, in m and rad, in place of G.
    """
    constraint, scales = Constraint(robot, q), robot.coordinate_scales
    A = scaled_jacobian(robot, constraint.jacobian())
    directions = LoopDirections.of(robot, A)
    N = directions.basis
    v, a = (N @ (N.swapaxes(1, 2) @ each[:, :, None]) for each in drawn)
    v, gamma = rate * scales * v[:, :, 0], np.zeros(q.shape[:1] + scales.shape)
    if v.any():
        drift = robot.row_scales * constraint.drift(v)
        gamma = -(directions.inverse @ drift[:, :, None])[:, :, 0]
        size = np.linalg.norm(gamma, axis=1, keepdims=True)
        slower = rate**2 / np.maximum(size, rate**2)
        v, gamma = v * np.sqrt(slower), gamma * slower * scales
    a = rate**2 * scales * a[:, :, 0] + gamma
    chosen, dependent = partition(robot)
    projection = Projection(N * scales[:, None], chosen, A[:, :, dependent])
    return ClosedMotion(q, v, a, gamma, projection), directions


def closed_nearby(robot: Robot, other: Robot, q: FloatArray) -> FloatArray:
    """Poses (k, nq) of a robot of slightly other geometry, next to those of a robot.

    Equations may be redundant for the one and contradict each other for the other. They are
    satisfied in the least-squares sense, with the rank that they have for the one.
    """
    A = scaled_jacobian(robot, Constraint(robot, q).jacobian())
    inverse = LoopDirections.of(robot, A).inverse
    for _ in range(CORRECTIONS):
        step = -(inverse @ scaled_residual(other, q)[:, :, None])[:, :, 0]
        q = integrate(other, q, step * robot.coordinate_scales)
    return q
