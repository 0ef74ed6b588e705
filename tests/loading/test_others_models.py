"""Closed loops that others describe: how they move.

Files are those of the folder of reference data, numbers those of docs/mechanisms.md.
"""

import numpy as np
import pinocchio as pin
import pytest

import loopid
from bank_robots import moved
from loopid import random_configurations
from loopid.errors import ModelWarning
from loopid.kinematics import mobility
from loopid.robot.robot import lock_options
from others_robots import ROWS, each, load, path, poses

# What the motors leave free, by hand. Unnamed: the motors are as many as the freedoms.
FREE = {
    # Closed by a weld between two hinges of one pin: the pin spins.
    "gepetto/5bar_linkage/robot.yaml": ["closedloop1_B"],
    "gepetto/robot_delta/robot.yaml": ["closedloop1_B", "closedloop3_B", "closedloop2_B"],
    # Rods between two balls of three hinges each, welded in their middle: 5, 6 and 6 motors.
    "gepetto/cassie_like/robot.yaml": [
        "foot_2_half_planta_rode_2_rev2",
        "tigh_half_hachil_rode_2_rev2",
    ],
    "gepetto/digit_like/robot.yaml": [
        "tarsus_toe_a_1/2_rev2",
        "foot_part_toe_b_1/2_2_rev2",
        "foot_part_toe_b_1/2_rev2",
    ],
    "gepetto/talos_like/robot.yaml": ["moteur_rod_1_rev2"],
    # Two such rods, and a cross whose one hinge has become a ball: it turns about the other.
    "gepetto/disney_like/robot.yaml": [
        "ankle_universal_2_rev0",
        "motor_link_tigh_mirror2_rev1",
        "motor_link_2_tigh_mirror2_2_rev1",
    ],
    # A pelvis that flies. Each leg has 13 coordinates, 5 independent equations and 5 motors: the
    # spin of a rod is left, and what the springs of shin and heel hold.
    "mjcf/cassie.xml": [
        *(f"cassie-pelvis_free.{part}" for part in ("vx", "vy", "vz", "wx", "wy", "wz")),
        "left-achilles-rod.wx",
        "right-achilles-rod.wx",
        "right-heel-spring",
        "left-heel-spring",
        "left-shin",
        "right-tarsus",
    ],
    # Each finger is a five-bar linkage with two freedoms, of which the motor has one.
    "mjcf/robotiq_2f85.xml": ["left_follower_joint", "right_follower_joint"],
}
WARNED = {
    **{model: {ModelWarning} for model in FREE},
    # Drawn open: its arms close as parallelograms, or crossed.
    "gepetto/robot_delta/robot.yaml": {ModelWarning, ModelWarning},
    "urdf_plus/mini_cheetah_leg.urdf": {ModelWarning},  # as its file has them
}
SPINNING = [model for model in FREE if model.startswith("gepetto/")]


@pytest.mark.parametrize("name", each(ROWS))
def test_mobility_is_as_counted_by_hand(name, shared):
    robot, categories = load(path(shared, name))
    found, row = mobility(robot), ROWS[name]
    assert robot.model.nv == int(row["coordinates"])
    assert f"{found.rank} of {found.rows}" == row["closure rank"]
    freedoms = found.degrees_of_freedom, found.generic_degrees_of_freedom
    assert freedoms == (int(row["freedoms"]),) * 2
    assert robot.model.nv - found.rank == len(robot.actuated) + len(robot.free)
    assert set(robot.free) == set(FREE.get(name, ()))
    assert len(robot.free) == int(row["left free"])
    assert not robot.redundant
    assert categories == WARNED.get(name, set())


@pytest.mark.parametrize("name", each(ROWS))
def test_all_poses_are_closed(name, shared):
    robot, _ = load(path(shared, name))
    assert robot.closure_residual == 0.0
    data = robot.model.createData()
    for q in (robot.reference, *random_configurations(robot, 6, seed=5)):
        pin.framesForwardKinematics(robot.model, data, q)
        for closure in robot.closures:
            one, other = (data.oMf[frame] for frame in closure.frame_ids)
            assert np.abs(one.translation - other.translation).max() < 1e-9
            if closure.kind == "6d":
                assert np.abs(one.rotation - other.rotation).max() < 1e-9
        for coupling in robot.couplings:
            left = np.dot(coupling.coefficients, q[list(coupling.q_indices)]) - coupling.offset
            assert abs(left) < 1e-9


@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize("name", each(FREE))
def test_what_is_to_be_locked_can_be_and_leaves_nothing_free(name, shared):
    file = path(shared, name)
    words = lock_options(load(file)[0])
    robot = loopid.load(file, **eval(f"dict({words})"))
    assert robot.free == ()
    assert len(robot.independent) == len(robot.actuated)


@pytest.mark.parametrize("name", each(SPINNING))
def test_what_is_left_free_is_the_spin_of_one_thing(name, shared):
    """The motors at rest, whatever moves noticeably turns about one line."""
    robot, _ = load(path(shared, name))
    data = robot.model.createData()
    q = poses(path(shared, name))[:1]
    G = moved(robot, "gravity", q).projection.G[0]
    spins = [G[:, robot.independent.index(coordinate)] for coordinate in robot.free]
    for spin in spins:
        pin.forwardKinematics(robot.model, data, q[0], spin)
        joints = [body.joint_id for body in robot.bodies]
        twists = np.array([data.oMi[k].act(data.v[k]).vector for k in joints])
        rates = np.linalg.norm(twists[:, 3:], axis=1)
        (turning,) = np.unique(np.round(twists[rates > 0.01 * rates.max()], 6), axis=0)
        assert abs(turning[:3] @ turning[3:]) < 1e-4 * rates.max() ** 2
    assert np.linalg.matrix_rank(np.array(spins)) == len(spins)


def test_a_hinge_across_a_planar_loop_is_held_still(shared):
    file = path(shared, "gepetto/5bar_linkage_iso3d/robot.yaml")
    robot, _ = load(file)
    G = moved(robot, "gravity", poses(file)).projection.G
    held = np.abs(G).max(axis=(0, 2)) < 1e-12
    assert list(np.array(robot.joints)[held]) == ["freeortho"]
