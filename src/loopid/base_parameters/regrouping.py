"""Regrouping: fold the dependent parameters into the base ones [Gautier1991].

With Pᵀ V2 = [V21; V22], V22 the rows of the dependent parameters D, W_D = -W_B V21 V22⁻¹, so
Φ_base = Φ_B - V21 V22⁻¹ Φ_D reproduces every force: W_B Φ_base = W Φ.
"""

from __future__ import annotations

import numpy as np

from loopid.arrays import FloatArray, IntArray

# Coefficients below this fraction of the largest are round-off of the inversion.
ZERO_COEFFICIENT = 1e-9


def base_columns(size: int, dependent: IntArray) -> IntArray:
    """Columns that are not dependent, ascending; shape (n - d,)."""
    is_base = np.ones(size, dtype=bool)
    is_base[dependent] = False
    return np.flatnonzero(is_base)


def regrouping_matrix(null_basis: FloatArray, dependent: IntArray) -> FloatArray:
    """Coefficients β of Φ_base = Φ_B + β Φ_D.

    Parameters
    ----------
    null_basis : FloatArray
        (n, d).
    dependent : IntArray
        (d,), or (c, d) for c choices at once.

    Returns
    -------
    FloatArray
        (n - d, d) or (c, n - d, d); coefficients that are round-off are zero.
    """
    choices = np.atleast_2d(dependent)
    n = len(null_basis)
    base = np.array([base_columns(n, choice) for choice in choices]).reshape(len(choices), -1)
    V21, V22 = null_basis[base], null_basis[choices]
    solution = -np.linalg.solve(V22.transpose(0, 2, 1), V21.transpose(0, 2, 1))
    beta = solution.transpose(0, 2, 1)
    largest = np.abs(beta).max(axis=(1, 2), initial=0.0)
    beta[np.abs(beta) <= ZERO_COEFFICIENT * np.maximum(largest, 1.0)[:, None, None]] = 0.0
    return beta if np.ndim(dependent) == 2 else beta[0]
