"""Equalities of joints and of fixed tendons as linear couplings of joint coordinates.

MuJoCo holds ``y - y0 = c0 + c1 (x - x0) + c2 (x - x0)^2 + ...``, with joint coordinates or tendon
lengths ``y`` and ``x`` that are ``y0`` and ``x0`` where the file draws the robot.
"""

from __future__ import annotations

import mujoco
import numpy as np

from loopid.loading.closure_description import ClosureDescription
from loopid.loading.mjcf.codes import WRAPS_JOINT
from loopid.loading.mjcf.scene import Scene

Terms = dict[int, float]  # coefficients of joint coordinates


def joint_coupling(scene: Scene, equality: int) -> ClosureDescription:
    """Coupling of two joints, or of one joint with a constant."""
    first, second = _objects(scene.compiled, equality)
    return _coupling(scene, equality, {first: 1.0}, {} if second < 0 else {second: 1.0})


def tendon_coupling(scene: Scene, equality: int) -> ClosureDescription:
    """Coupling of the lengths of two fixed tendons, or of one with a constant."""
    first, second = _objects(scene.compiled, equality)
    other = {} if second < 0 else fixed_tendon(scene, second)
    return _coupling(scene, equality, fixed_tendon(scene, first), other)


def fixed_tendon(scene: Scene, tendon: int) -> Terms:
    """Coefficients of the joints whose sum is the length of a tendon.

    Raises
    ------
    ValueError
        Where the length is no linear function of joint coordinates.
    """
    compiled = scene.compiled
    first, count = compiled.tendon_adr[tendon], compiled.tendon_num[tendon]
    terms: Terms = {}
    for wrap in range(first, first + count):
        if compiled.wrap_type[wrap] != WRAPS_JOINT:
            name = scene.names.tendons[tendon] or tendon
            raise ValueError(f"is of the spatial tendon {name}: only fixed tendons are supported")
        joint = int(compiled.wrap_objid[wrap])
        terms[joint] = terms.get(joint, 0.0) + float(compiled.wrap_prm[wrap])
    return terms


def _coupling(scene: Scene, equality: int, one: Terms, two: Terms) -> ClosureDescription:
    data = scene.compiled.eq_data[equality].tolist()
    if two and any(data[2:5]):
        terms = ", ".join(f"{value:g}" for value in data[:5])
        raise ValueError(f"has polycoef {terms}: only linear couplings are supported")
    slope = data[1] if two else 0.0
    joints = dict(one)
    for joint, factor in two.items():
        joints[joint] = joints.get(joint, 0.0) - slope * factor
    offset = data[0] + _at_start(scene, one) - slope * _at_start(scene, two)
    if not np.isfinite([offset, *joints.values()]).all():
        raise ValueError("has coefficients that are too large")
    named = {scene.names.joints[joint]: value for joint, value in joints.items() if value != 0}
    if not named:
        raise ValueError("couples no joint")
    return ClosureDescription(type="coupling", joints=named, offset=offset)


def _at_start(scene: Scene, terms: Terms) -> float:
    compiled = scene.compiled
    return sum(v * float(compiled.qpos0[compiled.jnt_qposadr[j]]) for j, v in terms.items())


def _objects(compiled: mujoco.MjModel, equality: int) -> tuple[int, int]:
    return int(compiled.eq_obj1id[equality]), int(compiled.eq_obj2id[equality])
