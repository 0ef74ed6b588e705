"""Asking Pinocchio, sample by sample: the one file that loops over samples.

Poses of frames, Jacobians of joints and their rates, torque regressors; all else is batched NumPy
on what is found here. Jacobians of joints are Pinocchio's ``data.J``: column by column the twist of
all bodies behind a coordinate, linear above angular, at the fixed origin along the fixed axes.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pinocchio as pin

from loopid.arguments import (
    BoolArray,
    FloatArray,
)
from loopid.parameters import model_kinds
from loopid.robot.mechanism import (
    Mechanism,
    scratch_data,
)

# Samples at a time: enough to spread the cost of calling NumPy, few enough for a small memory.
BLOCK = 1024
REGRESSORS = 128  # samples whose columns of all joints are in memory at a time
# glibc hands the memory of large arrays back to the system, from which it comes as slowly as it is
# used, until it has seen a large one come and go (M_MMAP_THRESHOLD in mallopt(3)). The array is
# never written to: elsewhere this does nothing.
np.empty(31 << 17)
# Joints whose axes change in their own frame, which Pinocchio's ``data.dJ`` leaves out.
VARYING_SUBSPACE = ("JointModelUniversal", "JointModelSphericalZYX", "JointModelComposite")


def blocks(count: int, size: int | None = None) -> Iterator[slice]:
    """Slices of a number of samples, one at least."""
    step = size or BLOCK
    for first in range(0, max(count, 1), step):
        yield slice(first, min(first + step, count))


@dataclass(frozen=True)
class FramePoses:
    """F frames at N samples."""

    origin: FloatArray  # (N, F, 3) in m
    rotation: FloatArray  # (N, F, 3, 3), columns are the frame's axes
    supports: BoolArray  # (F, nv), which coordinates move each frame
    joint_jacobian: FloatArray  # (N, 6, nv), ``data.J``; without rows where not asked for

    @cached_property
    def angular(self) -> FloatArray:
        """(N, F, 3, nv), angular velocity of the frames per unit of each coordinate."""
        return self.joint_jacobian[:, None, 3:] * self.supports[:, None]

    @cached_property
    def linear(self) -> FloatArray:
        """(N, F, 3, nv), velocity of the frames' origins per unit of each coordinate."""
        # Velocities at origins p from twists at the fixed origin: [I, -[p]].
        count, frames, _ = self.origin.shape
        shift = np.zeros((count, frames, 3, 6))
        shift[..., (0, 1, 2), (0, 1, 2)] = 1.0
        shift[..., (1, 2, 0), (5, 3, 4)] = self.origin
        shift[..., (2, 0, 1), (4, 5, 3)] = -self.origin
        moved = shift.reshape(count, 3 * frames, 6) @ self.joint_jacobian
        return moved.reshape(count, frames, 3, self.supports.shape[1]) * self.supports[:, None]


@dataclass(frozen=True)
class FrameMotions:
    """Velocities and accelerations of F frames at N samples, (N, F, 3) each."""

    velocity: FloatArray  # of the origins
    acceleration: FloatArray
    turn: FloatArray  # angular
    turning: FloatArray


def frame_poses(
    mechanism: Mechanism,
    q: FloatArray,
    frame_ids: Sequence[int],
    supports: BoolArray | None = None,
    jacobians: bool = True,
) -> FramePoses:
    """Place frames, by their indices in the model, at configurations (N, nq)."""
    model, data = mechanism.model, scratch_data(mechanism.model)
    # Views of Pinocchio's memory, so that no Python object is made at every sample.
    placed = [(data.oMf[k].translation, data.oMf[k].rotation) for k in frame_ids]
    origins, rotations, J = [p for p, _ in placed], [R for _, R in placed], data.J
    origin, rotation = np.empty((len(q), len(placed), 3)), np.empty((len(q), len(placed), 3, 3))
    jacobian = np.empty((len(q), 6 if jacobians else 0, model.nv))
    ask = pin.computeJointJacobians if jacobians else pin.forwardKinematics
    for k, configuration in enumerate(q):
        ask(model, data, configuration)
        pin.updateFramePlacements(model, data)
        origin[k], rotation[k] = origins, rotations
        if jacobians:
            jacobian[k] = J
    moved = mechanism.supports(frame_ids) if supports is None else supports
    return FramePoses(origin, rotation, moved, jacobian)


def frame_motions(
    mechanism: Mechanism, q: FloatArray, v: FloatArray, poses: FramePoses
) -> FrameMotions:
    """How frames move at velocities (N, nv) and zero joint acceleration."""
    model, data = mechanism.model, scratch_data(mechanism.model)
    varying = [
        k for k in range(1, model.njoints) if model.joints[k].shortname() in VARYING_SUBSPACE
    ]
    rates = np.empty((len(q), 6, model.nv))
    changes, dJ = np.zeros_like(rates) if varying else np.zeros(()), data.dJ
    for k, state in enumerate(zip(q, v, strict=True)):
        pin.computeJointJacobiansTimeVariation(model, data, *state)
        rates[k] = dJ
        for joint in varying:
            change = data.oMi[joint].act(pin.Motion(np.ravel(data.joints[joint].c)))
            changes[k, :, model.joints[joint].idx_v] = change.vector
    moved = poses.supports.T.astype(np.float64)
    twist = np.swapaxes((poses.joint_jacobian * v[:, None]) @ moved, 1, 2)  # (N, F, 6)
    rate = np.swapaxes((rates * v[:, None] + changes) @ moved, 1, 2)
    turn, turning = twist[:, :, 3:], rate[:, :, 3:]
    velocity = twist[:, :, :3] + np.cross(turn, poses.origin)
    # The origin's own acceleration, from that of the body's point at the fixed origin.
    acceleration = rate[:, :, :3] + np.cross(turning, poses.origin) + np.cross(turn, velocity)
    return FrameMotions(velocity, acceleration, turn, turning)


def torque_regressors(
    mechanism: Mechanism,
    q: FloatArray,
    v: FloatArray | None = None,
    a: FloatArray | None = None,
    model: str = "full",
    G: FloatArray | None = None,
) -> FloatArray:
    """Pinocchio's torque regressor Y, projected to Gᵀ Y where G (N, nv, dof) is given.

    Returns
    -------
    FloatArray
        (N, nv or dof, n), columns of ``mechanism.parameters(model)``.
    """
    tree, data = mechanism.model, scratch_data(mechanism.model)
    rest = np.zeros((len(q), tree.nv))
    v, a = rest if v is None else v, rest if a is None else a
    identity = np.broadcast_to(np.eye(tree.nv), (len(q), tree.nv, tree.nv))
    to_rows = identity if G is None else np.ascontiguousarray(G.transpose(0, 2, 1))
    columns = mechanism.columns(model)  # with "gravity" m, mx, my and mz of each body
    K = np.empty((len(q), to_rows.shape[1], len(columns)))
    whole = np.empty((REGRESSORS, to_rows.shape[1], 10 * (tree.njoints - 1)))
    for rows in blocks(len(q), REGRESSORS):
        states = zip(q[rows], v[rows], a[rows], to_rows[rows], whole, strict=False)
        for *state, to_row, out in states:
            Y = pin.computeJointTorqueRegressor(tree, data, *state)
            # For a single coordinate the binding drops the axis of its one row.
            np.dot(to_row, Y if tree.nv > 1 else Y.reshape(1, -1), out=out)
        K[rows] = whole[: rows.stop - rows.start, :, columns]
    if mechanism.tied:
        K = K @ mechanism.tie_matrix(len(model_kinds(model)))
    return K


def tree_reactions(
    tree: pin.Model, q: FloatArray, v: FloatArray, a: FloatArray, joints: Sequence[int]
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Joint forces (N, nv) of the tree without closures, and what some joints transmit then.

    Forces (N, J, 3) from each joint to what hangs on it, along the fixed axes, and the orientations
    (N, J, 3, 3) of the joints.
    """
    data = scratch_data(tree)
    tau, force = np.empty((len(q), tree.nv)), np.empty((len(q), len(joints), 3))
    turn = np.empty((len(q), len(joints), 3, 3))
    for k, state in enumerate(zip(q, v, a, strict=True)):
        tau[k] = pin.rnea(tree, data, *state)
        pin.forwardKinematics(tree, data, state[0])
        turn[k] = [data.oMi[j].rotation for j in joints]
        force[k] = [data.f[j].linear for j in joints]
    return tau, np.einsum("njab,njb->nja", turn, force), turn


def integrate(mechanism: Mechanism, configurations: FloatArray, steps: FloatArray) -> FloatArray:
    """Configurations (N, nq) moved by tangent steps (N, nv)."""
    model = mechanism.model
    if model.nq == model.nv:
        return np.asarray(configurations + steps, dtype=np.float64)
    moved = np.empty_like(configurations)
    for k, (q, step) in enumerate(zip(configurations, steps, strict=True)):
        moved[k] = pin.integrate(model, q, step)
    return moved


def difference(mechanism: Mechanism, origin: FloatArray, target: FloatArray) -> FloatArray:
    """Tangent steps (N, nv) between configurations (N, nq), which ``integrate`` would take."""
    model = mechanism.model
    if model.nq == model.nv:
        return np.asarray(target - origin, dtype=np.float64)
    steps = np.empty((len(origin), model.nv))
    for k, (before, after) in enumerate(zip(origin, target, strict=True)):
        steps[k] = pin.difference(model, before, after)
    return steps
