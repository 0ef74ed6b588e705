"""Intervals hold the truth as often as they say, over fresh draws of the noise."""

import numpy as np
import pytest

from loopid.identification import FitSamples
from loopid.paper.coverage import LEVEL, measure_coverage
from loopid.paper.simulated import ordered_samples, ordered_truth

REPETITIONS = 500


@pytest.fixture(scope="module")
def samples(experiment, comparison):
    every = round(experiment.rate / 0.2)
    thin = experiment.thinned(every)
    return FitSamples.combined(list(ordered_samples(thin, comparison, 0).values()))


@pytest.fixture(scope="module")
def measured(samples, comparison):
    return measure_coverage(samples, ordered_truth(comparison), REPETITIONS, seed=0)


def test_each_interval_holds_as_often_as_it_says(measured):
    assert measured.shares.shape == (15,)
    assert measured.shares.min() >= 0.92
    assert measured.shares.max() <= 0.98


def test_on_average_intervals_hold_as_often_as_they_say(measured):
    assert 0.94 <= measured.shares.mean() <= 0.96


def test_the_mean_of_all_draws_is_the_truth(measured):
    assert np.abs(measured.bias).max() < 4


def test_counts_are_told(measured, samples):
    assert (measured.repetitions, measured.samples) == (REPETITIONS, len(samples))
    np.testing.assert_allclose(measured.shares * REPETITIONS % 1, 0, atol=1e-9)


def test_the_share_of_few_draws_is_binomial(samples, comparison):
    truth = ordered_truth(comparison)
    found = measure_coverage(samples, truth, 60, seed=5)
    assert np.abs(found.shares - LEVEL).max() < 4 * np.sqrt(LEVEL * (1 - LEVEL) / 60)


def test_the_forces_of_the_samples_do_not_matter(samples, comparison):
    truth = ordered_truth(comparison)
    found, again = (
        measure_coverage(given, truth, 8, seed=5)
        for given in (samples, samples.with_force(1e3 + 0 * samples.force))
    )
    np.testing.assert_array_equal(found.shares, again.shares)
    np.testing.assert_allclose(found.bias, again.bias)


def test_a_seed_gives_the_same_shares_and_progress_is_told(samples, comparison):
    calls = []
    truth = ordered_truth(comparison)
    first, again, other = (
        measure_coverage(samples, truth, 8, seed, lambda *call: calls.append(call))
        for seed in (1, 1, 2)
    )
    np.testing.assert_array_equal(first.bias, again.bias)
    assert not np.array_equal(first.bias, other.bias)
    assert calls == [(k, 8) for k in range(1, 9)] * 3
