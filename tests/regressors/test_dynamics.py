"""One object for forces and motion: one sample as many, bodies of a file as values of a fit."""

import copy
import pickle
import threading
from dataclasses import replace
from functools import partial

import numpy as np
import pinocchio as pin
import polars
import pytest
from scipy.optimize import brentq

import loopid
from bank_robots import few_of
from linkages import LINKAGES, MOVED
from loopid import Dynamics, random_configurations
from loopid.base_parameters.rank import DoubtfulCombination
from loopid.errors import AssemblyError, DataError, MobilityError, OptionError, SingularityError
from loopid.kinematics import (
    AssemblyOptions,
    assemble,
    closed_motion,
    constraint_residual,
    measured_coordinates,
    platform_coordinates,
    project,
    random_motions,
)
from loopid.kinematics.measured import platform_motion

COUNT = 5
# Redundant rows, couplings, joints without end, balls that spin, redundant motors, floating bases.
OTHERS = ("3ups_rpu", "delta", "endless", "flying")
ROBOTS = few_of((*LINKAGES, "6ups", *OTHERS), *MOVED, *OTHERS)
FITTED = few_of(loopid.bundled_robots(), "3ups_rpu", "five_bar")


def close(found, expected, tolerance, scale=None):
    size = np.abs(expected).max() if scale is None else scale
    assert np.shape(found) == np.shape(expected)
    assert np.abs(found - expected).max(initial=0.0) <= tolerance * size


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
def dynamics(robot):
    return Dynamics(robot)


@pytest.fixture(scope="module")
def states(robot):
    q = random_configurations(robot, COUNT, seed=5)
    return q, *random_motions(robot, COUNT, seed=7)


def answers(dynamics, q, v, a):
    """All that an object says of states."""
    pose = dynamics.pose(q=q)
    return {
        "G": pose.G,
        "gamma": dynamics.gamma(pose, v),
        "K": dynamics.regressor(pose, v, a),
        "holding": dynamics.gravity(pose),
        "forces": dynamics.inverse(pose, v, a),
        "mass": dynamics.mass_matrix(pose),
        "coriolis": dynamics.coriolis(pose, v),
        "per unit": dynamics.mass_regressor(pose),
        "forward": dynamics.motion(pose, v, a)[1],
    }


def test_one_sample_is_answered_as_many(dynamics, states):
    many = answers(dynamics, *states)
    for k, state in enumerate(zip(*states, strict=True)):
        for name, one in answers(dynamics, *state).items():
            assert one.shape == many[name].shape[1:], name
            scale = max(np.abs(many[name]).max(initial=0.0), 1e-3)
            np.testing.assert_allclose(one, many[name][k], rtol=0, atol=1e-12 * scale)


def test_no_samples_are_answered_by_none(dynamics, states):
    one = answers(dynamics, *(values[:1] for values in states))
    for name, none in answers(dynamics, *(values[:0] for values in states)).items():
        assert none.shape == (0, *one[name].shape[1:]), name


OF_CONFIGURATIONS = {
    "residual": loopid.kinematics.constraint_residual,
    "jacobian": loopid.kinematics.constraint_jacobian,
    "drift": lambda robot, q: loopid.kinematics.constraint_drift(
        robot, q, 0.1 * np.ones((*q.shape[:-1], robot.model.nv))
    ),
    "platform": platform_coordinates,
    "gravity": loopid.regressors.gravity_regressor,
    "wrench": lambda robot, q: loopid.logs.wrench_forces(
        robot, q, [loopid.ExternalWrench("platform", np.ones((np.atleast_2d(q).shape[0], 6)))]
    ),
    "parts": lambda robot, q: (
        loopid.regressors.force_parts(
            robot,
            configurations=q,
            velocities=np.ones((*q.shape[:-1], 4)),
            accelerations=0 * q[..., :4],
        ).total
    ),
}


@pytest.mark.parametrize("name", OF_CONFIGURATIONS)
def test_functions_of_configurations_answer_one_sample_as_one(parallel, name):
    robot, function = parallel.robot, OF_CONFIGURATIONS[name]
    q = random_configurations(robot, 3, seed=4)
    np.testing.assert_allclose(function(robot, q[0]), function(robot, q)[0], atol=1e-12)
    np.testing.assert_array_equal(function(robot, q[:1])[0], function(robot, q[0]))


def test_a_single_coordinate_may_be_a_number(load_once):
    dynamics = Dynamics(load_once("four_bar"))
    (u,) = measured_coordinates(dynamics.robot).read(dynamics.start[None].copy())[0]
    assert dynamics.inverse(u, 0.1, 0.2) == dynamics.inverse([u], [0.1], [0.2])
    assert dynamics.mass_matrix(u).shape == (1, 1)


def test_columns_of_a_frame_are_taken_by_the_names_of_coordinates(load_once):
    dynamics = Dynamics(load_once("five_bar"))
    u, du, ddu = np.array([1.2, 1.9]) + np.random.default_rng(0).uniform(0.1, 0.2, (3, 5, 2))
    swapped = [
        polars.DataFrame(dict(zip(dynamics.robot.independent, x.T, strict=True)))[:, ::-1]
        for x in (u, du, ddu)
    ]
    tau = dynamics.inverse(u, du, ddu)
    equal = partial(np.testing.assert_allclose, rtol=1e-12, atol=1e-12)  # sums of other strides
    equal(dynamics.inverse(*swapped), tau)
    equal(dynamics.forward(*swapped[:2], tau), dynamics.forward(u, du, tau))
    equal(dynamics.coriolis(*swapped[:2]), dynamics.coriolis(u, du))


def test_positions_lead_to_poses_one_by_one_as_many(robot, dynamics, states):
    if robot.unmeasured:
        with pytest.raises(MobilityError, match=r"lock=\[.*dynamics\.pose\(q="):
            dynamics.assemble(np.zeros(len(robot.measured)))
        return
    u = measured_coordinates(robot).read(states[0].copy())
    many = dynamics.assemble(u)
    assert dynamics.assemble(u[:0]).shape == many[:0].shape
    close(many, assemble(robot, u), 1e-12, 1.0)
    close(dynamics.assemble(u, trajectory=True), assemble(robot, u, trajectory=True), 1e-12, 1.0)
    one = np.array([Dynamics(robot).assemble(each) for each in u])
    close(one, many, 1e-9, 1.0)
    close(dynamics.gravity(u), dynamics.gravity(dynamics.pose(q=many)), 1e-9)


def test_it_follows_a_motion_from_where_it_was(robot, states):
    """A millisecond later, as a controller asks: at the measured values, and closed."""
    if robot.unmeasured:
        return
    measured = measured_coordinates(robot)
    for q, rates in zip(states[0], states[1], strict=True):
        u = measured.read(q[None].copy())[0]
        dynamics = Dynamics(robot, start=q)
        for step in (1e-3, 2e-3):
            found = dynamics.assemble(u + step * rates)
            off = measured.difference(measured.read(found[None]), (u + step * rates)[None])
            close(off, 0 * off, 1e-11, 1.0)
            opening = constraint_residual(robot, found)
            assert np.abs(opening).max(initial=0.0) < 1e-11 * max(robot.length, 1.0)
            far = assemble(robot, [u + step * rates], start=q)
            close(found, far[0], 1e-10, 1.0)
        assert np.array_equal(dynamics.configuration, found)


def test_it_moves_as_the_projection_says(robot, dynamics, states):
    q, v, a = states
    motion, pose = closed_motion(robot, q, v, a), dynamics.pose(q=q)
    np.testing.assert_array_equal(dynamics.velocity_map(pose), project(robot, q).G)
    close(dynamics.gamma(pose, v), motion.gamma, 1e-12, max(1.0, np.abs(motion.gamma).max()))
    for found, expected in zip(
        dynamics.motion(pose, v, a), (motion.velocities, motion.accelerations), strict=True
    ):
        close(found, expected, 1e-12)


def test_forces_are_projected_inverse_dynamics(robot, dynamics, states, inverse_dynamics):
    if robot.tied:
        pytest.skip("shared parameters are means")
    q, v, a = states
    pose = dynamics.pose(q=q)
    tree = inverse_dynamics(robot, q, *dynamics.motion(pose, v, a))
    scale = np.abs(tree).max() * np.abs(pose.G).max()
    expected = np.einsum("nij,ni->nj", pose.G, tree)
    close(dynamics.inverse(pose, v, a), expected, 1e-11, scale)
    close(dynamics.regressor(pose, v, a) @ dynamics.values, expected, 1e-11, scale)
    rest = dynamics.regressor(pose) @ dynamics.values
    close(dynamics.inverse(pose), rest, 1e-11, scale)


def test_the_mass_matrix_is_that_of_the_tree_projected(robot, dynamics, states):
    data = robot.model.createData()
    for q in states[0]:
        pose = dynamics.pose(q=q)
        M = pin.crba(robot.model, data, q)
        M = np.triu(M) + np.triu(M, 1).T
        close(dynamics.mass_matrix(pose), pose.G.T @ M @ pose.G, 1e-10)
        close(dynamics.mass_regressor(pose) @ dynamics.values, dynamics.mass_matrix(pose), 1e-9)


def test_forward_dynamics_undo_inverse_dynamics(robot, dynamics, states):
    q, v, a = states
    pose = dynamics.pose(q=q)
    tau = dynamics.inverse(pose, v, a)
    again = dynamics.inverse(pose, v, dynamics.forward(pose, v, tau))
    # Of coordinates that no mass resists, any accelerations have these forces.
    close(again, tau, 1e-8, np.abs(tau).max() + 1e-3)


def test_values_may_be_other_bodies(robot, dynamics, states):
    pi = np.random.default_rng(0).normal(size=len(robot.parameters()))
    pose = dynamics.pose(q=states[0])
    K = dynamics.regressor(pose, *states[1:])
    other = Dynamics(robot, pi)  # no real ones: negative masses
    close(other.inverse(pose, *states[1:]), K @ pi, 1e-11, np.abs(K).max())
    heavier = Dynamics(robot, 3 * dynamics.values)
    close(heavier.mass_matrix(pose), 3 * dynamics.mass_matrix(pose), 1e-10)


def test_copies_and_pickles_answer_alike(dynamics, states):
    before = answers(dynamics, *states)
    for made in (
        copy.copy(dynamics),
        copy.deepcopy(dynamics),
        pickle.loads(pickle.dumps(dynamics)),
    ):
        for name, answer in answers(made, *states).items():
            np.testing.assert_array_equal(answer, before[name], err_msg=name)


@pytest.fixture(scope="module")
def parallel(load_once):
    return Dynamics(load_once("3ups_rpu"))


def test_blocks_of_samples_are_answered_as_one(parallel, monkeypatch):
    q = random_configurations(parallel.robot, 8, seed=1)
    v, a = random_motions(parallel.robot, 8, seed=1)
    whole = answers(parallel, q, v, a)
    monkeypatch.setattr("loopid.kinematics.poses.BLOCK", 3)
    for name, answer in answers(parallel, q, v, a).items():
        close(answer, whole[name], 1e-12)


def test_threads_may_share_it(parallel):
    q = random_configurations(parallel.robot, 40, seed=1)
    u = measured_coordinates(parallel.robot).read(q.copy())
    expected, found = parallel.gravity(parallel.pose(q=q)), {}

    def ask(part):
        found[part] = np.array([parallel.gravity(one) for one in u[part::4] for _ in range(5)])

    threads = [threading.Thread(target=ask, args=(part,)) for part in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for part, forces in found.items():
        close(forces[::5], expected[part::4], 1e-9)
    assert len(found) == 4


def test_the_platform_moves_by_its_jacobian(parallel, rate):
    robot = parallel.robot
    q = random_configurations(robot, COUNT, seed=2)
    v, pose = random_motions(robot, COUNT, seed=3)[0], parallel.pose(q=q)
    J = parallel.platform_jacobian(pose)
    close(J[2], parallel.platform_jacobian(parallel.pose(q=q[2])), 1e-12, 1.0)
    x = parallel.platform_coordinates(pose)
    np.testing.assert_array_equal(x, platform_coordinates(robot, q))
    strokes = measured_coordinates(robot).read(q.copy())
    for k in range(COUNT):
        near = Dynamics(robot, start=q[k])

        def ahead(t, k=k, near=near):
            return near.platform_coordinates(strokes[k] + 0.05 * t * v[k])

        np.testing.assert_allclose(0.05 * J[k] @ v[k], rate(ahead), atol=1e-7)
    # Back again: the motors' rates from those of the platform.
    rates = np.einsum("nij,nj->ni", J, v)
    again, _ = platform_motion(robot, q, rates, np.zeros_like(rates))
    motors = robot.velocity_indices(robot.independent)
    np.testing.assert_allclose(again[:, motors], v, atol=1e-9)
    assert np.linalg.matrix_rank(J[0]) == 4


@pytest.mark.parametrize(
    "wrong", [np.zeros(12), np.full(13, np.nan), np.zeros((2, 2, 13)), ["far"] * 13]
)
def test_wrong_configurations_are_refused(parallel, wrong):
    with pytest.raises(DataError):
        parallel.pose(q=wrong)


def test_wrong_arguments_are_refused(parallel, load_once):
    u = measured_coordinates(parallel.robot).read(parallel.start[None].copy())[0]
    with pytest.raises(DataError):
        parallel.gravity(np.zeros(3))
    with pytest.raises(DataError):
        parallel.inverse(u, np.zeros(4), np.zeros(5))
    with pytest.raises(DataError, match=r"velocities must have 2 rows"):
        parallel.inverse([u, u], np.zeros(4))
    with pytest.raises(DataError) as error:
        Dynamics(parallel.robot, np.zeros(7))
    assert error.value.facts["given"] == (7,)
    with pytest.raises(AssemblyError) as lost:
        parallel.gravity(np.full(4, 9.0))
    assert lost.value.facts["residual"] > lost.value.facts["tolerance"]
    five_bar = Dynamics(load_once("five_bar"))
    with pytest.raises(OptionError) as error:
        five_bar.platform_jacobian(five_bar.pose())
    assert error.value.facts["robot"] == "five_bar"
    with pytest.raises(OptionError) as refused:
        five_bar.payload_columns("elbow")
    assert "left_crank" in refused.value.facts["valid"]


def test_open_configurations_are_refused_and_those_with_four_digits_are_not(load_once):
    robot = load_once("five_bar")
    dynamics, model = Dynamics(robot), loopid.force_model(robot, "gravity", None)
    still = np.zeros(2)
    doors = (
        lambda q: dynamics.pose(q=q),
        lambda q: Dynamics(robot, start=q),
        lambda q: loopid.kinematics.project(robot, [robot.reference, q]),
        lambda q: loopid.kinematics.closed_motion(robot, q, still, still),
        lambda q: loopid.regressors.gravity_regressor(robot, q),
        model.regressor,
    )
    written, opened = robot.reference.round(4), robot.reference + np.array([0.01, 0, 0, 0])
    for door in doors:
        door(written)
        with pytest.raises(DataError, match=r"must be closed, but left_coup.* m \(at most") as said:
            door(opened)
        largest = np.abs(loopid.kinematics.constraint_residual(robot, opened)).max()
        assert said.value.facts["given"] == pytest.approx(largest)
        assert said.value.facts["tolerance"] < largest
    u = dynamics.pose(q=written).q[[0, 2]]  # the advice, followed
    for door in doors:
        door(dynamics.pose(u).q)


def test_starts_and_coefficients_are_checked_at_once(load_once):
    robot = load_once("five_bar")
    with pytest.raises(DataError, match=r"start must have shape \(4,\), not \(3,\)"):
        Dynamics(robot, start=[1, 2, 3])
    with pytest.raises(OptionError, match="unknown joint term 'Fcc'"):
        Dynamics(robot).coefficients("Fcc")
    assert not Dynamics(robot).coefficients("Fc").any()
    with pytest.raises(DataError, match=r"velocities must have shape \(2,\), not \(3,\)"):
        Dynamics(robot).inverse([2.0, 0.7], [1, 2, 3])


def test_a_singular_sample_is_refused_alone_and_among_others(parallel):
    # Turned so far, the motors lose the yaw of the platform: their rates do not tell its own.
    robot, limb = parallel.robot, ("leg4_revolute", "leg4_stroke", "platform_pitch",
                                   "platform_yaw")  # fmt: skip
    motors = robot.velocity_indices(robot.actuated)

    def at(yaw):
        return assemble(robot, [0, 0.7, 0, yaw], "platform")

    def determinant(yaw):
        return np.linalg.det(project(robot, at(yaw), independent=limb).G[0, motors])

    q = at(brentq(determinant, 0.4, 0.6, xtol=1e-14))[0]
    with pytest.raises(SingularityError) as alone:
        parallel.pose(q=q)
    with pytest.raises(SingularityError) as among:
        parallel.pose(q=np.stack([robot.reference, q]))
    assert (alone.value.facts["sample"], among.value.facts["sample"]) == (0, 1)
    assert alone.value.facts["rank"] < alone.value.facts["dependent"] == 9
    assert alone.value.facts["measure"] <= alone.value.facts["tolerance"]


def test_options_say_how_closely_loops_are_closed(parallel):
    robot = parallel.robot
    loose = Dynamics(robot, options=AssemblyOptions(tolerance=1e-3, short=1e-2))
    strokes = measured_coordinates(robot).read(robot.reference[None])[0] + 0.05
    rough, exact = loose.assemble([strokes]), parallel.assemble([strokes])
    assert 1e-13 < np.abs(rough - exact).max() < 1e-2
    assert np.abs(constraint_residual(robot, rough)).max() < 1e-3


def test_another_robot_is_another_object(parallel):
    robot = parallel.robot
    model = robot.model.copy()
    model.inertias[robot.bodies[-1].joint_id] = pin.Inertia(
        5.0, np.array([0.1, 0.2, 0.3]), np.eye(3)
    )
    other, pose = Dynamics(replace(robot, model=model)), parallel.pose()
    assert np.abs(other.gravity(other.pose()) - parallel.gravity(pose)).max() > 1e-3
    np.testing.assert_array_equal(other.pose().G, pose.G)
    with pytest.raises(OptionError, match="the pose is of another robot"):
        other.gravity(pose)
    with pytest.raises(OptionError, match="of positions u or of configurations q: give one"):
        parallel.pose(pose, q=pose.q)
    same = Dynamics(copy.deepcopy(robot))
    np.testing.assert_array_equal(same.gravity(pose), parallel.gravity(pose))


def test_a_welded_knee_moves_like_the_pinned_one(parallel, weld):
    welded = Dynamics(loopid.load(weld(parallel.robot.path)))
    q = random_configurations(parallel.robot, 3, seed=1)
    strokes = measured_coordinates(parallel.robot).read(q)
    close(welded.gravity(strokes), parallel.gravity(strokes), 1e-9)


# With values of a force model.


@pytest.fixture(params=FITTED)
def name(request):
    return request.param


def at(model, values, q, **options):
    """Dynamics at a configuration, and the positions there."""
    independent = model.robot.velocity_indices(model.robot.independent)
    return Dynamics(model, values, start=q, **options), q[independent]


def some_states(model, count=3):
    """Random closed configurations, velocities and accelerations."""
    q = random_configurations(model.robot, count, seed=4)
    rng = np.random.default_rng(0)
    return zip(q, *rng.standard_normal((2, count, len(model.robot.independent))), strict=True)


def test_forces_are_those_of_the_force_model(name, full_model, some_values):
    model, phi = full_model(name), some_values(name)
    for q, v, a in some_states(model):
        robot, u = at(model, phi, q)
        K = model.base.regressor(model.standard_regressor(q[None], v[None], a[None]))[0]
        close(robot.regressor(u, v, a), K, 1e-11)
        close(robot.inverse(u, v, a), K @ phi, 1e-10)
        # With bodies that no tree has, too.
        far = 1e3 * np.random.default_rng(1).standard_normal(len(phi))
        close(at(model, far, q)[0].inverse(u, v, a), K @ far, 1e-10, np.abs(K * far).max())


def test_parts_sum_up_to_the_forces(name, full_model, some_values):
    model, phi = full_model(name), some_values(name)
    for q, v, a in some_states(model):
        robot, u = at(model, phi, q)
        total = robot.mass_matrix(u) @ a + robot.coriolis(u, v) @ v + robot.gravity(u)
        close(total + robot.friction(u, v), robot.inverse(u, v, a), 1e-10)
        close(robot.friction_regressor(u, v) @ phi, robot.friction(u, v), 1e-12)
        close(robot.mass_regressor(u) @ phi, robot.mass_matrix(u), 1e-10)
        close(robot.forward(u, v, robot.inverse(u, v, a)), a, 1e-8)


@pytest.mark.parametrize("terms", ["Fc,Fv,Ia,Fk0~0.25,Fk~0.5,Fa~0.5,Fa1~1,Ft", "Fl~0.3,Fv,Ks,Ia"])
def test_friction_curves_and_loads_are_those_of_the_force_model(load_once, terms):
    model = loopid.force_model(load_once("five_bar"), "full", terms)
    phi = np.random.default_rng(1).standard_normal(len(model.parameters))
    loaded = model.with_loads(phi)
    for q, v, a in some_states(model):
        robot, u = at(model, phi, q)
        motion = loopid.motion.JointMotion(
            np.zeros(1), q[None], v[None], a[None], np.ones(1)
        )  # fmt: skip
        K = loaded.regressor(motion)[0]
        close(robot.regressor(u, v, a), K, 1e-10)
        close(robot.inverse(u, v, a), K @ phi, 1e-10)
        coast = robot.coriolis(u, v) @ v + robot.gravity(u)
        close(coast + robot.friction(u, v), robot.inverse(u, v), 1e-10)


@pytest.mark.parametrize("kinds", ["Fc,Fv,Ia,Ft", "Fv,Ia,Fl~0.3"])
def test_forward_dynamics_have_the_loads_of_their_accelerations(load_once, kinds):
    """The forces of a motion give that motion, for one state and for many."""
    model = loopid.force_model(load_once("five_bar"), "full", kinds)
    names, phi = model.parameters.names, model.prior.copy()
    for place in (k for k, name in enumerate(names) if name.endswith((".Ft", ".Fl~0.3"))):
        phi[place] = 0.3 if names[place].endswith(".Ft") else 0.01
    q, v, a = (np.array(each) for each in zip(*some_states(model), strict=True))
    robot = loopid.Dynamics(model, phi)
    pose = robot.pose(q=q)
    tau = robot.inverse(pose, v, a)
    close(robot.forward(pose, v, tau), a, 1e-8)
    for k in range(len(q)):
        one = robot.pose(q=q[k])
        close(robot.forward(one, v[k], tau[k]), a[k], 1e-8)


def test_values_of_a_fit_load_gears_as_the_fit_does(load_once):
    """A rotor in a value that a link leads is no load: not of the values, nor of generated code."""
    casadi = pytest.importorskip("casadi")
    model = loopid.force_model(load_once("five_bar"), "full", "Ia,Ft")
    phi = np.where([name.endswith(".Ft") for name in model.parameters.names], 0.3, model.prior)
    drives = np.zeros(len(phi))
    drives[model.body_columns[0]] = 0.2
    fitted = replace(model, bodies=model.load_values, drives=drives)
    again = fitted.with_loads(phi + drives)
    close(again.load_values[model.body_columns], phi[model.body_columns], 1e-12)
    code = casadi.Function.deserialize(loopid.export.c_source(fitted).casadi)
    for q, v, a in some_states(model):
        robot, u = at(fitted, phi + drives, q)
        force = code(q=q, du=v, ddu=a, phi=phi + drives)["force"]
        close(force.full().ravel(), robot.inverse(u, v, a), 1e-10)


def test_load_friction_that_locks_a_gear_is_an_error(load_once):
    model = loopid.force_model(load_once("five_bar"), "full", "Ft")
    phi = np.where([name.endswith(".Ft") for name in model.parameters.names], 3.0, model.prior)
    q, v, a = next(iter(some_states(model)))
    robot, u = at(model, phi, q)
    with pytest.raises(loopid.errors.SingularityError, match="load friction"):
        robot.forward(u, v, robot.inverse(u, v, a) + 1.0)


def test_combinations_that_are_doubtful_keep_the_regressor(full_model, some_values):
    """There bodies would have what the combinations that count have not."""
    model, phi = full_model("five_bar"), some_values("five_bar")
    lost = replace(model.base.structure, doubtful=(DoubtfulCombination({}, 0.0, 0.0),))
    doubtful = replace(model, base=replace(model.base, structure=lost))
    for q, v, a in some_states(model):
        plain, u = at(model, phi, q)
        robot, _ = at(doubtful, phi, q)
        assert robot._bodies.tree is None
        assert plain._bodies.tree is not None
        close(robot.inverse(u, v, a), plain.inverse(u, v, a), 1e-10)
        close(robot.mass_matrix(u), plain.mass_matrix(u), 1e-10)
        close(robot.coriolis(u, v), plain.coriolis(u, v), 1e-9)


@pytest.mark.parametrize("robot_name", ["3ups_rpu", "five_bar"])
def test_the_rate_of_the_mass_matrix_less_two_coriolis_is_skew(robot_name, full_model, some_values):
    model = full_model(robot_name)
    for q, v, _ in some_states(model):
        robot, u = at(model, some_values(robot_name), q)
        C, h = robot.coriolis(u, v), 2e-4
        near = robot.mass_matrix(u + h * v) - robot.mass_matrix(u - h * v)
        far = robot.mass_matrix(u + 2 * h * v) - robot.mass_matrix(u - 2 * h * v)
        S = (8 * near - far) / (12 * h) - 2 * C
        close(S, -S.T, 1e-5)


def test_the_deviation_is_that_of_forces_of_random_values(full_model):
    model = full_model("five_bar")
    (q, v, a), *_ = some_states(model)
    robot, u = at(model, None, q)
    root = np.random.default_rng(1).standard_normal(2 * robot.covariance.shape[:1]) / 10
    robot.covariance = root @ root.T
    draws = model.prior + np.random.default_rng(2).standard_normal((4000, len(root))) @ root.T
    spread = (draws @ robot.regressor(u, v, a).T).std(axis=0)
    close(robot.deviation(u, v, a), spread, 0.05)


def test_where_the_loops_do_not_close_the_last_pose_stays(load_once):
    robot = Dynamics(load_once("five_bar"))
    u = measured_coordinates(robot.robot).read(robot.start[None].copy())[0]
    before = robot.assemble(u)
    with pytest.raises(AssemblyError):
        robot.assemble([3.0, 0.1])
    assert np.array_equal(robot.configuration, before)
    assert np.array_equal(robot.assemble(u), before)


def test_positions_near_the_pose_share_it_where_they_may(parallel):
    robot = Dynamics(parallel.robot, near=1e-4)
    u = measured_coordinates(robot.robot).read(robot.start[None].copy())[0]
    assert np.array_equal(robot.assemble(u + 9e-5), robot.start)
    assert not np.array_equal(robot.assemble(u + 2e-4), robot.start)


def test_a_body_on_a_link_changes_the_forces_as_in_the_tree(full_model):
    model = full_model("3ups_rpu")
    (q, v, a), *_ = some_states(model)
    body = np.array([2.0, 0.1, -0.2, 0.3, 0.5, 0.01, 0.4, 0.02, -0.01, 0.6])
    heavier = np.array(model.robot.standard_parameters())
    heavier[[p.link == "platform" for p in model.robot.parameters()]] += body
    robot, u = at(model, None, q)
    loaded = robot.values + robot.payload_columns("platform") @ body
    expected = Dynamics(model.robot, heavier, start=q).inverse(u, v, a)
    close(robot.regressor(u, v, a) @ loaded, expected, 1e-10)


def test_a_gravity_model_has_no_mass_matrix(load_once):
    model = loopid.force_model(load_once("five_bar"), "gravity", None)
    robot, u = at(model, None, model.robot.reference)
    close(robot.gravity(u), Dynamics(model.robot).gravity(u), 1e-12)
    close(robot.inverse(u, [1.0, 2.0], [3.0, 4.0]), robot.gravity(u), 1e-12)
    for ask in (lambda: robot.mass_matrix(u), lambda: robot.forward(u, u, u)):
        with pytest.raises(OptionError, match="'full'"):
            ask()


def test_it_takes_a_fit_as_it_is_or_saved(load_once, tmp_path):
    model = loopid.force_model(load_once("five_bar"), "full", "Fc,Fv")
    phi = 1.1 * model.prior
    saved = loopid.load_fit(loopid.Fit.of(model, phi).save(tmp_path / "fit.yaml"))
    u, v, a = [2.1, 0.7], [0.3, -0.2], [1.0, 2.0]
    close(Dynamics(model.robot, saved).inverse(u, v, a), Dynamics(model, phi).inverse(u, v, a),
          1e-12)  # fmt: skip
    with pytest.raises(DataError, match=r"fit of five_bar, not of .*four_bar"):
        Dynamics(load_once("four_bar"), saved)


def test_regressors_of_another_shape_are_refused(load_once):
    robot = load_once("five_bar")
    model, q = loopid.force_model(robot, "gravity", None), robot.reference[None]
    for G in (3, np.zeros(4), np.zeros((2, 4, 2)), np.zeros((1, 3, 2))):
        with pytest.raises(DataError, match=r"G must have shape \(1, 4, dof\), not "):
            loopid.kinematics.torque_regressors(robot, q, G=G)
    for regressor in (5, np.zeros((1, 2, len(model.parameters) + 1))):
        with pytest.raises(DataError, match=r"regressor must have shape \(N, dof, "):
            model.loads(regressor)
