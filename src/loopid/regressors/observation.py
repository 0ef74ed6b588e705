"""The observation: a stacked regressor, reduced to its triangular factor.

Rank, null space, conditioning and least squares need only R of W = Q R, whose size does not
depend on the number of samples.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from loopid.arrays import FloatArray, finite, frozen
from loopid.errors import DataError
from loopid.parameters import ParameterSet


@dataclass(frozen=True)
class Observation:
    """Stacked rows of a regressor.

    Attributes
    ----------
    parameters : ParameterSet
        Names of the n columns.
    factor : FloatArray
        (n, n) upper triangular R with RᵀR = WᵀW, read-only.
    rows : int
        Rows of W.
    length : float
        Characteristic length in m: a column per kg m counts this much more than one per kg.
    matrix : FloatArray or None
        W itself (rows, n), where it was kept.
    """

    parameters: ParameterSet
    factor: FloatArray
    rows: int
    length: float = 1.0
    matrix: FloatArray | None = None

    @classmethod
    def from_matrix(
        cls,
        matrix: FloatArray,
        parameters: ParameterSet,
        length: float = 1.0,
        keep_matrix: bool = False,
    ) -> Observation:
        """Factor an observation matrix.

        Parameters
        ----------
        matrix : FloatArray
            (rows, n), or (N, dof, n) to be stacked.
        parameters : ParameterSet
        length : float
            See the attribute.
        keep_matrix : bool
            Whether to keep W beside its factor.
        """
        W = finite(matrix, "observation matrix")
        if W.ndim not in (2, 3) or W.shape[-1] != len(parameters):
            raise DataError(
                f"observation matrix must have {len(parameters)} columns, not shape {W.shape}"
            )
        W = W.reshape(-1, len(parameters))
        if len(W) == 0:
            raise DataError("observation matrix has no rows")
        kept = frozen(W) if keep_matrix else None
        return cls(parameters, frozen(triangular_factor(W)), len(W), length, kept)


def triangular_factor(matrix: FloatArray) -> FloatArray:
    """Square upper triangular R of a matrix (m, n), padded with zero rows where m < n."""
    R: FloatArray = np.asarray(np.linalg.qr(matrix, mode="r"), dtype=np.float64)
    missing = matrix.shape[1] - len(R)
    return np.pad(R, ((0, missing), (0, 0))) if missing > 0 else R
