"""Random closed configurations: reproducible, admissible, and different for other seeds."""

from dataclasses import replace

import numpy as np
import pytest

from loopid import assemble, random_configurations
from loopid.errors import AssemblyError, OptionError
from loopid.kinematics import constraint_residual, random_motions, singularity_measure


def test_a_seed_gives_the_same_configurations(mechanism):
    first, again = (random_configurations(mechanism, 20, seed=8) for _ in range(2))
    np.testing.assert_array_equal(first, again)


def test_a_larger_count_only_adds_more(mechanism):
    many = random_configurations(mechanism, 90, seed=8)
    np.testing.assert_array_equal(random_configurations(mechanism, 7, seed=8), many[:7])
    assert len(np.unique(many, axis=0)) == len(many) == 90


def test_other_seeds_give_other_configurations(mechanism):
    one, other = (random_configurations(mechanism, 5, seed=seed) for seed in (1, 2))
    assert (np.abs(one - other).max(axis=1) > 1e-3).all()


def test_configurations_are_closed_and_inside_all_limits(mechanism):
    q = random_configurations(mechanism, 60, seed=0)
    assert np.abs(constraint_residual(mechanism, q)).max() < 1e-13
    assert (q >= mechanism.model.lowerPositionLimit).all()
    assert (q <= mechanism.model.upperPositionLimit).all()


@pytest.mark.parametrize("margin", [0.0, 0.03, 0.06])
def test_the_margin_is_kept(mechanism, margin):
    q = random_configurations(mechanism, 40, seed=0, margin=margin)
    assert (singularity_measure(mechanism, q) >= margin).all()


def test_strokes_are_spread_over_their_whole_range(mechanism):
    motors = mechanism.velocity_indices(mechanism.actuated)
    strokes = random_configurations(mechanism, 200, seed=0)[:, motors]
    ranges = mechanism.model.upperPositionLimit - mechanism.model.lowerPositionLimit
    assert (np.ptp(strokes, axis=0) > 0.9 * ranges[motors]).all()


def test_configurations_lie_on_the_references_branch(mechanism):
    q = random_configurations(mechanism, 20, seed=0)
    motors = mechanism.velocity_indices(mechanism.actuated)
    np.testing.assert_allclose(assemble(mechanism, q[:, motors]), q, atol=1e-10)


def test_an_endless_motor_is_drawn_over_a_whole_turn(four_bars):
    bar = four_bars["6d"]
    q = random_configurations(bar, 200, seed=0)
    angles = np.arctan2(q[:, 1], q[:, 0])
    assert np.ptp(angles) > 1.9 * np.pi


def test_a_margin_that_none_keeps_is_refused(knee):
    # The measure of a tree is 1, and its draws are cheap.
    tree = replace(knee, closures=(), actuated=knee.joints)
    assert len(random_configurations(tree, 3, margin=1)) == 3
    with pytest.raises(AssemblyError, match=r"only 0 of \d+ random draws of 3ups_rpu .* least 2"):
        random_configurations(tree, 3, margin=2)


@pytest.mark.parametrize("arguments", [{"count": 0}, {"count": 3, "margin": -0.1}])
def test_absurd_arguments_are_refused(mechanism, arguments):
    with pytest.raises(OptionError, match=r"samples must be|margin must be"):
        random_configurations(mechanism, **arguments)
    with pytest.raises(OptionError):
        random_configurations(mechanism, 3, margin=np.nan)


def test_random_motions_are_seeded_and_of_the_order_of_gravity(mechanism):
    motions = random_motions(mechanism, 500, seed=3)
    for first, again in zip(motions, random_motions(mechanism, 500, seed=3), strict=True):
        np.testing.assert_array_equal(first, again)
        assert first.shape == (500, 4)
    velocities, accelerations = motions
    # Strokes: in m, free fall over the characteristic length.
    assert np.abs(accelerations).max() == pytest.approx(9.81, rel=0.01)
    fall = np.sqrt(9.81 * mechanism.length)
    assert np.abs(velocities).max() == pytest.approx(fall, rel=0.01)
