"""Table IV and figure 4: what eight of fifteen parameters turn into, and what that explains."""

import warnings
from dataclasses import replace

import numpy as np
import pytest

from loopid.errors import ExcitationWarning
from loopid.identification import FitSamples, influence, truncated_values
from loopid.paper.printed import FORCE_NOISE, TABLE_IV
from loopid.paper.simulated import fit_simulated, ordered_samples, ordered_truth

SEEDS = range(1, 6)
# Of the robot file, in the order of Table II (kg, kg m).
TRUTH = [14.1434, -0.2905, 0.2905, 1.4418, 1.4418, 1.4418, 0.2905, -0.9496, -0.0538, -0.0783]
TRUTH += [0.3643, -0.0086, 0.0087, -0.0087, -0.0087]


def refit(experiment, comparison, seed):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ExcitationWarning)
        return fit_simulated(experiment, comparison, seed)


@pytest.fixture(scope="module")
def simulated(paper):
    return paper.simulated


@pytest.fixture(scope="module")
def fits(coarse, comparison):
    return [refit(coarse, comparison, seed) for seed in SEEDS]


@pytest.fixture(scope="module")
def samples(coarse, comparison):
    """All nine trajectories together, columns in the order of Table II."""
    return FitSamples.combined(list(ordered_samples(coarse, comparison, 1).values()))


def test_the_truth_is_the_robot_file_in_the_papers_order(comparison, simulated):
    np.testing.assert_allclose(ordered_truth(comparison), TRUTH, atol=5e-5)
    np.testing.assert_array_equal(simulated.truth, ordered_truth(comparison))


def test_columns_are_in_the_order_of_table_ii(samples, comparison):
    assert samples.parameters.labels == tuple(comparison.base.names[j] for j in comparison.order)


def test_each_of_eight_is_what_leaving_out_the_rest_makes_of_it(simulated, fits):
    for found in [simulated, *fits]:
        off = (found.eight.values - found.expected) / found.eight.standard_errors
        assert np.abs(off).max() < 3


def test_eight_of_fifteen_are_not_the_truth(simulated):
    # Otherwise the test above could not tell truncation from nothing.
    assert np.abs(simulated.expected - simulated.truth[:8]).max() > 0.05


def test_truncation_is_least_squares_without_noise(samples, comparison, fits):
    truth = ordered_truth(comparison)
    W = samples.regressor.reshape(-1, 15)
    exact = np.linalg.lstsq(W[:, :8], W @ truth)[0]
    np.testing.assert_allclose(truncated_values(samples, truth, 8), exact, atol=1e-9)
    np.testing.assert_allclose(fits[0].expected, exact, atol=1e-9)


def test_single_trajectories_bend_the_eight_further_than_all_together(
    simulated, coarse, comparison
):
    low, high = simulated.expected_range.T
    assert (low < simulated.expected).all()
    assert (simulated.expected < high).all()
    truth = ordered_truth(comparison)
    alone = replace(coarse, motions={"6": coarse.motions["6"]})
    found = refit(alone, comparison, 1)
    np.testing.assert_allclose(found.expected_range.T, np.stack([found.expected] * 2), atol=1e-9)
    part = ordered_samples(alone, comparison, 1)["6"]
    np.testing.assert_allclose(found.expected, truncated_values(part, truth, 8), atol=1e-9)


def test_all_fifteen_are_the_truth(simulated, fits):
    for found in [simulated, *fits]:
        off = (found.fifteen.values - found.truth) / found.fifteen.standard_errors
        assert np.abs(off).max() < 4


def test_the_noise_is_the_papers(samples, comparison):
    error = samples.force - samples.regressor @ ordered_truth(comparison)
    # Inertial and Coriolis forces are in the simulated forces, but not in the model of gravity.
    assert np.abs(error).max() < FORCE_NOISE + 1.0
    assert error.std() == pytest.approx(FORCE_NOISE / np.sqrt(3), rel=0.05)


def test_table_iv_as_printed_is_near_what_truncation_predicts(simulated):
    off = np.abs(np.array(TABLE_IV) - simulated.expected)
    assert off.max() < 0.25


def test_condition_numbers_are_those_of_the_regressors(simulated, coarse, comparison):
    found = refit(coarse, comparison, 2).condition_numbers
    assert set(found) == {"all", *"123456789"}
    single = ordered_samples(coarse, comparison, 7)  # noise does not matter
    for name, part in {**single, "all": FitSamples.combined(list(single.values()))}.items():
        W = part.regressor.reshape(-1, 15)
        expected = np.linalg.cond(W), np.linalg.cond(W[:, :8])
        assert found[name] == pytest.approx(expected, rel=1e-6)
    assert simulated.condition_numbers["all"][0] < 500 < simulated.condition_numbers["1"][0]


def test_influence_is_its_definition_with_the_base_regressor_up_to_fifteen(samples, fits):
    values, W = fits[0].fifteen.values, samples.regressor.reshape(-1, 15)
    size = np.linalg.norm(samples.force)
    defined = [100 * np.linalg.norm(W[:, :i] @ values[:i]) / size for i in range(1, 16)]
    np.testing.assert_allclose(fits[0].influence, defined, rtol=1e-9)
    left = [np.linalg.norm(samples.force.ravel() - W[:, :i] @ values[:i]) for i in range(1, 16)]
    np.testing.assert_allclose(fits[0].explained, 100 * (1 - np.array(left) / size), rtol=1e-9)


def test_influence_is_no_accuracy(simulated):
    # Not monotone, above 100 % at times, and near 100 % where a tenth of the force is missing.
    assert (np.diff(simulated.influence) < 0).any()
    assert simulated.influence[7] > 95
    assert simulated.explained[7] < simulated.influence[7] - 5
    assert simulated.explained.argmax() >= 7


def test_the_reach_of_influence_is_that_of_other_draws_of_the_noise(fits, simulated):
    shares = np.array([found.influence for found in fits])
    reach = np.array([found.influence_reach for found in fits]).mean(axis=0)
    # Five draws of fifteen numbers tell a standard deviation to a factor of two or so.
    told, spread = np.sqrt((reach**2).mean()) / 1.96, np.sqrt(shares.var(axis=0, ddof=1).mean())
    assert 0.4 < told / spread < 2.5
    assert (simulated.influence_reach < reach).all()


def test_influence_of_the_truth_is_inside_its_interval(fits, samples, comparison):
    truth = ordered_truth(comparison)
    exact = influence(samples, truth, relative_to="measured")
    off = np.abs(fits[0].influence - exact) / fits[0].influence_reach
    assert (off < 2).all()


def test_a_seed_gives_the_same_fit_and_another_seed_another(coarse, comparison, fits):
    again = refit(coarse, comparison, SEEDS[0])
    np.testing.assert_array_equal(again.fifteen.values, fits[0].fifteen.values)
    np.testing.assert_array_equal(again.influence_reach, fits[0].influence_reach)
    assert not np.array_equal(fits[0].fifteen.values, fits[1].fifteen.values)
