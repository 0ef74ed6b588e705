"""An independent check of certificates, in ball arithmetic.

From the boxes and leaves of an exact search (``proof_recorder.py``) it verifies that the leaves of
every tree hold every selection, that no selection of a leaf lies in the box, and that the boxes
leave no room for a better choice. It shares no code with the search.
"""

from itertools import pairwise

import flint
import numpy as np

flint.ctx.prec = 200


def check(blocks, result, proof):
    """Assert that the record proves a certified result, for blocks of vectors (m, k)."""
    assert result.certified
    for entry in proof:
        assert_partition(entry)
        assert_excluded(entry)
    assert_no_room(blocks, result, proof)


def assert_partition(entry):
    """Every selection of k rows agrees with some leaf."""
    size, count = entry.vectors.shape
    leaves = [(frozenset(taken), frozenset(left)) for taken, left in entry.leaves]
    open_ = [(leaves, frozenset(), frozenset())]
    while open_:
        leaves, taken, left = open_.pop()
        if len(taken) > count or len(left) > size - count:
            continue  # no selection is here
        assert leaves, "selections without a leaf"
        if any(leaf[0] <= taken and leaf[1] <= left for leaf in leaves):
            continue
        decided = frozenset.intersection(*(t | r for t, r in leaves)) - taken - left
        assert decided, "no row divides the leaves"
        row = min(decided)
        open_.append(([leaf for leaf in leaves if row in leaf[0]], taken | {row}, left))
        open_.append(([leaf for leaf in leaves if row in leaf[1]], taken, left | {row}))


def assert_excluded(entry):
    """No selection of any leaf has all its eigenvalues in the box."""
    X, (size, count) = entry.vectors, entry.vectors.shape
    exact = flint.arb_mat(X.tolist())
    for taken, left in entry.leaves:
        if len(taken) > count or len(left) > size - count:
            continue
        rest = np.setdiff1d(np.arange(size), left)
        assert (
            too_small_together(X, exact, list(taken), entry.above)
            or too_little_left(X, exact, rest, entry.above)
            or too_large_together(X, exact, list(taken), entry.below)
        ), f"leaf {taken}, {left} is open"


def quotient(exact, rows, weights):
    """Rayleigh quotient of the Gram matrix of some rows, numerator and denominator as balls."""
    padded = np.zeros(exact.nrows())
    padded[rows] = weights
    column = flint.arb_mat([[x] for x in padded.tolist()])
    image = exact.transpose() * column
    return (image.transpose() * image)[0, 0], (column.transpose() * column)[0, 0]


def too_small_together(X, exact, taken, above):
    """By Cauchy interlacing: λ_min of the rows taken bounds the smallest eigenvalue."""
    if not taken:
        return False
    vectors = np.linalg.eigh(X[taken] @ X[taken].T)[1]
    numerator, denominator = quotient(exact, taken, vectors[:, 0])
    return bool(numerator <= flint.arb(above) * denominator)


def too_large_together(X, exact, taken, below):
    if not taken or np.isinf(below):
        return False
    vectors = np.linalg.eigh(X[taken] @ X[taken].T)[1]
    numerator, denominator = quotient(exact, taken, vectors[:, -1])
    return bool(numerator >= flint.arb(below) * denominator)


def too_little_left(X, exact, rest, above):
    """The rows that are not left out bound the smallest eigenvalue of all selections of them."""
    direction = np.linalg.svd(X[rest])[2][-1]
    column = flint.arb_mat([[x] for x in direction.tolist()])
    image = exact * column
    total = sum((image[int(row), 0] ** 2 for row in rest), start=flint.arb(0))
    return bool(total <= flint.arb(above) * (column.transpose() * column)[0, 0])


def assert_no_room(blocks, result, proof):
    """The boxes leave no joint selection with a better ratio than was certified.

    With s and l the extreme eigenvalues over all blocks: for every l there is a box that holds all
    s above l over the ratio.
    """
    ratio = (result.condition_number * (1 - result.tolerance)) ** 2
    boxes = [(entry.above, entry.below) for entry in proof]
    values = [np.linalg.svd(X, compute_uv=False) ** 2 for X in blocks]
    # What holds for every selection, from norms and interlacing.
    boxes.append((min(own[-1] for own in values) * (1 + 1e-10), np.inf))
    floor = 0.0
    for X, own in zip(blocks, values, strict=True):
        size, count = X.shape
        interlaced = own[size - count] if size - count < count else 0.0
        norms = np.sort((X**2).sum(axis=1))
        floor = max(floor, norms[norms > 0][count - 1], interlaced)
    top = max(own[0] for own in values) * (1 + 1e-10)
    ends = sorted({floor * (1 - 1e-9), top, *(b for _, b in boxes if floor < b < top)})
    for low, high in pairwise(ends):
        above = min(a for a, b in boxes if b >= high)
        assert above * ratio <= low * (1 + 1e-15), (above, low, high, ratio)
