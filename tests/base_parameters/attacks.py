"""Regressors that tempt rank, null space and search into false certificates, and the truth.

They are integers times powers of two, of a rank that is known: truth is exact arithmetic, to 200
bits where roots are taken.
"""

from itertools import combinations

import flint
import numpy as np

BITS = 200


def integers(rng, r, n):
    return rng.integers(-3, 4, size=(r, n))


def near_parallel(rng, r, n):
    """Some columns are others' multiples, but for a few units in ten bits to thirty."""
    B = integers(rng, r, n)
    for _ in range(2):
        i, j = rng.choice(n, 2, replace=False)
        B[:, i] = B[:, j] * 2 ** int(rng.integers(10, 30)) + rng.integers(-2, 3, size=r)
    return B


def sparse(rng, r, n):
    return integers(rng, r, n) * (rng.random((r, n)) < 0.5)


KINDS = (integers, near_parallel, sparse)
FEW_BITS = {near_parallel: 8}  # of the scales of columns: all products have to fit


def attack(seed):
    """A regressor W (m, n) of exact numbers, and its rank, columns up to 2^40 apart."""
    for attempt in range(100):
        rng = np.random.default_rng([seed, attempt])
        kind, n = KINDS[seed % len(KINDS)], int(rng.integers(3, 8))
        r = int(rng.integers(1, n))
        A, B = rng.integers(-2, 3, size=(r + 3, r)), kind(rng, r, n)
        spread = rng.choice([0, 8, 20, 34, 40])
        scales = 2.0 ** rng.integers(0, min(spread, FEW_BITS.get(kind, 40)) + 1, size=n)
        W = (A @ B) * scales
        whole = exact(W)
        if whole.rank() == r and W.any(axis=0).all() and np.abs(A @ B).max() < 2**40:
            return W, r
    raise AssertionError(f"no attack of seed {seed}")


def exact(W):
    """W (m, n) in rational numbers, none of which is rounded."""
    return flint.fmpq_mat(*W.shape, [flint.fmpq(*x.as_integer_ratio()) for x in W.ravel().tolist()])


def conditions(W, rank):
    """Each choice of dependent columns to cond(V22) and cond(W_B), infinite where not regular."""
    columns = np.arange(W.shape[1])
    whole, gram = exact(W), exact(W).transpose() * exact(W)
    projector = null_projector(whole, rank)
    found = {}
    for dependent in combinations(columns.tolist(), len(columns) - rank):
        base = [k for k in columns.tolist() if k not in dependent]
        found[dependent] = condition(projector, dependent), condition(gram, base)
    return found


def null_projector(whole, rank):
    """N = V2 V2ᵀ (n, n), from the reduced row echelon form."""
    form, n = whole.rref()[0].tolist(), whole.ncols()
    leading = [next(k for k in range(n) if form[row][k] != 0) for row in range(rank)]
    rest = [k for k in range(n) if k not in leading]
    Z = [[flint.fmpq(0)] * len(rest) for _ in range(n)]
    for column, k in enumerate(rest):
        Z[k][column] = flint.fmpq(1)
        for row, lead in enumerate(leading):
            Z[lead][column] = -form[row][k]
    Z = flint.fmpq_mat(Z)
    return Z * (Z.transpose() * Z).inv() * Z.transpose()


def condition(gram, chosen):
    """Square root of largest over smallest eigenvalue of a part of a matrix of rational numbers."""
    part = flint.fmpq_mat([[gram[i, j] for j in chosen] for i in chosen])
    if part.rank() < len(chosen):
        return np.inf
    with flint.ctx.workprec(BITS):
        entries = [[flint.acb(x) for x in row] for row in part.tolist()]
        values = [x.real for x in flint.acb_mat(entries).eig(algorithm="approx")]
        values.sort(key=lambda x: float(x.mid()))
        return float((values[-1] / values[0]).sqrt().mid())
