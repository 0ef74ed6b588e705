"""Results: equality, text, read-only arrays."""

import numpy as np
import pytest

from loopid import ParameterSet
from loopid.identification import FitSamples, WeightedLeastSquares, quiet_fit
from loopid.parameters import Parameter
from smooth_data import autoregressive, smooth_regressor

NAMES = ParameterSet(
    (Parameter("a.b", "m"), Parameter("leg1", "mx"), Parameter("slide", "Fc", "N"))
)


@pytest.fixture(scope="module")
def samples():
    W, rng = smooth_regressor(samples=400, dof=3, count=3), np.random.default_rng(0)
    force = W @ [3.0, 0.0, 1e-7] + autoregressive(rng, (400, 3), 0.7) * [1.0, 0.1, 1.0]
    used = np.ones((400, 3), dtype=bool) & [True, True, False]
    return FitSamples.of(NAMES, ("x", "y", "größe"), W, force, used)


@pytest.fixture(scope="module")
def results(samples):
    """With a noise model, and without."""
    return quiet_fit(samples), WeightedLeastSquares().fit(samples.problem)


def test_results_that_differ_are_not_equal(results):
    first, second = results
    assert first != second
    assert first != "something else"


def test_the_text_has_a_line_a_parameter(results):
    lines = str(results[0]).splitlines()
    assert len(lines) == 3
    assert lines[0].strip().startswith("1 a.b.m: ")
    assert "kg" in lines[0]
    assert "±" in lines[0]


def test_results_are_read_only(results):
    for array in (results[0].values, results[0].covariance, results[0].quality.residual_rms):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0
