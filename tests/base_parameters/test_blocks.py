"""Independent blocks are the connected components of the null-space projector."""

import numpy as np
from choice_problems import structure
from hypothesis import assume, given
from hypothesis import strategies as st

from loopid.base_parameters import independent_blocks
from loopid.base_parameters.structure import CONNECTED

SIZES = st.lists(st.tuples(st.integers(2, 5), st.integers(1, 4)), min_size=1, max_size=5)


@st.composite
def known_blocks(draw):
    """Null vectors of dense blocks and of columns outside them, shuffled; and the true blocks."""
    sizes = [(n, min(d, n - 1)) for n, d in draw(SIZES)]
    lonely = draw(st.integers(0, 3))
    size, width = sum(n for n, _ in sizes) + lonely, sum(d for _, d in sizes)
    rng = np.random.default_rng(draw(st.integers(0, 10**6)))
    order = rng.permutation(size)
    Z, blocks, row, column = np.zeros((size, width)), [], 0, 0
    for n, d in sizes:
        Z[order[row : row + n], column : column + d] = rng.uniform(0.5, 2.0, size=(n, d))
        blocks.append(sorted(order[row : row + n].tolist()))
        row, column = row + n, column + d
    blocks += [[int(j)] for j in order[row:]]
    return Z, sorted(blocks)


@given(known_blocks())
def test_blocks_are_found_in_any_order_of_the_columns(case):
    Z, expected = case
    # A basis that mixes the blocks: only the projector shows them.
    turn = np.linalg.qr(np.random.default_rng(0).normal(size=(Z.shape[1],) * 2))[0]
    found = independent_blocks(structure(Z).null_basis @ turn)
    assert [block.tolist() for block in found] == expected


@given(known_blocks())
def test_a_null_vector_across_two_blocks_joins_them(case):
    Z, blocks = case
    assume(len(blocks) > 1)
    bridge = np.zeros((len(Z), 1))
    bridge[[blocks[0][0], blocks[1][0]]] = [[1.0], [2.0]]
    found = independent_blocks(structure(np.hstack([Z, bridge])).null_basis)
    joined = sorted(blocks[0] + blocks[1])
    assert sorted(block.tolist() for block in found) == sorted([joined, *blocks[2:]])


def test_no_null_vector_means_no_connection():
    assert [block.tolist() for block in independent_blocks(np.empty((3, 0)))] == [[0], [1], [2]]


def test_weak_connections_count_and_round_off_does_not():
    for weight, count in ((30 * CONNECTED, 1), (CONNECTED / 30, 2)):
        Z = np.array([[1.0, 0.0], [1.0, 0.0], [0.0, 1.0], [weight, 1.0]])
        assert len(independent_blocks(structure(Z).null_basis)) == count
