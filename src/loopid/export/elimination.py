"""Least squares A X = B with a sparse A as straight-line code: no branch, no pivoting at run time.

Householder reflections, column by column, are backward stable in any order [Higham2002, ch. 19]. So
the order follows the zeros of A alone, which do not depend on the pose. The cheapest column is
first. That is leg by leg, as the coordinates of a leg take part in the equations of few loops.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import casadi as ca


@dataclass(frozen=True)
class Reflection:
    """A column's part of A = Q R."""

    column: int
    rows: tuple[int, ...]  # that it mixes; the first becomes a row of R
    mirror: list[Any]  # the vector m of I - m mᵀ / half; empty for a row alone
    half: list[Any]  # one number, if any
    pivot: list[Any]  # one number
    upper: dict[int, Any]  # further entries of the row of R

    @property
    def factors(self) -> list[Any]:
        """All numbers of the reflection."""
        return [*self.mirror, *self.half, *self.pivot, *self.upper.values()]

    def with_factors(self, numbers: Iterable[Any]) -> Reflection:
        """The same of other numbers, of which it takes its own."""
        own = iter(numbers)
        mirror, half, pivot = (
            [next(own) for _ in part] for part in (self.mirror, self.half, self.pivot)
        )
        upper = {column: next(own) for column in self.upper}
        return Reflection(self.column, self.rows, mirror, half, pivot, upper)


def eliminate(A: Any) -> list[Reflection]:
    """Factor a matrix (rows, n) of CasADi expressions, with at least n rows."""
    table = [{j: A[i, j] for j in range(A.shape[1]) if A.has_nz(i, j)} for i in range(A.shape[0])]
    rows, columns, done = set(range(A.shape[0])), set(range(A.shape[1])), list[Reflection]()
    while columns:
        column = min(columns, key=lambda j: (_cost(table, rows, j), j))
        found = _reflection(table, sorted(i for i in rows if column in table[i]), column)
        columns.remove(column)
        rows.remove(found.rows[0])
        done.append(found)
    return done


def solve(reflections: list[Reflection], B: Any) -> Any:
    """The least-squares solution X (n, c) for right-hand sides B (rows, c)."""
    n, count = len(reflections), B.shape[1]
    right = [[B[i, j] for j in range(count)] for i in range(B.shape[0])]
    X = ca.SX(n, count)
    for j in range(count):
        for each in reflections:
            if each.mirror:
                along = sum(m * right[i][j] for m, i in zip(each.mirror, each.rows, strict=True))
                along /= each.half[0]
                for m, i in zip(each.mirror, each.rows, strict=True):
                    right[i][j] -= m * along
        for each in reversed(reflections):
            rest = right[each.rows[0]][j] - sum(r * X[k, j] for k, r in each.upper.items())
            X[each.column, j] = rest / each.pivot[0]
    return X


def _cost(table: list[dict[int, Any]], rows: set[int], column: int) -> int:
    """Entries that a reflection of the column would touch."""
    mixed = [table[i].keys() for i in rows if column in table[i]]
    return len(mixed) * len(set().union(*mixed)) if len(mixed) > 1 else 0


def _reflection(table: list[dict[int, Any]], rows: list[int], column: int) -> Reflection:
    """Eliminate the column from a table of rows in place."""
    first, entries = table[rows[0]], [table[i].pop(column) for i in rows]
    mirror, half, pivot = list[Any](), list[Any](), entries
    if len(rows) > 1:
        pivot = [-ca.copysign(ca.sqrt(sum(x * x for x in entries)), entries[0])]
        mirror = [entries[0] - pivot[0], *entries[1:]]
        half = [-pivot[0] * mirror[0]]
        for j in sorted(set().union(*(table[i].keys() for i in rows))):
            mixed = [table[i].get(j, 0) for i in rows]
            along = sum(m * x for m, x in zip(mirror, mixed, strict=True)) / half[0]
            for m, x, i in zip(mirror, mixed, rows, strict=True):
                table[i][j] = x - m * along
    return Reflection(column, tuple(rows), mirror, half, pivot, dict(first))
