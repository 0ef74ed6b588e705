"""Friction first, gravity second: as good as both at once, and honest about what it costs."""

import numpy as np
import pytest

from loopid.paper.experiment import COULOMB, VISCOUS
from loopid.paper.two_steps import identify_in_two_steps
from loopid.simulation import simulate_measurement


@pytest.fixture(scope="module")
def steps(paper):
    return paper.two_steps


def deviations(result, truth):
    return (result.values - truth) / result.standard_errors


def test_both_ways_find_the_truth(steps):
    for result in (steps.in_steps, steps.together):
        assert np.abs(deviations(result, steps.truth)).max() < 4
        assert np.sqrt((deviations(result, steps.truth) ** 2).mean()) < 1.6


def test_other_noise_gives_the_truth_too(coarse):
    found = identify_in_two_steps(coarse, seed=7)
    for result in (found.in_steps, found.together):
        assert np.abs(deviations(result, found.truth)).max() < 4


def test_the_truth_is_the_robot_file_and_the_friction_by_limb(steps, comparison):
    prior = comparison.base.values(comparison.mechanism.standard_parameters("gravity"))
    np.testing.assert_allclose(steps.truth[:15], prior[comparison.order])
    np.testing.assert_array_equal(steps.truth[15::2], COULOMB)
    np.testing.assert_array_equal(steps.truth[16::2], VISCOUS)
    assert steps.together.parameters == steps.in_steps.parameters
    labels = steps.in_steps.parameters.labels
    assert labels[:15] == tuple(comparison.base.names[j] for j in comparison.order)
    assert labels[15:17] == ("leg1_stroke.Fc", "leg1_stroke.Fv")


def test_friction_from_the_warm_up_alone_is_less_certain(steps):
    ratio = steps.in_steps.standard_errors / steps.together.standard_errors
    assert (ratio[15:] > 1.2).all()
    assert (ratio > 0.95).all()


def test_no_two_runs_share_their_noise(coarse, monkeypatch):
    # Steps are joined as if their errors were independent.
    seeds = []

    def noting(mechanism, motion, noise, seed, *arguments):
        seeds.append(seed)
        return simulate_measurement(mechanism, motion, noise, seed, *arguments)

    monkeypatch.setattr("loopid.paper.two_steps.simulate_measurement", noting)
    identify_in_two_steps(coarse, seed=7)
    assert len(seeds) == 11
    assert len(set(seeds)) == len(seeds)
