"""Choice problems that tempt a search into false certificates, and the best choices known of them.

Small ones are solved by brute force. Of weakly coupled blocks, too many for that, the blocks' own
best selections are combined and judged on the whole problem: whatever they reach exists.
"""

from functools import partial
from itertools import combinations

import numpy as np
from choice_problems import structure
from scipy.linalg import block_diag

from loopid.base_parameters import ChoiceProblem
from loopid.base_parameters.choice import condition_numbers

SHAPES = ("path", "star", "tree")


def sizes(rng, largest=10):
    n = int(rng.integers(3, largest + 1))
    return n, int(rng.integers(1, n))


def generic(rng, largest=10):
    return rng.normal(size=sizes(rng, largest))


def integers(rng):
    n, d = sizes(rng, 9)
    return rng.integers(-1, 2, size=(n, d)).astype(float)


def blocks(rng):
    Z = block_diag(*(generic(rng, 5) for _ in range(int(rng.integers(2, 4)))))
    return Z[rng.permutation(len(Z))]


def near_parallel(rng):
    Z = generic(rng)
    for _ in range(int(rng.integers(1, 4))):
        i, j = rng.choice(len(Z), 2, replace=False)
        apart = 10.0 ** rng.uniform(-13, -4)
        Z[i] = rng.choice([-1.0, 1.0]) * Z[j] + apart * rng.normal(size=Z.shape[1])
    return Z


def near_tied(rng):
    """Copies of one block, or small integers, all but equal."""
    if rng.random() < 0.5:
        Z = generic(rng, 5)
        Z = block_diag(Z, Z)
    else:
        Z = integers(rng)
    return Z + (Z != 0) * 10.0 ** rng.uniform(-12, -6) * rng.normal(size=Z.shape)


def small_rows(rng):
    Z = generic(rng)
    few = rng.random(len(Z)) < 0.4
    Z[few] *= 10.0 ** rng.uniform(-11, -2, size=(int(few.sum()), 1))
    return Z


def graded(rng):
    Z = generic(rng)
    return Z * 10.0 ** rng.uniform(-8, 8, size=(len(Z), 1))


def joined(rng, parts, shape):
    """Null vectors of blocks, each leaking a little into the blocks beside it."""
    Z, strength = block_diag(*parts), 10.0 ** rng.uniform(-8, -2)
    rows = np.cumsum([0, *(len(part) for part in parts)])
    columns = np.cumsum([0, *(part.shape[1] for part in parts)])
    for b in range(1, len(parts)):
        a = {"path": b - 1, "star": 0, "tree": int(rng.integers(b))}[shape]
        for to, of in ((a, b), (b, a)):
            part = Z[rows[to] : rows[to + 1], columns[of] : columns[of + 1]]
            part += strength * rng.normal(size=part.shape)
    return Z


def coupled(rng, shape):
    return joined(rng, [generic(rng, 4) for _ in range(3)], shape)


KINDS = {
    "generic": generic,
    "integers": integers,
    "blocks": blocks,
    "near parallel": near_parallel,
    "near tied": near_tied,
    "small rows": small_rows,
    "graded": graded,
    **{f"coupled {shape}": partial(coupled, shape=shape) for shape in SHAPES},
}


def small_problem(kind, seed, criterion):
    """A problem of a kind that brute force can solve."""
    for attempt in range(100):
        rng = np.random.default_rng([list(KINDS).index(kind), seed, attempt])
        Z = KINDS[kind](rng)
        if np.linalg.matrix_rank(Z) < Z.shape[1]:
            continue
        n, d = Z.shape
        mixing = rng.normal(size=(n - d, n - d)) if rng.random() < 0.5 else None
        found = structure(Z, mixing)
        return ChoiceProblem(found, criterion)
    raise AssertionError(f"no problem of kind {kind} and seed {seed}")


def least(problem):
    """The least condition number by brute force."""
    count = problem.vectors.shape[1]
    chosen = np.array(list(combinations(range(problem.size), count)))
    return float(condition_numbers(problem.vectors[chosen]).min())


def weakly_coupled(rng, shape, count):
    """A large problem of weakly coupled blocks, and the best joint choice that they suggest.

    The blocks' own best selections are combined and judged on the whole problem: what they reach
    exists, and no certificate may claim more.
    """
    parts = [generic(rng, 8) for _ in range(count)]
    problem = ChoiceProblem(structure(joined(rng, parts, shape)))
    V2, first, options = problem.structure.null_basis, 0, []
    for part in parts:
        chosen = np.array(list(combinations(range(len(part)), part.shape[1])))
        values = np.linalg.svd(np.linalg.qr(part)[0][chosen], compute_uv=False)
        # The highest smallest singular value matters most: the largest one is near 1 somewhere.
        options.append(first + chosen[np.argsort(-values[:, -1])[:3]])
        first += len(part)
    picks = [[own[0] for own in options]]
    for b, own in enumerate(options):
        picks += [[*picks[0][:b], other, *picks[0][b + 1 :]] for other in own[1:]]
    return problem, min(float(np.linalg.cond(V2[np.concatenate(pick)])) for pick in picks)
