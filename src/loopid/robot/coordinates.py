"""Names of single velocity coordinates, also of joints that have several."""

from __future__ import annotations

import pinocchio as pin

ANGULAR = ("wx", "wy", "wz")
LINEAR = ("vx", "vy", "vz")
# Velocity components of Pinocchio's joints, in its order, along the axes of the joint's own frame.
COMPONENTS = {
    "JointModelFreeFlyer": LINEAR + ANGULAR,
    "JointModelSpherical": ANGULAR,
    "JointModelPlanar": ("vx", "vy", "wz"),
    "JointModelTranslation": LINEAR,
}


def coordinate_names(name: str, joint: pin.JointModel) -> tuple[str, ...]:
    """The joint's name where it has one coordinate, ``<joint>.wx`` and so on where it has more."""
    if joint.nv == 1:
        return (name,)
    numbered = tuple(f"v{k}" for k in range(joint.nv))
    return tuple(f"{name}.{part}" for part in COMPONENTS.get(joint.shortname(), numbered))


def is_sliding(name: str, joint: pin.JointModel) -> tuple[bool, ...]:
    """Whether each coordinate is a length in m; all others are angles in rad."""
    if joint.nv > 1:
        return tuple(part.rpartition(".")[2] in LINEAR for part in coordinate_names(name, joint))
    return (joint.shortname().startswith("JointModelP"),)
