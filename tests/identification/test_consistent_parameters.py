"""Standard parameters with given base parameters: exact, closest to the prior, or refused."""

import numpy as np
import pytest
from oracles import bodies_of, body_columns, closest, least_eigenvalue, least_relative, shaken

from loopid import load_mechanism
from loopid.errors import DataError, OptionError
from loopid.identification import REGULARISATIONS, consistent_parameters, find_force_model

MARGIN = 1e-3


def assert_reproduced(case, values, prior, found):
    sizes = np.abs(values) + np.linalg.norm(case.base.matrix * prior, axis=1) + 1e-12
    assert (np.abs(case.base.values(found) - values) <= 1e-11 * sizes).all()
    assert (least_relative(case.base.parameters, found, prior) >= MARGIN).all()


@pytest.mark.parametrize(("size", "seed"), [(0.01, 0), (0.1, 1), (0.5, 2), (1.0, 0), (3.0, 1)])
def test_possible_base_values_are_met_exactly(knee_case, size, seed):
    other = shaken(knee_case.base.parameters, knee_case.truth, size, seed)
    # A margin that these bodies have to spare.
    least = least_relative(knee_case.base.parameters, other, knee_case.prior).min()
    values = knee_case.base.values(other)
    margin = min(MARGIN, 0.1 * least)
    found = consistent_parameters(knee_case.base, values, knee_case.prior, margin=margin)
    sizes = np.abs(values) + np.linalg.norm(knee_case.base.matrix * knee_case.prior, axis=1)
    np.testing.assert_allclose(knee_case.base.values(found) / sizes, values / sizes, atol=1e-11)
    assert (least_relative(knee_case.base.parameters, found, knee_case.prior) >= margin).all()


def test_the_prior_itself_comes_back(knee_case):
    found = consistent_parameters(
        knee_case.base, knee_case.base.values(knee_case.prior), knee_case.prior
    )
    own = body_columns(knee_case.base.parameters)
    np.testing.assert_allclose(
        bodies_of(knee_case.base.parameters, found),
        bodies_of(knee_case.base.parameters, knee_case.prior),
        atol=1e-7 * np.abs(knee_case.prior[own]).max(),
    )


@pytest.mark.parametrize("regularisation", REGULARISATIONS)
@pytest.mark.parametrize("size", [0.02, 0.4])
def test_they_are_the_closest_that_an_independent_program_finds(arm_case, regularisation, size):
    base, prior = arm_case.base, arm_case.prior.copy()
    prior[-6:] = arm_case.truth[-6:]  # of joint terms: what has no prior has hardly a distance
    values = base.values(shaken(base.parameters, arm_case.truth, size, seed=3))
    found = consistent_parameters(base, values, prior, regularisation=regularisation)
    assert_reproduced(arm_case, values, prior, found)
    own = body_columns(base.parameters)
    expected = closest(arm_case, values, prior, regularisation, MARGIN)
    scale = np.abs(prior[own]).max()
    np.testing.assert_allclose(found[own], expected[own], atol=1e-4 * scale)


def test_possible_or_not_is_what_an_independent_program_says(arm_case):
    base, prior = arm_case.base, arm_case.prior
    bodies = bodies_of(base.parameters, prior)
    generator, verdicts = np.random.default_rng(7), []
    for k in range(16):
        noise = generator.normal(size=len(base)) * 10.0 ** generator.uniform(-1.5, 1.0)
        values = base.values(arm_case.truth) * (1 + noise)
        expected = least_eigenvalue(arm_case, values, bodies)
        if abs(expected - MARGIN) < 1e-4:
            continue
        verdicts.append(expected > MARGIN)
        try:
            found = consistent_parameters(base, values, prior, margin=MARGIN)
        except DataError:
            assert not verdicts[-1], k
        else:
            assert verdicts[-1], k
            assert_reproduced(arm_case, values, prior, found)
    assert 3 <= sum(verdicts) <= len(verdicts) - 3


def test_what_is_impossible_is_named(arm_case, knee_gravity):
    base, prior = arm_case.base, arm_case.prior
    values = base.values(arm_case.truth)
    names = list(base.names)
    spoilt = values.copy()
    spoilt[names.index("elbow.Fc")] = -0.4
    with pytest.raises(DataError, match=r"of elbow\.Fc have .* elbow\.Fc = -0\.4 \(possible"):
        consistent_parameters(base, spoilt, prior)
    # All coefficients of the platform's mass are positive: what moves with it weighs something.
    base, prior = knee_gravity.base, knee_gravity.prior
    heavy = [j for j, row in enumerate(base.matrix) if base.names[j].endswith(".m")]
    assert (base.matrix[heavy] >= 0).all()
    values = base.values(knee_gravity.truth)
    values[heavy[0]] *= -1
    with pytest.raises(DataError, match=f"out of reach: .*{base.names[heavy[0]]} = -14"):
        consistent_parameters(base, values, prior)


def test_drive_inertia_and_links_share_what_only_their_sum_shows(arm_case):
    """Less inertia than the prior's link has: the link gives way, the drive stays positive."""
    base, labels = arm_case.base, arm_case.base.parameters.labels
    truth = arm_case.truth.copy()
    truth[[labels.index("shoulder.Ia"), labels.index("elbow.Ia")]] = 0.0
    truth[: len(truth) - 6] *= 0.8
    found = consistent_parameters(base, base.values(truth), arm_case.prior)
    joints = [labels.index(name) for name in ("shoulder.Ia", "elbow.Ia")]
    assert (found[joints] >= 0).all()
    assert_reproduced(arm_case, base.values(truth), arm_case.prior, found)


def test_tied_links_are_one_body():
    robot = load_mechanism("3rrr", tied=True)
    base, prior = find_force_model(robot, "full", None).base, robot.standard_parameters()
    truth = shaken(base.parameters, prior, 0.2, seed=1)
    found = consistent_parameters(base, base.values(truth), prior)
    np.testing.assert_allclose(
        base.values(found), base.values(truth), atol=1e-10 * np.abs(prior).max()
    )
    assert (least_relative(base.parameters, found, prior) >= MARGIN).all()


def test_arguments_are_checked(arm_case):
    values = arm_case.base.values(arm_case.truth)
    with pytest.raises(DataError, match=r"base parameters must have shape"):
        consistent_parameters(arm_case.base, values[:-1], arm_case.prior)
    with pytest.raises(DataError, match="finite"):
        consistent_parameters(arm_case.base, np.full(len(values), np.nan), arm_case.prior)
    with pytest.raises(OptionError, match="regularisation"):
        consistent_parameters(arm_case.base, values, arm_case.prior, regularisation="none")
    with pytest.raises(OptionError, match="margin"):
        consistent_parameters(arm_case.base, values, arm_case.prior, margin=-0.1)
