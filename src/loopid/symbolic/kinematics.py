"""Closed-form inverse kinematics of the robot, symbolically."""

from __future__ import annotations

import sympy as sp

from loopid.symbolic.geometry import base_points, limb_4_point, platform_points

# Pose of the platform: position (m) in the X_F Z_F plane, pitch and yaw (rad).
POSE: tuple[sp.Symbol, ...] = sp.symbols("x_m z_m theta psi")


def platform_position() -> sp.ImmutableMatrix:
    """Platform origin p, which is also the end of limb 4; (3, 1) in the fixed frame, m."""
    x_m, z_m, _, _ = POSE
    return sp.ImmutableMatrix([x_m, 0, z_m])


def platform_rotation() -> sp.ImmutableMatrix:
    """Rotation of the platform, Ry(theta) Rz(psi); (3, 3), platform to fixed frame."""
    _, _, theta, psi = POSE
    c, s = sp.cos(theta), sp.sin(theta)
    pitch = sp.ImmutableMatrix([[c, 0, s], [0, 1, 0], [-s, 0, c]])
    c, s = sp.cos(psi), sp.sin(psi)
    return pitch * sp.ImmutableMatrix([[c, -s, 0], [s, c, 0], [0, 0, 1]])


def leg_vectors() -> tuple[sp.ImmutableMatrix, sp.ImmutableMatrix, sp.ImmutableMatrix]:
    """Vectors d_i = p + R B_i - A_i of limbs 1 to 3; three (3, 1) in the fixed frame, m."""
    p, R = platform_position(), platform_rotation()
    A, B = base_points(), platform_points()
    return p + R * B[0] - A[0], p + R * B[1] - A[1], p + R * B[2] - A[2]


def leg_coordinates(d: sp.ImmutableMatrix) -> tuple[sp.Expr, sp.Expr, sp.Expr]:
    """Coordinates q_i1, q_i2 (rad) and q_i3 (m) of a limb 1 to 3 along the vector d_i."""
    d_x, d_y, d_z = d
    across = sp.sqrt(d_x**2 + d_z**2)
    return sp.atan2(d_z, d_x), sp.atan2(across, -d_y), sp.sqrt(d_x**2 + d_y**2 + d_z**2)


def limb_4_coordinates() -> tuple[sp.Expr, sp.Expr]:
    """Coordinates q_41 (rad) and q_42 (m) of limb 4."""
    d_x, _, d_z = platform_position() - limb_4_point()
    return sp.atan2(-d_x, d_z), sp.sqrt(d_x**2 + d_z**2)


def stroke_functions() -> sp.ImmutableMatrix:
    """Actuated coordinates q_13, q_23, q_33, q_42 as functions of the pose; (4, 1), m."""
    legs = [leg_coordinates(d)[2] for d in leg_vectors()]
    return sp.ImmutableMatrix([*legs, limb_4_coordinates()[1]])
