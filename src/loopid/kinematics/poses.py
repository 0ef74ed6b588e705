"""Asking Pinocchio, sample by sample: the one file that loops over samples.

Poses of frames, Jacobians of joints and their rates, torque regressors. All else is batched NumPy
on what is found here. Jacobians of joints are Pinocchio's ``data.J``. Column by column this is the
twist of all bodies behind a coordinate, linear above angular, at the fixed origin along the fixed
axes.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pinocchio as pin

from loopid.arguments import FloatArray, IntArray, checked, samples
from loopid.errors import DataError
from loopid.parameters import model_kinds
from loopid.records import derived
from loopid.robot.robot import Memory, Robot

# Samples at a time: enough to spread the cost of calling NumPy, few enough for a small memory.
BLOCK = 1024
REGRESSORS = 128  # samples whose columns of all joints are in memory at a time
# glibc hands the memory of large arrays back to the system, from which it comes as slowly as it is
# used, until it has seen a large one come and go (M_MMAP_THRESHOLD in mallopt(3)). The array is
# never written to: elsewhere this does nothing.
np.empty(31 << 17)
# Joints whose axes change in their own frame, which Pinocchio's ``data.dJ`` leaves out.
VARYING_SUBSPACE = ("JointModelUniversal", "JointModelSphericalZYX", "JointModelComposite")
# [I, -[p]] of an origin p, which takes a twist at the fixed origin there: p @ ARM + AT_ORIGIN.
AT_ORIGIN, ARM = np.eye(3, 6).ravel(), np.zeros((3, 18))
ARM[(0, 1, 2), (11, 15, 4)] = 1.0
ARM[(0, 1, 2), (16, 5, 9)] = -1.0


def blocks(count: int, size: int | None = None) -> Iterator[slice]:
    """Slices of a number of samples, one at least."""
    step = size or BLOCK
    for first in range(0, max(count, 1), step):
        yield slice(first, min(first + step, count))


class Prepared:
    """Indices and units of a robot."""

    def __init__(self, robot: Robot) -> None:
        models = list(enumerate(robot.model.joints))[1:]
        # Index and first coordinate of the joints that ``data.dJ`` is not all of.
        self.varying = [
            (k, joint.idx_v) for k, joint in models if joint.shortname() in VARYING_SUBSPACE
        ]
        # Of all frames: 1 where a coordinate moves a frame, else 0.
        self.supports = robot.supports(range(robot.model.nframes)).astype(np.float64)
        self.closure_rows = len(robot.row_closures)
        units = robot.row_scales[:, None] * robot.coordinate_scales
        self.in_common_units = units * robot.moving
        self.few_enough: set[int] = set()  # numbers of independent coordinates


prepared = derived(Prepared)  # made once a robot, when it is first used


@dataclass(eq=False)
class FramePoses:
    """F frames at N samples."""

    origin: FloatArray  # (N, F, 3) in m
    rotation: FloatArray  # (N, F, 3, 3), columns are the frame's axes
    supports: FloatArray  # (F, nv), 1 where a coordinate moves a frame, else 0
    joint_jacobian: FloatArray  # (N, 6, nv), ``data.J``; without rows where not required

    def repeated(self, count: int) -> FramePoses:
        """The same, each sample ``count`` times."""
        arrays = self.origin, self.rotation, self.joint_jacobian
        origin, rotation, jacobian = (np.repeat(each, count, axis=0) for each in arrays)
        return FramePoses(origin, rotation, self.supports, jacobian)

    @cached_property
    def angular(self) -> FloatArray:
        """(N, F, 3, nv), angular velocity of the frames per unit of each coordinate."""
        return self.joint_jacobian[:, None, 3:] * self.supports[:, None]

    @cached_property
    def linear(self) -> FloatArray:
        """(N, F, 3, nv), velocity of the frames' origins per unit of each coordinate."""
        count, frames, _ = self.origin.shape
        shift = self.origin.reshape(-1, 3) @ ARM
        shift += AT_ORIGIN
        moved = shift.reshape(count, 3 * frames, 6) @ self.joint_jacobian
        return moved.reshape(count, frames, 3, moved.shape[2]) * self.supports[:, None]

    @property
    def twists(self) -> FloatArray:
        """(N, 6, nv) of the first frame, linear above angular, per unit of each coordinate."""
        return np.concatenate([self.linear[:, 0], self.angular[:, 0]], axis=1)


@dataclass(frozen=True)
class FrameMotions:
    """Velocities and accelerations of F frames at N samples, (N, F, 3) each."""

    velocity: FloatArray  # of the origins
    acceleration: FloatArray
    turn: FloatArray  # angular
    turning: FloatArray


def frame_poses(
    robot: Robot, q: FloatArray, frame_ids: Sequence[int], *, jacobians: bool = True
) -> FramePoses:
    """Place frames, by their indices in the model, at configurations (N, nq)."""
    own = prepared(robot)
    model, memory = robot.model, robot.memory
    data, frames, ids = memory.data, memory.placed, np.asarray(frame_ids, dtype=np.intp)
    placed = np.empty((len(q), len(ids), 12))
    jacobian, J = np.empty((len(q), 6 if jacobians else 0, model.nv)), data.J
    for k, (configuration, out) in enumerate(zip(q, placed, strict=True)):
        if jacobians:
            pin.computeJointJacobians(model, data, configuration)
            pin.updateFramePlacements(model, data)
            jacobian[k] = J
        else:
            pin.framesForwardKinematics(model, data, configuration)
        # Without a mode NumPy copies the output, in case that an index is none.
        frames.take(ids, 0, out, "clip")
    rotation = placed[..., :9].reshape(*placed.shape[:2], 3, 3).swapaxes(2, 3)
    return FramePoses(placed[..., 9:], rotation, own.supports[ids], jacobian)


def frame_motions(robot: Robot, q: FloatArray, v: FloatArray, poses: FramePoses) -> FrameMotions:
    """How frames move at velocities (N, nv) and zero joint acceleration."""
    own, model, data = prepared(robot), robot.model, robot.memory.data
    # What each coordinate adds to the twists of bodies at the fixed origin, and to their rates.
    parts, dJ = np.empty((2, len(q), 6, model.nv)), data.dJ
    changes = np.zeros((len(q), 6, len(own.varying)))
    parts[0] = poses.joint_jacobian
    for k, state in enumerate(zip(q, v, strict=True)):
        pin.computeJointJacobiansTimeVariation(model, data, *state)
        parts[1, k] = dJ
        for j, (joint, _) in enumerate(own.varying):
            change = data.oMi[joint].act(pin.Motion(np.ravel(data.joints[joint].c)))
            changes[k, :, j] = change.vector
    parts *= v[:, None]
    parts[1][:, :, [first for _, first in own.varying]] += changes
    both = np.swapaxes(parts @ poses.supports.T, 2, 3)  # (2, N, F, 6)
    turn, turning = both[..., 3:]
    velocity, rate = both[..., :3] + _cross(both[..., 3:], poses.origin)
    return FrameMotions(velocity, rate + _cross(turn, velocity), turn, turning)


AFTER, BEFORE = np.array([1, 2, 0]), np.array([2, 0, 1])


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """As ``np.cross`` of (..., 3), in an eighth of the time for a single sample."""
    forth = a.take(AFTER, axis=-1) * b.take(BEFORE, axis=-1)
    return np.asarray(forth - a.take(BEFORE, axis=-1) * b.take(AFTER, axis=-1))


@checked
def torque_regressors(
    robot: Robot,
    q: FloatArray,
    v: FloatArray | None = None,
    a: FloatArray | None = None,
    *,
    model: str = "full",
    G: FloatArray | None = None,
) -> FloatArray:
    """Pinocchio's torque regressor Y, projected to Gᵀ Y where G is given.

    Parameters
    ----------
    robot : Robot
    q : FloatArray
        (N, nq).
    v, a : FloatArray, optional
        (N, nv), of the tree; by default zero.
    model : str
        ``"full"`` or ``"gravity"``.
    G : FloatArray, optional
        (N, nv, dof), as ``project`` gives it.

    Returns
    -------
    FloatArray
        (N, nv or dof, n), columns of ``robot.parameters(model)``.

    Examples
    --------
    >>> import loopid
    >>> robot = loopid.load("five_bar")
    >>> loopid.kinematics.torque_regressors(robot, robot.reference[None]).shape
    (1, 4, 40)
    """
    tree, data = robot.model, robot.memory.data
    for name, array, width in (("q", q, tree.nq), ("v", v, tree.nv), ("a", a, tree.nv)):
        if array is not None and (np.ndim(array) != 2 or np.shape(array) != (len(q), width)):
            message = f"{name} must have shape (samples, {width}), not {np.shape(array)}"
            raise DataError(message, argument=name, given=np.shape(array), width=width)
    if G is not None and (np.ndim(G) != 3 or np.shape(G)[:2] != (len(q), tree.nv)):
        message = f"G must have shape ({len(q)}, {tree.nv}, dof), not {np.shape(G)}"
        raise DataError(message, argument="G")
    v, a = (np.zeros((len(q), tree.nv)) if rate is None else rate for rate in (v, a))
    columns, ties = _columns(robot, model)
    G = np.broadcast_to(np.eye(tree.nv), (len(q), tree.nv, tree.nv)) if G is None else G
    to_rows = np.ascontiguousarray(G.transpose(0, 2, 1))
    K = np.empty((len(q), to_rows.shape[1], len(columns)))
    whole = np.empty((min(len(q), REGRESSORS), tree.nv, 10 * (tree.njoints - 1)))
    for rows in blocks(len(q), REGRESSORS):
        for k, state in enumerate(zip(q[rows], v[rows], a[rows], strict=True)):
            whole[k] = pin.computeJointTorqueRegressor(tree, data, *state)
        projected = to_rows[rows] @ whole[: rows.stop - rows.start]
        projected.take(columns, axis=2, out=K[rows], mode="clip")
    return K if ties is None else K @ ties


@derived
def _columns(robot: Robot, model: str) -> tuple[IntArray, FloatArray | None]:
    """With "gravity" m, mx, my and mz of each body; and what ties those of links alike."""
    ties = robot.tie_matrix(len(model_kinds(model))) if robot.tied else None
    return robot.columns(model), ties


class Tree:
    """A tree of bodies without closures, and Pinocchio's memory of it."""

    def __init__(self, model: pin.Model) -> None:
        self.model, self._memory = model, Memory(model)

    def inverse_dynamics(self, q: FloatArray, v: FloatArray, a: FloatArray) -> FloatArray:
        """Joint forces (N, k, nv) at configurations (N, nq), for k motions (N, k, nv) of each."""
        model, data, tau = self.model, self._memory.data, np.empty(v.shape)
        for out, configuration, rates, accelerations in zip(tau, q, v, a, strict=True):
            for k in range(len(out)):
                out[k] = pin.rnea(model, data, configuration, rates[k], accelerations[k])
        return tau

    def reactions(
        self, q: FloatArray, v: FloatArray, a: FloatArray, joints: Sequence[int]
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Joint forces (N, nv) of a motion, and what some joints transmit then.

        Forces (N, J, 3) from each joint to what hangs on it, along the fixed axes, and the
        orientations (N, J, 3, 3) of the joints.
        """
        model, data, tau = self.model, self._memory.data, np.empty((len(q), self.model.nv))
        force = np.empty((len(q), len(joints), 3))
        turn = np.empty((len(q), len(joints), 3, 3))
        for k, state in enumerate(zip(q, v, a, strict=True)):
            tau[k] = pin.rnea(model, data, *state)
            pin.forwardKinematics(model, data, state[0])
            turn[k] = [data.oMi[j].rotation for j in joints]
            force[k] = [data.f[j].linear for j in joints]
        return tau, np.einsum("njab,njb->nja", turn, force), turn


def integrate(robot: Robot, configurations: FloatArray, steps: FloatArray) -> FloatArray:
    """Configurations (N, nq) moved by tangent steps (N, nv)."""
    model = robot.model
    if model.nq == model.nv:
        return np.asarray(configurations + steps, dtype=np.float64)
    moved = np.empty_like(configurations)
    for k, (q, step) in enumerate(zip(configurations, steps, strict=True)):
        moved[k] = pin.integrate(model, q, step)
    return moved


@checked
def difference(robot: Robot, origin: FloatArray, target: FloatArray) -> FloatArray:
    """Tangent steps between configurations, which ``integrate`` would take.

    Parameters
    ----------
    robot : Robot
    origin, target : FloatArray
        (N, nq).

    Returns
    -------
    FloatArray
        (N, nv), in rad or m.

    Examples
    --------
    >>> import loopid
    >>> robot = loopid.load("five_bar")
    >>> first, second = loopid.random_configurations(robot, 2)[:, None]
    >>> loopid.kinematics.difference(robot, first, second).shape
    (1, 4)
    """
    model = robot.model
    origin = samples(origin, model.nq, "origin")
    target = samples(target, model.nq, "target", len(origin))
    if model.nq == model.nv:
        return target - origin
    steps = np.empty((len(origin), model.nv))
    for k, (before, after) in enumerate(zip(origin, target, strict=True)):
        steps[k] = pin.difference(model, before, after)
    return steps
