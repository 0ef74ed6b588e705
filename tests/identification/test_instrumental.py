"""Instruments: unbiased where the regressor is measured with errors."""

import numpy as np
import pytest
from hypothesis import given, strategies as st

from loopid.errors import OptionError, RankError
from loopid.identification import FitSamples, InstrumentalVariables
from loopid.identification.fitting import quiet_fit
from smooth_data import (
    TRUTH,
    assert_coverage,
    autoregressive,
    covered,
    named_samples,
    smooth_regressor,
)

DEVIATIONS = np.array([0.5, 2.0])


def make_run(seed=0, count=200, noise=0.3, correlation=0.0):
    """A regressor with errors of neighbouring entries, and the true one as instruments.

    The first actuator is not used in the last tenth.
    """
    W, rng = smooth_regressor(samples=count), np.random.default_rng(seed)
    measured = W + noise * np.cumsum(rng.normal(size=W.shape), axis=2)
    force = W @ TRUTH + autoregressive(rng, (count, 2), correlation) * DEVIATIONS
    used = np.arange(count)[:, None] < count * np.array([0.9, 1.0])
    return named_samples(measured, force, used).with_instruments(W)


@given(st.integers(0, 1000))
def test_estimates_solve_the_defining_equations(seed):
    samples = make_run(seed, 60)
    found = quiet_fit(samples, "iv")
    Z, X = (array[samples.used] for array in (samples.instruments, samples.regressor))
    w = np.broadcast_to(found.weights**2, samples.used.shape)[samples.used]
    expected = np.linalg.solve((Z.T * w) @ X, (Z.T * w) @ samples.force[samples.used])
    np.testing.assert_allclose(found.values, expected, rtol=1e-7)


def test_the_covariance_of_independent_errors_is_the_textbooks():
    samples = make_run()
    found = InstrumentalVariables().fit_samples(samples).result
    w = np.broadcast_to(found.weights**2, samples.used.shape)[samples.used]
    Z, X = (array[samples.used] for array in (samples.instruments, samples.regressor))
    bread = np.linalg.inv((Z.T * w) @ X)
    np.testing.assert_allclose(found.covariance, bread @ ((Z.T * w) @ Z) @ bread.T, rtol=1e-7)


def test_the_regressor_as_its_own_instrument_is_weighted_least_squares():
    samples = make_run(correlation=0.9)
    own = samples.with_instruments(samples.regressor)
    found, plain = quiet_fit(own, "iv"), quiet_fit(samples, "wls")
    for field in ("values", "covariance", "weights", "degrees_of_freedom", "condition_number"):
        np.testing.assert_allclose(getattr(found, field), getattr(plain, field), rtol=1e-6)
    assert found.quality == plain.quality or np.allclose(
        found.quality.residual_rms, plain.quality.residual_rms
    )


@pytest.mark.validate
@pytest.mark.parametrize("runs", [60])
@pytest.mark.parametrize("correlation", [0.0, 0.8])
def test_it_is_unbiased_and_covers_where_least_squares_does_not(correlation, runs):
    data = [make_run(seed, 300, correlation=correlation) for seed in range(runs)]
    fits = {name: [quiet_fit(one, name) for one in data] for name in ("wls", "iv")}
    values = {name: np.array([f.values for f in found]) for name, found in fits.items()}
    bias = {name: np.abs(v.mean(axis=0) - TRUTH) for name, v in values.items()}
    deviation = {name: v.std(axis=0) / np.sqrt(runs) for name, v in values.items()}
    assert (bias["iv"] < 4 * deviation["iv"]).all()
    assert (bias["wls"] > 1.3 * np.sqrt(runs) * deviation["wls"]).any()
    assert_coverage([covered(fit) for fit in fits["iv"]])


def test_what_is_no_instrument_is_refused():
    samples = make_run()
    data = samples.parameters, samples.actuators, samples.regressor, samples.force
    with pytest.raises(OptionError, match=r"iv needs instruments.*with_instruments"):
        quiet_fit(FitSamples.of(*data), "iv")
    unrelated = np.random.default_rng(0).normal(size=samples.regressor.shape)
    with pytest.raises(RankError, match="instruments are too weak"):
        quiet_fit(samples.with_instruments(unrelated), "iv")
    silent = samples.instruments * [1, 1, 0, 1, 1, 1]
    with pytest.raises(RankError, match=r"link2\.m"):
        quiet_fit(samples.with_instruments(silent), "iv")
