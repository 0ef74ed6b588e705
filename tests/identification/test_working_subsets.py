"""Subsets are fitted as all parameters are: outliers count as little in them."""

import numpy as np
import pytest

from loopid.identification import FitSamples, quiet_fit
from loopid.parameters import ParameterSet
from loopid.identification import eliminate

NAMES = ParameterSet.from_labels([f"body{j}.m" for j in range(5)])
TRUTH = np.array([5.0, -2.0, 3.0, 0.0, 0.0])


def made(seed):
    """Samples of two motors, of which one in twenty is far off."""
    generator = np.random.default_rng(seed)
    W = generator.normal(size=(400, 2, 5))
    error = generator.normal(size=(400, 2))
    error[generator.random((400, 2)) < 0.05] += 40.0
    return FitSamples.of(NAMES, ("one", "two"), W, W @ TRUTH + error)


@pytest.mark.parametrize("estimator", ["wls", "huber", "bisquare"])
def test_the_first_step_is_the_fit_of_all_parameters(estimator):
    training, validation = made(1), made(2)
    found = eliminate(training, validation, estimator)
    full = quiet_fit(training, estimator)
    np.testing.assert_allclose(found.steps[0].values, full.values, rtol=1e-6, atol=1e-8)


@pytest.mark.parametrize("estimator", ["huber", "bisquare"])
def test_subsets_are_no_worse_for_outliers(estimator):
    found = eliminate(made(1), made(2), estimator)
    three = next(step for step in found.steps if len(step.labels) == 3)
    assert set(three.labels) == {"body0.m", "body1.m", "body2.m"}
    plain = eliminate(made(1), made(2), "wls")
    errors = [
        np.abs(next(s for s in each.steps if len(s.labels) == 3).values - TRUTH).max()
        for each in (found, plain)
    ]
    assert errors[0] < 0.5 * errors[1]
