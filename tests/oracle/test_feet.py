"""Floating robots on their feet: forces with measured wrenches, and ranks, are MuJoCo's."""

import numpy as np
import pinocchio as pin
import pytest

import loopid
from floating_robots import FEET, biped
from loopid import ExternalWrench, random_configurations
from loopid.base_parameters import find_base
from loopid.kinematics import closed_motion, random_motions
from loopid.logs import wrench_forces
from loopid.regressors import motion_regressor, structural_observation

pytest.importorskip("mujoco", reason="needs pip install 'loopid[mjcf]'")
import mujoco
from mujoco_rank import Oracle, positions, rates

COUNT = 6
# Two links that stand on the ground, and how the robot is loaded.
OTHERS = {
    "mjcf/cassie.xml": (("left-foot", "right-foot"), {}),
    "gepetto/digit_like/robot.yaml": (None, {"floating_base": True}),
}


def assert_forces_agree(robot, feet):
    """Those of the motors, and none on the base, with the wrenches of the feet."""
    oracle, generator = weighed(robot), np.random.default_rng(4)
    q = random_configurations(robot, COUNT, seed=1)
    motion = closed_motion(robot, q, *random_motions(robot, COUNT, seed=2))
    pi = robot.standard_parameters()
    wrenches = [
        ExternalWrench(foot, generator.normal(scale=50, size=(COUNT, 6)), "world") for foot in feet
    ]
    ours = motion_regressor(robot, motion) @ pi - wrench_forces(robot, q, wrenches)
    for k in range(COUNT):
        T, turned = rates(robot, oracle.model, q[k])
        v, a = motion.velocities[k], motion.accelerations[k]
        position = positions(robot, oracle.model, q[k])
        needed = oracle.forces(position, T @ v, T @ (a + turned(v)))
        mujoco.mj_fwdPosition(oracle.model, oracle.data)
        for wrench, place in zip(wrenches, placed(robot, q[k], feet), strict=True):
            body = oracle.bodies[robot.links.index(wrench.frame)]
            linear, angular = np.zeros((2, 3, oracle.model.nv))
            mujoco.mj_jac(oracle.model, oracle.data, linear, angular, place, body)
            needed -= linear.T @ wrench.values[k, :3] + angular.T @ wrench.values[k, 3:]
        theirs = (T @ motion.projection.G[k]).T @ needed
        scale = np.abs(theirs).max()
        np.testing.assert_allclose(ours[k], theirs, atol=1e-8 * scale)


def weighed(robot):
    """The robot in MuJoCo, where its tree is written with unit inertias with its own ones."""
    oracle = Oracle.of(robot)
    compiled = oracle.model
    if robot.path.suffix == ".xml":
        return oracle
    compiled.body_mass[:], compiled.body_inertia[:] = 0, 0
    for body, own in zip(robot.bodies, oracle.bodies, strict=True):
        inertia = robot.model.inertias[body.joint_id]
        moments, axes = np.linalg.eigh(inertia.inertia)
        axes[:, 0] *= np.linalg.det(axes)
        x, y, z, w = pin.Quaternion(axes).coeffs()
        compiled.body_mass[own], compiled.body_ipos[own] = inertia.mass, inertia.lever
        compiled.body_iquat[own], compiled.body_inertia[own] = (w, x, y, z), moments
    return oracle


def placed(robot, q, frames):
    """Origins of frames, by Pinocchio alone."""
    data = robot.model.createData()
    pin.framesForwardKinematics(robot.model, data, q)
    indices = [robot.model.getFrameId(frame, pin.FrameType.BODY) for frame in frames]
    return [data.oMf[index].translation for index in indices]


def test_a_biped_with_a_loop(load_files):
    robot = load_files(*biped())
    assert_forces_agree(robot, FEET)
    q = random_configurations(robot, 30, seed=3)
    for kind in ("full", "gravity"):
        rank, gap = Oracle.of(robot).rank(q, kind)
        assert gap > 1e3
        assert len(find_base(structural_observation(robot, kind))) == rank


@pytest.mark.validate
@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize("name", OTHERS)
def test_models_of_others(name, shared):
    feet, options = OTHERS[name]
    robot = loopid.load(shared / "models" / name, **options)
    assert robot.floating
    assert_forces_agree(robot, feet or robot.links[-2:])
