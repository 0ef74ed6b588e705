"""The pseudo-inertia of a body: its ten parameters as one symmetric matrix.

P = [Σ h; hᵀ m] with the second moments Σ = ½ tr(I) 1 - I about the link's origin and the first
moments h. A body of positive density all over some volume has P positive definite, and every
positive definite P is that of such a body [Wensing2018].
"""

from __future__ import annotations

import numpy as np

from loopid.arrays import FloatArray, finite
from loopid.errors import DataError

SIZE = 4  # rows x, y, z and one of the mass
WIDTH = 10  # numbers of a symmetric matrix of this size
# Rows and columns of the upper triangle, column by column, as conic solvers want them.
COLUMNS, ROWS = np.tril_indices(SIZE)
DIAGONAL = ROWS == COLUMNS
# Off-diagonal entries count twice in tr(A B): this makes it a product of vectors.
SCALES = np.where(DIAGONAL, 1.0, np.sqrt(2.0))
IDENTITY = np.eye(SIZE)[ROWS, COLUMNS]  # as a vector
_INERTIA = ((4, 5, 7), (5, 6, 8), (7, 8, 9))  # where Ixx Ixy Ixz ... stand among the ten


def pseudo_inertia(parameters: FloatArray) -> FloatArray:
    """Pseudo-inertias P (..., 4, 4) of standard parameters (..., 10) in the order of ``KINDS``.

    Raises
    ------
    DataError
        When the parameters have another shape or are not finite.
    """
    parameters = finite(parameters, "parameters")
    if parameters.shape[-1:] != (WIDTH,):
        raise DataError(f"parameters must have shape (..., {WIDTH}), not {parameters.shape}")
    inertia = parameters[..., _INERTIA]
    half = np.trace(inertia, axis1=-2, axis2=-1)[..., None, None] / 2
    P = np.empty((*parameters.shape[:-1], SIZE, SIZE))
    P[..., :3, :3] = half * np.eye(3) - inertia
    P[..., 3, :3] = P[..., :3, 3] = parameters[..., 1:4]
    P[..., 3, 3] = parameters[..., 0]
    return P


def parameters_of(P: FloatArray) -> FloatArray:
    """Standard parameters (..., 10) of pseudo-inertias (..., 4, 4)."""
    second = P[..., :3, :3]
    trace = np.trace(second, axis1=-2, axis2=-1)[..., None, None]
    inertia = trace * np.eye(3) - second
    parameters = np.empty((*P.shape[:-2], WIDTH))
    parameters[..., 0] = P[..., 3, 3]
    parameters[..., 1:4] = P[..., :3, 3]
    for row, places in enumerate(_INERTIA):
        parameters[..., places] = inertia[..., row, :]
    return parameters


def vector(matrix: FloatArray) -> FloatArray:
    """Symmetric matrices (..., 4, 4) as vectors (..., 10) with tr(A B) = aᵀ b."""
    return np.asarray(matrix[..., ROWS, COLUMNS] * SCALES, dtype=np.float64)


def matrix(vectors: FloatArray) -> FloatArray:
    """Symmetric matrices (..., 4, 4) of vectors (..., 10)."""
    found = np.empty((*vectors.shape[:-1], SIZE, SIZE))
    found[..., ROWS, COLUMNS] = found[..., COLUMNS, ROWS] = vectors / SCALES
    return found


def congruence(factor: FloatArray) -> FloatArray:
    """The map (..., 10, 10) from the vector of X to that of L X Lᵀ, for factors L (..., 4, 4)."""
    units = matrix(np.eye(WIDTH))
    images = factor[..., None, :, :] @ units @ np.swapaxes(factor, -1, -2)[..., None, :, :]
    return np.swapaxes(vector(images), -1, -2)


def upper_factor(P: FloatArray) -> FloatArray:
    """Upper triangular L (..., 4, 4) with positive diagonals and P = L Lᵀ.

    Second moments are then changed by the upper left part of X in L X Lᵀ alone.
    """
    flipped = np.linalg.cholesky(P[..., ::-1, ::-1])
    return np.asarray(flipped[..., ::-1, ::-1], dtype=np.float64)
