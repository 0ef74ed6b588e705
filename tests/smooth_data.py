"""Smooth motion with errors of a known kind, as a robot's log has them, and rates of coverage."""

import numpy as np
import pytest
import scipy

from loopid.identification import FitSamples
from loopid.parameters import ParameterSet

TRUTH = np.array([3.0, -1.0, 0.5, 10.0, 2.0, -4.0])
DEVIATIONS = np.array([0.5, 4.0])  # of the errors of two actuators


def smooth_regressor(seed=0, samples=1000, dof=2, count=6, harmonics=4):
    """Fourier series of the time, (samples, dof, count), and a constant part."""
    rng = np.random.default_rng(seed)
    phase = 2 * np.pi * np.arange(samples)[:, None] / samples * np.arange(1, harmonics + 1)
    waves = np.concatenate([np.cos(phase), np.sin(phase)], axis=1)
    W = np.einsum("tk,kij->tij", waves, rng.normal(size=(2 * harmonics, dof, count)))
    return W + rng.normal(size=(dof, count))


def autoregressive(rng, shape, coefficient, lead=500):
    """Stationary errors of unit variance along the first axis."""
    white = rng.normal(size=(lead + shape[0], *shape[1:])) * np.sqrt(1 - coefficient**2)
    return scipy.signal.lfilter([1.0], [1.0, -coefficient], white, axis=0)[lead:]


def outliers(rng, shape, share=0.05, size=12.0):
    return np.where(rng.random(shape) < share, rng.choice([-size, size], size=shape), 0.0)


def named(count):
    return ParameterSet.from_labels([f"link{j}.m" for j in range(count)])


def named_samples(W, force, used=None, segments=None):
    return FitSamples.of(
        named(W.shape[2]), tuple("abcd"[: W.shape[1]]), W, force, used=used, segments=segments
    )


def runs(few, many):
    """Repetitions of a Monte Carlo: few in an ordinary run, many in ``make validate``."""
    marked = (few, pytest.mark.draws), (many, pytest.mark.validate)
    return pytest.mark.parametrize("runs", [pytest.param(n, marks=mark) for n, mark in marked])


def covered(result, truth=TRUTH):
    low, high = result.intervals().T
    return (low <= truth) & (truth <= high)


def assert_coverage(rates, slack=0.015):
    """95 % intervals covered the true values (runs, n) at their rate, as far as the runs tell.

    Each parameter by 4 binomial standard deviations, their mean by 2, and some slack.
    """
    deviation = np.sqrt(0.95 * 0.05 / len(rates))
    assert np.mean(rates, axis=0).min() > 0.95 - 4 * deviation - slack
    assert abs(np.mean(rates) - 0.95) < 2 * deviation + slack
