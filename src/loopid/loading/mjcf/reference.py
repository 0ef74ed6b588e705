"""The configuration that a compiled model names or starts from."""

from __future__ import annotations

import mujoco
import numpy as np

from loopid.arrays import FloatArray
from loopid.loading.mjcf.names import joint_kind, key_names
from loopid.loading.mjcf.scene import Scene


def read_reference(scene: Scene) -> dict[str, float | list[float]]:
    """Joint values of the keyframe ``home``, else of the first one, else as the file is drawn.

    Several coordinates of one joint are in Pinocchio's order: positions, then a quaternion with w
    last.
    """
    q = _configuration(scene.compiled)
    starts = scene.compiled.jnt_qposadr
    return {
        name: _value(scene, joint, q[starts[joint] :])
        for joint, name in enumerate(scene.names.joints)
    }


def _configuration(compiled: mujoco.MjModel) -> FloatArray:
    if compiled.nkey == 0:
        return np.array(compiled.qpos0)
    names = key_names(compiled)
    return np.array(compiled.key_qpos[names.index("home") if "home" in names else 0])


def _value(scene: Scene, joint: int, q: FloatArray) -> float | list[float]:
    kind = joint_kind(scene.compiled, joint)
    if kind in ("hinge", "slide"):
        return float(q[0])
    first = 3 if kind == "free" else 0
    quaternion = q[first : first + 4]
    w, x, y, z = (quaternion / np.linalg.norm(quaternion)).tolist()
    return [*q[:first].tolist(), x, y, z, w]
