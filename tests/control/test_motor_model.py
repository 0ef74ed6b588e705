"""Forces, matrices and deviations from the signals of the motors."""

import numpy as np
import pinocchio as pin
import pytest

import loopid
from bank_robots import few_of
from loopid.errors import AssemblyError, DataError, MobilityError, OptionError

ROBOTS = few_of(loopid.bundled_robots(), "3ups_rpu", "five_bar", "delta", "6ups")


@pytest.fixture(params=ROBOTS)
def name(request):
    return request.param


def at(model, values, q, **options):
    """A motor model at a configuration, and the positions there."""
    independent = model.mechanism.velocity_indices(model.mechanism.independent)
    return loopid.MotorModel(model, values, start=q, **options), q[independent]


def states(model, count=3):
    """Random closed configurations, velocities and accelerations."""
    q = loopid.random_configurations(model.mechanism, count, seed=4)
    rng = np.random.default_rng(0)
    return zip(q, *rng.standard_normal((2, count, len(model.mechanism.independent))), strict=True)


def close(found, expected, tolerance):
    assert np.abs(found - expected).max() <= tolerance * np.abs(expected).max()


def test_forces_are_those_of_the_force_model(name, full_model, some_values):
    model, phi = full_model(name), some_values(name)
    for q, v, a in states(model):
        robot, u = at(model, phi, q)
        K = model.base.regressor(model.standard_regressor(q[None], v[None], a[None]))[0]
        close(robot.forces(u, v, a), K @ phi, 1e-12)


def test_parts_sum_up_to_the_forces(name, full_model, some_values):
    model, phi = full_model(name), some_values(name)
    for q, v, a in states(model):
        robot, u = at(model, phi, q)
        total = robot.mass(u) @ a + robot.coriolis(u, v) @ v + robot.gravity(u)
        close(total + robot.friction(u, v), robot.forces(u, v, a), 1e-12)
        w = v[::-1]
        passive = robot.mass(u) @ a + robot.coriolis(u, v) @ w + robot.gravity(u)
        close(robot.passive_regressor(u, v, w, a) @ phi, passive, 1e-12)


def test_friction_curves_and_load_are_those_of_the_force_model(load_once):
    terms = "Fc,Fv,Ia,Fk0~0.25,Fk~0.5,Fa~0.5,Fa1~1,Ft"
    model = loopid.find_force_model(load_once("five_bar"), "full", terms)
    phi = np.random.default_rng(1).standard_normal(len(model.parameters))
    loaded, own = model.with_loads(phi), model.body_columns
    for q, v, a in states(model):
        robot, u = at(model, phi, q)
        motion = loopid.motion.JointMotion(
            np.zeros(1), q[None], v[None], a[None], np.ones(1)
        )  # fmt: skip
        close(robot.forces(u, v, a), loaded.regressor(motion)[0] @ phi, 1e-12)
        coast = robot.mass(u) @ (0 * a) + robot.coriolis(u, v) @ v + robot.gravity(u)
        still = robot.forces(u, v, 0 * a)
        close(coast + robot.friction(u, v), still, 1e-12)
        dry, uneven = robot.dry_friction(v, robot.rigid_regressor(u, v, 0 * a)[:, own] @ phi[own])
        whole = np.sign(v) * dry + uneven + robot.coefficients("Fv") * v
        if (dry > 0).all():
            close(whole, robot.friction(u, v), 1e-12)


def test_mass_and_coriolis_are_those_of_pinocchios_tree(name, full_model):
    """M = Gᵀ M G; C v = Gᵀ (h(v) + M γ), with Pinocchio's matrices of the tree."""
    model = full_model(name)
    tree, loop = model.mechanism.model, loopid.ClosedLoop(model.mechanism)
    data = tree.createData()
    for q, v, _ in states(model):
        robot, u = at(model, None, q)
        G, gamma = loop.velocity_map(q), loop.gamma(q, v)
        inertia = np.triu(pin.crba(tree, data, q))
        inertia = inertia + np.triu(inertia, 1).T
        close(robot.mass(u), G.T @ inertia @ G, 1e-10)
        bias = pin.rnea(tree, data, q, G @ v, gamma) - pin.computeGeneralizedGravity(tree, data, q)
        # Of the joints' own: those of the motors cancel in a parallelogram.
        largest = (np.abs(G.T) @ np.abs(bias)).max()
        assert np.abs(robot.coriolis(u, v) @ v - G.T @ bias).max() <= 1e-10 * largest


@pytest.mark.parametrize("robot_name", ["3ups_rpu", "five_bar"])
def test_the_rate_of_the_mass_matrix_less_two_coriolis_is_skew(robot_name, full_model, some_values):
    model = full_model(robot_name)
    for q, v, _ in states(model):
        robot, u = at(model, some_values(robot_name), q)
        C, h = robot.coriolis(u, v), 2e-4
        near = robot.mass(u + h * v) - robot.mass(u - h * v)
        far = robot.mass(u + 2 * h * v) - robot.mass(u - 2 * h * v)
        S = (8 * near - far) / (12 * h) - 2 * C
        close(S, -S.T, 1e-5)


def test_the_deviation_is_that_of_forces_of_random_values(full_model):
    model = full_model("five_bar")
    (q, v, a), *_ = states(model)
    robot, u = at(model, None, q)
    root = np.random.default_rng(1).standard_normal(2 * robot.covariance.shape[:1]) / 10
    robot.covariance = root @ root.T
    draws = model.prior + np.random.default_rng(2).standard_normal((4000, len(root))) @ root.T
    spread = (draws @ robot.regressor(u, v, a).T).std(axis=0)
    close(robot.deviation(u, v, a), spread, 0.05)


def test_it_follows_a_motion_and_far_ways_as_assemble_does(full_model):
    model = full_model("3ups_rpu")
    (q, *_), (far, *_), *_ = states(model)
    robot, u = at(model, None, q)
    rng = np.random.default_rng(0)
    for step in (2e-4, 2e-3, 2e-2):
        aim = u + step * rng.uniform(-1, 1, len(u))
        expected = loopid.assemble(model.mechanism, aim, start=q)[0]
        assert np.abs(robot.assemble(aim) - expected).max() < 1e-9
    _, there = at(model, None, far)
    expected = loopid.assemble(model.mechanism, there, start=q)[0]
    assert np.abs(robot.assemble(there) - expected).max() < 1e-9


def test_where_the_loops_do_not_close_the_last_pose_stays(full_model):
    robot, u = at(full_model("five_bar"), None, full_model("five_bar").mechanism.reference)
    before = robot.assemble(u)
    with pytest.raises(AssemblyError):
        robot.assemble([3.0, 0.1])
    assert np.array_equal(robot.configuration, before)
    assert np.array_equal(robot.assemble(u), before)


def test_positions_near_the_pose_share_it_where_they_may(full_model):
    model = full_model("3ups_rpu")
    robot, u = at(model, None, model.mechanism.reference, near=1e-4)
    assert np.array_equal(robot.assemble(u + 9e-5), model.mechanism.reference)
    assert not np.array_equal(robot.assemble(u + 2e-4), model.mechanism.reference)


def test_a_body_on_a_link_changes_the_forces_as_in_the_tree(full_model):
    model = full_model("3ups_rpu")
    (q, v, a), *_ = states(model)
    body = np.array([2.0, 0.1, -0.2, 0.3, 0.5, 0.01, 0.4, 0.02, -0.01, 0.6])
    heavier = np.array(model.mechanism.standard_parameters())
    heavier[[p.link == "platform" for p in model.mechanism.parameters()]] += body
    robot, u = at(model, None, q)
    loaded = robot.values + robot.payload_columns("platform") @ body
    expected = loopid.ClosedLoop(model.mechanism).forces(q, v, a, standard_parameters=heavier)
    close(robot.regressor(u, v, a) @ loaded, expected, 1e-10)


def test_a_gravity_model_has_no_mass_matrix(load_once):
    model = loopid.find_force_model(load_once("five_bar"), "gravity", None)
    robot, u = at(model, None, model.mechanism.reference)
    loop = loopid.ClosedLoop(model.mechanism)
    close(robot.gravity(u), loop.forces(model.mechanism.reference), 1e-12)
    with pytest.raises(OptionError, match="'full'"):
        robot.mass(u)


def test_a_spin_that_no_position_gives_is_refused_with_what_locks_it(linkage):
    model = loopid.find_force_model(linkage("ball rssr"), "full", None)
    with pytest.raises(MobilityError, match=r"lock=\['"):
        loopid.MotorModel(model)


def test_what_cannot_be_is_refused(full_model, load_once):
    model = full_model("five_bar")
    robot, u = at(model, None, model.mechanism.reference)
    with pytest.raises(DataError, match="shape"):
        robot.forces(u, [0.0], [0.0, 0.0])
    with pytest.raises(DataError, match="shape"):
        loopid.MotorModel(model, [1.0])
    with pytest.raises(OptionError, match="find_force_model"):
        loopid.MotorModel(model.mechanism)
    with pytest.raises(OptionError) as refused:
        robot.payload_columns("elbow")
    assert "left_crank" in refused.value.facts["valid"]
    loaded = loopid.find_force_model(load_once("five_bar"), "full", "Fl,Fv")
    with pytest.raises(OptionError, match="identify with terms"):
        loopid.MotorModel(loaded)
