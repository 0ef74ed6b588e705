"""The force model: base parameters of bodies and joints together, over any motion."""

import numpy as np
import pytest

from loopid import JointTerms, closed_motion, force_parts, random_configurations
from loopid.experiment import find_force_model, force_model
from loopid.kinematics import random_motions
from loopid.regressors import JOINT_TERMS, motion_parameters
from loopid.trajectories import JointMotion
from made_runs import record

KINDS = tuple(JOINT_TERMS)


def random_motion(robot, count, seed):
    """Unrelated closed samples, as a motion."""
    q = random_configurations(robot, count, seed=seed)
    v, a = random_motions(robot, count, seed=seed)
    return JointMotion(np.arange(count) / 10, q, v, a, np.ones(count))


def joint_forces(robot, terms, motion, values):
    whole = closed_motion(robot, motion.configurations, motion.velocities, motion.accelerations)
    return terms.columns(robot, whole) @ values


def parts_of(robot, motion, standard=None):
    state = motion.configurations, motion.velocities, motion.accelerations
    return force_parts(robot, *state, standard)


@pytest.fixture(
    scope="module",
    params=[("knee", "gravity"), ("knee", "full"), ("arm", "gravity"), ("arm", "full")],
    ids=" ".join,
)
def case(request, knee, arm):
    """A robot, its terms and its force model."""
    name, model = request.param
    robot = {"knee": knee, "arm": arm}[name]
    terms = JointTerms(robot.actuated, KINDS)
    return robot, terms, find_force_model(robot, model, terms)


def test_base_values_of_any_parameters_give_the_forces_of_all_parts(case):
    robot, terms, model = case
    motion, generator = random_motion(robot, 25, seed=4), np.random.default_rng(5)
    standard = generator.normal(size=len(robot.parameters()))
    friction = generator.normal(size=len(terms.parameters(robot)))
    parts = parts_of(robot, motion, standard)
    bodies = parts.total if model.model == "full" else parts.gravity
    labels = robot.parameters().labels
    columns = [labels.index(label) for label in robot.parameters(model.model).labels]
    values = model.base.values(np.concatenate([standard[columns], friction]))
    expected = bodies + joint_forces(robot, terms, motion, friction)
    np.testing.assert_allclose(
        model.regressor(motion) @ values, expected, atol=1e-9 * np.abs(expected).max()
    )


def test_the_prior_gives_the_forces_of_the_robot_file(case):
    robot, _, model = case
    motion = random_motion(robot, 25, seed=6)
    parts = parts_of(robot, motion)
    expected = parts.total if model.model == "full" else parts.gravity
    np.testing.assert_allclose(
        model.regressor(motion) @ model.prior, expected, atol=1e-9 * np.abs(expected).max()
    )


def test_every_column_belongs_to_bodies_or_to_joints(case):
    robot, _, model = case
    bodies, joints = set(model.body_columns), set(model.joint_columns)
    assert not bodies & joints
    assert bodies | joints == set(range(len(model.parameters)))
    labels = model.parameters.labels
    assert {labels[j].rpartition(".")[0] for j in joints} <= set(robot.actuated)
    assert {labels[j].rpartition(".")[0] for j in bodies} <= {body.link for body in robot.bodies}
    assert {label for j in joints for label in [labels[j].rpartition(".")[2]]} <= set(KINDS)


def test_parameters_are_the_leading_ones_in_the_order_of_the_columns(case):
    robot, terms, model = case
    assert model.parameters.labels == model.base.names
    assert set(model.parameters) <= set(motion_parameters(robot, model.model, terms))


@pytest.mark.parametrize("chunk", [1, 7, 30])
def test_memory_does_not_change_the_regressor(case, monkeypatch, chunk):
    robot, _, model = case
    motion = random_motion(robot, 30, seed=7)
    whole = model.regressor(motion)
    monkeypatch.setattr(force_model, "CHUNK", chunk)
    parts = model.regressor(motion)
    assert parts.shape == whole.shape
    np.testing.assert_allclose(parts, whole, atol=1e-12 * np.abs(whole).max())


def test_without_joint_terms_all_columns_are_bodies(knee):
    model = find_force_model(knee)
    assert (len(model.parameters), len(model.joint_columns)) == (15, 0)
    np.testing.assert_array_equal(model.body_columns, np.arange(15))
    np.testing.assert_allclose(model.prior, model.base.values(knee.standard_parameters("gravity")))


def test_friction_is_nothing_that_the_robot_file_knows(knee_model):
    assert len(knee_model.joint_columns) == 8
    assert not knee_model.prior[knee_model.joint_columns].any()


def test_samples_keep_forces_masks_and_stretches(knee, knee_model):
    motion, generator = random_motion(knee, 30, seed=8), np.random.default_rng(9)
    recording = record(knee, motion)
    masked = type(recording)(
        name=recording.name,
        actuators=recording.actuators,
        motion=motion,
        force=recording.force,
        used=generator.random((30, 4)) < 0.6,
        stretches=np.repeat([0, 1, 4], 10),
    )
    samples = knee_model.samples(masked)
    assert samples.parameters == knee_model.parameters
    assert samples.actuators == knee.actuated
    np.testing.assert_array_equal(samples.regressor, knee_model.regressor(motion))
    np.testing.assert_array_equal(samples.force, masked.force)
    np.testing.assert_array_equal(samples.used, masked.used)
    np.testing.assert_array_equal(samples.problem.samples, masked.used.sum(axis=0))
    assert [(piece.start, piece.stop) for piece in samples.pieces] == [(0, 10), (10, 20), (20, 30)]


def test_a_seed_gives_the_same_model_again(knee, terms):
    first, again = (find_force_model(knee, "gravity", terms[0], seed=3) for _ in range(2))
    assert first.parameters == again.parameters
    np.testing.assert_array_equal(first.base.matrix, again.base.matrix)
