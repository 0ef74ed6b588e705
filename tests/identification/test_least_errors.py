"""Forces that are known to be zero: as sure as they are said to be, and no surer."""

import numpy as np
import pytest

from loopid import ParameterSet
from loopid.errors import DataError
from loopid.identification import FitSamples, quiet_fit

NAMES = ParameterSet.from_labels([f"link{j}.m" for j in range(3)])
TRUTH = np.array([3.0, -1.0, 2.0])
LEAST = 0.01


def samples(seed=0, count=200, least=LEAST):
    """One actuator with errors of 0.5, and one whose rows are exactly zero."""
    generator = np.random.default_rng(seed)
    W = generator.normal(size=(count, 2, 3))
    # Rows at right angles to the truth.
    W[:, 1] -= np.outer(W[:, 1] @ TRUTH, TRUTH) / (TRUTH @ TRUTH)
    force = W @ TRUTH
    force[:, 0] += 0.5 * generator.normal(size=count)
    force[:, 1] = 0.0
    return FitSamples.of(NAMES, ("motor", "free"), W, force, least_errors=np.array([0.0, least]))


def test_estimates_are_those_of_the_stated_error():
    data = samples()
    found = quiet_fit(data)
    deviation = np.array([found.noise.deviation[0], LEAST])
    flat = (data.regressor / deviation[:, None]).reshape(-1, 3)
    expected = np.linalg.lstsq(flat, (data.force / deviation).ravel())[0]
    np.testing.assert_allclose(found.values, expected, rtol=1e-3)
    np.testing.assert_allclose(found.weights[1], 1 / LEAST)
    np.testing.assert_allclose(found.noise.deviation[1], LEAST, rtol=0.02)
    covariance = np.linalg.inv(flat.T @ flat)
    # The motor's errors may look a little correlated.
    np.testing.assert_allclose(found.covariance, covariance, atol=0.3 * covariance.max())


def test_what_is_less_sure_tells_less():
    sure, vague = (quiet_fit(samples(least=least)).standard_errors for least in (0.01, 2.0))
    assert (sure < vague).all()


def test_larger_errors_than_the_least_count_as_they_are():
    data = samples()
    force = data.force.copy()
    force[:, 1] += np.random.default_rng(1).normal(scale=0.2, size=len(force))
    assert quiet_fit(data.with_force(force)).noise.deviation[1] == pytest.approx(0.2, rel=0.2)


def test_parts_and_selections_keep_them():
    parts = [samples(0), samples(1, least=2 * LEAST)]
    whole = FitSamples.combined(parts)
    np.testing.assert_array_equal(whole.least_errors, [0, 2 * LEAST])
    np.testing.assert_array_equal(whole.problem.least_errors, whole.least_errors)
    joined = type(whole.problem).combined(part.problem for part in parts)
    np.testing.assert_array_equal(joined.least_errors, whole.least_errors)
    for same in (whole.select([0, 2]), whole.less(whole.force)):
        np.testing.assert_array_equal(same.least_errors, whole.least_errors)


@pytest.mark.parametrize("least", [[0.0, -1.0], [0.0], [0.0, np.nan], [0.0, np.inf]])
def test_what_is_no_error_is_refused(least):
    data = samples()
    with pytest.raises(DataError, match="least errors"):
        FitSamples.of(NAMES, data.actuators, data.regressor, data.force, None, None, least)
