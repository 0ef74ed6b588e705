"""Estimation while the robot moves: recursive least squares, and changes that it detects.

The state is the triangular factor [R z; 0 ρ] of all weighted rows seen so far, R φ = z. A sample is
stacked below and all is made triangular again, so that RᵀR stays positive definite. Without
forgetting the values are those of the batch fit. Forgetting multiplies the factor from the left,
which moves no values:

    none          I
    exponential   √λ I
    directional   I - (1 - √λ) Q Qᵀ, Q an orthonormal basis of R Kᵀ

Exponential forgetting lets information decay everywhere. Without excitation there is soon none
left. Directional forgetting lets it decay along what new rows have [Cao2000], and nowhere else. It
takes several rows a sample [Lai2024].
"""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field
from scipy.linalg import lapack, solve_triangular

from loopid.arguments import FloatArray, Number, Positive, checked, checked_late, finite, shaped
from loopid.errors import DataError, RankError

Forgetting = Literal["none", "exponential", "directional"]
LEAST = 1e-3  # of the largest excited direction: smaller ones do not forget


@checked_late
class RecursiveLeastSquares:
    """Base parameters φ from rows K φ = force, one sample after the other.

    Parameters
    ----------
    values : FloatArray
        (n,), to begin with.
    covariance : FloatArray or None
        (n, n) of these; None where nothing is known, and the data alone determine them.
    deviations : FloatArray
        (dof,), standard deviations of the forces in N or N m.
    forgetting : "none", "exponential" or "directional"
    memory : float
        Samples after which a sample counts 1/e of a new one, 1 / (1 - λ).

    Raises
    ------
    DataError
        When shapes differ or the covariance is not positive definite.

    Examples
    --------
    >>> import numpy as np
    >>> from loopid.control import RecursiveLeastSquares
    >>> estimate = RecursiveLeastSquares(np.zeros(2), None, np.ones(1))
    >>> for row, force in (([1.0, 0.0], 3.0), ([1.0, 1.0], 5.0)):
    ...     estimate.update(np.array([row]), np.array([force]))
    >>> estimate.values.round(6).tolist()
    [3.0, 2.0]
    """

    def __init__(
        self,
        values: FloatArray,
        covariance: FloatArray | None,
        deviations: FloatArray,
        *,
        forgetting: Forgetting = "none",
        memory: Annotated[float, Field(gt=1)] = 1000.0,
    ) -> None:
        phi, sigma = finite(values, "values"), finite(deviations, "deviations")
        if phi.ndim != 1 or sigma.ndim != 1 or not (sigma > 0).all():
            raise DataError("values (n,) and positive deviations (dof,) must be vectors")
        self.deviations, self.forgetting, self.memory = sigma, forgetting, memory
        self._n, self._keep = len(phi), np.sqrt(1.0 - 1.0 / memory)
        root = np.zeros(2 * phi.shape) if covariance is None else _information_root(covariance, phi)
        self._work = np.zeros((self._n + 1 + len(sigma), self._n + 1), order="F")
        self._restart(root, phi)

    def update(self, regressor: FloatArray, force: FloatArray) -> None:
        """Take a sample, K (dof, n) and forces (dof,); rows of zeros say nothing."""
        K, force = self._sample(regressor, force)
        n, rows = self._n, K / self.deviations[:, None]
        if self.forgetting == "exponential":
            self._work[: n + 1] *= self._keep
        elif self.forgetting == "directional":
            told = self._work[:n, :n] @ rows.T
            squares, axes = np.linalg.eigh(told.T @ told)
            kept = squares > LEAST**2 * max(squares[-1], np.finfo(float).tiny)
            Q = told @ (axes[:, kept] / np.sqrt(squares[kept]))
            self._work[:n] -= (1.0 - self._keep) * (Q @ (Q.T @ self._work[:n]))
        self._work[n + 1 :, :n], self._work[n + 1 :, n] = rows, force / self.deviations
        self._triangle()

    def _sample(self, regressor: FloatArray, force: FloatArray) -> tuple[FloatArray, FloatArray]:
        dof = len(self.deviations)
        return shaped(regressor, "regressor", dof, self._n), shaped(force, "force", dof)

    @property
    def values(self) -> FloatArray:
        """Estimates (n,).

        Raises
        ------
        RankError
            When the data do not determine all of them, and nothing was known before.
        """
        R = self._told()
        return np.asarray(solve_triangular(R, self._work[: self._n, self._n], check_finite=False))

    @property
    def covariance(self) -> FloatArray:
        """(n, n) of the estimates, for errors that are independent."""
        root = solve_triangular(self._told(), np.eye(self._n), check_finite=False)
        return np.asarray(root @ root.T)

    def innovation(self, regressor: FloatArray, force: FloatArray) -> tuple[float, int]:
        """Squared innovation of a sample in its own deviations, and the number of its forces.

        Chi-squared with as many degrees of freedom while nothing has changed. Rows of zeros are no
        forces.
        """
        K, force = self._sample(regressor, force)
        used = K.any(axis=1)
        K = K[used] / self.deviations[used, None]
        error = force[used] / self.deviations[used] - K @ self.values
        spread = solve_triangular(self._told(), K.T, trans="T", check_finite=False)
        S = spread.T @ spread + np.eye(len(K))
        return float(error @ np.linalg.solve(S, error)), int(used.sum())

    def loosen(self, columns: FloatArray, deviations: FloatArray) -> None:
        """Forget along columns B (n, k): φ may have changed by B π, π of these deviations (k,).

        With ``Dynamics.payload_columns``, by a body on a link.
        """
        sigma, values = np.atleast_1d(finite(deviations, "deviations")), self.values
        B = shaped(columns, "columns", self._n, len(sigma))
        spread = self.covariance + (B * sigma**2) @ B.T
        self._restart(_information_root(spread, values), values)

    def _restart(self, root: FloatArray, values: FloatArray) -> None:
        self._work[:] = 0.0
        self._work[: self._n, : self._n], self._work[: self._n, self._n] = root, root @ values
        self._triangle()

    def _triangle(self) -> None:
        factored, *_ = lapack.dgeqrf(self._work, overwrite_a=True)
        self._work = np.asfortranarray(np.triu(factored))

    def _told(self) -> FloatArray:
        R: FloatArray = self._work[: self._n, : self._n]
        own = np.abs(R.diagonal())
        if missing := int((own <= np.finfo(float).eps * own.max()).sum()):
            raise RankError(
                f"{missing} of {self._n} values are not determined yet: begin with a covariance, "
                "or with more samples"
            )
        return R


def _information_root(covariance: FloatArray, values: FloatArray) -> FloatArray:
    """A root W of the information, WᵀW = C⁻¹."""
    C = shaped(covariance, "covariance", *2 * values.shape)
    # Scaled, as values have units of their own.
    scale = np.sqrt(np.maximum(C.diagonal(), np.finfo(float).tiny))
    try:
        L = np.linalg.cholesky(C / np.outer(scale, scale))
    except np.linalg.LinAlgError:
        raise DataError("the covariance must be positive definite") from None
    return np.asarray(solve_triangular(L, np.diag(1.0 / scale), lower=True))


@checked
class ChangeDetector:
    """Tells from innovations that something has changed: a one-sided cumulative sum [Page1954].

    Squared innovations, divided by their number, are 1 on average while nothing changes. What is
    above ``drift`` adds up, and at ``limit`` there is an alarm.

    Parameters
    ----------
    drift : float
        Larger than 1. Errors of the model add to innovations as noise does.
    limit : float
        The higher, the later the alarm, and the fewer false ones.

    Examples
    --------
    >>> from loopid.control import ChangeDetector
    >>> detector = ChangeDetector()
    >>> [detector.update(4 * each, 4) for each in (1.0, 9.0, 9.0, 9.0, 9.0)]
    [False, False, False, False, True]
    """

    def __init__(
        self, *, drift: Annotated[float, Field(gt=1)] = 2.0, limit: Positive = 25.0
    ) -> None:
        self.drift, self.limit, self.sum = drift, limit, 0.0

    def update(self, innovation: Number, count: int) -> bool:
        """Take a squared innovation of this many forces; whether something has changed."""
        if count:
            self.sum = max(0.0, self.sum + innovation / count - self.drift)
        changed = self.sum > self.limit
        if changed:
            self.sum = 0.0
        return changed
