"""What the motors' forces are made of, along the nine trajectories."""

import numpy as np
import pytest

from loopid import dynamic_regressor
from loopid.paper.shares import SHOWN, force_shares

PARTS = ("inertial", "coriolis", "gravity")


@pytest.fixture(scope="module")
def shares(paper):
    return paper.shares


def test_the_parts_add_up_to_the_forces_of_the_motion(knee, experiment):
    pi = knee.standard_parameters()
    for name in ("3", "9"):
        motion, parts = experiment.motions[name], experiment.parts[name]
        state = motion.configurations, motion.velocities, motion.accelerations
        total = dynamic_regressor(knee, *state) @ pi
        np.testing.assert_allclose(parts.total, total, atol=1e-9 * np.abs(total).max())
        np.testing.assert_allclose(sum(getattr(parts, part) for part in PARTS), total, atol=1e-9)


def test_inertia_and_coriolis_effects_are_lost_in_gravity(shares):
    # The paper's figures 2 and 3: at therapy speeds, gravity is all that counts.
    assert shares.greatest["inertial"].max() < 0.2
    assert shares.greatest["coriolis"].max() < 0.2
    assert shares.greatest["gravity"].max() > 150


def test_greatest_forces_are_those_of_all_trajectories(shares, experiment):
    for part in PARTS:
        all_forces = np.concatenate([getattr(p, part) for p in experiment.parts.values()])
        np.testing.assert_array_equal(shares.greatest[part], np.abs(all_forces).max(axis=0))


def test_the_trajectory_shown_is_one_of_the_nine(shares, experiment):
    assert shares.trajectory == SHOWN
    assert set(experiment.motions) == set("123456789")
    for part in PARTS:
        expected = getattr(experiment.parts[SHOWN], part)
        np.testing.assert_array_equal(getattr(shares, part), expected)
    assert len(shares.time) == len(shares.friction) == len(shares.gravity)


def test_friction_opposes_the_way_that_each_motor_goes(shares, experiment):
    velocities = experiment.motions[SHOWN].velocities
    moving = np.abs(velocities) > 1e-4
    assert (np.sign(shares.friction)[moving] == np.sign(velocities)[moving]).all()
    # The round-off of a motor that stands has no direction, so no Coulomb friction.
    assert np.abs(shares.friction[np.abs(velocities) < 1e-7]).max() < 1e-3


def test_a_thinned_experiment_keeps_every_tenth_sample_and_all_parts(experiment):
    thin = experiment.thinned(10)
    assert thin.rate == pytest.approx(experiment.rate / 10)
    for name, motion in experiment.motions.items():
        np.testing.assert_array_equal(thin.motions[name].time, motion.time[::10])
        assert thin.parts[name] is experiment.parts[name]
    np.testing.assert_array_equal(
        force_shares(experiment).greatest["gravity"], force_shares(thin).greatest["gravity"]
    )


def test_the_nine_trajectories_can_be_run(experiment):
    assert not any(review.problems for review in experiment.reviews.values())
