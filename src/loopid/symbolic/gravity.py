"""Gravity regressor K_G of the robot by the principle of virtual power, symbolically."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import sympy as sp

from loopid.symbolic.kinematics import POSE, stroke_functions
from loopid.symbolic.link_frames import Frame, link_frames

GRAVITY = 9.81  # m/s², against Z_F


@dataclass(frozen=True)
class GravityModel:
    """What K_G is made of, in the symbols of the pose and of the geometry.

    In equilibrium the power of the actuators equals the rate of the potential energy for every
    pose rate Ẋ compatible with the loops: τᵀ J Ẋ = Ẋᵀ P Φ_G. Hence τ = J⁻ᵀ P Φ_G = K_G Φ_G, the
    gravitational term of the paper's equation (3).

    Parameters
    ----------
    strokes : ImmutableMatrix
        Actuated coordinates q_13, q_23, q_33, q_42, m; (4, 1).
    jacobian : ImmutableMatrix
        J = ∂(strokes)/∂(x_m, z_m, θ, ψ), m or m/rad; (4, 4).
    energy : ImmutableMatrix
        Potential energy for each unit parameter, in the order of ``GRAVITY_LABELS``, J; (1, 36).
    power : ImmutableMatrix
        P, power of each unit parameter for each unit pose rate; (4, 36).
    """

    strokes: sp.ImmutableMatrix
    jacobian: sp.ImmutableMatrix
    energy: sp.ImmutableMatrix
    power: sp.ImmutableMatrix


@cache
def gravity_model() -> GravityModel:
    """Derive the gravity model; the first call takes a moment, later ones return the same."""
    strokes = stroke_functions()
    heights = [height for frame in link_frames().values() for height in _heights(frame)]
    energy = GRAVITY * sp.ImmutableMatrix([heights])
    return GravityModel(strokes, strokes.jacobian(POSE), energy, energy.jacobian(POSE).T)


def _heights(frame: Frame) -> tuple[sp.Expr, ...]:
    """Factors of m, mx, my, mz in the height of a body's centre of mass times its mass."""
    return frame.origin[2], *frame.axes[2, :]
