"""Regressors give inverse dynamics, by work and energy too."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

import loopid
from loopid import JointTerms, random_configurations
from loopid.base_parameters import find_base
from loopid.errors import DataError, OptionError
from loopid.kinematics import (
    assemble,
    closed_motion,
    measured_coordinates,
    project,
    random_motions,
    torque_regressors,
)
from loopid.regressors import (
    force_parts,
    gravity_regressor,
    motion_regressor,
    structural_observation,
)
from loopid.regressors.motion_regressors import motion_parameters

TREES = {
    "ur5": ("ur_description/urdf/ur5_robot.urdf", ()),
    "panda": (
        "panda_description/urdf/panda.urdf",
        ("panda_finger_joint1", "panda_finger_joint2"),
    ),
    "kinova": ("kinova_description/robots/kinova.urdf", ()),
}


def random_states(robot, count, seed):
    generator = np.random.default_rng(seed)
    nv = robot.model.nv
    steps, v, a = generator.uniform(-1, 1, size=(3, count, nv))
    q = np.array([pin.integrate(robot.model, robot.reference, step) for step in steps])
    return q, v, a


def assert_inverse_dynamics(robot, inverse_dynamics):
    q, v, a = random_states(robot, 5, seed=2)
    Y = torque_regressors(robot, q, v, a)
    assert Y.shape == (5, robot.model.nv, len(robot.parameters()))
    expected = inverse_dynamics(robot, q, v, a)
    scale = np.abs(expected).max()
    np.testing.assert_allclose(Y @ robot.standard_parameters(), expected, atol=1e-12 * scale)


def test_open_loops_move_by_inverse_dynamics(loops, inverse_dynamics):
    for robot in loops.values():
        assert_inverse_dynamics(robot, inverse_dynamics)


@pytest.mark.parametrize("name", TREES)
def test_serial_robots_move_by_inverse_dynamics(name, robot_data, inverse_dynamics):
    path, lock = TREES[name]
    assert_inverse_dynamics(loopid.load(robot_data / path, lock=lock), inverse_dynamics)


@pytest.mark.parametrize(
    ("name", "wrong"),
    [
        ("configurations", np.zeros((1, 5))),
        ("configurations", np.full((1, 13), np.nan)),
        ("velocities", np.zeros((1, 13))),
        ("velocities", np.zeros((2, 4))),
        ("accelerations", np.full((1, 4), np.inf)),
        ("accelerations", np.zeros((2, 4))),
    ],
)
def test_bad_states_are_refused_by_name(knee, name, wrong):
    states = dict.fromkeys(("velocities", "accelerations"), np.zeros((1, 4)))
    states = {"configurations": knee.reference[None]} | states | {name: wrong}
    with pytest.raises(DataError) as error:
        closed_motion(knee, **states)
    assert error.value.facts["argument"] == name


def test_an_unknown_model_is_refused(knee):
    with pytest.raises(OptionError, match=r"'static'.*gravity, full"):
        structural_observation(knee, "static")


def in_motion(robot, q, v, a):
    return motion_regressor(robot, closed_motion(robot, q, v, a))


def actuator_forces(moving):
    robot, q, rates, accelerations = moving
    return in_motion(robot, q, rates, accelerations) @ robot.standard_parameters()


def followed(robot, q, motion):
    """Closed configurations after a small motion (N, dof) of the actuated joints."""
    values = measured_coordinates(robot).read(q.copy()) + motion
    pairs = zip(values, q, strict=True)
    return np.concatenate([assemble(robot, value, start=start) for value, start in pairs])


def potential_energy(robot, q):
    data = robot.model.createData()
    return np.array([pin.computePotentialEnergy(robot.model, data, row) for row in q])


def kinetic_energy(robot, q, v):
    data = robot.model.createData()
    pairs = zip(q, v, strict=True)
    return np.array([pin.computeKineticEnergy(robot.model, data, *pair) for pair in pairs])


def with_random_inertias(robot, seed):
    """The same robot with other bodies."""
    model, generator = robot.model.copy(), np.random.default_rng(seed)
    for body in robot.bodies:
        spread = generator.normal(size=(3, 3))
        mass, lever = generator.uniform(0.5, 5.0), generator.normal(size=3)
        model.inertias[body.joint_id] = pin.Inertia(mass, lever, spread @ spread.T)
    return replace(robot, model=model)


def test_actuator_forces_are_projected_inverse_dynamics(moving, inverse_dynamics):
    robot, q, rates, accelerations = moving
    robot = with_random_inertias(robot, seed=3)
    G = project(robot, q).G
    v = np.einsum("nij,nj->ni", G, rates)
    gamma = closed_motion(robot, q, rates, accelerations).gamma
    tree = inverse_dynamics(robot, q, v, np.einsum("nij,nj->ni", G, accelerations) + gamma)
    expected = np.einsum("nij,ni->nj", G, tree)
    scale = np.abs(tree).max() * np.abs(G).max()
    found = actuator_forces((robot, q, rates, accelerations))
    np.testing.assert_allclose(found, expected, atol=1e-11 * scale)


def test_actuator_power_is_the_rate_of_energy(moving, rate, all_velocities):
    # No inverse dynamics, drift or gamma here: energies along the assembled motion alone.
    robot, q, rates, accelerations = moving
    rates, accelerations = 0.1 * rates, 0.1 * accelerations

    def energy(t):
        at = followed(robot, q, t * rates + t**2 / 2 * accelerations)
        v = all_velocities(robot, at, rates + t * accelerations)
        return potential_energy(robot, at) + kinetic_energy(robot, at, v)

    forces = actuator_forces((robot, q, rates, accelerations))
    power = np.einsum("ni,ni->n", forces, rates)
    np.testing.assert_allclose(power, rate(energy), rtol=1e-6, atol=1e-6)


def test_holding_forces_are_the_slopes_of_potential_energy(moving, rate):
    robot, q, _, _ = moving
    forces = gravity_regressor(robot, q) @ robot.standard_parameters("gravity")
    for motor in range(forces.shape[1]):
        step = np.eye(forces.shape[1])[motor]

        def energy(t, step=step):
            return potential_energy(robot, followed(robot, q, t * step))

        slope = rate(energy, 3e-4)
        np.testing.assert_allclose(forces[:, motor], slope, rtol=1e-6, atol=1e-5)


def test_gravity_columns_are_the_full_ones_at_rest(moving):
    robot, q, _, _ = moving
    rest = np.zeros((len(q), len(robot.actuated)))
    full = in_motion(robot, q, rest, rest)
    columns = {label: j for j, label in enumerate(robot.parameters().labels)}
    shared_ones = [columns[label] for label in robot.parameters("gravity").labels]
    gravity = gravity_regressor(robot, q)
    scale = np.abs(gravity).max()
    np.testing.assert_allclose(gravity, full[:, :, shared_ones], atol=1e-13 * scale)
    inertias = np.setdiff1d(np.arange(full.shape[2]), shared_ones)
    np.testing.assert_allclose(full[:, :, inertias], 0, atol=1e-12 * scale)


@pytest.mark.parametrize("names", [("pinned bar", "welded bar"), ("3ups_rpu", "welded knee")])
def test_forces_do_not_depend_on_where_the_loops_are_cut(loops, names):
    pinned, welded = (loops[name] for name in names)
    assert pinned.parameters() == welded.parameters()
    strokes = measured_coordinates(pinned).read(random_configurations(pinned, 10, seed=0))
    motions = random_motions(pinned, 10, seed=0)
    one, other = (
        in_motion(robot, assemble(robot, strokes), *motions) for robot in (pinned, welded)
    )
    np.testing.assert_allclose(one, other, atol=1e-10 * np.abs(one).max())


def test_without_loops_it_is_the_trees_regressor(knee):
    tree = replace(knee, closures=(), actuated=knee.joints)
    q = random_configurations(tree, 4, seed=1)
    v, a = random_motions(tree, 4, seed=1)
    Y = torque_regressors(tree, q, v, a)
    scale = np.abs(Y).max()
    np.testing.assert_allclose(in_motion(tree, q, v, a), Y, atol=1e-14 * scale)


def test_rows_follow_the_order_of_the_motors(mechanism, poses):
    backwards = replace(mechanism, actuated=mechanism.actuated[::-1])
    np.testing.assert_allclose(
        gravity_regressor(backwards, poses),
        gravity_regressor(mechanism, poses)[:, ::-1],
        atol=1e-9,
    )


def test_one_sample_may_come_without_its_axis(mechanism, poses):
    rates = np.array([0.1, -0.2, 0.3, 0.4])
    alone = in_motion(mechanism, poses[0], rates, -rates)
    stacked = in_motion(mechanism, poses[:1], rates[None], -rates[None])
    np.testing.assert_array_equal(alone, stacked)


@pytest.mark.parametrize(
    ("name", "shapes"),
    [
        ("velocities", ((12, 3), (12, 4))),
        ("velocities", ((5, 4), (12, 4))),
        ("accelerations", ((12, 4), (12, 13))),
        ("accelerations", ((12, 4), (1, 4))),
    ],
)
def test_motions_of_the_wrong_shape_are_refused(mechanism, poses, name, shapes):
    with pytest.raises(DataError) as error:
        in_motion(mechanism, poses, *(np.zeros(shape) for shape in shapes))
    assert error.value.facts["argument"] == name


def test_motions_that_are_not_finite_are_refused(mechanism, poses):
    good, bad = np.zeros((12, 4)), np.full((12, 4), np.nan)
    for name, rates in (("velocities", (bad, good)), ("accelerations", (good, bad))):
        with pytest.raises(DataError) as error:
            in_motion(mechanism, poses, *rates)
        assert error.value.facts["argument"] == name


KINDS = ("Ia", "Fc", "Fc~0.7", "Fv", "Ks3")


def test_the_gravity_model_does_not_see_the_motion(moving, motion):
    robot, q, rates, accelerations = moving
    columns = motion_regressor(robot, motion, "gravity")
    scale = np.abs(columns).max()
    np.testing.assert_allclose(columns, gravity_regressor(robot, q), atol=1e-13 * scale)
    faster = closed_motion(robot, q, 5 * rates, -accelerations)
    np.testing.assert_array_equal(motion_regressor(robot, faster, "gravity"), columns)


@pytest.mark.parametrize("model", ["gravity", "full"])
def test_joint_terms_follow_the_bodies(moving, motion, model):
    robot = moving[0]
    terms = JointTerms(robot.actuated, KINDS)
    both = motion_regressor(robot, motion, model, joint_terms=terms)
    width = len(robot.parameters(model))
    np.testing.assert_array_equal(both[:, :, :width], motion_regressor(robot, motion, model))
    np.testing.assert_array_equal(both[:, :, width:], terms.columns(robot, motion))


@pytest.mark.parametrize("model", ["gravity", "full"])
def test_joint_forces_reach_the_motors_through_the_loops(moving, motion, model, joint_signals):
    # By hand: the terms of every joint, passive ones too, pressed through the transposed Gᵀ.
    robot = moving[0]
    G = motion.projection.G
    signals = joint_signals
    terms = JointTerms(robot.joints, tuple(signals))
    phi = np.random.default_rng(4).normal(size=(len(robot.joints), len(signals)))
    in_joints = sum(phi[:, k] * signal for k, signal in enumerate(signals.values()))
    columns = motion_regressor(robot, motion, model, joint_terms=terms)[
        :, :, len(robot.parameters(model)) :
    ]
    expected = np.einsum("nji,nj->ni", G, in_joints)
    np.testing.assert_allclose(columns @ phi.ravel(), expected, atol=1e-12 * np.abs(expected).max())


@pytest.mark.parametrize("model", ["gravity", "full"])
def test_labels_name_the_columns(moving, motion, model):
    robot = moving[0]
    terms = JointTerms(robot.actuated, ("Fv", "Fc"))
    names = motion_parameters(robot, model, terms)
    assert names.labels == (
        *robot.parameters(model).labels,
        *(f"{joint}.{kind}" for joint in robot.actuated for kind in ("Fv", "Fc")),
    )
    assert motion_regressor(robot, motion, model, joint_terms=terms).shape[2] == len(names)
    assert motion_parameters(robot, model) == robot.parameters(model)


def test_an_unknown_model_of_a_motion_is_refused(knee, moving, motion):
    with pytest.raises(OptionError, match=r"'half'.*gravity, full"):
        motion_regressor(moving[0], motion, "half")


@pytest.mark.parametrize("model", ["gravity", "full"])
def test_random_motion_tells_every_term_of_the_motors_from_the_bodies(knee, model):
    terms = JointTerms(knee.actuated, KINDS)
    count = len(terms.parameters(knee))
    observation = structural_observation(knee, model, joint_terms=terms)
    assert observation.parameters == motion_parameters(knee, model, terms)
    found = find_base(observation)
    alone = find_base(structural_observation(knee, model))
    assert len(found) == len(alone) + count
    assert set(terms.parameters(knee).labels) <= set(found.names)
    q, motions = random_configurations(knee, 40, seed=5), random_motions(knee, 40, seed=8)
    fresh = motion_regressor(knee, closed_motion(knee, q, *motions), model, joint_terms=terms)
    assert found.reconstruction_error(fresh) < 1e-11


def test_a_seed_gives_the_same_moving_poses_again(knee):
    terms = JointTerms(knee.actuated)
    first, again, other = (
        structural_observation(knee, samples=40, seed=seed, joint_terms=terms) for seed in (2, 2, 3)
    )
    np.testing.assert_array_equal(first.factor, again.factor)
    assert not np.array_equal(first.factor, other.factor)


def close(actual, expected, scale):
    np.testing.assert_allclose(actual, expected, atol=1e-11 * scale)


def test_parts_add_up_for_any_parameters(moving):
    robot, *state = moving
    pi = np.random.default_rng(0).normal(size=len(robot.parameters()))
    parts = force_parts(robot, *state, standard_parameters=pi)
    K = in_motion(robot, *state)
    close(parts.total, K @ pi, np.abs(K).max() * np.abs(pi).max())


def test_inertial_forces_are_linear_in_the_accelerations_alone(moving):
    robot, q, rates, accelerations = moving
    parts = force_parts(robot, q, rates, accelerations)
    scale = np.abs(parts.total).max()
    tripled = force_parts(robot, q, 0.5 * rates, 3 * accelerations)
    close(tripled.inertial, 3 * parts.inertial, scale)
    close(force_parts(robot, q, rates, 0 * accelerations).inertial, 0, scale)


def test_coriolis_forces_are_quadratic_in_the_velocities_alone(moving):
    robot, q, rates, accelerations = moving
    parts = force_parts(robot, q, rates, accelerations)
    scale = np.abs(parts.total).max()
    doubled = force_parts(robot, q, 2 * rates, -accelerations)
    close(doubled.coriolis, 4 * parts.coriolis, scale)
    close(force_parts(robot, q, -rates, accelerations).coriolis, parts.coriolis, scale)


def test_gravity_is_what_holds_the_robot_at_rest(moving):
    robot, q, rates, accelerations = moving
    parts = force_parts(robot, q, rates, accelerations)
    held = gravity_regressor(robot, q) @ robot.standard_parameters("gravity")
    close(parts.gravity, held, np.abs(held).max())


def test_inertial_forces_do_positive_work_on_the_accelerations(moving):
    # The projected mass matrix is positive definite: üᵀ M ü > 0.
    robot, q, rates, accelerations = moving
    inertial = force_parts(robot, q, rates, accelerations).inertial
    assert (np.einsum("ni,ni->n", inertial, accelerations) > 0).all()


@pytest.mark.parametrize("wrong", [np.ones(7), np.full(90, np.nan)])
def test_wrong_parameters_are_refused(knee, wrong):
    rest = np.zeros((1, 4))
    with pytest.raises(DataError, match="standard parameters"):
        force_parts(knee, knee.reference[None], rest, rest, standard_parameters=wrong)


def tree_columns(robot, q, v, a, model="full"):
    """Y (N, nv, n) by Pinocchio."""
    data, columns = robot.model.createData(), robot.columns(model)
    states = zip(q, v, a, strict=True)
    wholes = (pin.computeJointTorqueRegressor(robot.model, data, *state) for state in states)
    return np.array([whole.reshape(robot.model.nv, -1)[:, columns] for whole in wholes])


def test_both_regressors_are_projections_of_pinocchios(moving):
    robot, q, rates, second = moving
    motion = closed_motion(robot, q, rates, second)
    still = np.zeros_like(motion.velocities)
    for found, Y in (
        (
            in_motion(*moving),
            tree_columns(robot, q, motion.velocities, motion.accelerations),
        ),
        (gravity_regressor(robot, q), tree_columns(robot, q, still, still, "gravity")),
    ):
        expected = np.einsum("nji,njk->nik", motion.projection.G, Y)
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12 * np.abs(expected).max())


@pytest.mark.parametrize("count", [1, 30])
def test_pinocchio_is_asked_for_one_regressor_a_sample(moving, count, monkeypatch):
    robot = moving[0]
    q, rates = random_configurations(robot, count), random_motions(robot, count)
    ask, calls = pin.computeJointTorqueRegressor, []

    def counted(*arguments):
        calls.append(arguments)
        return ask(*arguments)

    monkeypatch.setattr(pin, "computeJointTorqueRegressor", counted)
    gravity_regressor(robot, q)
    assert len(calls) == count
    in_motion(robot, q, *rates)
    assert len(calls) == 2 * count


@pytest.mark.parametrize("away", [0.0, 1e4])
def test_where_the_robot_stands_costs_few_digits(knee, away):
    q, rates = random_configurations(knee, 3, seed=0), random_motions(knee, 3, seed=0)
    model = knee.model.copy()
    for k in range(1, model.njoints):
        if model.parents[k] == 0:
            model.jointPlacements[k].translation += away * np.array([1.0, -2.0, 3.0])
    expected = in_motion(knee, q, *rates)
    found = in_motion(replace(knee, model=model), q, *rates)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9 * np.abs(expected).max())


def test_samples_do_not_depend_on_their_neighbours(knee):
    q, rates = random_configurations(knee, 60, seed=5), random_motions(knee, 60, seed=1)
    whole = in_motion(knee, q, *rates)
    for size in (7, 1):
        parts = [slice(first, first + size) for first in range(0, 60, size)]
        found = [in_motion(knee, q[k], *(rate[k] for rate in rates)) for k in parts]
        np.testing.assert_allclose(np.concatenate(found), whole, atol=1e-13 * np.abs(whole).max())


def test_no_samples_give_no_rows(knee):
    none = np.empty((0, 4))
    assert in_motion(knee, np.empty((0, knee.model.nq)), none, none).shape == (0, 4, 90)
    assert gravity_regressor(knee, np.empty((0, knee.model.nq))).shape == (0, 4, 36)
