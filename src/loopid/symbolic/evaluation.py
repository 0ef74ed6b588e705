"""Numerical values of the symbolic model over many poses at once."""

from __future__ import annotations

from functools import cache

import numpy as np
import sympy as sp
from numpy.typing import ArrayLike

from loopid.arrays import BoolArray, FloatArray, samples
from loopid.errors import SingularityError
from loopid.symbolic.compilation import Evaluator, compile_matrix
from loopid.symbolic.geometry import Geometry
from loopid.symbolic.gravity import GRAVITY, gravity_model
from loopid.symbolic.inertia_transfer import base_parameter_rows
from loopid.symbolic.kinematics import POSE

# Below this reciprocal condition number of J the forces are round-off.
SINGULAR_RCOND = 1e-13


def strokes(geometry: Geometry, poses: ArrayLike) -> FloatArray:
    """Strokes of the four prismatic joints by closed-form inverse kinematics.

    Parameters
    ----------
    geometry : Geometry
        Geometric parameters, m and rad.
    poses : array-like
        x_m, z_m (m), theta, psi (rad) of each pose; (N, 4), or (4,) for one.

    Returns
    -------
    ndarray
        q_13, q_23, q_33, q_42 in m; (N, 4).

    Raises
    ------
    DataError
        If `poses` has another shape or is not finite.
    """
    return _strokes()(geometry, samples(poses, len(POSE), "poses"))[:, :, 0]


def stroke_jacobian(geometry: Geometry, poses: ArrayLike) -> FloatArray:
    """Jacobian J of the strokes with respect to the pose.

    Parameters as in :func:`strokes`.

    Returns
    -------
    ndarray
        Rows limbs 1 to 4, columns x_m, z_m (m/m), theta, psi (m/rad); (N, 4, 4).

    Raises
    ------
    DataError
        If `poses` has another shape or is not finite.
    SingularityError
        If a limb has no length at a pose.
    """
    poses = samples(poses, len(POSE), "poses")
    J = _jacobian()(geometry, poses)
    missing = np.asarray(~np.isfinite(J).all(axis=(1, 2)), dtype=np.bool_)
    _refuse(poses, missing, "a limb has no length")
    return J


def gravity_regressor(geometry: Geometry, poses: ArrayLike) -> FloatArray:
    """Gravity regressor K_G = J⁻ᵀ P of the paper's equation (3).

    K_G Φ_G are the forces of the actuators that hold the robot against gravity.

    Parameters
    ----------
    geometry : Geometry
        Geometric parameters, m and rad.
    poses : array-like
        x_m, z_m (m), theta, psi (rad) of each pose; (N, 4), or (4,) for one.

    Returns
    -------
    ndarray
        Rows limbs 1 to 4, columns ``GRAVITY_LABELS``, N per kg or per kg m; (N, 4, 36).

    Raises
    ------
    DataError
        If `poses` has another shape or is not finite.
    SingularityError
        If a pose is a type II singularity (J loses rank), or puts a limb 1 to 3 parallel to Y_F,
        where its universal joint is singular, or leaves a limb without length.
    """
    return _forces(_power(), geometry, poses)


def base_regressor(geometry: Geometry, poses: ArrayLike) -> FloatArray:
    """Regressor of the 15 base parameters, from the gradients of their atoms.

    Parameters and errors as in :func:`gravity_regressor`.

    Returns
    -------
    ndarray
        Rows limbs 1 to 4, columns as :func:`base_parameter_rows`, N per kg or per kg m;
        (N, 4, 15).
    """
    return _forces(_atom_power(), geometry, poses)


def _forces(power: Evaluator, geometry: Geometry, poses: ArrayLike) -> FloatArray:
    """J⁻ᵀ times the power for each unit parameter and unit pose rate."""
    poses = samples(poses, len(POSE), "poses")
    J, P = stroke_jacobian(geometry, poses), power(geometry, poses)
    lost = np.asarray(~np.isfinite(P).all(axis=(1, 2)), dtype=np.bool_)
    _refuse(poses, lost, "a limb is parallel to Y_F")
    singular = np.asarray(1.0 / np.linalg.cond(J) < SINGULAR_RCOND, dtype=np.bool_)
    _refuse(poses, singular, f"type II singularity, 1/cond(J) is below {SINGULAR_RCOND:g}")
    forces = np.linalg.solve(J.transpose(0, 2, 1), P)
    return np.asarray(forces, dtype=np.float64)


def _refuse(poses: FloatArray, bad: BoolArray, reason: str) -> None:
    if bad.any():
        first = int(np.argmax(bad))
        raise SingularityError(
            f"{bad.sum()} of {len(poses)} poses: {reason}; the first is pose {first}, "
            f"(x_m, z_m, theta, psi) = {poses[first].tolist()}"
        )


@cache
def _strokes() -> Evaluator:
    return compile_matrix(gravity_model().strokes)


@cache
def _jacobian() -> Evaluator:
    return compile_matrix(gravity_model().jacobian)


@cache
def _power() -> Evaluator:
    return compile_matrix(gravity_model().power)


@cache
def _atom_power() -> Evaluator:
    atoms = sp.ImmutableMatrix([row.atom for row in base_parameter_rows()])
    return compile_matrix(GRAVITY * atoms.jacobian(POSE).T)
