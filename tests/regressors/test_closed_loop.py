"""A robot that is asked again and again: one sample as many, laws of motion and force in both."""

import copy
import pickle
import threading
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from scipy.optimize import brentq

from linkages import LINKAGES
from loopid import (
    ClosedLoop,
    assemble,
    dynamic_regressor,
    gravity_regressor,
    load_mechanism,
    random_configurations,
)
from loopid.errors import AssemblyError, DataError, OptionError, SingularityError
from loopid.kinematics import (
    AssemblyOptions,
    closed_motion,
    constraint_residual,
    measured_coordinates,
    platform_coordinates,
    platform_motion,
    project,
    random_motions,
)

COUNT = 5
# Redundant rows, couplings, joints without end, balls that spin, redundant motors, floating bases.
ROBOTS = (*LINKAGES, "3ups_rpu", "6ups", "delta", "endless", "flying")


@pytest.fixture(scope="module", params=ROBOTS)
def robot(request, linkage, load_once, load_files, four_bars):
    name = request.param
    if name == "flying":
        return load_files(*LINKAGES["geared five-bar"], floating_base=True)
    others = {"endless": four_bars["6d"]}
    if name in others:
        return others[name]
    return linkage(name) if name in LINKAGES else load_once(name)


@pytest.fixture(scope="module")
def loop(robot):
    return ClosedLoop(robot)


@pytest.fixture(scope="module")
def states(robot):
    q = random_configurations(robot, COUNT, seed=5)
    return q, *random_motions(robot, COUNT, seed=7)


def answers(loop, q, v, a):
    """All that an object says of states."""
    return {
        "residual": loop.residual(q),
        "G": loop.velocity_map(q),
        "gamma": loop.gamma(q, v),
        "gravity": loop.gravity_regressor(q),
        "full": loop.dynamic_regressor(q, v, a),
        "holding": loop.forces(q),
        "forces": loop.forces(q, v, a),
        "mass": loop.mass_matrix(q),
    }


def test_one_sample_is_answered_as_many(loop, states):
    many = answers(loop, *states)
    for k, state in enumerate(zip(*states, strict=True)):
        for name, one in answers(loop, *state).items():
            assert one.shape == many[name].shape[1:], name
            scale = max(np.abs(many[name]).max(initial=0.0), 1e-3)
            np.testing.assert_allclose(one, many[name][k], rtol=0, atol=1e-12 * scale)


def test_one_sample_is_assembled_as_many(robot, loop, states):
    values = measured_coordinates(robot).read(states[0].copy())
    many = loop.assemble(values)
    np.testing.assert_allclose(many, assemble(robot, values), rtol=0, atol=1e-12)
    one = np.array([loop.assemble(value) for value in values])
    np.testing.assert_allclose(one, many, rtol=0, atol=1e-12)


def test_warm_starts_lead_to_the_same_configurations(robot, loop, states):
    """A millisecond later, as a controller asks: at the measured values, and closed."""
    measured = measured_coordinates(robot)
    for q, rates in zip(states[0], states[1], strict=True):
        spinning = len(rates) - measured.width  # parts of joints, that are not measured
        rates = rates[np.isin(robot.independent, robot.measured)] if spinning else rates
        value = measured.read(q[None].copy())[0] + 1e-3 * rates
        found = loop.assemble(value, start=q)
        off = measured.difference(measured.read(found[None]), value[None])
        np.testing.assert_allclose(off, 0, atol=1e-12)
        assert np.abs(loop.residual(found)).max(initial=0.0) < 1e-13 * max(robot.length, 1.0)
        far = assemble(robot, [value], start=q, options=AssemblyOptions(near=0.0))[0]
        np.testing.assert_allclose(found, far, rtol=0, atol=1e-12)


def test_the_functions_say_the_same(robot, loop, states):
    q, v, a = states
    motion = closed_motion(robot, q, v, a)
    pairs = [
        (loop.velocity_map(q), project(robot, q).G),
        (loop.gamma(q, v), motion.gamma),
        (loop.residual(q), constraint_residual(robot, q)),
        (loop.gravity_regressor(q), gravity_regressor(robot, q)),
        (loop.dynamic_regressor(q, v, a), dynamic_regressor(robot, q, v, accelerations=a)),
    ]
    for found, expected in pairs:
        np.testing.assert_array_equal(found, expected)


def test_forces_are_projected_inverse_dynamics(robot, loop, states, inverse_dynamics):
    if robot.tied:
        pytest.skip("shared parameters are means")
    q, v, a = states
    G = loop.velocity_map(q)
    velocity = np.einsum("nij,nj->ni", G, v)
    acceleration = np.einsum("nij,nj->ni", G, a) + loop.gamma(q, v)
    tree = inverse_dynamics(robot, q, velocity, acceleration)
    expected = np.einsum("nij,ni->nj", G, tree)
    scale = np.abs(tree).max() * np.abs(G).max()
    np.testing.assert_allclose(loop.forces(q, v, a), expected, rtol=0, atol=1e-11 * scale)
    for k in range(COUNT):
        one = loop.forces(q[k], v[k], a[k])
        np.testing.assert_allclose(one, expected[k], rtol=0, atol=1e-11 * scale)


def test_the_mass_matrix_is_that_of_the_tree_projected(robot, loop, states):
    data, q = robot.model.createData(), states[0]
    for configuration in q:
        M = pin.crba(robot.model, data, configuration)
        M = np.triu(M) + np.triu(M, 1).T
        G = loop.velocity_map(configuration)
        expected = G.T @ M @ G
        found = loop.mass_matrix(configuration)
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-10 * np.abs(expected).max())


def test_forces_are_those_of_given_parameters(loop, states):
    q, v, a = states
    pi = np.random.default_rng(0).normal(size=len(loop.mechanism.parameters()))
    K = loop.dynamic_regressor(q, v, a)
    found = loop.forces(q, v, a, standard_parameters=pi)
    scale = np.abs(K).max()
    np.testing.assert_allclose(found, K @ pi, rtol=0, atol=1e-12 * scale)
    held = loop.forces(q[0], standard_parameters=2 * loop.standard_parameters)
    np.testing.assert_allclose(held, 2 * loop.forces(q[0]), rtol=1e-12)
    heavier = loop.mass_matrix(q[0], standard_parameters=3 * loop.standard_parameters)
    expected = 3 * loop.mass_matrix(q[0])
    np.testing.assert_allclose(heavier, expected, atol=1e-10 * np.abs(expected).max())


def test_copies_and_pickles_answer_alike(loop, states):
    before = answers(loop, *states)
    for made in (copy.copy(loop), copy.deepcopy(loop), pickle.loads(pickle.dumps(loop))):
        for name, answer in answers(made, *states).items():
            np.testing.assert_array_equal(answer, before[name], err_msg=name)


@pytest.fixture(scope="module")
def parallel(load_once):
    return ClosedLoop(load_once("3ups_rpu"))


def test_threads_may_share_it(parallel):
    q = random_configurations(parallel.mechanism, 40, seed=1)
    expected, found = parallel.forces(q), {}

    def ask(part):
        found[part] = np.array([parallel.forces(one) for one in q[part::4] for _ in range(5)])

    threads = [threading.Thread(target=ask, args=(part,)) for part in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for part, forces in found.items():
        np.testing.assert_allclose(forces[::5], expected[part::4], rtol=1e-12)
    assert len(found) == 4


def test_the_platform_moves_by_its_jacobian(parallel, rate):
    robot = parallel.mechanism
    q = random_configurations(robot, COUNT, seed=2)
    v = random_motions(robot, COUNT, seed=3)[0]
    J = parallel.platform_jacobian(q)
    np.testing.assert_allclose(J[2], parallel.platform_jacobian(q[2]), atol=1e-12)
    x = parallel.platform_coordinates(q)
    np.testing.assert_array_equal(x, platform_coordinates(robot, q))
    strokes = measured_coordinates(robot).read(q.copy())
    for k in range(COUNT):

        def ahead(t, k=k):
            return parallel.platform_coordinates(
                parallel.assemble(strokes[k] + 0.05 * t * v[k], start=q[k])
            )

        np.testing.assert_allclose(0.05 * J[k] @ v[k], rate(ahead), atol=1e-7)
    # Back again: the motors' rates from those of the platform.
    rates = np.einsum("nij,nj->ni", J, v)
    again, _ = platform_motion(robot, q, rates, np.zeros_like(rates))
    motors = robot.velocity_indices(robot.independent)
    np.testing.assert_allclose(again[:, motors], v, atol=1e-9)


def test_virtual_work_of_the_platform(parallel):
    """Forces at the platform, through its Jacobian, do the work of the motors' forces."""
    robot = parallel.mechanism
    q, v = random_configurations(robot, 1, seed=4)[0], np.array([0.1, -0.2, 0.3, 0.05])
    wrench = np.array([3.0, -20.0, 4.0, 1.5])
    J = parallel.platform_jacobian(q)
    assert (J.T @ wrench) @ v == pytest.approx(wrench @ (J @ v), rel=1e-12)
    assert np.linalg.matrix_rank(J) == 4


@pytest.mark.parametrize(
    "wrong", [np.zeros(12), np.full(13, np.nan), np.zeros((2, 2, 13)), ["far"] * 13]
)
def test_wrong_configurations_are_refused(parallel, wrong):
    with pytest.raises(DataError):
        parallel.forces(wrong)


def test_wrong_values_are_refused(parallel):
    reference = parallel.mechanism.reference
    with pytest.raises(DataError):
        parallel.assemble(np.zeros(3))
    with pytest.raises(DataError):
        parallel.forces(reference, np.zeros(4), np.zeros(5))
    with pytest.raises(DataError) as error:
        parallel.forces(reference, standard_parameters=np.zeros(7))
    assert error.value.facts["given"] == (7,)
    with pytest.raises(AssemblyError) as lost:
        parallel.assemble(np.full(4, 9.0))
    assert lost.value.facts["sample"] == 0
    assert lost.value.facts["residual"] > lost.value.facts["tolerance"]


def test_what_is_not_declared_is_refused(load_once):
    with pytest.raises(OptionError) as error:
        ClosedLoop(load_once("five_bar")).platform_jacobian(load_once("five_bar").reference)
    assert error.value.facts["robot"] == "five_bar"


def test_a_singular_sample_is_refused_alone_and_among_others(parallel):
    # Turned so far, the motors lose the yaw of the platform: their rates do not tell its own.
    robot, limb = parallel.mechanism, ("leg4_revolute", "leg4_stroke", "platform_pitch",
                                       "platform_yaw")  # fmt: skip
    motors = robot.velocity_indices(robot.actuated)

    def at(yaw):
        return assemble(robot, [0, 0.7, 0, yaw], "platform")

    def determinant(yaw):
        return np.linalg.det(project(robot, at(yaw), independent=limb).G[0, motors])

    q = at(brentq(determinant, 0.4, 0.6, xtol=1e-14))[0]
    with pytest.raises(SingularityError) as alone:
        parallel.forces(q)
    with pytest.raises(SingularityError) as among:
        parallel.forces(np.stack([robot.reference, q]))
    assert (alone.value.facts["sample"], among.value.facts["sample"]) == (0, 1)
    assert alone.value.facts["rank"] < alone.value.facts["dependent"] == 9
    assert alone.value.facts["measure"] <= alone.value.facts["tolerance"]


def test_options_say_how_closely_loops_are_closed(parallel):
    robot = parallel.mechanism
    loose = ClosedLoop(robot, options=AssemblyOptions(tolerance=1e-3, short=1e-2, near=0.0))
    strokes = measured_coordinates(robot).read(robot.reference[None])[0] + 0.02
    rough, exact = loose.assemble(strokes), parallel.assemble(strokes)
    assert 1e-13 < np.abs(rough - exact).max() < 1e-2
    assert np.abs(loose.residual(rough)).max() < 1e-3


def test_another_robot_is_another_object(parallel):
    robot = parallel.mechanism
    model = robot.model.copy()
    model.inertias[robot.bodies[-1].joint_id] = pin.Inertia(
        5.0, np.array([0.1, 0.2, 0.3]), np.eye(3)
    )
    q = robot.reference
    other = ClosedLoop(replace(robot, model=model))
    assert np.abs(other.forces(q) - parallel.forces(q)).max() > 1e-3
    np.testing.assert_array_equal(other.velocity_map(q), parallel.velocity_map(q))


def test_a_welded_knee_moves_like_the_pinned_one(parallel, load_once, weld):
    welded = ClosedLoop(load_mechanism(weld(parallel.mechanism.path)))
    strokes = measured_coordinates(parallel.mechanism).read(
        random_configurations(parallel.mechanism, 3, seed=1)
    )
    for stroke in strokes:
        one, other = (loop.forces(loop.assemble(stroke)) for loop in (parallel, welded))
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-9 * np.abs(one).max())
