"""Forward dynamics undoes inverse dynamics, and agrees with Pinocchio's own."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

import loopid
import pinocchio_loops
from bank_robots import few_of
from closure_robots import body
from linkages import LINKAGES, MOVED
from loopid import Dynamics, random_configurations
from loopid.base_parameters import find_base
from loopid.errors import DataError, SingularityError
from loopid.kinematics import closed_motion, random_motions
from loopid.regressors import motion_regressor, structural_observation

ROBOTS = few_of((*LINKAGES, "3ups_rpu", "flying"), *MOVED, "3ups_rpu", "flying")
GEPETTO = ("5bar_linkage", "5bar_linkage_iso3d", "robot_delta", "digit_like", "talos_like")
WITHOUT_AXES = ("3d loop", "6d loop", "3d four-bar", "6d four-bar", "ball rssr",
                "redundant five-bar")  # fmt: skip


@pytest.fixture(scope="module")
def robot(request, linkage, load_once, load_files):
    name = request.param
    if name == "flying":
        return load_files(*LINKAGES["geared five-bar"], floating_base=True)
    return linkage(name) if name in LINKAGES else load_once(name)


def case(mechanism, count=4, q=None):
    """Configurations, independent velocities and motor forces as large as gravity."""
    q = random_configurations(mechanism, count, seed=5) if q is None else q
    rates, _ = random_motions(mechanism, count, seed=9)
    motors = mechanism.velocity_indices(mechanism.actuated)
    forces = 10 * np.random.default_rng(10).uniform(-1, 1, size=(count, len(motors)))
    return q, rates, forces


def moved(robot, q, rates, forces, values=None):
    """The motion under forces of the motors, and these along the independent coordinates."""
    dynamics = Dynamics(robot, values)
    pose, motors = dynamics.pose(q=q), robot.velocity_indices(robot.actuated)
    tau = np.einsum("nji,nj->ni", pose.G[:, motors], forces)
    return closed_motion(robot, q, rates, dynamics.forward(pose, rates, tau)), tau


@pytest.mark.parametrize("robot", ROBOTS, indirect=True)
def test_inverse_dynamics_gives_the_forces_back(robot):
    q, rates, forces = case(robot)
    motion, expected = moved(robot, q, rates, forces)
    again = closed_motion(robot, q, rates, motion.accelerations[:, motion.projection.independent])
    np.testing.assert_allclose(again.accelerations, motion.accelerations, rtol=1e-9, atol=1e-9)
    found = motion_regressor(robot, motion) @ robot.standard_parameters()
    np.testing.assert_allclose(found, expected, atol=1e-8 * np.abs(expected).max())


def assert_pinocchio_agrees(mechanism, q=None):
    q, rates, forces = case(mechanism, 4 if q is None else len(q), q)
    motion, _ = moved(mechanism, q, rates, forces)
    states = zip(q, motion.velocities, forces, strict=True)
    expected = np.array([pinocchio_loops.accelerations(mechanism, *state) for state in states])
    unit = np.abs(expected).max()
    np.testing.assert_allclose(motion.accelerations, expected, atol=1e-8 * unit)


@pytest.mark.parametrize("robot", [*WITHOUT_AXES, "3ups_rpu"], indirect=True)
def test_pinocchio_accelerates_alike(robot):
    assert_pinocchio_agrees(robot)


def test_pinocchio_accelerates_a_flying_linkage_alike(load_files):
    assert_pinocchio_agrees(load_files(*LINKAGES["five-bar"], floating_base=True))


@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize("name", few_of(GEPETTO, *GEPETTO[:2], "talos_like"))
def test_pinocchio_accelerates_other_peoples_robots_alike(name, shared):
    robot = loopid.load(shared / "models" / "gepetto" / name / "robot.yaml")
    assert_pinocchio_agrees(robot, robot.reference[None])


def energy(mechanism, q, v):
    data = mechanism.model.createData()
    return pin.computeMechanicalEnergy(mechanism.model, data, q, v)


@pytest.mark.parametrize("robot", ["hinge loop, skew", "ball rssr", "flying"], indirect=True)
def test_the_motors_power_is_what_the_energy_grows_by(robot, rate):
    q, rates, forces = case(robot)
    motion, _ = moved(robot, q, rates, forces)
    motors = robot.velocity_indices(robot.actuated)
    for k, (v, a) in enumerate(zip(motion.velocities, motion.accelerations, strict=True)):

        def later(t, start=q[k], v=v, a=a):
            moved = pin.integrate(robot.model, start, v * t + a * t**2 / 2)
            return energy(robot, moved, v + a * t)

        assert rate(later) == pytest.approx(forces[k] @ v[motors], rel=1e-6)


def test_a_tree_falls_as_pinocchio_says(knee):
    tree = replace(knee, closures=(), actuated=knee.joints)
    q, rates, forces = case(tree)
    found = Dynamics(tree).forward(Dynamics(tree).pose(q=q), rates, forces)
    data = tree.model.createData()
    for k, expected in enumerate(found):
        np.testing.assert_allclose(
            pin.aba(tree.model, data, q[k], rates[k], forces[k]), expected, rtol=1e-7
        )


@pytest.mark.parametrize("robot", ["cross rssr", "geared five-bar"], indirect=True)
def test_base_parameters_alone_move_the_robot_alike(robot):
    # Dependent parameters set to zero: no body has such masses, yet all forces are the same.
    base = find_base(structural_observation(robot, "full"))
    regrouped = np.zeros(len(base.parameters))
    regrouped[base.base] = base.values(robot.standard_parameters())
    expected = moved(robot, *case(robot))[0].accelerations
    found = moved(robot, *case(robot), regrouped)[0].accelerations
    np.testing.assert_allclose(found, expected, atol=1e-8 * np.abs(expected).max())


def without_mass(name, link):
    parts, description = LINKAGES[name]
    return [f'<link name="{link}"/>' if part == body(link) else part for part in parts], description


@pytest.mark.parametrize("flying", [False, True])
def test_a_rod_without_inertia_does_not_spin_faster(flying, load_files):
    robot = load_files(*without_mass("ball rssr", "rod"), floating_base=flying)
    motion, _ = moved(robot, *case(robot, count=20))
    spin = motion.accelerations[:, robot.velocity_indices(["ball.wx"])]
    np.testing.assert_allclose(spin, 0, atol=1e-9)
    assert 1 < np.abs(motion.accelerations).max() < 1e4


@pytest.mark.filterwarnings("ignore:.*joints that move nothing with mass")
def test_a_force_that_no_mass_resists_is_refused(load_files):
    robot = load_files(*without_mass("rack and pinion", "arm"))
    with pytest.raises(SingularityError, match=r"sample 0: a force acts on arm_joint.*4 such"):
        moved(robot, *case(robot))


@pytest.mark.parametrize(("place", "name"), [(0, "velocities"), (1, "forces")])
def test_bad_arrays_are_refused_by_name(linkage, place, name):
    dynamics = Dynamics(linkage("redundant five-bar"))
    pose, arrays = dynamics.pose(q=case(dynamics.robot)[0]), [np.zeros((4, 2))] * 2
    for bad in (np.zeros((4, 5)), np.full((4, 2), np.nan), np.zeros((2, 2))):
        with pytest.raises(DataError, match=name):
            dynamics.forward(pose, *arrays[:place], bad, *arrays[place + 1 :])
