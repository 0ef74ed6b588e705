"""The simulated experiment: forces along the nine trajectories, their noise, the stand-in."""

from itertools import combinations

import numpy as np
import pytest

from loopid.kinematics import closed_motion
from loopid.paper.reproduction import (
    BODIES,
    COULOMB,
    FORCE_NOISE,
    FRICTION,
    MAIN,
    SHOWN,
    SIMULATED,
    SPREAD,
    VISCOUS,
    WARM_UP,
    friction_forces,
    greatest_forces,
    run_experiment,
    simulate_stand_in,
    with_noise,
)
from loopid.regressors import motion_regressor

PARTS = ("inertial", "coriolis", "gravity")
# Of the robot file, in the order of Table II (kg, kg m).
TRUTH = [14.1434, -0.2905, 0.2905, 1.4418, 1.4418, 1.4418, 0.2905, -0.9496, -0.0538, -0.0783]
TRUTH += [0.3643, -0.0086, 0.0087, -0.0087, -0.0087]


def test_the_parts_add_up_to_the_forces_of_the_motion(knee, experiment):
    pi = knee.standard_parameters()
    for name in ("3", "9"):
        motion, parts = experiment.motions[name], experiment.parts[name]
        q, v, a = motion.configurations, motion.velocities, motion.accelerations
        total = motion_regressor(knee, closed_motion(knee, q, v, a)) @ pi
        np.testing.assert_allclose(parts.total, total, atol=1e-9 * np.abs(total).max())
        np.testing.assert_array_equal(experiment.samples[name].force, parts.total)


def test_gravity_is_the_regressor_times_the_robot_files_values(experiment):
    for name, samples in experiment.samples.items():
        gravity = samples.regressor[:, :, BODIES] @ experiment.truth[BODIES]
        np.testing.assert_allclose(gravity, experiment.parts[name].gravity, atol=1e-9)


def test_columns_are_in_the_order_of_table_ii_then_friction_by_limb(experiment, comparison):
    labels = experiment.samples["1"].parameters.labels
    assert labels[BODIES] == tuple(comparison.base.names[j] for j in comparison.order)
    assert labels[15:17] == ("leg1_stroke.Fc", "leg1_stroke.Fv")
    np.testing.assert_allclose(experiment.truth[BODIES], TRUTH, atol=5e-5)
    np.testing.assert_array_equal(experiment.truth[15::2], COULOMB)
    np.testing.assert_array_equal(experiment.truth[16::2], VISCOUS)


def test_inertia_and_coriolis_effects_are_lost_in_gravity(experiment):
    # The paper's figures 2 and 3: at therapy speeds, gravity is all that counts.
    greatest = greatest_forces(experiment)
    assert greatest["inertial"].max() < 0.2
    assert greatest["coriolis"].max() < 0.2
    assert greatest["gravity"].max() > 150


def test_greatest_forces_are_those_of_all_trajectories(experiment):
    for part in PARTS:
        all_forces = np.concatenate([getattr(p, part) for p in experiment.parts.values()])
        found = greatest_forces(experiment)[part]
        np.testing.assert_array_equal(found, np.abs(all_forces).max(axis=0))


def test_friction_opposes_the_way_that_each_motor_goes(experiment):
    velocities = experiment.motions[SHOWN].velocities
    friction = friction_forces(experiment.samples[SHOWN])
    moving = np.abs(velocities) > 1e-4
    assert (np.sign(friction)[moving] == np.sign(velocities)[moving]).all()
    # The round-off of a motor that stands has no direction, so no Coulomb friction.
    assert np.abs(friction[np.abs(velocities) < 1e-7]).max() < 1e-3


def test_the_noise_is_the_papers_and_no_two_parts_share_it(experiment):
    samples = experiment.samples["3"]
    errors = [
        (with_noise(samples, *part).force - samples.force).ravel()
        for part in ((0, SIMULATED, 2), (0, MAIN, 2), (0, WARM_UP, 2), (0, MAIN, 3), (1, MAIN, 2))
    ]
    for error in errors:
        assert np.abs(error).max() <= FORCE_NOISE
        assert error.std() == pytest.approx(FORCE_NOISE / np.sqrt(3), rel=0.1)
    for first, second in combinations(errors, 2):
        assert abs(np.corrcoef(first, second)[0, 1]) < 0.15


def test_a_stand_in_is_not_quite_the_robot_file(knee, made):
    recordings, truth = made[0]
    file = knee.standard_parameters()
    assert (truth[file != 0] / file[file != 0]).std() == pytest.approx(SPREAD, rel=0.25)
    assert [recording.name for recording in recordings] == ["3", "9"]


def test_a_seed_gives_the_same_stand_in_and_another_seed_another(knee):
    one = run_experiment(knee, 2.0, names=("3",))
    calls = []
    first, again, other = (simulate_stand_in(one, s, lambda *c: calls.append(c)) for s in (0, 0, 1))
    np.testing.assert_array_equal(again[1], first[1])
    np.testing.assert_array_equal(again[0][0].force, first[0][0].force)
    assert not np.array_equal(other[1], first[1])
    assert not np.array_equal(other[0][0].force, first[0][0].force)
    assert calls == [(1, 1)] * 3


def test_friction_takes_part_where_it_is_asked_for(experiment):
    samples = experiment.with_friction(0, MAIN, ("3",))
    exact = experiment.samples["3"]
    error = samples.force - exact.force - exact.regressor[:, :, 15:] @ FRICTION
    assert np.abs(error).max() <= FORCE_NOISE
