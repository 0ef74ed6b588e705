"""Branch decompositions say of every set what its Gram matrix says."""

import numpy as np
import pytest
from chains import chain_vectors, chains
from hypothesis import given
from hypothesis import strategies as st

from loopid.base_parameters.search.branches import branch_decomposition


@given(vectors=chains())
def test_every_set_is_described_by_its_gram_matrix(vectors):
    """Eigenvalues 1 are inside, those between 0 and 1 shared."""
    for branch in branch_decomposition(vectors).walk():
        rows = vectors[list(branch.rows)]
        gram = rows.T @ rows
        values = np.linalg.eigvalsh(gram)
        shared = values[(values > 1e-9) & (values < 1 - 1e-9)]
        np.testing.assert_allclose(np.sort(branch.weights), shared, atol=1e-9)
        assert branch.inside == (values >= 1 - 1e-9).sum()
        own = branch.boundary.T @ gram @ branch.boundary
        np.testing.assert_allclose(own, np.diag(branch.weights), atol=1e-9)


@given(vectors=chains())
def test_a_tree_joins_all_vectors_two_sets_at_a_time(vectors):
    root = branch_decomposition(vectors)
    assert sorted(root.rows) == list(range(len(vectors)))
    assert (root.inside, root.width) == (vectors.shape[1], 0)
    for branch in root.walk():
        assert branch.rows == sum((child.rows for child in branch.children), start=()) or (
            not branch.children and len(branch.rows) == 1
        )


@given(vectors=chains())
def test_maps_give_the_boundaries_of_the_children(vectors):
    """A child's coordinates of any null vector follow from those of its parent."""
    for branch in branch_decomposition(vectors).walk():
        for child, own in zip(branch.children, branch.maps, strict=True):
            np.testing.assert_allclose(own @ own.T, np.eye(child.width), atol=1e-9)
            shared = own[:, : branch.width] @ branch.boundary.T
            # What is left of the child's boundary lies in directions that close with the parent.
            rest = child.boundary.T - shared
            closing = own[:, branch.width :]
            np.testing.assert_allclose(rest @ rest.T, closing @ closing.T, atol=1e-9)


@pytest.mark.parametrize("bodies", [5, 40])
def test_the_width_of_a_chain_does_not_grow_with_its_length(bodies):
    vectors = chain_vectors(bodies, 6, 2, seed=1)
    assert max(branch.width for branch in branch_decomposition(vectors).walk()) <= 8


@given(scale=st.sampled_from([1e-3, 1e-5, 3e-8]))
def test_weak_couplings_are_shared_directions(scale):
    """A vector that hardly touches another set still does."""
    Z = np.array([[1.0, 0.0], [1.0, scale], [0.0, 1.0], [0.0, 1.0]])
    vectors = np.linalg.qr(Z)[0]
    sets = {branch.rows: branch for branch in branch_decomposition(vectors).walk()}
    pair = next(rows for rows in sets if sorted(rows) in ([0, 1], [2, 3]))
    assert sets[pair].width >= 1
