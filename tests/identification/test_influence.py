"""The paper's p_i, and what leaving parameters out does to a fit."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from loopid.errors import DataError, OptionError
from loopid.identification import OrdinaryLeastSquares, WeightedLeastSquares
from loopid.identification import influence, truncated_values, truncation_bias

TRUTH = np.array([3.0, -1.0, 5.0, 10.0, 2.0, -4.0])
NAMES = ["link4.m", "link0.m", "link3.m"]


def noisy(make_regressor, make_samples, seed=0):
    W, rng = make_regressor(seed, 120), np.random.default_rng(seed)
    return make_samples(W, W @ TRUTH + rng.normal(size=(120, 2)))


@pytest.mark.parametrize("relative_to", ["measured", "predicted"])
def test_influence_is_equation_12(make_regressor, make_samples, relative_to):
    samples = noisy(make_regressor, make_samples)
    W = samples.regressor.reshape(-1, 6)
    force = samples.force.ravel() if relative_to == "measured" else W @ TRUTH
    norm = np.linalg.norm
    expected = [100 * norm(W[:, :i] @ TRUTH[:i]) / norm(force) for i in range(1, 7)]
    for data in (samples, samples.problem):
        np.testing.assert_allclose(influence(data, TRUTH, relative_to), expected)


def test_influence_need_not_grow_and_may_exceed_all(make_samples):
    W = np.ones((10, 1, 2))
    samples = make_samples(W, np.ones((10, 1)))
    np.testing.assert_allclose(influence(samples, np.array([3.0, -2.0])), [300.0, 100.0])


def test_influence_of_nothing_is_refused(make_regressor, make_samples):
    samples = noisy(make_regressor, make_samples)
    with pytest.raises(
        OptionError, match="unknown force 'true': choose one of measured, predicted"
    ):
        influence(samples, TRUTH, "true")
    with pytest.raises(DataError, match="predicted forces are all zero"):
        influence(samples, 0 * TRUTH, "predicted")
    with pytest.raises(DataError, match="values"):
        influence(samples, TRUTH[:3])


@given(st.integers(0, 1000), st.permutations(range(6)), st.integers(1, 6))
def test_a_noiseless_fit_of_some_parameters_gives_the_truncated_values(
    make_regressor, make_samples, seed, order, count
):
    W = make_regressor(seed, 60)
    samples, kept = make_samples(W, W @ TRUTH), list(order[:count])
    names = [samples.parameters.labels[j] for j in kept]
    found = OrdinaryLeastSquares().fit(samples.select(kept).problem)
    for data in (samples, samples.problem):
        expected = truncated_values(data, TRUTH, names)
        np.testing.assert_allclose(found.values, expected, rtol=1e-6, atol=1e-6)
    bias = truncation_bias(samples, TRUTH, names)
    np.testing.assert_allclose(bias, expected - TRUTH[kept], atol=1e-9)


def test_weights_count_as_in_the_fit(make_regressor, make_samples):
    samples = noisy(make_regressor, make_samples)
    weights = WeightedLeastSquares().fit(samples.problem).weights * [1, 5]
    X = (samples.regressor * weights[:, None]).reshape(-1, 6)
    expected = np.linalg.lstsq(X[:, [4, 0, 3]], X @ TRUTH)[0]
    np.testing.assert_allclose(truncated_values(samples, TRUTH, NAMES, weights), expected)


def test_the_first_parameters_may_be_counted(make_regressor, make_samples):
    samples = noisy(make_regressor, make_samples)
    expected = truncated_values(samples, TRUTH, ["link0.m", "link1.m"])
    np.testing.assert_allclose(truncated_values(samples, TRUTH, 2), expected)
    np.testing.assert_allclose(truncated_values(samples, TRUTH, 6), TRUTH)
    np.testing.assert_allclose(truncation_bias(samples, TRUTH, 6), 0.0, atol=1e-12)


@pytest.mark.parametrize("kept", [0, 7, ["link9.m"], [], ["link1.m", "link1.m"]])
def test_parameters_that_cannot_be_kept_are_refused(make_regressor, make_samples, kept):
    with pytest.raises(OptionError, match=r"parameter"):
        truncated_values(noisy(make_regressor, make_samples), TRUTH, kept)


def test_weights_of_another_robot_are_refused(make_regressor, make_samples):
    with pytest.raises(DataError, match="weights must have shape"):
        truncated_values(noisy(make_regressor, make_samples), TRUTH, 2, np.ones(3))
