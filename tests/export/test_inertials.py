"""Links of one body: what they get adds up to the body, and each of them exists."""

import numpy as np
from feasible_changes import pseudo, solid, standard
from hypothesis import given, strategies as st

from loopid.export.robot_file import shared, shared_at_rest
from loopid.inertia import body_defect

SEEDS = st.integers(0, 10_000)
COUNTS = st.integers(1, 4)


def exists(P):
    """The law itself: positive definite."""
    return np.linalg.eigvalsh(P)[0] > 0


def bodies(seed, count, scale):
    rng = np.random.default_rng(seed)
    links = [solid(rng, mass) for mass in rng.uniform(0.1, 2.0, count)]
    return rng, links, scale * solid(rng, rng.uniform(0.1, 5.0))


@given(seed=SEEDS, count=COUNTS, scale=st.floats(1e-3, 1e3))
def test_links_add_up_and_exist(seed, count, scale):
    rng, links, whole = bodies(seed, count, scale)
    found = shared(links, int(rng.integers(count)), whole)
    np.testing.assert_allclose(np.sum(found, axis=0), whole, atol=1e-13 * np.abs(whole).max())
    assert all(exists(P) for P in found)
    assert not any(map(body_defect, found))


@given(seed=SEEDS, count=COUNTS)
def test_a_small_change_is_the_carriers_alone(seed, count):
    rng, links, other = bodies(seed, count, 1e-3)
    carrier = int(rng.integers(count))
    found = shared(links, carrier, np.sum(links, axis=0) + other)
    assert [k for k, (P, own) in enumerate(zip(found, links, strict=True)) if P is not own] == [
        carrier
    ]


@given(seed=SEEDS, count=COUNTS)
def test_no_change_is_none(seed, count):
    _, links, _ = bodies(seed, count, 1.0)
    for share in (shared, shared_at_rest):
        found = share(links, 0, np.sum(links, axis=0))
        assert all(P is own for P, own in zip(found, links, strict=True))


@given(seed=SEEDS, count=COUNTS, ratio=st.floats(0.01, 10.0))
def test_at_rest_links_keep_their_central_inertias(seed, count, ratio):
    rng, links, other = bodies(seed, count, 1.0)
    whole = np.sum(links, axis=0)
    goal = np.zeros((4, 4))
    goal[3] = goal[:, 3] = ratio * whole[3] + [*0.1 * other[3, :3], 0]
    found = shared_at_rest(links, int(rng.integers(count)), goal)
    np.testing.assert_allclose(np.sum(found, axis=0)[3], goal[3], atol=1e-12 * abs(goal[3]).max())
    for P, own in zip(found, links, strict=True):
        assert P[3, 3] > 0
        for one, two in ((P, own), (own, P)):
            assert np.abs(central(one) - central(two)).max() < 1e-12


def central(P):
    return P[:3, :3] - np.outer(P[:3, 3], P[3, :3]) / P[3, 3]


def test_points_share_by_their_masses():
    # Two points are no body that could be stretched to another shape.
    ends = [np.outer(p, p) for p in ([0.1, 0, 0, 1.0], [-0.1, 0, 0, 0.7])]
    whole = solid(np.random.default_rng(1), 0.5)
    found = shared(ends, 0, whole)
    np.testing.assert_allclose(np.sum(found, axis=0), whole, atol=1e-15)
    assert not any(map(body_defect, found))


@given(seed=SEEDS)
def test_bodies_exist_exactly_where_their_matrix_is_positive_definite(seed):
    rng = np.random.default_rng(seed)
    P = solid(rng)
    square = rng.standard_normal((4, 4)) * 0.05
    P -= rng.uniform(0, 2) * square @ square.T
    parameters = standard(P)
    np.testing.assert_allclose(pseudo(parameters), P, atol=1e-15)
    if abs(np.linalg.eigvalsh(P)).min() > 1e-6:
        assert (body_defect(P) == "") == exists(P)


def test_rods_and_points_pass_where_they_are_the_files_own():
    for moments, passes in (((0, 2, 2), True), ((0, 0, 0), True), ((1, 2, 3.1), False)):
        parameters = np.array([1.0, 0, 0, 0, moments[0], 0, moments[1], 0, 0, moments[2]])
        listed = ", ".join(f"{moment:g}" for moment in moments)
        assert f"principal moments of inertia {listed} kg m²" in body_defect(pseudo(parameters))
        assert (body_defect(pseudo(parameters), flat_allowed=True) == "") == passes
