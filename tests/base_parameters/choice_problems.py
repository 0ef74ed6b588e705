"""Choice problems for the search tests, and their solution by brute force."""

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from hypothesis import assume, strategies as st
from scipy.linalg import block_diag

from loopid.base_parameters import ChoiceProblem, Structure
from loopid.parameters import KINDS, ParameterSet

# Choices that are not equal to round-off should not tie by chance either.
EQUAL, DISTINCT = 1e-12, 1e-6


def parameters(count):
    """Any standard parameters, ten a link."""
    links = [f"link{i}" for i in range(-(-count // len(KINDS)))]
    return ParameterSet.of_links(links, KINDS).select(range(count))


def structure(null_vectors, mixing=None):
    """A structure with given null vectors (n, d), its rows mixed by a matrix (r, r)."""
    n, d = null_vectors.shape
    U = np.linalg.svd(null_vectors)[0]
    rows = U[:, d:].T if mixing is None else mixing @ U[:, d:].T
    return Structure(parameters(n), np.arange(n), np.ones(n), n - d, 1e15, U[:, :d], rows)


def random_structure(n, d, seed=0):
    rng = np.random.default_rng([n, d, seed])
    return structure(rng.normal(size=(n, d)), rng.normal(size=(n - d, n - d)))


@dataclass(frozen=True)
class Brute:
    """Condition numbers of all choices, by definition."""

    choices: np.ndarray
    conditions: np.ndarray

    @property
    def least(self):
        return self.conditions.min()

    @property
    def tied(self):
        return self.choices[self.conditions <= self.least * (1 + 1e-9)]

    @property
    def clear(self):
        """Whether ties are equal to round-off and everything else is clearly worse."""
        near = self.conditions <= self.least * (1 + DISTINCT)
        return not (near & (self.conditions > self.least * (1 + EQUAL))).any()


def brute_force(problem):
    n, d = problem.size, problem.dependent_count
    choices = np.array(list(combinations(range(n), d)))
    if problem.criterion == "nullspace":
        matrices = problem.structure.null_basis[choices]
    else:
        rest = np.array([np.setdiff1d(np.arange(n), choice) for choice in choices])
        matrices = problem.structure.row_factor.T[rest]
    return Brute(choices, np.linalg.cond(matrices))


@st.composite
def integer_bases(draw, largest=8, entry=1):
    """Small integers, as the null vectors of robots have: many ties, repeated and zero rows."""
    n = draw(st.integers(2, largest))
    d = draw(st.integers(1, n - 1))
    entries = st.lists(st.integers(-entry, entry), min_size=n * d, max_size=n * d)
    return np.array(draw(entries), dtype=float).reshape(n, d)


@st.composite
def random_bases(draw, largest=9, decades=0.0):
    """No structure at all; the rows may spread over decades."""
    n = draw(st.integers(2, largest))
    d = draw(st.integers(1, n - 1))
    rng = np.random.default_rng(draw(st.integers(0, 10**6)))
    return rng.normal(size=(n, d)) * 10 ** rng.uniform(-decades, 0, size=(n, 1))


@st.composite
def parallel_bases(draw, largest=8):
    """Rows repeated, with either sign and also with other lengths."""
    Z = draw(random_bases(largest)).copy()
    rows = st.integers(0, len(Z) - 1)
    factors = st.sampled_from([1.0, -1.0, 2.0])
    for i, j, factor in draw(st.lists(st.tuples(rows, rows, factors), min_size=1, max_size=4)):
        Z[i] = factor * Z[j]
    return Z


@st.composite
def block_bases(draw):
    """Two or three independent blocks in shuffled order."""
    each = st.one_of(random_bases(4), integer_bases(4, entry=2))
    Z = block_diag(*draw(st.lists(each, min_size=2, max_size=3)))
    return Z[draw(st.permutations(range(len(Z))))]


BASES = {
    "random": random_bases(),
    "small integers": integer_bases(),
    "parallel rows": parallel_bases(),
    "blocks": block_bases(),
    "scales": random_bases(8, decades=5.0),
}


@st.composite
def structures(draw, bases, decades=0.0):
    """Structures with such null vectors, and rows that are orthonormal or mixed at random."""
    Z = draw(bases)
    n, d = Z.shape
    assume(np.linalg.matrix_rank(Z, tol=1e-7) == d)
    mixing = None
    if draw(st.booleans()):
        rng = np.random.default_rng(draw(st.integers(0, 10**6)))
        scales = 10 ** np.linspace(0, -decades, n - d)
        turns = [np.linalg.qr(rng.normal(size=(n - d, n - d)))[0] for _ in range(2)]
        plain = rng.normal(size=(n - d, n - d))
        mixing = plain if decades == 0 else turns[0] * scales @ turns[1]
    found = structure(Z, mixing)
    assume((np.linalg.norm(found.row_factor, axis=0) > 1e-8).all())
    return found


def problems(bases, criterion, decades=0.0):
    return structures(bases, decades).map(lambda found: ChoiceProblem(found, criterion))
