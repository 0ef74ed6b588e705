"""Fits of some of the parameters, from what the fit of all of them left behind."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.linalg import solve_triangular

from loopid.arrays import FloatArray
from loopid.identification import WorkingFit


class SubsetFits:
    """Least squares of any parameters, the others at their reference.

    Weights, working samples and error model stay those of the full fit, so that no sample is needed
    again: with R the weighted triangular factor and C the full covariance, M = R C Rᵀ is the
    covariance of the errors as R sees them, and a subset with R_S = Q T has T⁻¹ Qᵀ M Q T⁻ᵀ.

    Parameters
    ----------
    full : WorkingFit
        Of all n parameters.
    reference : FloatArray
        (n,), values of those that are not fitted.
    """

    def __init__(self, full: WorkingFit, reference: FloatArray) -> None:
        width, factor = len(full.result.values), full.factor
        self._R, self._force = factor[:width, :width], factor[:width, width]
        self._errors = self._R @ full.result.covariance @ self._R.T
        self.reference = reference

    def fit(self, columns: Sequence[int]) -> tuple[FloatArray, FloatArray]:
        """All values (n,), and standard errors of the fitted columns."""
        values = self.reference.copy()
        values[columns] = 0.0
        Q, T = np.linalg.qr(self._R[:, columns])
        values[columns] = solve_triangular(T, Q.T @ (self._force - self._R @ values))
        inverse = np.linalg.inv(T) @ Q.T
        variances = np.einsum("ij,jk,ik->i", inverse, self._errors, inverse)
        return values, np.sqrt(variances)
