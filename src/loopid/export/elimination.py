"""Least squares A X = B with a sparse A as straight-line code: no branch, no pivoting at run time.

Householder reflections are backward stable in any order [Higham2002, ch. 19]. So CasADi's order
follows the zeros of A alone, which do not depend on the pose.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import casadi as ca


class Elimination(NamedTuple):
    """A = Q R of a matrix (rows, n) of CasADi expressions, with at least n rows."""

    mirrors: Any  # (rows, n), a vector v of each reflection I - b v vᵀ
    R: Any  # (rows, n)
    b: Any  # (n, 1)
    rows: list[int]  # places of the rows of A and of its columns
    columns: list[int]

    @classmethod
    def of(cls, A: Any) -> Elimination:
        """Factor a matrix."""
        return cls(*ca.qr_sparse(A))

    @property
    def pivots(self) -> list[Any]:
        """The diagonal of R."""
        return [self.R[k, k] for k in range(len(self.columns))]

    @property
    def factors(self) -> Any:
        """All numbers as one vector."""
        return ca.vertcat(*(ca.SX(part).nz[:] for part in self[:3]))

    def with_factors(self, numbers: Any) -> Elimination:
        """The same of other numbers."""
        new, first = dict[str, Any](), 0
        for name, part in zip(self._fields, self[:3], strict=False):
            own = numbers[first : first + part.nnz()]
            new[name] = ca.SX(part.sparsity(), own)
            first += part.nnz()
        return self._replace(**new)

    def solve(self, B: Any) -> Any:
        """The least-squares solution X (n, c) for right-hand sides B (rows, c)."""
        n = len(self.columns)
        Q_B, X = ca.SX(self.mirrors.shape[0], B.shape[1]), ca.SX(n, B.shape[1])
        Q_B[self.rows[: B.shape[0]], :] = B
        for k in range(n):
            mirror = self.mirrors[:, k]
            Q_B -= mirror @ (self.b[k] * (mirror.T @ Q_B))
        for k in reversed(range(n)):
            X[k, :] = (Q_B[k, :] - self.R[k, k + 1 :] @ X[k + 1 :, :]) / self.R[k, k]
        return X[[self.columns.index(k) for k in range(n)], :]
