"""Joints of a compiled model, added to Pinocchio's with coordinates that equal MuJoCo's."""

from __future__ import annotations

from dataclasses import dataclass, replace

import mujoco
import numpy as np
import pinocchio as pin

from loopid.arrays import FloatArray
from loopid.loading.mjcf.efforts import effort_limit
from loopid.loading.mjcf.names import joint_kind
from loopid.loading.mjcf.scene import Scene

AXES = {(1.0, 0.0, 0.0): "X", (0.0, 1.0, 0.0): "Y", (0.0, 0.0, 1.0): "Z"}
# Quaternions have no limits; random configurations need some.
QUATERNION_LIMIT = np.full(4, 1.01)
VELOCITIES = {"hinge": 1, "slide": 1, "ball": 3, "free": 6}


@dataclass(frozen=True)
class Mount:
    """Where MuJoCo's body frame is while a body is being built.

    Attributes
    ----------
    joint : int
        Pinocchio's joint that carries the body so far.
    frame : int
        Frame of the link that carries it.
    placement : pinocchio.SE3
        Of the body frame, in the frame of the joint.
    """

    joint: int
    frame: int
    placement: pin.SE3

    def moved(self, by: pin.SE3) -> Mount:
        """The mount behind a placement in the body frame."""
        return replace(self, placement=self.placement * by)

    def on(self, frame: int) -> Mount:
        """The mount on another frame."""
        return replace(self, frame=frame)


def add_joint(scene: Scene, model: pin.Model, joint: int, mount: Mount) -> Mount:
    """Add a joint of MuJoCo where the body is mounted; the body frame behind it."""
    compiled, kind = scene.compiled, joint_kind(scene.compiled, joint)
    start, anchor = pin.SE3.Identity(), pin.SE3.Identity()
    # The coordinates of a free joint are the whole placement, wherever the file draws the body.
    if kind != "free":
        anchor = _shift(compiled.jnt_pos[joint])
        start = mount.placement * anchor * _at_zero(compiled, joint)
    low, high = _limits(compiled, joint)
    unlimited = np.full(VELOCITIES[kind], np.inf)
    effort = unlimited if kind in ("ball", "free") else np.full(1, effort_limit(compiled, joint))
    motion, name = _motion(kind, compiled.jnt_axis[joint]), scene.names.joints[joint]
    index = model.addJoint(mount.joint, motion, start, name, effort, unlimited, low, high)
    frame = model.addJointFrame(index, mount.frame)
    return Mount(int(index), int(frame), anchor.inverse())


def _motion(kind: str, axis: FloatArray) -> pin.JointModel:
    if kind == "free":
        return pin.JointModelFreeFlyer()
    if kind == "ball":
        return pin.JointModelSpherical()
    aligned = AXES.get(tuple(axis.tolist()))
    if aligned is not None:
        return getattr(pin, f"JointModel{'P' if kind == 'slide' else 'R'}{aligned}")()
    other = pin.JointModelPrismaticUnaligned if kind == "slide" else pin.JointModelRevoluteUnaligned
    return other(axis.copy())


def _at_zero(compiled: mujoco.MjModel, joint: int) -> pin.SE3:
    """Motion from where the file draws a body to where the joint's coordinate is zero."""
    kind = joint_kind(compiled, joint)
    back = -compiled.qpos0[compiled.jnt_qposadr[joint]] * compiled.jnt_axis[joint]
    if kind == "hinge":
        return pin.SE3(pin.exp3(back), np.zeros(3))
    return _shift(back) if kind == "slide" else pin.SE3.Identity()


def _limits(compiled: mujoco.MjModel, joint: int) -> tuple[FloatArray, FloatArray]:
    kind = joint_kind(compiled, joint)
    if kind in ("ball", "free"):
        high = np.concatenate([np.full(3 * (kind == "free"), np.inf), QUATERNION_LIMIT])
        return -high, high
    limits = compiled.jnt_range[joint] if compiled.jnt_limited[joint] else (-np.inf, np.inf)
    return np.array(limits[:1]), np.array(limits[1:])


def _shift(by: FloatArray) -> pin.SE3:
    return pin.SE3(np.eye(3), np.asarray(by, dtype=np.float64))
