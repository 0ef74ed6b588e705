"""Null vectors along a chain or a tree: each touches the columns of two neighbouring bodies."""

from itertools import combinations

import numpy as np
from hypothesis import assume
from hypothesis import strategies as st

from loopid.base_parameters import independent_blocks
from loopid.base_parameters.search.block import make_block


def chain_vectors(bodies, columns, shared, seed, parents=None):
    """Orthonormal columns: the largest block of null vectors of a tree of bodies."""
    rng = np.random.default_rng([bodies, columns, shared, seed])
    parents = range(bodies - 1) if parents is None else parents
    Z = np.zeros((bodies * columns, (bodies - 1) * shared))
    for joint, parent in enumerate(parents):
        for body in (parent, joint + 1):
            rows = slice(body * columns, (body + 1) * columns)
            own = slice(joint * shared, (joint + 1) * shared)
            # Digits that repeat make parallel vectors and ties, as robots do.
            Z[rows, own] = rng.choice([0.0, 1.0, 1.0, -0.5, 0.3], size=(columns, shared))
    U, values, _ = np.linalg.svd(Z, full_matrices=False)
    U = U[:, values > 1e-9]
    largest = max(independent_blocks(U), key=len)
    own, values, _ = np.linalg.svd(U[largest], full_matrices=False)
    return own[:, values > 0.5]


@st.composite
def chains(draw, largest=12):
    """Vectors of a small chain or tree, all of whose selections can be enumerated."""
    bodies = draw(st.integers(2, 4))
    columns = draw(st.integers(2, max(2, largest // bodies)))
    shared = draw(st.integers(1, min(2, columns)))
    parents = [draw(st.integers(0, joint)) for joint in range(bodies - 1)]
    vectors = chain_vectors(bodies, columns, shared, draw(st.integers(0, 10**6)), parents)
    assume(len(vectors) > 1)
    return vectors


def chain_block(vectors):
    return make_block(vectors, np.arange(len(vectors)))


def levels_of_all(block):
    """Smallest and largest eigenvalues (c,) of all selections."""
    selections = list(combinations(range(block.size), block.count))
    values = np.linalg.svd(block.vectors[selections], compute_uv=False) ** 2
    return values[:, -1], values[:, 0]
