"""Smooth motion with errors of a known kind, as a robot's log has them."""

import numpy as np
import pytest
from scipy.signal import lfilter

from loopid import ParameterSet
from loopid.identification import FitSamples


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
    return lfilter([1.0], [1.0, -coefficient], white, axis=0)[lead:]


def named_samples(W, force, used=None, stretches=None):
    names = ParameterSet.from_labels([f"link{j}.m" for j in range(W.shape[2])])
    return FitSamples.of(names, tuple("abcd"[: W.shape[1]]), W, force, used, stretches)


@pytest.fixture(scope="session")
def make_regressor():
    return smooth_regressor


@pytest.fixture(scope="session")
def make_errors():
    return autoregressive


@pytest.fixture(scope="session")
def make_samples():
    return named_samples
