"""The paper's robot: what can be known, Table II term by term, and the forces."""

from math import comb, cos, radians, sin

import numpy as np
import pytest

from loopid import random_configurations
from loopid.base_parameters import ChoiceProblem, SubgroupSearch, find_base
from loopid.observation import Observation
from loopid.regressors import gravity_regressor

# What the actuators cannot feel at all: cylinders that turn about their origin have no weight,
# and the first moments of limb 4 along its horizontal axis do no work.
WITHOUT_EFFECT = {
    "leg1_cylinder.m",
    "leg2_cylinder.m",
    "leg3_cylinder.m",
    "leg4_cylinder.m",
    "leg4_cylinder.my",
    "leg4_stem.mz",
}


@pytest.fixture(scope="module")
def table_ii(table):
    """The paper's Table II, its coefficients in closed form (Table III) from the geometry."""
    geometry = table["3ups_rpu"]["configurations"][1]
    right, left = radians(geometry["beta_MD"]), radians(geometry["beta_MI"])
    Rm1, Rm2, Rm3 = (geometry[f"Rm{leg}"] for leg in (1, 2, 3))
    stems = [f"leg{leg}_stem.m" for leg in (1, 2, 3, 4)]

    def limb(leg, axis):
        return {f"leg{leg}_cylinder.m{axis}": 1.0, f"leg{leg}_stem.m{axis}": 1.0}

    assert cos(left) == pytest.approx(0.0, abs=1e-15)  # why Table III shows no Rm3 in row 9
    row_9 = {"leg2_stem.m": Rm2 * cos(right), "leg1_stem.m": -Rm1, "platform.mx": 1.0}
    row_10 = {"leg2_stem.m": Rm2 * sin(right), "leg3_stem.m": -Rm3 * sin(left), "platform.my": 1.0}
    return [
        dict.fromkeys([*stems, "platform.m"], 1.0),
        limb(1, "x"),
        limb(2, "x"),
        limb(1, "z"),
        limb(2, "z"),
        limb(3, "z"),
        limb(3, "x"),
        {"leg4_stem.my": 1.0, "leg4_cylinder.mz": -1.0},
        row_9,
        row_10,
        {"platform.mz": 1.0},
        {"leg4_stem.mx": 1.0, "leg4_cylinder.mx": -1.0},
        limb(1, "y"),
        limb(2, "y"),
        limb(3, "y"),
    ]


@pytest.fixture(scope="module")
def cad(table):
    """Gravity parameters by label, from the masses and centres of mass in the table."""
    values = {}
    for link, (mass, centre, _) in table["3ups_rpu"]["inertials"].items():
        values[f"{link}.m"] = mass
        values |= {f"{link}.m{axis}": mass * x for axis, x in zip("xyz", centre, strict=True)}
    return values


def test_what_can_be_known(knee_base, knee_observation):
    structure = knee_base.structure
    labels = set(knee_observation.parameters.labels)
    assert len(labels) == 36
    assert labels - set(structure.parameters.labels) == WITHOUT_EFFECT
    assert structure.rank == len(knee_base) == 15
    assert structure.rank_gap > 1e10
    assert structure.null_basis.shape == (30, 15)
    assert knee_base.search.candidates == 155_117_520  # the paper's number
    assert knee_base.search.certified


def test_table_ii_term_by_term(knee_base, table_ii):
    ours = {frozenset(terms): terms for terms in knee_base.terms}
    assert ours.keys() == {frozenset(row) for row in table_ii}
    for row in table_ii:
        assert ours[frozenset(row)] == pytest.approx(row, rel=0, abs=1e-9)


def test_printed_coefficients(knee_base):
    """0.1928, 0.2298 and 0.3, the numbers in the paper's rows 9 and 10."""
    assert "platform.mx - 0.3 leg1_stem.m + 0.1928 leg2_stem.m" in knee_base.expressions
    assert "platform.my + 0.2298 leg2_stem.m - 0.3 leg3_stem.m" in knee_base.expressions


def test_true_base_parameters(knee_base, knee, cad, table_ii):
    """Table II with the CAD values: 14.1434 kg in all; row 8 is the limb that carries."""
    phi = np.array([cad[label] for label in knee_base.parameters.labels])
    np.testing.assert_allclose(knee.standard_parameters("gravity"), phi, atol=1e-12)
    ours = dict(zip(map(frozenset, knee_base.terms), knee_base.values(phi), strict=True))
    for row in table_ii:
        expected = sum(coefficient * cad[label] for label, coefficient in row.items())
        assert ours[frozenset(row)] == pytest.approx(expected, rel=1e-9, abs=1e-9)
    found = [ours[frozenset(row)] for row in table_ii]
    known = (14.1434, -0.2905, 0.2905, 1.4418, 1.4418, 1.4418, 0.2905, -0.9496, -0.0538)
    known += (-0.0783, 0.3643, -0.0086, 0.0087, -0.0087, -0.0087)
    np.testing.assert_allclose(found, known, atol=5.1e-5)


@pytest.mark.parametrize("criterion", ["nullspace", "regressor"])
@pytest.mark.parametrize("search", ["exact", "qr"])
def test_base_forces_are_the_full_forces_on_fresh_poses(knee, knee_observation, search, criterion):
    found = find_base(knee_observation, search, criterion=criterion)
    K = gravity_regressor(knee, random_configurations(knee, 40, seed=77))
    phi = knee.standard_parameters("gravity")
    full, base = K @ phi, found.regressor(K) @ found.values(phi)
    assert np.linalg.norm(base - full) < 1e-9 * np.linalg.norm(full)
    assert found.reconstruction_error(K) < 1e-9


def test_the_papers_subgroup_search(knee_base, papers_choice):
    """n* = 19, so 3876 combinations a group, in 12 groups."""
    problem = ChoiceProblem(knee_base.structure)
    assert SubgroupSearch().group_size(problem) == 19
    assert comb(19, 15) == 3876
    found = papers_choice.search
    assert found.evaluated == 12 * 3876
    assert not found.certified
    assert found.condition_number >= knee_base.search.condition_number * (1 - 1e-9)


@pytest.mark.parametrize("criterion", ["nullspace", "regressor"])
def test_exact_is_certified_and_never_worse(knee_observation, criterion):
    exact = find_base(knee_observation, "exact", criterion=criterion)
    pivoted = find_base(knee_observation, "qr", criterion=criterion)
    assert exact.search.certified
    assert exact.search.condition_number < pivoted.search.condition_number


def test_the_order_of_the_columns_does_not_change_the_optimum(knee_observation, knee_base):
    order = np.random.default_rng(5).permutation(36)
    labels = knee_observation.parameters
    shuffled = Observation.from_matrix(
        knee_observation.factor[:, order], labels.select(order), length=knee_observation.length
    )
    found = find_base(shuffled)
    expected = knee_base.search
    assert found.search.condition_number == pytest.approx(expected.condition_number, rel=1e-9)
    assert found.search.ties == expected.ties
