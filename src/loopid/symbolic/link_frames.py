"""The paper's Denavit-Hartenberg link frames, as functions of the pose."""

from __future__ import annotations

from dataclasses import dataclass

import sympy as sp

from loopid.symbolic.geometry import base_points, limb_4_point
from loopid.symbolic.kinematics import (
    leg_coordinates,
    leg_vectors,
    limb_4_coordinates,
    platform_position,
    platform_rotation,
)


@dataclass(frozen=True)
class Frame:
    """A link frame: `origin` (3, 1) in m and `axes` (3, 3), x y z as columns, fixed frame."""

    origin: sp.ImmutableMatrix
    axes: sp.ImmutableMatrix


def link_frames() -> dict[str, Frame]:
    """Frames of the nine bodies, by link name in the column order of the regressor.

    Every stem is reached along its own limb, not through the platform: that both ways agree
    is the loop closure, which the inertia transfer uses and a test proves.
    """
    frames: dict[str, Frame] = {}
    for leg, (A, d) in enumerate(zip(base_points(), leg_vectors(), strict=True), start=1):
        frames |= _leg_frames(f"leg{leg}", A, d)
    return frames | _limb_4_frames() | {"platform": Frame(platform_position(), platform_rotation())}


def _leg_frames(name: str, A: sp.ImmutableMatrix, d: sp.ImmutableMatrix) -> dict[str, Frame]:
    """Limbs 1 to 3: cylinder at A_i, stem at the spherical joint, common axes."""
    q_1, q_2, q_3 = leg_coordinates(d)
    c1, s1, c2, s2 = sp.cos(q_1), sp.sin(q_1), sp.cos(q_2), sp.sin(q_2)
    axes = sp.ImmutableMatrix([[c1 * c2, -s1, c1 * s2], [s2, 0, -c2], [s1 * c2, c1, s1 * s2]])
    stem_origin = A + q_3 * axes[:, 2]
    return {f"{name}_cylinder": Frame(A, axes), f"{name}_stem": Frame(stem_origin, axes)}


def _limb_4_frames() -> dict[str, Frame]:
    """Limb 4: cylinder at the revolute joint, stem at p with axes -x_41, -z_41, -y_41."""
    q_1, q_2 = limb_4_coordinates()
    c, s = sp.cos(q_1), sp.sin(q_1)
    axes = sp.ImmutableMatrix([[c, 0, -s], [0, 1, 0], [s, 0, c]])
    x, y, z = axes[:, 0], axes[:, 1], axes[:, 2]
    stem_origin = limb_4_point() + q_2 * z
    return {
        "leg4_cylinder": Frame(limb_4_point(), axes),
        "leg4_stem": Frame(stem_origin, sp.ImmutableMatrix.hstack(-x, -z, -y)),
    }
